"""After which step a winner stands, whatever the inputs may still do.

Every population of the readout says what it gives in the end at the least and at the most
(:mod:`hw_model.streaming.population_bounds`). Weighted and added up, these bound the score of every
class. A winner stands where its least score is above the most that any other class can reach, with
ties decided as the readout decides them.
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
"""Share of the largest score that float64 may round off in one, with much to spare."""


class Proof:
    """Of a batch that was run to its end: what was known already after so many steps.

    ``rows``: steps of the recordings. Steps are counted over all phases, one after the other.
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

        The search goes by halves: what is proven after a step is proven after every later one.
        """
        low = np.zeros(self._batch, dtype=np.int64)
        high = np.full(self._batch, self.all_steps, dtype=np.int64)
        while (low < high).any():
            middle = (low + high) // 2
            proven = self._is_proven(middle)
            high = np.where(proven, middle, high)
            low = np.where(proven, low, np.minimum(middle + 1, high))
        return high

    def _is_proven(self, step: IntArray) -> BoolArray:
        """Tell of each recording whether its winner stands after ``step`` steps, (batch,)."""
        scores = self._score_bounds(step)
        all_are_known = (scores.least == scores.most).all(axis=1)
        return np.asarray(all_are_known | self._winner_stands(scores))

    def _score_bounds(self, step: IntArray) -> "_ScoreBounds":
        """Add up what all populations gave until ``step``, and what they give in the end."""
        so_far, least, most = np.zeros((3, self._batch, self._classes))
        steps_before = 0
        for phase in self._phases:
            steps_run = np.clip(step - steps_before, 0, phase.steps)
            nothing_comes = (step >= self._over_from) & (steps_run >= phase.rests_from)
            for term in phase.terms:
                so_far += term.weight * term.population.given(steps_run)
                ends = term.population.at_the_end(steps_run, nothing_comes[:, None])
                # A negative weight turns the least into the most.
                one_end, other_end = (term.weight * end for end in ends)
                least += np.minimum(one_end, other_end)
                most += np.maximum(one_end, other_end)
            steps_before += phase.steps
        return _ScoreBounds(so_far, least, most)

    def _winner_stands(self, scores: "_ScoreBounds") -> BoolArray:
        """Tell whether no other class can come to win in the place of the one that leads now."""
        winner = winning(scores.so_far, self._tie_class)
        of_winner = scores.least[np.arange(self._batch), winner][:, None] - self._rounding
        class_index = np.arange(self._classes)[None]
        is_rival = class_index != winner[:, None]
        stays_below = scores.most < of_winner
        stays_at_most_equal = scores.most <= of_winner
        # A tie goes to the first class: those before the winner must stay below it.
        loses = np.where(class_index < winner[:, None], stays_below, stays_at_most_equal)
        stands = (loses | ~is_rival).all(axis=1)
        if self._tie_class is not None:
            # A tie of all goes to its own class, so for another winner a rival must stay below it.
            no_tie_of_all = (stays_below & is_rival).any(axis=1)
            stands &= (winner == self._tie_class) | no_tie_of_all
        return np.asarray(stands)


class _ScoreBounds(Frozen, eq=False):
    """Class scores, (batch, classes): so far, and the least and the most that they are in the end."""

    so_far: FloatArray
    least: FloatArray
    most: FloatArray


class _Term(Frozen, eq=False):
    """A population of the readout and its weight in the scores."""

    weight: float
    population: PopulationBounds


class _PhaseTerms(Frozen, eq=False):
    """The terms of the readout that are populations of one phase, ``steps`` long.

    ``rests_from`` (batch,): the step from which on nothing moves in the phase; see :func:`_rests_from`.
    """

    steps: int
    rests_from: IntArray
    terms: list[_Term]


def _phase_terms(
    program: ChipProgram, readout: Readout, result: SimulationResult, phase: Phase
) -> _PhaseTerms:
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
    """Return the step from which on a phase is given nothing and has nothing to work on, (batch,)."""
    rests_from = np.zeros(len(activity), dtype=np.int64)
    for recording, counts in enumerate(activity):
        has_updates = counts.by_piece["neuron_updates_active"].any(axis=1)
        has_input = counts.by_piece["synaptic_ops"].any(axis=1)
        last_busy_step = np.flatnonzero(has_updates | has_input).max(initial=-1)
        rests_from[recording] = last_busy_step + 1
    return rests_from


def _recording_over_from(program: ChipProgram, rows: int, steps_of_first_phase: int) -> int:
    """Return the step from which on the whole recording has been read.

    A phase that is played from the transpose buffer begins when the buffer holds the recording.
    """
    inputs = program.inputs_of(program.phases[0].name)
    begins_with_buffer = any(item.positions is not None for item in inputs)
    return 0 if begins_with_buffer else min(rows, steps_of_first_phase)


def _rounding_of_scores(program: ChipProgram, readout: Readout, all_steps: int) -> float:
    """Return by how much scores must differ to be told apart.

    Scores of weights that are not whole are rounded: equal ones then prove nothing.
    """
    if all(float(weight).is_integer() for weight in readout.weights):
        return 0.0
    most_given = program.chip.registers.voltage_max if readout.from_step else all_steps
    return ROUNDING * math.fsum(map(abs, readout.weights)) * most_given
