"""The plain engine: the chip's step as the description tells it, core by core, spike by spike. Slow and obvious.

One step is: update every compartment of every core (accumulate, decay, join, fire), then deliver the spikes of this
step to the accumulator slots of the steps in which their charge is due.
"""

import numpy as np

from hw_model.arithmetic.fixed_point import clip, decay, wrap
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
        (program.route_of(name), lines[:, here]) for name, here in program.lines_of(phase).items()
    ]
    for step in range(played.start[b], played.stop[b]):
        for state in cores.values():
            state.update(step)

        for state in cores.values():
            axons = state.core.axons
            for k in np.flatnonzero(state.fired[axons.out_compartment]):
                cores[int(axons.out_core[k])].deliver(int(axons.out_axon[k]), step)
        for route, own in routes:
            for k in np.flatnonzero(own[step][route.line]):
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
        self.core, self.limits = core, program.chip.registers
        n = core.compartments
        self.decay_u, self.decay_v = core.setting("decay_u"), core.setting("decay_v")
        self.refractory, self.spiking = core.setting("refractory"), core.setting("joined") == 0
        self.bias, self.threshold = core.bias, core.threshold_voltage
        self.weight = core.effective_weights
        # A slot for every delay in use, the step being read and the next.
        self.slots = np.zeros((int(core.axons.delay.max(initial=0)) + 2, n), dtype=np.int64)
        self.u, self.v, self.potential = (np.zeros(n, dtype=np.int64) for _ in range(3))
        self.blocked = np.zeros(n, dtype=np.int64)
        self.fired = np.zeros(n, dtype=np.bool_)
        self.busy = np.zeros(n, dtype=np.bool_)
        self.turns = core.turns
        self.events = np.zeros((len(EVENTS), n), dtype=np.int64)

    def update(self, step: int) -> None:
        """Accumulate, decay, join and fire, for every compartment of the core."""
        bits = self.limits
        slot = self.slots[step % len(self.slots)]
        arrived = slot.copy()
        slot[:] = 0
        busy = (arrived != 0) | (self.u != 0) | (self.v != 0) | (self.bias != 0)

        q = self._counted("charge_wraps", arrived, wrap(arrived, bits.charge_bits))
        u = decay(self.u, self.decay_u) + q
        self.u = self._counted("current_wraps", u, wrap(u, bits.current_bits))

        joined = np.zeros_like(self.v)
        for members in self.turns:
            busy[members] |= joined[members] != 0
            self._update_voltage(members, joined)
        self.busy = busy
        self.blocked = np.maximum(self.blocked - 1, 0)
        self.blocked[self.fired] = self.refractory[self.fired] - 1

    def active(self) -> list[int]:
        """Count the compartments of every piece that had anything to work on."""
        return [int(self.busy[p.offset : p.offset + p.size].sum()) for p in self.core.slices]

    def _update_voltage(self, i: IntArray, joined: IntArray) -> None:
        """Update v of compartments i, none the parent of another; ``joined[i]`` is complete."""
        drive = self.u[i] + self.bias[i]
        wrapped = wrap(drive, self.limits.current_bits)
        v = decay(self.v[i], self.decay_v[i]) + wrapped + joined[i]
        clipped = clip(v, self.core.vmin, self.core.vmax)

        held = self.blocked[i] > 0
        self.events[EVENTS.index("current_wraps"), i] += (wrapped != drive) & ~held
        self.events[EVENTS.index("voltage_clips"), i] += (clipped != v) & ~held
        self.potential[i] = np.where(held, 0, clipped)
        self.fired[i] = ~held & self.spiking[i] & (clipped > self.threshold[i])
        self.v[i] = np.where(self.fired[i], 0, self.potential[i])

        children = i[self.core.parent[i] >= 0]
        np.add.at(joined, self.core.parent[children], self.v[children])

    def deliver(self, axon: int, step: int) -> None:
        """Add the weights of an axon's synapses to the slots of the steps in which they are due."""
        axons = self.core.axons
        row = slice(int(axons.list_start[axon]), int(axons.list_start[axon + 1]))
        due = (step + 1 + axons.delay[row]) % len(self.slots)
        np.add.at(self.slots, (due, axons.target[row]), self.weight[row])

    def _counted(self, event: str, before: IntArray, after: IntArray) -> IntArray:
        self.events[EVENTS.index(event)] += before != after
        return after
