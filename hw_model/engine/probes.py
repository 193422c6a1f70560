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
    by_kind: dict[Kind, Probe] = {}
    for kind_or_probe in probe:
        read = _hashable(kind_or_probe)
        where = f"probe {read.kind!r}"
        check_known(where, "does not exist", str(read.kind), KINDS)
        if read.kind in by_kind:
            raise InputError(where, "is asked for twice", fix="List its populations in one probe.")
        for name in read.populations or ():
            check_known(where, f"there is no {name!r}", str(name), program.populations)
        if read.steps is not None and (read.steps.step != 1 or read.steps.start < 0):
            raise InputError(
                where, "steps must count up by one from 0 or later", fix="Give a range."
            )
        by_kind[read.kind] = read
    return by_kind


def _hashable(kind_or_probe: Kind | Probe) -> Probe:
    """Return a probe whose populations are no list: a program is planned once for equal probes."""
    if not isinstance(kind_or_probe, Probe):
        return Probe(kind_or_probe)
    if isinstance(kind_or_probe.populations, list):
        return Probe(kind_or_probe.kind, tuple(kind_or_probe.populations), kind_or_probe.steps)
    return kind_or_probe


class ProbedPopulation(NamedTuple):
    """Steps of a population that are kept, and where they lie in an array of the engine.

    An engine returns all spikes of a phase, and of each register what its :class:`Window` covers.
    ``rows`` and ``columns`` are those of the array of this ``kind``.
    """

    kind: Kind
    name: str
    rows: slice
    columns: slice
    is_copied: bool
    """Whether a small part of all spikes is copied: a view would keep them all in memory."""

    def taken_from(self, arrays: Mapping[Kind, AnyArray]) -> AnyArray:
        """Return its steps, (batch, rows, n), from the arrays of an engine by kind."""
        view = arrays[self.kind][:, self.rows, self.columns]
        return view.copy() if self.is_copied else view


class PhaseProbes(NamedTuple):
    """What an engine must keep of a phase for some probes, and where each probe has it from."""

    windows: dict[Register, Window]
    populations: dict[Probe, list[ProbedPopulation]]


class _Selection(NamedTuple):
    """What a probe selects of a phase: steps, and populations with their columns in the phase."""

    columns: dict[str, slice]
    steps: range


class _EngineArray(NamedTuple):
    """An array that an engine returns: the step of its first row, and the columns of populations."""

    first_step: int
    columns: dict[str, slice]


SMALL_PART = 4
"""A probe of less than a fourth of a phase's spikes is copied."""


def phase_probes(
    program: ChipProgram, phase: str, probes: Sequence[Probe], steps: int
) -> PhaseProbes:
    """Return what an engine must keep of a phase of ``steps`` steps; it returns spikes anyway."""
    selections: dict[Probe, _Selection] = {}
    for probe in probes:
        if probe.kind != "activity":
            selections[probe] = _Selection(_columns(program, phase, probe), _steps(probe, steps))
    windows: dict[Register, Window] = {}
    arrays: dict[Kind, _EngineArray] = {"spikes": _EngineArray(0, program.columns_of(phase))}
    for register in REGISTERS:
        of_register = [
            selection for probe, selection in selections.items() if probe.kind == register
        ]
        if of_register:
            windows[register], arrays[register] = _common_window(of_register)

    phase_size = sum(program.populations[name] for name in program.columns_of(phase))
    populations: dict[Probe, list[ProbedPopulation]] = {probe: [] for probe in probes}
    for probe, selection in selections.items():
        size = sum(program.populations[name] for name in selection.columns)
        is_small = len(selection.steps) * size < steps * phase_size // SMALL_PART
        is_copied = is_small and probe.kind == "spikes"
        array = arrays[probe.kind]
        rows = slice(
            selection.steps.start - array.first_step, selection.steps.stop - array.first_step
        )
        for name in selection.columns:
            population = ProbedPopulation(probe.kind, name, rows, array.columns[name], is_copied)
            populations[probe].append(population)
    return PhaseProbes(windows, populations)


def _common_window(selections: Sequence[_Selection]) -> tuple[Window, _EngineArray]:
    """Return a window of a register that covers some selections, and the array it gives."""
    start = min(selection.steps.start for selection in selections)
    stop = max(selection.steps.stop for selection in selections)
    columns_in_phase: dict[str, slice] = {}
    for selection in selections:
        columns_in_phase |= selection.columns
    phase_columns = [np.empty(0, dtype=np.int64)]
    columns_in_window: dict[str, slice] = {}
    width = 0
    for name, columns in columns_in_phase.items():
        size = columns.stop - columns.start
        phase_columns.append(np.arange(columns.start, columns.stop))
        columns_in_window[name] = slice(width, width + size)
        width += size
    window = Window(np.concatenate(phase_columns), start, stop)
    return window, _EngineArray(start, columns_in_window)


def _columns(program: ChipProgram, phase: str, probe: Probe) -> dict[str, slice]:
    """Return the populations of a phase that a probe selects, and their columns."""
    selected: dict[str, slice] = {}
    for name, columns in program.columns_of(phase).items():
        is_named = probe.populations is None or name in probe.populations
        has_values = probe.kind != "spikes" or name in program.spiking
        if is_named and has_values:
            selected[name] = columns
    return selected


def _steps(probe: Probe, steps: int) -> range:
    """Return the steps of a probe that a phase of ``steps`` steps has."""
    if probe.steps is None:
        return range(steps)
    stop = max(probe.steps.stop, probe.steps.start)
    return range(min(probe.steps.start, steps), min(stop, steps))
