"""What a population of the readout has given so far, and what it can give until the end.

The proof. Whatever the inputs do, the registers of a readout compartment stay at or below those of
the *highest run*: every source spikes in every step, none of its negative weights counts, and no
spike resets it. For ``u = rz(u) + q``, ``v = rz(v) + u + bias + joined``, and the clipping of v all
grow with what they are given, as long as nothing wraps, which :func:`hw_model.prove_range` tells.

So in a step in which the highest run stays at or below the threshold there is no spike, and with a
refractory count of k there is at most one in any k steps: this bounds the spikes that are to come.
The same run bounds potentials from above; from below they are bounded by the register's own limit,
and by the largest potential that there was.

Once a recording is over, all that a phase will be given is known. Where that is nothing, and the
phase is at rest, no spike is to come, and every potential is 0.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import AT_REST, Parameters
from hw_model.arithmetic.neutral import NOTHING
from hw_model.arithmetic.on_integers import WithoutWraps
from hw_model.mapping.graph import Phase
from hw_model.program.chip_program import ChipProgram
from hw_model.range_proof import charges, prove_range
from hw_model.simulation import SimulationResult
from hw_model.values import BoolArray, IntArray


def joined_groups(program: ChipProgram, name: str) -> list[str]:
    """Return the groups joined to a group, children first, and the group itself last."""
    parents_first: list[str] = []
    to_visit = [name]
    while to_visit:
        parent = to_visit.pop()
        parents_first.append(parent)
        to_visit += [child for child, of in program.joined_to.items() if of == parent]
    return parents_first[::-1]


class PopulationBounds(ABC):
    """A population of the readout in its phase; ``result`` is the batch run to its end.

    ``result`` holds u and v of the population and of all groups joined to it, after every step.
    Steps below are numbers of steps done, (batch,): recordings may have got differently far.
    """

    _given_after: IntArray
    """What the population has given after 0, 1, ... steps, (batch, steps + 1, n)."""

    def __init__(
        self, program: ChipProgram, phase: Phase, name: str, result: SimulationResult
    ) -> None:
        self._groups = joined_groups(program, name)
        self._parent_of = program.joined_to
        self._starts_late = phase.align_events is not None
        self._u = result.u
        self._v = result.v
        self._steps = self._u[name].shape[1]
        columns = program.columns_of(phase.name)
        cannot_wrap = _cannot_wrap(program, phase)
        self._never_wraps = all(cannot_wrap[columns[group]].all() for group in self._groups)
        parameters = _parameters_of(program, phase)
        self._parameters = {
            group: Parameters(*(values[columns[group]] for values in parameters))
            for group in self._groups
        }
        charge = _highest_charge(program, phase)
        self._highest_charge = {group: charge[columns[group]] for group in self._groups}
        registers = program.chip.registers
        self._arithmetic = WithoutWraps(registers.charge_bits, registers.current_bits)

    def given(self, step: IntArray) -> IntArray:
        """Return what the population has given after ``step`` steps, (batch, n)."""
        return np.asarray(self._given_after[np.arange(len(step)), step])

    @abstractmethod
    def at_the_end(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return what it gives in the end at the least and at the most, as known after ``step``.

        Both are (batch, n). ``nothing_comes`` (batch, 1) marks recordings whose phase is at rest
        and is given nothing any more.
        """

    def _highest_voltages(self, step: IntArray) -> Iterator[IntArray]:
        """Yield v of the highest run in the step after ``step`` and in each that follows, (batch, n).

        They go on until the recording with most steps left is done: for the others, the last ones
        are of steps that are never run.
        """
        u = {group: self._register_after(step, self._u[group]) for group in self._groups}
        v = {group: self._register_after(step, self._v[group]) for group in self._groups}
        steps_left = self._steps - step
        for _ in range(int(steps_left.max(initial=0))):
            passed_up: dict[str | None, IntArray] = {}
            for group in self._groups:
                response = loihi.respond(
                    self._arithmetic,
                    self._parameters[group],
                    u[group],
                    v[group],
                    self._highest_charge[group],
                    passed_up.get(group, NOTHING),
                )
                u[group] = response.u
                v[group] = self._kept_at_most(group, response.v)
                parent = self._parent_of.get(group)
                passed_up[parent] = v[group] + passed_up.get(parent, NOTHING)
            # The population comes last of its groups.
            yield response.v

    def _kept_at_most(self, group: str, voltage: IntArray) -> IntArray:
        """Return the highest v that a group can be left with by a step.

        A spike, or a refractory step, brings v to rest, which may be higher than what it was. Joined
        groups do neither; but v of any group is at rest while its phase has not started.
        """
        never_resets = group in self._parent_of
        if never_resets and not self._starts_late:
            return voltage
        return np.maximum(voltage, AT_REST)

    def _register_after(self, step: IntArray, register: IntArray) -> IntArray:
        """Return a register (batch, steps, n) as it was after ``step`` steps, (batch, n)."""
        has_started = (step > 0)[:, None]
        last_step = np.maximum(step - 1, 0)
        return np.where(has_started, register[np.arange(len(step)), last_step], AT_REST)


class SpikeBounds(PopulationBounds):
    """A population that gives its spikes."""

    def __init__(
        self, program: ChipProgram, phase: Phase, name: str, result: SimulationResult
    ) -> None:
        super().__init__(program, phase, name, result)
        self._threshold = self._parameters[name].threshold
        self._refractory = self._parameters[name].refractory
        spikes = result.spikes[name]
        before_the_first = np.zeros((len(spikes), 1, spikes.shape[2]), dtype=np.int64)
        self._given_after = np.concatenate(
            (before_the_first, spikes.cumsum(axis=1, dtype=np.int64)), axis=1
        )
        # By steps done, (batch, steps + 1, n): the first step in which a next spike may come.
        step = np.arange(self._steps)[:, None]
        free_from = np.where(spikes, step + self._refractory, 0)
        self._free_from = np.concatenate(
            (before_the_first, np.maximum.accumulate(free_from, axis=1)), axis=1
        )

    def at_the_end(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the fewest and the most spikes of all steps."""
        given = self.given(step)
        return given, given + np.where(nothing_comes, 0, self._most_spikes_after(step))

    def _most_spikes_after(self, step: IntArray) -> IntArray:
        """Return how many spikes there can be in the steps that are left at the most, (batch, n)."""
        spikes = np.zeros(self._given_after[:, 0].shape, dtype=np.int64)
        # Counted from the steps done, as ``ahead`` is.
        free_from = self._free_from[np.arange(len(step)), step] - step[:, None]
        for ahead, voltage in enumerate(self._highest_voltages(step)):
            # A register that may wrap may hold anything, also what is above the threshold.
            may_spike = (voltage > self._threshold) | (not self._never_wraps)
            is_free = ahead >= free_from
            is_run = step[:, None] + ahead < self._steps
            spike = may_spike & is_free & is_run
            spikes += spike
            free_from = np.where(spike, ahead + self._refractory, free_from)
        return spikes


class PotentialBounds(PopulationBounds):
    """A population that gives its largest potential from a step of the readout on."""

    def __init__(
        self,
        program: ChipProgram,
        phase: Phase,
        name: str,
        result: SimulationResult,
        first_step: int,
    ) -> None:
        super().__init__(program, phase, name, result)
        self._first_step = first_step
        potential = result.potential[name]
        self._given_after = np.zeros(
            (len(potential), self._steps + 1, potential.shape[2]), dtype=np.int64
        )
        self._given_after[:, first_step + 1 :] = np.maximum.accumulate(
            potential[:, first_step:], axis=1
        )
        self._vmin = self._parameters[name].vmin
        self._vmax = self._parameters[name].vmax

    def at_the_end(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the lowest and the highest that the largest potential can be."""
        steps_done = step[:, None]
        given = self.given(step)
        so_far = np.where(steps_done > self._first_step, given, self._vmin)
        lowest_to_come = np.where(nothing_comes, AT_REST, self._vmin)
        highest_to_come = np.where(nothing_comes, AT_REST, self._highest_after(step))
        # Where no step that counts is left, what is given stands: 0 if none ever counted.
        is_decided = np.maximum(steps_done, self._first_step) >= self._steps
        lowest = np.where(is_decided, given, np.maximum(so_far, lowest_to_come))
        highest = np.where(is_decided, given, np.maximum(so_far, highest_to_come))
        return lowest, highest

    def _highest_after(self, step: IntArray) -> IntArray:
        """Return the highest potential that can come in the steps that are left, (batch, n)."""
        steps_done = step[:, None]
        highest = np.broadcast_to(self._vmin, self._given_after[:, 0].shape)
        for ahead, voltage in enumerate(self._highest_voltages(step)):
            counts = (steps_done + ahead >= self._first_step) & (steps_done + ahead < self._steps)
            # A potential is at rest as long as the phase has not started.
            potential = np.maximum(voltage, AT_REST) if self._never_wraps else self._vmax
            highest = np.where(counts, np.maximum(highest, potential), highest)
        return highest


def _cannot_wrap(program: ChipProgram, phase: Phase) -> BoolArray:
    """Mark the compartments of a phase of which no register can wrap, (columns,)."""
    proven = {core.core: core.cannot_wrap.astype(np.int64) for core in prove_range(program)}
    return program.by_column(phase.name, lambda core: proven[core.number]).astype(np.bool_)


def _highest_charge(program: ChipProgram, phase: Phase) -> IntArray:
    """Return the charge that no step of a compartment can exceed, (columns,)."""
    return program.by_column(phase.name, lambda core: charges(core).high.astype(np.int64))


def _parameters_of(program: ChipProgram, phase: Phase) -> Parameters:
    """Return the parameters of every compartment of a phase, each (columns,)."""
    of_core = {core.number: core.step_parameters for core in program.cores_of(phase.name)}

    def column(field: int) -> IntArray:
        return program.by_column(phase.name, lambda core: of_core[core.number][field])

    return Parameters(*map(column, range(len(Parameters._fields))))
