"""Strategy ``auto``: the cheapest lowering of SRM neurons that keeps an error budget on calibration recordings."""

from __future__ import annotations

from dataclasses import dataclass

import hw_model as hw
from hw_model.counts import total
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import TargetError
from locsnn_compile.matching import compare
from locsnn_compile.network import Network
from locsnn_compile.neurons import SrmAlpha
from locsnn_compile.passes.quantize_srm import STRATEGIES
from locsnn_compile.pipeline import Levels, lower

SPIKE_TOLERANCE = 0.01
"""Without a budget, so much more of the spikes may differ than with ``dendrite``, and no prediction more."""


@dataclass(frozen=True)
class ErrorBudget:
    """What a program may lose: it keeps ``min_agreement`` of the predictions, and misses ``max_spike_error`` of spikes.

    The spike error is 1 less the spike agreement. With neither given, the budget is what ``dendrite`` loses.
    """

    min_agreement: float | None = None
    max_spike_error: float | None = None


@dataclass(frozen=True)
class Candidate:
    """A strategy on the calibration recordings; energy is the mean by the chip's default profile."""

    strategy: str
    prediction_agreement: float
    spike_error: float
    energy_pj: float

    def keeps(self, budget: ErrorBudget) -> bool:
        """Tell whether the budget is kept."""
        return (budget.min_agreement is None or self.prediction_agreement >= budget.min_agreement) and (
            budget.max_spike_error is None or self.spike_error <= budget.max_spike_error
        )


@dataclass(frozen=True, eq=False)
class Choice:
    """The candidate that was taken, its program, all that were compared, on how many recordings of which source."""

    taken: Candidate
    levels: Levels
    candidates: tuple[Candidate, ...]
    budget: ErrorBudget
    samples: int
    source: str


def choose_strategy(
    network: Network, chip: hw.Chip, weight_bits: int, recordings: Recordings, budget: ErrorBudget
) -> Choice | None:
    """Try every strategy and take the cheapest that keeps the budget, or, if none does, the most accurate.

    A strategy that this chip cannot hold is passed over; if that is all of them, the first ``TargetError`` is raised.
    Returns None for a network with no float SRM neurons: there is nothing to choose.
    """
    if not any(isinstance(population.neuron, SrmAlpha) for population in network.populations):
        return None
    candidates: list[Candidate] = []
    programs: dict[str, Levels] = {}
    errors: list[TargetError] = []
    for strategy in STRATEGIES:
        try:
            levels = lower(network, chip, weight_bits, strategy)
        except TargetError as error:
            errors.append(error)
        else:
            programs[strategy] = levels
            candidates.append(_measure(strategy, levels, recordings))
    if not candidates:
        raise errors[0]
    limits = _default(candidates[0]) if budget == ErrorBudget() else budget
    kept = [candidate for candidate in candidates if candidate.keeps(limits)]
    if kept:
        taken = min(kept, key=lambda c: c.energy_pj)
    else:
        taken = max(candidates, key=lambda c: (c.prediction_agreement, -c.spike_error))
    return Choice(taken, programs[taken.strategy], tuple(candidates), limits, len(recordings), recordings.source)


def _default(first: Candidate) -> ErrorBudget:
    return ErrorBudget(first.prediction_agreement, first.spike_error + SPIKE_TOLERANCE)


def _measure(strategy: str, levels: Levels, recordings: Recordings) -> Candidate:
    match = compare(levels.quantized, levels.program, recordings.spikes, source=recordings.source)
    chip = levels.program.chip
    energy_pj = sum(hw.energy_pj(total(match.counts), chip.profile(chip.default_profile)).values())
    return Candidate(strategy, match.prediction_agreement, 1 - match.spikes.agreement, energy_pj / match.samples)
