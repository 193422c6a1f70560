"""Entries of report.json on the checks beyond the match.

- error budget: which stage of compiling, such as rounding weights, changes which spikes
- margins: how far potentials stay from their thresholds, next to the error of the chip's arithmetic
- predictions over time: how soon a prediction is right
- choice of settings: what ``auto`` compared before it chose
"""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np

from hw_model.program.chip_program import ChipProgram
from hw_model.values import picked
from locsnn_compile.report.figures.entries import INLINED, Entry, IfKnown, Inlined
from locsnn_compile.request.choose_strategy import Candidate, Choice
from locsnn_compile.settings import DIALS, Setting
from locsnn_compile.verification.diagnosis import EDGES, Diagnosis, PopulationMargins
from locsnn_compile.verification.error_bounds import ErrorBudget, Losses
from locsnn_compile.verification.error_budget.budget import Cause, Deviation
from locsnn_compile.verification.matching import PopulationMatch
from locsnn_compile.verification.over_time import OverTime
from locsnn_compile.verification.savings import Savings, savings

_REGISTERS = ("peak_u", "share_u", "peak_v", "share_v", "headroom_bits", "wraps", "clips")
"""Figures on the use of registers, by their names in ``diagnosis.RegisterUse``."""
_POINTS = 50
"""Most steps of a recording for which predictions are kept, evenly spread up to the last; chosen by hand."""
_PREDICTIONS = ("together", "time", "location", "time_weighted")
"""The ways to predict from the two branches of a network, in the order of the report."""
_TAKEN = Inlined(tuple((dial.name, dial.taken_key) for dial in DIALS))
"""The chosen setting stands among the keys of its entry; each dial (option of the compiler) has a key of its own."""


class CauseFigures(Entry):
    """Why the first spike differs: what each stage of compiling adds to the potential that decided it.

    - ``moved_by``: by each stage alone, in the network's units
    - ``moved_by_interaction``: what remains of ``moved_together``, the sum over all stages at once
    - ``largest``: the stage that adds most in the direction of the difference
    - ``enough_alone``: stages each of which changes the spike without the others
    """

    moved_by: Mapping[str, float]
    moved_by_interaction: float
    moved_together: float
    largest: str
    enough_alone: tuple[str, ...]


class Sample(Entry):
    """The recordings on which a check was made, by number, out of ``recordings_available``."""

    recordings: tuple[int, ...]
    recordings_available: int


class SpikeErrors(Entry):
    """How equal the spikes of two sides are; the agreement is None if neither side spikes."""

    spike_agreement: float | None
    spike_mismatches: int


class DeviationFigures(Entry):
    """How a variant of the network, with some stages of compiling applied, differs from the float network."""

    spikes: Annotated[SpikeErrors, INLINED]
    predictions_changed: int
    score_error: float | None
    by_population: Mapping[str, SpikeErrors]


class BudgetFigures(Entry):
    """``error_budget``: what each stage of compiling changes alone, and what all other stages change without it.

    ``unexplained_spikes`` is 0 if the stages account for every difference. ``kernel_tail`` is what cutting
    kernels would change, as slayerPytorch does in training; None where the network has no such kernels.
    """

    sample: Annotated[Sample, INLINED]
    alone: Mapping[str, DeviationFigures]
    all_but: Mapping[str, DeviationFigures]
    together: DeviationFigures
    unexplained_spikes: int
    kernel_tail: DeviationFigures | None


class MarginsOfPopulation(Entry):
    """How far potentials of a population are from the threshold, and how far the chip's potentials are off.

    Both are taken for every neuron at every step, without sign, in units of the threshold.

    - ``nearest``, ``error``: by a share of the neuron steps, the distance or error that this share does not exceed
    - ``within_error``: the share of neuron steps whose distance is not larger than their error
    - ``decided_otherwise``: the share in which a spike does change
    """

    neuron_steps: int
    nearest: Mapping[str, float]
    error: Mapping[str, float]
    within_error: float
    decided_otherwise: float
    distance_histogram: tuple[int, ...]
    error_histogram: tuple[int, ...]


class RegisterFigures(Entry):
    """How full the registers of a group of compartments get.

    ``peak_u`` and ``peak_v`` are the largest magnitudes of current and voltage, and ``share_u`` and
    ``share_v`` their shares of the registers' limits. ``headroom_bits`` is how often the fuller of the two
    registers could double; None if neither was ever used.
    """

    peak_u: int
    share_u: float
    peak_v: int
    share_v: float
    headroom_bits: float | None
    wraps: int
    clips: int


class MarginFigures(Entry):
    """``margins``: distances from the threshold, errors, and registers; ``histogram_edges`` are in thresholds."""

    sample: Annotated[Sample, INLINED]
    histogram_edges: tuple[float, ...]
    by_population: Mapping[str, MarginsOfPopulation]
    registers: Mapping[str, RegisterFigures]


class NotFollowed(Entry):
    """Why predictions were not followed over time."""

    left_out: str


class OverTimeFigures(Entry):
    """``over_time``: the share of right predictions after some of the steps.

    - ``right``: the shares after each of ``steps``, by the way to predict: from both branches together, from the
      time or the location branch alone, or from both with time-dependent weights (Kang et al. 2022)
    - ``psi``: the parameter of these weights
    - ``proven_stop``: what it saves to stop once no further event can change the prediction
    """

    sample: Annotated[Sample, INLINED]
    right_is: Literal["the label", "the prediction after the last step"]
    psi: float
    step_seconds: float | None
    steps: tuple[int, ...]
    right: Mapping[str, tuple[float, ...]]
    proven_stop: Savings


class CandidateFigures(Entry):
    """A setting of the compiler that ``auto`` compared, what it loses and what it costs."""

    setting: Annotated[Setting, INLINED]
    prediction_agreement: float | None
    spike_error: float | None
    score_error: float | None
    energy_pj: float | None
    chip_time_ns: float
    within_budget: bool

    @property
    def losses(self) -> Losses:
        """The figures that settings are ranked by."""
        spike_error = self.spike_error
        return Losses(
            self.prediction_agreement,
            None if spike_error is None else 1 - spike_error,
            self.score_error,
            self.energy_pj,
            self.chip_time_ns,
        )


class ChoiceFigures(Entry):
    """``strategy_choice``: the settings that ``auto`` compared, and the one that it took.

    - ``budget``: what a setting may lose; ``kept``: whether the taken one keeps it
    - ``spike_worth``: to get another percent of the spikes wrong, a setting has to save this many percent
      of the cost; absent where errors are not weighed
    """

    calibration_source: str
    calibration_samples: int
    budget: Annotated[ErrorBudget, INLINED]
    kept: bool
    taken: Annotated[Setting, _TAKEN]
    candidates: tuple[CandidateFigures, ...]
    spike_worth: IfKnown[float] = None

    def weighed(self, candidate: CandidateFigures) -> float | None:
        """Return the cost of a candidate relative to the cheapest, plus what its errors are worth.

        None if errors are not weighed, or if no candidate keeps the budget.
        """
        if self.spike_worth is None:
            return None
        costs = [rival.losses.cost for rival in self.candidates if rival.within_budget]
        if not costs:
            return None
        return candidate.losses.weighed(min(costs), self.spike_worth)


def budget_figures(diagnosis: Diagnosis) -> BudgetFigures | None:
    """Return ``error_budget``; None if nothing was rounded."""
    budget = diagnosis.budget
    if budget is None:
        return None
    tail = budget.kernel_tail
    return BudgetFigures(
        sample=_sample(diagnosis),
        alone={stage: _deviation(deviation) for stage, deviation in budget.alone.items()},
        all_but={stage: _deviation(deviation) for stage, deviation in budget.without.items()},
        together=_deviation(budget.together),
        unexplained_spikes=budget.unexplained,
        kernel_tail=None if tail is None else _deviation(tail),
    )


def cause_figures(cause: Cause | None) -> CauseFigures | None:
    """Return ``match.first_divergence.cause``; None without a cause."""
    if cause is None:
        return None
    return CauseFigures(
        moved_by={str(stage): moved for stage, moved in cause.moved.items()},
        moved_by_interaction=cause.rest,
        moved_together=cause.together,
        largest=cause.largest,
        enough_alone=cause.enough,
    )


def margin_figures(diagnosis: Diagnosis) -> MarginFigures:
    """Return ``margins``."""
    margins = diagnosis.margins
    return MarginFigures(
        sample=_sample(diagnosis),
        # Six digits, because the last digits of numpy's powers of ten may differ between machines.
        histogram_edges=tuple(float(f"{edge:.6g}") for edge in EDGES),
        by_population={
            name: _margins(population) for name, population in margins.populations.items()
        },
        registers={
            name: RegisterFigures(**picked(use, *_REGISTERS))
            for name, use in margins.registers.items()
        },
    )


def _sample(diagnosis: Diagnosis) -> Sample:
    return Sample(tuple(diagnosis.recordings), diagnosis.available)


def _deviation(deviation: Deviation) -> DeviationFigures:
    """Return how far the chip is from the network: in spikes, predictions and class scores."""
    return DeviationFigures(
        spikes=_spike_errors(deviation.spikes),
        predictions_changed=deviation.predictions_changed,
        score_error=deviation.scores.relative_error,
        by_population={
            name: _spike_errors(spikes) for name, spikes in deviation.by_population.items()
        },
    )


def _spike_errors(spikes: PopulationMatch) -> SpikeErrors:
    return SpikeErrors(spikes.agreement, spikes.mismatches)


def _margins(margins: PopulationMargins) -> MarginsOfPopulation:
    """Return how near the potentials of a population came to their thresholds, and by how much they err."""
    return MarginsOfPopulation(
        neuron_steps=margins.neuron_steps,
        nearest={f"{share:g}": distance for share, distance in margins.nearest.items()},
        error={f"{share:g}": error for share, error in margins.error.items()},
        within_error=margins.within_error,
        decided_otherwise=margins.decided_otherwise,
        distance_histogram=tuple(margins.distance_histogram.tolist()),
        error_histogram=tuple(margins.error_histogram.tolist()),
    )


def over_time_figures(
    followed: OverTime | str, program: ChipProgram, step_seconds: float | None
) -> OverTimeFigures | NotFollowed:
    """Return ``over_time``; if predictions were not followed, only the reason, which is then in ``followed``."""
    if isinstance(followed, str):
        return NotFollowed(followed)
    length = len(next(iter(followed.right.values())))
    # The numbers of steps after which predictions are kept. A recording with fewer steps than points
    # would have some twice; ``unique`` keeps each once.
    ends = np.arange(1, _POINTS + 1) * length / _POINTS
    steps = np.unique(np.ceil(ends).astype(np.int64))
    return OverTimeFigures(
        sample=Sample(followed.recordings, followed.available),
        right_is="the label" if followed.labelled else "the prediction after the last step",
        psi=followed.psi,
        step_seconds=step_seconds,
        steps=tuple(steps.tolist()),
        # The prediction after n steps is entry n - 1. A network without a location branch lacks some ways.
        right={
            name: tuple(followed.right[name][steps - 1].tolist())
            for name in _PREDICTIONS
            if name in followed.right
        },
        proven_stop=savings(program, followed.proven),
    )


def choice_figures(choice: Choice | None) -> ChoiceFigures | None:
    """Return ``strategy_choice``; None if nothing was chosen."""
    if choice is None:
        return None
    return ChoiceFigures(
        calibration_source=choice.source,
        calibration_samples=choice.samples,
        budget=choice.budget,
        kept=choice.keeps_budget,
        taken=choice.taken.setting,
        candidates=tuple(_candidate(choice, candidate) for candidate in choice.candidates),
        spike_worth=choice.spike_worth,
    )


def _candidate(choice: Choice, candidate: Candidate) -> CandidateFigures:
    """Return what one setting that the search tried costs, and whether it keeps to the budget."""
    return CandidateFigures(
        setting=candidate.setting,
        prediction_agreement=candidate.prediction_agreement,
        spike_error=candidate.spike_error,
        score_error=candidate.score_error,
        energy_pj=candidate.energy_pj,
        chip_time_ns=candidate.chip_time_ns,
        within_budget=candidate.keeps(choice.budget),
    )
