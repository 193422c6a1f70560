"""The plain engine: in which order cores, compartments and spikes take their turns. Slow and obvious.

One step is: update every compartment of every core, then deliver the spikes of this step to the accumulator slots of
the steps in which their charge acts. What an update does is said in :mod:`hw_model.arithmetic.loihi`.
"""

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import Parameters, State
from hw_model.arithmetic.on_integers import OnIntegers
from hw_model.engine.trace import EVENTS, PhaseInput, PhaseTrace, Register, Window, added_up
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import ByteArray, IntArray


def run_phase(
    program: ChipProgram, phase: str, played: PhaseInput, windows: dict[Register, Window]
) -> PhaseTrace:
    """Run a batch through one phase, recording by recording; keep of the registers what the windows ask for."""
    pieces = [piece for core in program.cores_of(phase) for piece in core.slices]
    compartments = sum(piece.size for piece in pieces)
    trace = PhaseTrace.empty(played, compartments, len(pieces), windows)
    for recording in range(len(played.start)):
        run = _Run(program, phase, played.lines(recording))
        for step in range(played.start[recording], played.stop[recording]):
            run.update(step)
            run.deliver(step)
            run.note(recording, step, windows, trace)
        trace.events[recording][:, run.columns] = run.events()
    return added_up(program, phase, played, trace)


class _Run:
    """One recording on the cores of a phase; ``columns`` are those of the cores' compartments, core by core."""

    def __init__(self, program: ChipProgram, phase: str, lines: ByteArray) -> None:
        cores = program.cores_of(phase)
        self.columns = np.concatenate([program.columns_of_core(core) for core in cores])
        self._cores = {core.number: _CoreState(core, program) for core in cores}
        self._routes = [
            (program.route_of(name), lines[:, lines_of_input])
            for name, lines_of_input in program.lines_of(phase).items()
        ]

    def update(self, step: int) -> None:
        """Update every compartment of every core."""
        for state in self._cores.values():
            state.update(step)

    def deliver(self, step: int) -> None:
        """Deliver the spikes of a step: those of compartments, then those of input lines."""
        for state in self._cores.values():
            axons = state.core.axons
            for sending in np.flatnonzero(state.fired[axons.out_compartment]):
                target = self._cores[int(axons.out_core[sending])]
                target.deliver(int(axons.out_axon[sending]), step)
        for route, spikes in self._routes:
            for sending in np.flatnonzero(spikes[step][route.line]):
                target = self._cores[int(route.core[sending])]
                target.deliver(int(route.axon[sending]), step)

    def note(
        self, recording: int, step: int, windows: dict[Register, Window], trace: PhaseTrace
    ) -> None:
        """Write the row of a step into a trace."""
        states = self._cores.values()
        trace.spikes[recording, step, self.columns] = np.concatenate([s.fired for s in states])
        trace.active[recording, step] = np.concatenate([s.active() for s in states])
        for kind, window in windows.items():
            if window.start <= step < window.stop:
                register = np.empty(len(self.columns), dtype=np.int64)
                register[self.columns] = np.concatenate([s.register(kind) for s in states])
                row = step - window.start
                trace.registers[kind][recording, row] = register[window.columns]

    def events(self) -> IntArray:
        """Return how often every compartment met each event, (events, compartments)."""
        return np.concatenate([state.events for state in self._cores.values()], axis=1)


class _CoreState:
    """Registers and accumulators of one core, arrays (compartments,)."""

    def __init__(self, core: Core, program: ChipProgram) -> None:
        registers = program.chip.registers
        size = core.compartments
        self.core = core
        self.arithmetic = OnIntegers(registers.charge_bits, registers.current_bits)
        self.turns = [(members, _rows(core.step_parameters, members)) for members in core.turns]
        self.has_bias = core.bias != 0
        self.charge = core.effective_weights
        self.steps_until_it_acts = loihi.acts_at(0, core.axons.delay)
        # A slot for every delay in use, the step being read and the next.
        self.slots = np.zeros((int(core.axons.delay.max(initial=0)) + 2, size), dtype=np.int64)
        self.u = np.zeros(size, dtype=np.int64)
        self.v = np.zeros(size, dtype=np.int64)
        self.blocked = np.zeros(size, dtype=np.int64)
        self.potential = np.zeros(size, dtype=np.int64)
        self.fired = np.zeros(size, dtype=np.bool_)
        self.busy = np.zeros(size, dtype=np.bool_)
        self.events = np.zeros((len(EVENTS), size), dtype=np.int64)

    def update(self, step: int) -> None:
        """Update every compartment, children before their parents."""
        slot = self.slots[step % len(self.slots)]
        charge = slot.copy()
        slot[:] = 0
        joined = np.zeros_like(self.v)
        for members, parameters in self.turns:
            self._update(members, parameters, charge[members], joined[members])
            children = members[self.core.parent[members] >= 0]
            np.add.at(joined, self.core.parent[children], self.v[children])

    def _update(
        self, i: IntArray, parameters: Parameters, charge: IntArray, joined: IntArray
    ) -> None:
        """Take the step of compartments i, none the parent of another."""
        before = State(self.u[i], self.v[i], self.blocked[i])
        step = loihi.step(self.arithmetic, parameters, before, charge, joined)

        busy = (charge != 0) | (joined != 0) | self.has_bias[i]
        self.busy[i] = busy | (before.u != 0) | (before.v != 0)
        self.u[i], self.v[i], self.blocked[i] = step.state
        self.potential[i] = step.potential
        self.fired[i] = step.fired
        for event, met in loihi.events(step.response, step.live):
            if met.any():
                self.events[EVENTS.index(event), i] += met

    def register(self, kind: Register) -> IntArray:
        """Return a register of every compartment after the step."""
        return {"u": self.u, "v": self.v, "potential": self.potential}[kind]

    def active(self) -> list[int]:
        """Count the compartments of every piece that had anything to work on."""
        return [int(self.busy[p.offset : p.offset + p.size].sum()) for p in self.core.slices]

    def deliver(self, axon: int, step: int) -> None:
        """Add the weights of an axon's synapses to the slots of the steps in which they act."""
        axons = self.core.axons
        row = slice(int(axons.list_start[axon]), int(axons.list_start[axon + 1]))
        due = (step + self.steps_until_it_acts[row]) % len(self.slots)
        np.add.at(self.slots, (due, axons.target[row]), self.charge[row])


def _rows(parameters: Parameters, members: IntArray) -> Parameters:
    """Return the parameters of some compartments."""
    return Parameters(*(array[members] for array in parameters))
