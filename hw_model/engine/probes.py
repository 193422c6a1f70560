"""What of a simulation to keep: spikes and registers, of all or chosen populations, in all or chosen steps."""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np

from hw_model.engine.trace import REGISTERS, Register, Window
from hw_model.errors import InputError, check_known
from hw_model.program.chip_program import ChipProgram
from hw_model.values import AnyArray, Frozen

Kind = Literal["spikes", "u", "v", "potential", "activity"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""``activity`` keeps the counts of every step and core, which latency is computed from."""


class Probe(Frozen):
    """Keep ``kind`` of ``populations`` (None: all) in rows ``steps`` (None: all; a range of step 1)."""

    kind: Kind
    populations: tuple[str, ...] | None = None
    steps: range | None = None


def read_probes(program: ChipProgram, probe: Sequence[Kind | Probe]) -> dict[Kind, Probe]:
    """Return the probes by kind; an unknown kind or population, or a kind twice, is an ``InputError``."""
    found: dict[Kind, Probe] = {}
    for item in probe:
        one = item if isinstance(item, Probe) else Probe(item)
        if isinstance(
            one.populations, list
        ):  # a program is planned once for equal probes, which a list cannot be
            one = Probe(one.kind, tuple(one.populations), one.steps)
        check_known(f"probe {one.kind!r}", "does not exist", str(one.kind), KINDS)
        if one.kind in found:
            raise InputError(
                f"probe {one.kind!r}",
                "is asked for twice",
                fix="List its populations in one probe.",
            )
        for name in one.populations or ():
            check_known(
                f"probe {one.kind!r}", f"there is no {name!r}", str(name), program.populations
            )
        if one.steps is not None and (one.steps.step != 1 or one.steps.start < 0):
            raise InputError(
                f"probe {one.kind!r}",
                "steps must count up by one from 0 or later",
                fix="Give a range.",
            )
        found[one.kind] = one
    return found


class Part(NamedTuple):
    """Rows of a population that are kept, and where they lie in what an engine gives: all spikes, or a window."""

    kind: Kind
    name: str
    rows: slice
    columns: slice
    few: bool
    """A part of all spikes keeps them all in memory: where only a few are wanted, it is copied."""

    def of(self, given: Mapping[Kind, AnyArray]) -> AnyArray:
        """Return them, (batch, rows, n), of what an engine gives by kind."""
        found = given[self.kind][:, self.rows, self.columns]
        return found.copy() if self.few else found


def parts_of(
    program: ChipProgram, phase: str, probes: Sequence[Probe], steps: int
) -> tuple[dict[Register, Window], dict[Probe, list[Part]]]:
    """Return what an engine must keep of a phase for some probes, of which it gives spikes anyway, and their parts."""
    arrays = [probe for probe in probes if probe.kind != "activity"]
    asked = {probe: (_columns(program, phase, probe), _rows(probe, steps)) for probe in arrays}
    windows: dict[Register, Window] = {}
    places: dict[Kind, tuple[int, dict[str, slice]]] = {"spikes": (0, program.columns_of(phase))}
    for register in REGISTERS:
        if its := [kept for probe, kept in asked.items() if probe.kind == register]:
            columns = {name: place for names, _ in its for name, place in names.items()}
            start, stop = min(rows.start for _, rows in its), max(rows.stop for _, rows in its)
            each = [np.arange(place.start, place.stop) for place in columns.values()]
            windows[register] = Window(
                np.concatenate([np.empty(0, dtype=np.int64), *each]), start, stop
            )
            ends = np.cumsum([0, *map(len, each)]).tolist()
            places[register] = start, dict(zip(columns, map(slice, ends, ends[1:]), strict=True))
    parts: dict[Probe, list[Part]] = {probe: [] for probe in probes}
    for probe, (names, rows) in asked.items():
        start, columns = places[probe.kind]
        size, whole = (
            sum(program.populations[name] for name in some)
            for some in (names, program.columns_of(phase))
        )
        few, within = (
            len(rows) * size < steps * whole // 4,
            slice(rows.start - start, rows.stop - start),
        )
        parts[probe] = [
            Part(probe.kind, n, within, columns[n], few and probe.kind == "spikes") for n in names
        ]
    return windows, parts


def _columns(program: ChipProgram, phase: str, probe: Probe) -> dict[str, slice]:
    """Return the populations of a phase of which there is something to keep, and their columns."""
    return {
        name: columns
        for name, columns in program.columns_of(phase).items()
        if (probe.populations is None or name in probe.populations)
        and (probe.kind != "spikes" or name in program.spiking)
    }


def _rows(probe: Probe, steps: int) -> range:
    if probe.steps is None:
        return range(steps)
    return range(
        min(probe.steps.start, steps), min(max(probe.steps.stop, probe.steps.start), steps)
    )
