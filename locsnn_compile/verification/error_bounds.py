"""How much a compiled program may differ from its float network, and how much a setting of the compiler does differ.

``auto``, which chooses a setting, and ``locsnn explore``, which compares many, use the same bounds
(:class:`ErrorBudget`) and the same measurements (:class:`Losses`).
"""

from collections.abc import Sequence
from typing import Annotated, TypeVar

from hw_model.io.records import NOT_NEGATIVE, Checked, between
from hw_model.values import Frozen
from locsnn_compile.errors import listed

SPIKE_TOLERANCE = 0.01
"""If the user gives no budget, a setting may lose this much more of the spikes than the first strategy, and no more
predictions. Chosen by hand."""
SCORE_TOLERANCE = 0.05
"""If the user gives no budget, class scores may be off by this much more of their spread. A bound of its own, because
scores read from potentials can be wrong although spikes and classes are right. Chosen by hand."""


def _is_kept(error: float | None, bound: float | None) -> bool:
    """Return whether an error is within a bound; with no bound it always is, an unknown error otherwise never is."""
    if bound is None:
        return True
    return error is not None and within(error, bound)


def within(error: float, bound: float) -> bool:
    """Return whether an error is at most a bound, apart from the last digits of floats: 1 - 0.99 is above 0.01."""
    return error <= bound or round(error, 12) <= bound


LossesT = TypeVar("LossesT", bound="Losses")


class ErrorBudget(Checked):
    """How much a program may differ from its float network; None means no bound.

    - ``min_agreement``: at least this share of the predictions must be equal
    - ``max_spike_error``: the spike error, 1 minus the spike agreement, must not be larger
    - ``max_score_error``: class scores must not be off by more than this share of their spread

    Without any bound, :func:`default_budget` takes the errors of the first strategy, ``dendrite``.
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

    An agreement is None if nothing was compared, because all class scores tie or no neuron spikes. The score error is
    None if the class scores of the float network tie. Energy and time come from the chip's default profile; an open
    core has exact cycles and may have no energy.
    """

    prediction_agreement: float | None
    spike_agreement: float | None
    score_error: float | None
    energy_pj: float | None
    chip_time_ns: float

    @property
    def cost(self) -> float:
        """The number by which settings are ranked: energy, or time if no energy is known."""
        return self.chip_time_ns if self.energy_pj is None else self.energy_pj

    def weighed(self, least_cost: float, spike_worth: float) -> float:
        """Return ``cost / least_cost + spike_worth * error``: what a setting costs together with its errors.

        ``least_cost`` is that of the cheapest setting compared. The error is that of spikes or, if no neuron spikes,
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
        """Return whether the setting is within a budget; a bound on a figure that was not compared is not kept."""
        agreement = self.prediction_agreement
        least = budget.min_agreement
        if least is not None and (agreement is None or agreement < least):
            return False
        return _is_kept(self.spike_error, budget.max_spike_error) and _is_kept(
            self.score_error, budget.max_score_error
        )

    @property
    def losses(self) -> tuple[float, float, float]:
        """Errors of predictions, spikes and scores, as a tuple to compare; 0 for those that were not measured."""
        return self.prediction_error or 0.0, self.spike_error or 0.0, self.score_error or 0.0


def weighed_best(settings: Sequence[LossesT], spike_worth: float) -> LossesT | None:
    """Return the setting with the least :meth:`Losses.weighed` cost; None if there are no settings."""
    least_cost = min((setting.cost for setting in settings), default=0.0)
    return min(settings, key=lambda setting: setting.weighed(least_cost, spike_worth), default=None)


def default_budget(first: Losses) -> ErrorBudget:
    """Return the budget if the user gives none: a little more than the errors of the first strategy.

    Errors that are unknown for the first strategy have no bound.
    """
    max_spike_error = None
    if first.spike_error is not None:
        max_spike_error = min(1.0, first.spike_error + SPIKE_TOLERANCE)
    max_score_error = None
    if first.score_error is not None:
        max_score_error = first.score_error + SCORE_TOLERANCE
    return ErrorBudget(first.prediction_agreement, max_spike_error, max_score_error)
