"""Which winner stands, whatever the inputs may still do.

The proof. Whatever the inputs do, the registers of a readout compartment stay at or below a run in which every source
spikes in every step, none of its negative weights counts, and no spike resets it. For u = rz(u) + q, v = rz(v) + u +
bias + joined, and the clipping of v all grow with what they are given, as long as nothing wraps, which
:func:`hw_model.prove_range` tells. So in a step in which that run stays at or below the threshold there is no spike,
and with a refractory count of k at most one in any k steps: this bounds the spikes that each class can still win. The
same run bounds the potentials of a class from above; from below its register does, and the largest that there was.

Once a recording is over, all that a phase will be given is known. Where that is nothing, and the phase is at rest, no
spike is to come, and every potential is 0.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from hw_model.accounting.activity import StepActivity
from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import AT_REST, Parameters
from hw_model.arithmetic.neutral import NOTHING
from hw_model.arithmetic.on_integers import WithoutWraps
from hw_model.mapping.graph import Phase, Readout, winning
from hw_model.program.chip_program import ChipProgram
from hw_model.range_proof import charges, prove_range
from hw_model.simulation import SimulationResult
from hw_model.values import BoolArray, IntArray


class Proof:
    """What is known of a batch that was run to its end, ``rows`` long, asked as if it had been run only so far."""

    def __init__(
        self, program: ChipProgram, readout: Readout, result: SimulationResult, rows: int
    ) -> None:
        self._phases: list[tuple[int, IntArray, list[_BySpikes | _ByPotentials]]] = []
        for phase in program.phases:
            voters: list[_BySpikes | _ByPotentials] = [
                (_ByPotentials if name in readout.from_step else _BySpikes)(
                    program, phase, name, weight, result
                )
                for name, weight in readout.terms
                if name in program.columns_of(phase.name)
            ]
            activity = result.activity[phase.name]
            self._phases.append((len(activity[0].count("spikes")), _rests_from(activity), voters))
        self._batch, self._classes = len(activity), program.populations[readout.populations[0]]
        self.all_steps = sum(steps for steps, _, _ in self._phases)
        # A transposed phase begins when the buffer holds the whole recording.
        turned = any(
            item.positions is not None for item in program.inputs_of(program.phases[0].name)
        )
        self._over = 0 if turned else min(rows, self._phases[0][0])
        # Scores of weights that are not whole are rounded: equal ones then prove nothing.
        whole = all(float(weight).is_integer() for weight in readout.weights)
        most = program.chip.registers.voltage_max if readout.from_step else self.all_steps
        self._tie_class = readout.tie_class
        self._slack = 0.0 if whole else 1e-9 * math.fsum(map(abs, readout.weights)) * most

    def stops(self) -> IntArray:
        """Search for the first step by halves: what is proven after a step is proven after every later one."""
        low, high = (
            np.zeros(self._batch, dtype=np.int64),
            np.full(self._batch, self.all_steps, dtype=np.int64),
        )
        while (low < high).any():
            middle = (low + high) // 2
            settled = self._settled(middle)
            high = np.where(settled, middle, high)
            low = np.where(settled, low, np.minimum(middle + 1, high))
        return high

    def _settled(self, step: IntArray) -> BoolArray:
        """Tell for each recording whether its winner stands after ``step`` steps, counted over all phases."""
        score, least, most = np.zeros((3, self._batch, self._classes))
        before = 0
        for steps, rests_from, voters in self._phases:
            done = np.clip(step - before, 0, steps)
            nothing_comes = (step >= self._over) & (done >= rests_from)
            for voter in voters:
                score += voter.weight * voter.given(done)
                low, high = (voter.weight * end for end in voter.ends(done, nothing_comes[:, None]))
                least += np.minimum(low, high)
                most += np.maximum(low, high)
            before += steps
        known = (least == most).all(axis=1)
        winner = winning(score, self._tie_class)
        each = np.arange(self._batch)
        bound = least[each, winner][:, None] - self._slack
        most[each, winner] = -np.inf
        # A tie goes to the first class: those before the winner must stay below it.
        earlier = np.arange(self._classes)[None] < winner[:, None]
        settled = np.asarray(np.where(earlier, most < bound, most <= bound).all(axis=1))
        if self._tie_class is not None:
            # A tie of all goes to its own class, so for another winner one class must stay below it.
            others = np.arange(self._classes)[None] != winner[:, None]
            settled &= (winner == self._tie_class) | ((most < bound) & others).any(axis=1)
        return np.asarray(settled | known)


def _rests_from(activity: Sequence[StepActivity]) -> IntArray:
    """Return the step from which on a phase is given nothing and has nothing to work on, (batch,)."""
    found = np.zeros(len(activity), dtype=np.int64)
    for b, item in enumerate(activity):
        busy = item.by_piece["neuron_updates_active"].any(axis=1) | item.by_piece[
            "synaptic_ops"
        ].any(axis=1)
        found[b] = np.flatnonzero(busy).max(initial=-1) + 1
    return found


class _Voter:
    """A readout population in its phase."""

    _so_far: IntArray

    def __init__(
        self, program: ChipProgram, phase: Phase, name: str, weight: float, result: SimulationResult
    ) -> None:
        self.weight = weight
        self._members = members_of(program, name)
        self._parent = program.joined_to
        self._starts_late = phase.align_events is not None
        self._u, self._v = result.u, result.v
        self._steps = self._u[name].shape[1]
        columns = program.columns_of(phase.name)
        proved = {found.core: found.cannot_wrap.astype(np.int64) for found in prove_range(program)}
        cannot_wrap = program.by_column(phase.name, lambda core: proved[core.number])
        self._safe = all(cannot_wrap[columns[member]].all() for member in self._members)
        parameters = _parameters_of(program, phase)
        charge = program.by_column(phase.name, lambda core: charges(core).high.astype(np.int64))
        self._parameters = {
            member: Parameters(*(array[columns[member]] for array in parameters))
            for member in self._members
        }
        self._charge = {member: charge[columns[member]] for member in self._members}
        registers = program.chip.registers
        self._arithmetic = WithoutWraps(registers.charge_bits, registers.current_bits)

    def given(self, step: IntArray) -> IntArray:
        """Return what counts after the first steps, (batch, n)."""
        return np.asarray(self._so_far[np.arange(len(step)), step])

    def _voltages(self, step: IntArray) -> Iterator[IntArray]:
        """Yield the highest voltages of every step from ``step`` on, (batch, n)."""
        each, last = np.arange(len(step)), np.maximum(step - 1, 0)
        started = (step > 0)[:, None]
        u = {name: np.where(started, self._u[name][each, last], AT_REST) for name in self._members}
        v = {name: np.where(started, self._v[name][each, last], AT_REST) for name in self._members}
        for _ in range(int((self._steps - step).max(initial=0))):
            joined: dict[str | None, IntArray] = {}
            for name in self._members:
                parent = self._parent.get(name)
                response = loihi.respond(
                    self._arithmetic,
                    self._parameters[name],
                    u[name],
                    v[name],
                    self._charge[name],
                    joined.get(name, NOTHING),
                )
                u[name] = response.u
                voltage = response.v
                # A spike, or a refractory step, brings the v of a spiking compartment to rest, which may be higher. So
                # may be the v of any that has not started.
                v[name] = (
                    voltage if parent and not self._starts_late else np.maximum(voltage, AT_REST)
                )
                joined[parent] = joined[parent] + v[name] if parent in joined else v[name]
            yield voltage


class _BySpikes(_Voter):
    """A population whose spikes count."""

    def __init__(
        self, program: ChipProgram, phase: Phase, name: str, weight: float, result: SimulationResult
    ) -> None:
        super().__init__(program, phase, name, weight, result)
        self._threshold = self._parameters[name].threshold
        self._refractory = self._parameters[name].refractory
        spikes = result.spikes[name]
        before = np.zeros((len(spikes), 1, spikes.shape[2]), dtype=np.int64)
        self._so_far = np.concatenate((before, spikes.cumsum(axis=1, dtype=np.int64)), axis=1)
        free_from = np.where(spikes, np.arange(self._steps)[:, None] + self._refractory, 0)
        self._free_from = np.concatenate((before, np.maximum.accumulate(free_from, axis=1)), axis=1)

    def ends(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return what counts at the end at the least and at the most, (batch, n), as known after ``step`` steps."""
        given = self.given(step)
        return given, given + np.where(nothing_comes, 0, self._spikes_after(step))

    def _spikes_after(self, step: IntArray) -> IntArray:
        """Return how many spikes there can be after the first steps at the most, (batch, n)."""
        found = np.zeros(self._so_far[:, 0].shape, dtype=np.int64)
        free_from = self._free_from[np.arange(len(step)), step] - step[:, None]
        for ahead, voltage in enumerate(self._voltages(step)):
            can = (voltage > self._threshold) | (not self._safe)
            spikes = can & (ahead >= free_from) & (step[:, None] + ahead < self._steps)
            found += spikes
            free_from = np.where(spikes, ahead + self._refractory, free_from)
        return found


class _ByPotentials(_Voter):
    """A population whose largest potential counts."""

    def __init__(
        self, program: ChipProgram, phase: Phase, name: str, weight: float, result: SimulationResult
    ) -> None:
        super().__init__(program, phase, name, weight, result)
        assert program.readout is not None
        self._first = program.readout.from_step[name]
        rows = result.potential[name]
        self._so_far = np.zeros((len(rows), self._steps + 1, rows.shape[2]), dtype=np.int64)
        self._so_far[:, self._first + 1 :] = np.maximum.accumulate(rows[:, self._first :], axis=1)

    def ends(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the same of potentials."""
        read = step[:, None]
        vmin = self._parameters[self._members[-1]].vmin
        vmax = self._parameters[self._members[-1]].vmax
        given = self.given(step)
        most = np.broadcast_to(vmin, given.shape)
        for ahead, voltage in enumerate(self._voltages(step)):
            counts = (read + ahead >= self._first) & (read + ahead < self._steps)
            highest = np.maximum(voltage, AT_REST) if self._safe else vmax
            most = np.where(counts, np.maximum(most, highest), most)
        at_least = np.where(read > self._first, given, vmin)
        ends = (np.maximum(at_least, np.where(nothing_comes, AT_REST, end)) for end in (vmin, most))
        decided = np.maximum(read, self._first) >= self._steps
        low, high = (np.where(decided, given, end) for end in ends)
        return low, high


def _parameters_of(program: ChipProgram, phase: Phase) -> Parameters:
    """Return the parameters of every compartment of a phase, each (columns,)."""
    fields = range(len(Parameters._fields))
    of_core = {core.number: core.step_parameters for core in program.cores_of(phase.name)}

    def column(field: int) -> IntArray:
        return program.by_column(phase.name, lambda core: of_core[core.number][field])

    return Parameters(*map(column, fields))


def members_of(program: ChipProgram, name: str) -> list[str]:
    """Return the groups joined to a group, children first, and the group itself last."""
    found, begun = [], [name]
    while begun:
        found.append(begun.pop())
        begun += [child for child, parent in program.joined_to.items() if parent == found[-1]]
    return found[::-1]
