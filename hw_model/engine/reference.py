"""The plain engine: numpy arrays, core by core, obvious rather than fast. The fast engine is tested against it.

A step first updates every compartment of every core, by the arithmetic of :mod:`hw_model.arithmetic.loihi`. Then it
delivers the spikes of this step: through the wires of their compartment or input line to axons of cores, and along the
synapses of these axons to *accumulator slots*. A core has one slot per step of delay, a ring that is indexed by the
step modulo its length; in each step it reads one slot, the charges that act now.

Recordings do not influence each other: each has registers and slots of its own. All of a batch take the same step
together, as rows of arrays.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import Parameters, State
from hw_model.arithmetic.on_integers import OnIntegers
from hw_model.engine.trace import (
    EVENTS,
    SKIPPED,
    PhaseInput,
    PhaseTrace,
    Register,
    Window,
    added_up,
)
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import AnyArray, BoolArray, ByteArray, IntArray, ranges

Rows = slice | IntArray
"""The recordings of a batch that take a step. Recordings may start and stop at different steps."""
ALL = slice(None)
NUMBERS_AT_ONCE = 1 << 22
"""The most numbers in the slots of a core over all recordings that run together, 32 MiB; chosen by hand. A larger batch
runs in parts, and a single recording may take more."""


def run_phase(
    program: ChipProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    skip: bool,
) -> PhaseTrace:
    """Run a batch through one phase; record the columns and steps of registers that ``windows`` name.

    With ``skip``, steps in which nothing could change are counted as skipped, though this engine runs them like others.
    """
    cores = program.cores_of(phase)
    pieces = sum(len(core.slices) for core in cores)
    compartments = sum(core.compartments for core in cores)
    trace = PhaseTrace.empty(played, compartments, pieces, windows)
    batch = len(played.start)
    most_of_core = max((core.compartments * _slots(core) for core in cores), default=1)
    together = max(1, NUMBERS_AT_ONCE // most_of_core)
    for low in range(0, batch, together):
        # Parts are views: what is written to the trace of a part is written to the whole trace.
        part = slice(low, low + together)
        _run_part(program, phase, played.part(part), windows, trace.part(part), skip)
    return added_up(program, phase, played, trace)


def _run_part(
    program: ChipProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    trace: PhaseTrace,
    skip: bool,
) -> None:
    """Run some recordings step by step, and write their trace."""
    batch = len(played.start)
    run = Run(program, phase, batch)
    lines = np.stack([played.lines(recording) for recording in range(batch)])
    for step in range(played.start.min(), played.stop.max()):
        is_run = (played.start <= step) & (step < played.stop)
        # Nearly always all: a slice then gives views, where numbers of recordings would copy every array.
        recordings = ALL if is_run.all() else np.flatnonzero(is_run)
        run.update(recordings, step)
        run.deliver(recordings, step, lines[recordings, step])
        run.note(recordings, step, windows, trace)
        if skip:
            trace.totals[recordings, SKIPPED] += run.was_idle()[recordings]
    trace.events[:] = run.events()


def _slots(core: Core) -> int:
    """Return how many slots a core needs.

    Charges that arrive in a step act 1 to 1 + longest delay steps later, and one more slot is being read.
    """
    return int(core.axons.delay.max(initial=0)) + 2


class Run:
    """A batch of recordings on the cores of a phase.

    ``columns`` are the columns of all compartments, core by core: arrays of cores side by side are in this order.
    """

    def __init__(self, program: ChipProgram, phase: str, batch: int) -> None:
        cores = program.cores_of(phase)
        self.columns = np.concatenate([program.columns_of_core(core) for core in cores])
        self._batch = batch
        self._cores = {core.number: _CoreState(core, program, batch) for core in cores}
        self._input_wires: list[_Wires] = []
        for name, lines in program.lines_of(phase).items():
            route = program.route_of(name)
            line = np.arange(lines.start, lines.stop)[route.line]
            self._input_wires += _by_target(line, route.core, route.axon)

    def update(self, recordings: Rows, step: int) -> None:
        """Update every compartment of every core."""
        for state in self._cores.values():
            state.update(recordings, step)

    def deliver(self, recordings: Rows, step: int, lines: ByteArray) -> None:
        """Deliver the spikes of a step: those of compartments, then those of input ``lines`` (recordings, lines)."""
        for state in self._cores.values():
            # Wires lead from the compartments of this core; a core that sends nothing has none.
            if state.wires:
                fired = state.of_all(_fired)[recordings]
                for wires in state.wires:
                    self._deliver_along(wires, fired, recordings, step)
        for wires in self._input_wires:
            self._deliver_along(wires, lines, recordings, step)

    def _deliver_along(
        self, wires: "_Wires", spikes: BoolArray | ByteArray, recordings: Rows, step: int
    ) -> None:
        """Deliver the spikes (recordings, sources) of the sources of some wires."""
        row, wire = np.nonzero(spikes[:, wires.source])
        if len(row):
            # From rows of `spikes` to numbers in the batch.
            recording = np.arange(self._batch)[recordings][row]
            self._cores[wires.core].deliver(recording, wires.axon[wire], step)

    def note(
        self, recordings: Rows, step: int, windows: dict[Register, Window], trace: PhaseTrace
    ) -> None:
        """Write a step into a trace."""
        trace.spikes[recordings, step] = self.fired()[recordings]
        active = np.concatenate([state.active() for state in self._cores.values()], axis=1)
        trace.active[recordings, step] = active[recordings]
        for kind, window in windows.items():
            if window.start <= step < window.stop:
                kept = self.register(kind)[:, window.columns]
                trace.registers[kind][recordings, step - window.start] = kept[recordings]

    def fired(self) -> BoolArray:
        """Return which compartments spiked in the step, (batch, columns)."""
        return self._by_column(_fired)

    def register(self, kind: Register) -> IntArray:
        """Return a register of every compartment after the step, (batch, columns)."""
        return self._by_column(lambda turn: turn.register(kind))

    def events(self) -> IntArray:
        """Return how often every compartment met each event, (batch, events, columns)."""
        by_event = [self._by_column(partial(_events, event=event)) for event in EVENTS]
        return np.stack(by_event, axis=1)

    def _by_column(self, take: "_Take") -> AnyArray:
        """Return what ``take`` returns of all turns, in the order of columns, (batch, columns)."""
        by_core = np.concatenate([state.of_all(take) for state in self._cores.values()], axis=1)
        by_column = np.empty_like(by_core)
        by_column[:, self.columns] = by_core
        return by_column

    def was_idle(self) -> BoolArray:
        """Return in which recordings nothing could have changed in the step, (batch,)."""
        changing = np.zeros(self._batch, dtype=np.bool_)
        for state in self._cores.values():
            for turn in state.turns:
                changing |= (turn.busy | turn.waiting).any(axis=1)
        return ~changing


class _Wires(NamedTuple):
    """Wires to one core: wire i leads from ``source[i]``, a compartment or an input line, to its input ``axon[i]``."""

    core: int
    source: IntArray
    axon: IntArray


def _by_target(source: IntArray, core: IntArray, axon: IntArray) -> list[_Wires]:
    """Group wires by the core to which they lead."""
    return [
        _Wires(target, source[core == target], axon[core == target])
        for target in np.unique(core).tolist()
    ]


class _CoreState:
    """One core in all recordings: the registers of its compartments, in *turns*, and its accumulator slots.

    A turn is a group of compartments that can be updated at once, as none is the parent of another.
    """

    def __init__(self, core: Core, program: ChipProgram, batch: int) -> None:
        registers = program.chip.registers
        axons = core.axons
        self.core = core
        self.wires = _by_target(axons.out_compartment, axons.out_core, axons.out_axon)
        self.charge = core.effective_weights
        self.steps_until_it_acts = loihi.acts_at(0, axons.delay)
        self.slots = np.zeros((_slots(core), batch, core.compartments), dtype=np.int64)
        arithmetic = OnIntegers(registers.charge_bits, registers.current_bits)
        self.turns = [_Turn(core, members, arithmetic, batch) for members in core.turns]

    def update(self, recordings: Rows, step: int) -> None:
        """Update every compartment, children before their parents."""
        slot = self.slots[step % len(self.slots)]
        charge = slot[recordings].copy()
        slot[recordings] = 0  # for the charges that act one round of the ring later
        joined = np.zeros_like(charge)
        for turn in self.turns:
            turn.update(recordings, charge[:, turn.members], joined[:, turn.members])
            if len(turn.parents):
                # A parent may have several children, of which `+=` would add only one.
                np.add.at(joined.T, turn.parents, turn.v[recordings][:, turn.children].T)

    def of_all(self, take: "_Take") -> AnyArray:
        """Return what ``take`` returns of all turns, in the order of compartments, (batch, compartments)."""
        parts = [take(turn) for turn in self.turns]
        of_core = np.empty((len(parts[0]), self.core.compartments), dtype=parts[0].dtype)
        for turn, part in zip(self.turns, parts, strict=True):
            of_core[:, turn.members] = part
        return of_core

    def active(self) -> IntArray:
        """Count the compartments of every piece that had anything to work on, (batch, pieces).

        A piece, a slice of the core, is its share of a group.
        """
        busy = self.of_all(lambda turn: turn.busy)
        counts = []
        for piece in self.core.slices:
            busy_of_piece = busy[:, piece.offset : piece.offset + piece.size]
            counts.append(busy_of_piece.sum(axis=1))
        return np.stack(counts, axis=1)

    def deliver(self, recordings: IntArray, axons: IntArray, step: int) -> None:
        """Add the weights of the synapses of ``axons[i]``, in ``recordings[i]``, to the slots from which they act."""
        synapses = self.core.axons
        first = synapses.list_start[axons]
        length = synapses.list_start[axons + 1] - first
        synapse = ranges(first, length)
        due = (step + self.steps_until_it_acts[synapse]) % len(self.slots)
        at = (due, np.repeat(recordings, length), synapses.target[synapse])
        # Along one axis, numpy adds several times as fast as along three.
        place = np.ravel_multi_index(at, self.slots.shape)
        np.add.at(self.slots.reshape(self.slots.size), place, self.charge[synapse])


class _Turn:
    """Compartments of a core of which none is the parent of another; arrays are (batch, members).

    ``members`` are their numbers in the core. ``children`` are positions in ``members`` of those that are joined to a
    parent, and ``parents`` the numbers of these parents in the core.
    """

    def __init__(self, core: Core, members: IntArray, arithmetic: OnIntegers, batch: int) -> None:
        shape = (batch, len(members))
        self.members = members
        self.children = np.flatnonzero(core.parent[members] >= 0)
        self.parents = core.parent[members[self.children]]
        self.arithmetic = arithmetic
        self.parameters = Parameters(*(array[members] for array in core.step_parameters))
        self.has_bias = self.parameters.bias != 0
        self.u = np.zeros(shape, dtype=np.int64)
        self.v = np.zeros(shape, dtype=np.int64)
        self.blocked = np.zeros(shape, dtype=np.int64)
        self.potential = np.zeros(shape, dtype=np.int64)
        self.fired = np.zeros(shape, dtype=np.bool_)
        self.busy = np.zeros(shape, dtype=np.bool_)
        self.waiting = np.zeros(shape, dtype=np.bool_)
        self.events = {event: np.zeros(shape, dtype=np.int64) for event in EVENTS}

    def update(self, recordings: Rows, charge: IntArray, joined: IntArray) -> None:
        """Run a step of some recordings."""
        before = State(self.u[recordings], self.v[recordings], self.blocked[recordings])
        step = loihi.step(self.arithmetic, self.parameters, before, charge, joined)

        # All four are 0 if no bit is set in any of them: one comparison instead of four.
        bits = charge | joined | before.u | before.v
        self.busy[recordings] = self.has_bias | (bits != 0)
        self.waiting[recordings] = before.blocked != 0
        self.u[recordings], self.v[recordings], self.blocked[recordings] = step.state
        self.potential[recordings] = step.potential
        self.fired[recordings] = step.fired
        for event, met in loihi.events(step.response, step.live):
            # Events are rare, and looking is faster than adding.
            if met.any():
                self.events[event][recordings] += met

    def register(self, kind: Register) -> IntArray:
        """Return a register after the step."""
        return {"u": self.u, "v": self.v, "potential": self.potential}[kind]


_Take = Callable[[_Turn], AnyArray]
"""A function that returns something of a turn for each of its compartments, (batch, members)."""


def _fired(turn: _Turn) -> BoolArray:
    """Return which members of a turn spiked."""
    return turn.fired


def _events(turn: _Turn, event: str) -> IntArray:
    """Return how often each member of a turn met an event."""
    return turn.events[event]
