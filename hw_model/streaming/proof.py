"""Find the first step after which the predicted class is proven: no further input can change it.

Every population of the readout has a lower and an upper bound of its reading at the end
(:mod:`hw_model.streaming.population_bounds`). Weighted and added up, they bound the score of every class. A class has
won if its lowest possible score is above the highest possible score of every other class, with ties decided as the
readout decides them. :func:`hw_model.stop_when_proven` uses this on recordings that were run to their end.
"""

import math
from collections.abc import Sequence

import numpy as np

from hw_model.accounting.activity import StepActivity
from hw_model.mapping.graph import Phase, Readout, winning
from hw_model.program.chip_program import ChipProgram
from hw_model.simulation import SimulationResult
from hw_model.streaming.population_bounds import PopulationBounds, PotentialBounds, SpikeBounds
from hw_model.values import BoolArray, FloatArray, Frozen, IntArray

ROUNDING = 1e-9
"""A generous bound of the rounding errors of a score in float64, as a share of the largest possible score."""


class Proof:
    """What was known about the winners of a batch of recordings after any number of steps.

    ``result`` is the batch, run to its end; ``rows`` is the steps of the recordings. Steps are counted over all phases,
    one after the other.
    """

    def __init__(
        self, program: ChipProgram, readout: Readout, result: SimulationResult, rows: int
    ) -> None:
        self._phases = [_phase_terms(program, readout, result, phase) for phase in program.phases]
        self._batch = len(self._phases[0].rests_from)
        self._classes = program.populations[readout.populations[0]]
        self._tie_class = readout.tie_class
        self.all_steps = sum(phase.steps for phase in self._phases)
        self._over_from = _recording_over_from(program, rows, self._phases[0].steps)
        self._rounding = _rounding_of_scores(program, readout, self.all_steps)

    def stops(self) -> IntArray:
        """Return the first step after which each winner is proven, (batch,).

        This is a binary search, of all recordings at once: what is proven after a step stays proven after later ones.
        """
        low = np.zeros(self._batch, dtype=np.int64)
        high = np.full(self._batch, self.all_steps, dtype=np.int64)
        while (low < high).any():
            middle = (low + high) // 2
            proven = self._is_proven(middle)
            high = np.where(proven, middle, high)
            # Recordings that are done have low = middle = high, which must stay.
            low = np.where(proven, low, np.minimum(middle + 1, high))
        return high

    def _is_proven(self, step: IntArray) -> BoolArray:
        """Return whether the winner of each recording is proven after ``step`` steps, (batch,)."""
        scores = self._score_bounds(step)
        # If all final scores are known exactly, so is the winner, however narrow the lead.
        all_are_known = (scores.least == scores.most).all(axis=1)
        return np.asarray(all_are_known | self._winner_is_safe(scores))

    def _score_bounds(self, step: IntArray) -> "_ScoreBounds":
        """Return the scores after ``step`` steps, and bounds of the scores at the end."""
        so_far, least, most = np.zeros((3, self._batch, self._classes))
        steps_before = 0
        for phase in self._phases:
            steps_run = np.clip(step - steps_before, 0, phase.steps)
            nothing_comes = (step >= self._over_from) & (steps_run >= phase.rests_from)
            for term in phase.terms:
                so_far += term.weight * term.population.reading(steps_run)
                bounds = term.population.final_bounds(steps_run, nothing_comes[:, None])
                weighted_low, weighted_high = (term.weight * bound for bound in bounds)
                # A negative weight exchanges the bounds.
                least += np.minimum(weighted_low, weighted_high)
                most += np.maximum(weighted_low, weighted_high)
            steps_before += phase.steps
        return _ScoreBounds(so_far, least, most)

    def _winner_is_safe(self, scores: "_ScoreBounds") -> BoolArray:
        """Return whether no other class can win any more instead of the one that leads now, (batch,)."""
        winner = winning(scores.so_far, self._tie_class)
        lowest_of_winner = scores.least[np.arange(self._batch), winner][:, None] - self._rounding
        class_index = np.arange(self._classes)[None]
        is_rival = class_index != winner[:, None]
        stays_below = scores.most < lowest_of_winner
        stays_at_most_equal = scores.most <= lowest_of_winner
        # Of equal scores the first class wins. So classes before the winner must stay below it; those after it may
        # reach the same score.
        loses = np.where(class_index < winner[:, None], stays_below, stays_at_most_equal)
        is_safe = (loses | ~is_rival).all(axis=1)
        if self._tie_class is not None:
            # If all scores are equal, the tie class wins. So for another winner, some rival must stay below it.
            not_all_can_tie = (stays_below & is_rival).any(axis=1)
            is_safe &= (winner == self._tie_class) | not_all_can_tie
        return np.asarray(is_safe)


class _ScoreBounds(Frozen, eq=False):
    """Class scores, each (batch, classes): so far, and the lowest and highest that are possible at the end."""

    so_far: FloatArray
    least: FloatArray
    most: FloatArray


class _Term(Frozen, eq=False):
    """A population of the readout and its weight in the scores."""

    weight: float
    population: PopulationBounds


class _PhaseTerms(Frozen, eq=False):
    """The terms of the readout whose populations are in one phase, which has ``steps`` steps.

    ``rests_from`` (batch,): the step from which on the phase is at rest; see :func:`_rests_from`.
    """

    steps: int
    rests_from: IntArray
    terms: list[_Term]


def _phase_terms(
    program: ChipProgram, readout: Readout, result: SimulationResult, phase: Phase
) -> _PhaseTerms:
    """Return the terms of the readout in a phase, with the bounds of their populations."""
    activity = result.activity[phase.name]
    columns = program.columns_of(phase.name)
    terms = []
    for name, weight in readout.terms:
        if name not in columns:
            continue
        if name in readout.from_step:
            first_step = readout.from_step[name]
            population: PopulationBounds = PotentialBounds(program, phase, name, result, first_step)
        else:
            population = SpikeBounds(program, phase, name, result)
        terms.append(_Term(weight, population))
    return _PhaseTerms(activity[0].steps, _rests_from(activity), terms)


def _rests_from(activity: Sequence[StepActivity]) -> IntArray:
    """Return the step from which on a phase gets no input and no compartment is active, (batch,)."""
    rests_from = np.zeros(len(activity), dtype=np.int64)
    for recording, counts in enumerate(activity):
        has_updates = counts.by_piece["neuron_updates_active"].any(axis=1)
        has_input = counts.by_piece["synaptic_ops"].any(axis=1)
        # -1 if no step was busy: then the phase rests from step 0 on.
        last_busy_step = np.flatnonzero(has_updates | has_input).max(initial=-1)
        rests_from[recording] = last_busy_step + 1
    return rests_from


def _recording_over_from(program: ChipProgram, rows: int, steps_of_first_phase: int) -> int:
    """Return the step from which on the whole recording is known.

    If the first phase plays from the transpose buffer, it begins only when the buffer holds the whole recording.
    """
    inputs = program.inputs_of(program.phases[0].name)
    begins_with_buffer = any(item.positions is not None for item in inputs)
    return 0 if begins_with_buffer else min(rows, steps_of_first_phase)


def _rounding_of_scores(program: ChipProgram, readout: Readout, all_steps: int) -> float:
    """Return by how much two scores must differ to be certainly different.

    With whole weights, scores are exact. Otherwise they are rounded, so that scores which differ by less prove nothing.
    """
    if all(float(weight).is_integer() for weight in readout.weights):
        return 0.0
    # A population has at most one spike per step, and its potential stays within the voltage register.
    largest_reading = program.chip.registers.voltage_max if readout.from_step else all_steps
    return ROUNDING * math.fsum(map(abs, readout.weights)) * largest_reading
