"""Probes: which spikes and registers of a simulation to keep, of which populations, in which steps.

Users pass kinds or :class:`Probe` objects to ``simulate``. :func:`phase_probes` works out, for one
phase, what the engine must record for them and where each population then lies in its arrays.
"""

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np

from hw_model.engine.trace import REGISTERS, Register, Window
from hw_model.errors import InputError, check_known
from hw_model.program.chip_program import ChipProgram
from hw_model.values import AnyArray, Frozen

Kind = Literal["spikes", "u", "v", "potential", "activity"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""``potential`` is v as it was compared with the threshold. ``activity`` keeps the counts of every step and core, from
which latency is computed."""


class Probe(Frozen):
    """Keep ``kind`` of ``populations`` (None: all of them) in ``steps``, a range without gaps (None: all steps)."""

    kind: Kind
    populations: tuple[str, ...] | None = None
    steps: range | None = None


def read_probes(program: ChipProgram, probe: Sequence[Kind | Probe]) -> dict[Kind, Probe]:
    """Return the probes by kind.

    Raises ``InputError`` for an unknown kind or population, for steps with gaps or before 0, and
    for a kind that is asked for twice.
    """
    by_kind: dict[Kind, Probe] = {}
    for kind_or_probe in probe:
        read = _as_probe(kind_or_probe)
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


def _as_probe(kind_or_probe: Kind | Probe) -> Probe:
    """Return a hashable probe, with a tuple of populations: plans of a simulation are cached by its probes."""
    if not isinstance(kind_or_probe, Probe):
        return Probe(kind_or_probe)
    if isinstance(kind_or_probe.populations, list):
        return Probe(kind_or_probe.kind, tuple(kind_or_probe.populations), kind_or_probe.steps)
    return kind_or_probe


class ProbedPopulation(NamedTuple):
    """A population that a probe keeps, and where it lies in an array of the engine.

    An engine returns all spikes of a phase, and the part of each register that its :class:`Window`
    covers. ``rows`` and ``columns`` are positions in the array of this ``kind``.
    """

    kind: Kind
    name: str
    rows: slice
    columns: slice
    is_copied: bool
    """Whether to copy a small part of the spikes of a phase: a view of it would keep all of them in memory."""

    def taken_from(self, arrays: Mapping[Kind, AnyArray]) -> AnyArray:
        """Return the population's values, (batch, rows, n), from the arrays of an engine by kind."""
        view = arrays[self.kind][:, self.rows, self.columns]
        return view.copy() if self.is_copied else view


class PhaseProbes(NamedTuple):
    """The windows of registers that an engine must record in a phase, and the populations of each probe."""

    windows: dict[Register, Window]
    populations: dict[Probe, list[ProbedPopulation]]


class _Selection(NamedTuple):
    """The steps of a phase that a probe selects, and its populations with their columns in the phase."""

    columns: dict[str, slice]
    steps: range


class _EngineArray(NamedTuple):
    """An array that an engine returns: the step of its first row, and the columns of each population."""

    first_step: int
    columns: dict[str, slice]


SMALL_PART = 4
"""A probe of less than a fourth of a phase's spikes is copied; chosen by hand."""


def phase_probes(
    program: ChipProgram, phase: str, probes: Sequence[Probe], steps: int
) -> PhaseProbes:
    """Return what an engine must record in a phase of ``steps`` steps. Spikes it returns in any case."""
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
    """Return the smallest window of a register that covers some selections, and the layout of its array."""
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
    """Return the populations of a phase that a probe selects, and their columns. Joined ones have no spikes."""
    selected: dict[str, slice] = {}
    for name, columns in program.columns_of(phase).items():
        is_named = probe.populations is None or name in probe.populations
        has_values = probe.kind != "spikes" or name in program.spiking
        if is_named and has_values:
            selected[name] = columns
    return selected


def _steps(probe: Probe, steps: int) -> range:
    """Return the steps of a probe, cut to a phase of ``steps`` steps."""
    if probe.steps is None:
        return range(steps)
    stop = max(probe.steps.stop, probe.steps.start)  # an empty range may stop before its start
    return range(min(probe.steps.start, steps), min(stop, steps))
