"""What a program may lose, and what a setting loses: the same bounds for ``auto`` and for ``locsnn explore``."""

from collections.abc import Sequence
from typing import Annotated, TypeVar

from hw_model.io.records import NOT_NEGATIVE, Checked, between
from hw_model.values import Frozen
from locsnn_compile.errors import listed

SPIKE_TOLERANCE = 0.01
"""Without a budget, a setting may lose this share of spikes more than the first strategy, and no more predictions."""
SCORE_TOLERANCE = 0.05
"""Its class scores may also be off by this share of their spread more: spikes and classes say nothing of potentials."""


def _is_kept(error: float | None, bound: float | None) -> bool:
    """Tell whether an error keeps a bound, if there is one; an error that is not known keeps none."""
    if bound is None:
        return True
    return error is not None and within(error, bound)


def within(error: float, bound: float) -> bool:
    """Tell whether an error is not above a bound, apart from the last digits of floats: 1 - 0.99 is above 0.01."""
    return error <= bound or round(error, 12) <= bound


LossesT = TypeVar("LossesT", bound="Losses")


class ErrorBudget(Checked):
    """What a program may lose: at least ``min_agreement`` of the predictions stay, no more than ``max_spike_error`` of
    the spikes differ, and class scores are off by no more than ``max_score_error`` of their spread.

    The spike error is 1 minus the spike agreement. If none is given, the budget is what ``dendrite`` loses.
    """

    called = "budget"
    min_agreement: Annotated[float | None, between(0, 1)] = None
    max_spike_error: Annotated[float | None, between(0, 1)] = None
    max_score_error: Annotated[float | None, NOT_NEGATIVE] = None

    @property
    def given(self) -> bool:
        """Whether there is any bound."""
        return self != ErrorBudget()

    def words(self) -> str:
        """Return the bounds as options of the command line."""
        bounds = {name: bound for name, bound in vars(self).items() if bound is not None}
        return listed([f"--{name.replace('_', '-')} {bound:g}" for name, bound in bounds.items()])


class Losses(Frozen):
    """How a setting does on some recordings: agreement with the float network, and mean energy and time per recording.

    An agreement is None if nothing was compared, because all class scores tie or no neuron spikes, and so is the error
    of scores if those of the float network tie. Energy and time come from the chip's default profile; an open core has
    exact cycles and may have no energy.
    """

    prediction_agreement: float | None
    spike_agreement: float | None
    score_error: float | None
    energy_pj: float | None
    chip_time_ns: float

    @property
    def cost(self) -> float:
        """What settings are ranked by: energy, or time if no energy is known."""
        return self.chip_time_ns if self.energy_pj is None else self.energy_pj

    def weighed(self, least_cost: float, spike_worth: float) -> float:
        """Return the cost, relative to the least of some settings, and what its errors are worth.

        cost / least_cost + spike_worth * error, where the error is that of spikes or, without any,
        that of class scores.
        """
        error = self.score_error if self.spike_error is None else self.spike_error
        relative_cost = self.cost / least_cost if least_cost else self.cost
        return relative_cost + spike_worth * (error or 0.0)

    @property
    def prediction_error(self) -> float | None:
        """Share of predictions that differ from the float network's."""
        return None if self.prediction_agreement is None else 1 - self.prediction_agreement

    @property
    def spike_error(self) -> float | None:
        """1 minus the spike agreement."""
        return None if self.spike_agreement is None else 1 - self.spike_agreement

    def keeps(self, budget: ErrorBudget) -> bool:
        """Tell whether the budget is kept; a bound on something that was not compared is not kept."""
        agreement = self.prediction_agreement
        least = budget.min_agreement
        if least is not None and (agreement is None or agreement < least):
            return False
        return _is_kept(self.spike_error, budget.max_spike_error) and _is_kept(
            self.score_error, budget.max_score_error
        )

    @property
    def losses(self) -> tuple[float, float, float]:
        """Errors of predictions, spikes and scores, to compare by; 0 for what was not compared."""
        return self.prediction_error or 0.0, self.spike_error or 0.0, self.score_error or 0.0


def weighed_best(settings: Sequence[LossesT], spike_worth: float) -> LossesT | None:
    """Return the setting that costs least with its errors weighed in; None without any."""
    least_cost = min((setting.cost for setting in settings), default=0.0)
    return min(settings, key=lambda setting: setting.weighed(least_cost, spike_worth), default=None)


def default_budget(first: Losses) -> ErrorBudget:
    """Return the bounds to use if none is given: what the first strategy loses, with no bound on what is not known."""
    spikes, scores = first.spike_error, first.score_error
    return ErrorBudget(
        first.prediction_agreement,
        None if spikes is None else min(1.0, spikes + SPIKE_TOLERANCE),
        None if scores is None else scores + SCORE_TOLERANCE,
    )
