"""Bound what a population of the readout can still do: how many spikes it can send, how high its potential can rise.

The *reading* of a population is what the readout takes from it: spike counts, or largest potentials. The proof that a
recording can stop early (:mod:`hw_model.streaming.proof`) needs its lowest and highest possible value at the end.

The argument: whatever the inputs do, the registers of a readout compartment stay at or below those of the *highest
run*, in which every source spikes in every step, no negative weight counts, and no spike resets the compartment. This
holds because ``u = rz(u) + q``, ``v = rz(v) + u + bias + joined`` and the clipping of v are all monotonic, as long as
nothing wraps, which :func:`hw_model.prove_range` decides.

So there is no spike in a step in which the highest run stays at or below the threshold, and with a refractory count of
k there is at most one spike in any k steps. This bounds the number of spikes to come. The same run bounds potentials
from above. From below they are bounded by the voltage register's limit, and by the largest potential so far.

Once a recording is over, all further input of a phase is known. If there is none, and the phase is at rest, no spike
will come, and every potential will be 0.
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
    """Return all groups that are joined to a group, children before parents, and the group itself last."""
    parents_first: list[str] = []
    to_visit = [name]
    while to_visit:
        parent = to_visit.pop()
        parents_first.append(parent)
        to_visit += [child for child, of in program.joined_to.items() if of == parent]
    return parents_first[::-1]


class PopulationBounds(ABC):
    """The bounds of a population of the readout, in its phase, for a batch of recordings.

    ``result`` is the batch, run to its end, with u and v of the population and of all groups joined to it after every
    step. In the methods, ``step`` (batch,) is the number of steps that were done: each recording has its own, since the
    search for the stops is done for all recordings at once.
    """

    _reading_after: IntArray
    """The reading after 0, 1, ... steps, (batch, steps + 1, n)."""

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

    def reading(self, step: IntArray) -> IntArray:
        """Return the reading after ``step`` steps, (batch, n)."""
        return np.asarray(self._reading_after[np.arange(len(step)), step])

    @abstractmethod
    def final_bounds(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the lowest and the highest possible reading at the end, as known after ``step`` steps.

        Both are (batch, n). ``nothing_comes`` (batch, 1) marks recordings whose phase is at rest and gets no more
        input.
        """

    def _highest_voltages(self, step: IntArray) -> Iterator[IntArray]:
        """Yield v (batch, n) of the highest run, for the step after ``step`` and for each further step.

        The iterator goes on until the recording with the most steps left is at its end. For other recordings, the last
        values belong to steps that do not exist; callers ignore them.
        """
        u = {group: self._register_after(step, self._u[group]) for group in self._groups}
        v = {group: self._register_after(step, self._v[group]) for group in self._groups}
        steps_left = self._steps - step
        for _ in range(int(steps_left.max(initial=0))):
            # By group, the sum of the voltages that its children add to it. Children come first.
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
                v[group] = self._highest_after_reset(group, response.v)
                parent = self._parent_of.get(group)
                passed_up[parent] = v[group] + passed_up.get(parent, NOTHING)
            # The population is the last of its groups, so this is its v.
            yield response.v

    def _highest_after_reset(self, group: str, voltage: IntArray) -> IntArray:
        """Return the highest v that a group can have at the end of a step, given v before a possible reset.

        A spike, or a refractory step, resets v to rest, which may be higher than v was. Joined groups are not reset,
        but v of any group is at rest as long as an aligned phase has not started.
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
    """A population that is read by its spike counts."""

    def __init__(
        self, program: ChipProgram, phase: Phase, name: str, result: SimulationResult
    ) -> None:
        super().__init__(program, phase, name, result)
        self._threshold = self._parameters[name].threshold
        self._refractory = self._parameters[name].refractory
        spikes = result.spikes[name]
        before_the_first = np.zeros((len(spikes), 1, spikes.shape[2]), dtype=np.int64)
        self._reading_after = np.concatenate(
            (before_the_first, spikes.cumsum(axis=1, dtype=np.int64)), axis=1
        )
        # The first step that is not refractory, after 0, 1, ... steps, (batch, steps + 1, n).
        step = np.arange(self._steps)[:, None]
        free_from = np.where(spikes, step + self._refractory, 0)
        self._free_from = np.concatenate(
            (before_the_first, np.maximum.accumulate(free_from, axis=1)), axis=1
        )

    def final_bounds(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the fewest and the most spikes of all steps."""
        spikes_so_far = self.reading(step)
        most_to_come = np.where(nothing_comes, 0, self._most_spikes_after(step))
        return spikes_so_far, spikes_so_far + most_to_come

    def _most_spikes_after(self, step: IntArray) -> IntArray:
        """Return the largest possible number of spikes in the steps after ``step``, (batch, n)."""
        spikes = np.zeros(self._reading_after[:, 0].shape, dtype=np.int64)
        # Counted from the steps done, as ``ahead`` is.
        free_from = self._free_from[np.arange(len(step)), step] - step[:, None]
        for ahead, voltage in enumerate(self._highest_voltages(step)):
            # A register that may wrap can hold any value, so it may be above the threshold.
            may_spike = (voltage > self._threshold) | (not self._never_wraps)
            is_free = ahead >= free_from
            is_run = step[:, None] + ahead < self._steps
            # To spike as early as possible gives the most spikes.
            spike = may_spike & is_free & is_run
            spikes += spike
            free_from = np.where(spike, ahead + self._refractory, free_from)
        return spikes


class PotentialBounds(PopulationBounds):
    """A population that is read by its largest potential from ``first_step`` on."""

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
        # Up to the first step that counts, the reading is 0.
        self._reading_after = np.zeros(
            (len(potential), self._steps + 1, potential.shape[2]), dtype=np.int64
        )
        self._reading_after[:, first_step + 1 :] = np.maximum.accumulate(
            potential[:, first_step:], axis=1
        )
        self._vmin = self._parameters[name].vmin
        self._vmax = self._parameters[name].vmax

    def final_bounds(self, step: IntArray, nothing_comes: BoolArray) -> tuple[IntArray, IntArray]:
        """Return the lowest and the highest possible value of the largest potential."""
        steps_done = step[:, None]
        reading = self.reading(step)
        # Before the first step that counts, the reading of 0 is no potential, so it bounds nothing.
        so_far = np.where(steps_done > self._first_step, reading, self._vmin)
        lowest_to_come = np.where(nothing_comes, AT_REST, self._vmin)
        highest_to_come = np.where(nothing_comes, AT_REST, self._highest_after(step))
        # If no step that counts is left, the reading is final: 0 if no step ever counted.
        is_decided = np.maximum(steps_done, self._first_step) >= self._steps
        lowest = np.where(is_decided, reading, np.maximum(so_far, lowest_to_come))
        highest = np.where(is_decided, reading, np.maximum(so_far, highest_to_come))
        return lowest, highest

    def _highest_after(self, step: IntArray) -> IntArray:
        """Return the highest possible potential in the steps after ``step``, (batch, n)."""
        steps_done = step[:, None]
        highest = np.broadcast_to(self._vmin, self._reading_after[:, 0].shape)
        for ahead, voltage in enumerate(self._highest_voltages(step)):
            counts = (steps_done + ahead >= self._first_step) & (steps_done + ahead < self._steps)
            if self._never_wraps:
                # As long as an aligned phase has not started, potentials are at rest, which may be higher.
                potential = np.maximum(voltage, AT_REST)
            else:
                potential = self._vmax
            highest = np.where(counts, np.maximum(highest, potential), highest)
        return highest


def _cannot_wrap(program: ChipProgram, phase: Phase) -> BoolArray:
    """Return whether it is proven of each compartment that none of its registers can wrap, (columns,)."""
    proven = {core.core: core.cannot_wrap.astype(np.int64) for core in prove_range(program)}
    return program.by_column(phase.name, lambda core: proven[core.number]).astype(np.bool_)


def _highest_charge(program: ChipProgram, phase: Phase) -> IntArray:
    """Return the largest charge that each compartment can get in a step, (columns,)."""
    return program.by_column(phase.name, lambda core: charges(core).high.astype(np.int64))


def _parameters_of(program: ChipProgram, phase: Phase) -> Parameters:
    """Return the parameters of every compartment of a phase, each (columns,)."""
    of_core = {core.number: core.step_parameters for core in program.cores_of(phase.name)}

    def column(field: int) -> IntArray:
        return program.by_column(phase.name, lambda core: of_core[core.number][field])

    return Parameters(*map(column, range(len(Parameters._fields))))
