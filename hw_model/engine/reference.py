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
from hw_model.values import IntArray


def run_phase(
    program: ChipProgram, phase: str, played: PhaseInput, windows: dict[Register, Window]
) -> PhaseTrace:
    """Run a batch through one phase, recording by recording; keep of the registers what the windows ask for."""
    pieces = [piece for core in program.cores_of(phase) for piece in core.slices]
    trace = PhaseTrace.empty(played, sum(piece.size for piece in pieces), len(pieces), windows)
    for b in range(len(played.start)):
        _run_recording(program, phase, played, windows, b, trace)
    return added_up(program, phase, played, trace)


def _run_recording(
    program: ChipProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    b: int,
    trace: PhaseTrace,
) -> None:
    """Run recording ``b``, and write its row of the trace."""
    cores = {core.number: _CoreState(core, program) for core in program.cores_of(phase)}
    columns = np.concatenate([program.columns_of_core(core) for core in program.cores_of(phase)])
    lines = played.lines(b)
    routes = [
        (program.route_of(name), lines[:, of_input])
        for name, of_input in program.lines_of(phase).items()
    ]
    for step in range(played.start[b], played.stop[b]):
        for state in cores.values():
            state.update(step)

        for state in cores.values():
            axons = state.core.axons
            for k in np.flatnonzero(state.fired[axons.out_compartment]):
                cores[int(axons.out_core[k])].deliver(int(axons.out_axon[k]), step)
        for route, spikes in routes:
            for k in np.flatnonzero(spikes[step][route.line]):
                cores[int(route.core[k])].deliver(int(route.axon[k]), step)

        trace.spikes[b, step, columns] = np.concatenate([state.fired for state in cores.values()])
        trace.active[b, step] = np.concatenate([state.active() for state in cores.values()])
        for kind, window in windows.items():
            if window.start <= step < window.stop:
                register = np.empty(len(columns), dtype=np.int64)
                register[columns] = np.concatenate(
                    [getattr(state, kind) for state in cores.values()]
                )
                trace.registers[kind][b, step - window.start] = register[window.columns]
    trace.events[b][:, columns] = np.concatenate([state.events for state in cores.values()], axis=1)


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
