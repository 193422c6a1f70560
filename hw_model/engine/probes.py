"""What of a simulation to keep: spikes and registers, of all or chosen populations, in all or chosen steps."""

from collections.abc import Sequence
from typing import Literal, get_args

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


def hull(first: Probe, second: Probe) -> Probe:
    """Return the probe of one kind that keeps at least what both keep."""
    names = None
    if first.populations is not None and second.populations is not None:
        names = tuple(dict.fromkeys(first.populations + second.populations))
    steps = None
    if first.steps is not None and second.steps is not None:
        steps = range(min(first.steps.start, second.steps.start), max(first.steps.stop, second.steps.stop))
    return Probe(first.kind, names, steps)


def read_probes(program: ChipProgram, probe: Sequence[Kind | Probe]) -> dict[Kind, Probe]:
    """Return the probes by kind; an unknown kind or population, or a kind twice, is an ``InputError``."""
    found: dict[Kind, Probe] = {}
    for item in probe:
        one = item if isinstance(item, Probe) else Probe(item)
        if isinstance(one.populations, list):  # a program is planned once for equal probes, which a list cannot be
            one = Probe(one.kind, tuple(one.populations), one.steps)
        check_known(f"probe {one.kind!r}", "does not exist", str(one.kind), KINDS)
        if one.kind in found:
            raise InputError(f"probe {one.kind!r}", "is asked for twice", fix="List its populations in one probe.")
        for name in one.populations or ():
            check_known(f"probe {one.kind!r}", f"there is no {name!r}", str(name), program.populations)
        if one.steps is not None and (one.steps.step != 1 or one.steps.start < 0):
            raise InputError(f"probe {one.kind!r}", "steps must count up by one from 0 or later", fix="Give a range.")
        found[one.kind] = one
    return found


class PhaseProbes:
    """Where the populations that the probes want lie in the arrays of a phase."""

    def __init__(self, program: ChipProgram, phase: str, probes: dict[Kind, Probe], steps: int) -> None:
        self.kinds = frozenset(probes)
        self._rows = {kind: _rows(probe, steps) for kind, probe in probes.items()}
        self._columns = {
            kind: {
                name: columns
                for name, columns in program.columns_of(phase).items()
                if (probe.populations is None or name in probe.populations)
                and (kind != "spikes" or name in program.spiking)
            }
            for kind, probe in probes.items()
        }

    def windows(self) -> dict[Register, Window]:
        """Return what the engine must keep; spikes it gives anyway."""
        found: dict[Register, Window] = {}
        for kind in REGISTERS:
            if kind in self._rows:
                parts = [np.arange(columns.start, columns.stop) for columns in self._columns[kind].values()]
                columns = np.concatenate([np.empty(0, dtype=np.int64), *parts])
                found[kind] = Window(columns, self._rows[kind].start, self._rows[kind].stop)
        return found

    def of_spikes(self, spikes: AnyArray) -> dict[str, AnyArray]:
        """Return the spikes asked for, (batch, rows, n) by population, of all (batch, steps, columns)."""
        if "spikes" not in self._rows:
            return {}
        rows = slice(self._rows["spikes"].start, self._rows["spikes"].stop)
        found = {name: spikes[:, rows, columns] for name, columns in self._columns["spikes"].items()}
        # Parts of all spikes keep them all in memory: where only a few are wanted, these are copied.
        few = sum(array.size for array in found.values()) < spikes.size // 4
        return {name: array.copy() for name, array in found.items()} if few else found

    def of_register(self, kind: Register, kept: AnyArray, keeping: "PhaseProbes") -> dict[str, AnyArray]:
        """Return what these probes want of what the window of others kept, ``keeping``: (batch, rows, n) by name.

        The others keep at least as much.
        """
        found, at = {}, 0
        wanted, held = self._rows[kind], keeping._rows[kind]
        rows = slice(wanted.start - held.start, wanted.stop - held.start)
        for name, columns in keeping._columns[kind].items():
            size = columns.stop - columns.start
            if name in self._columns[kind]:
                found[name] = kept[:, rows, at : at + size]
            at += size
        return found


def _rows(probe: Probe, steps: int) -> range:
    if probe.steps is None:
        return range(steps)
    return range(min(probe.steps.start, steps), min(max(probe.steps.stop, probe.steps.start), steps))
