"""What a program may lose, and what a setting loses: the same bounds for ``auto`` and for ``locsnn explore``."""

from hw_model.values import Frozen

SPIKE_TOLERANCE = 0.01
"""Without a budget, so much more of the spikes may differ than with the first strategy, and no prediction more."""


class ErrorBudget(Frozen):
    """What a program may lose: it keeps ``min_agreement`` of the predictions, and misses ``max_spike_error`` of spikes.

    The spike error is 1 less the spike agreement. With neither given, the budget is what ``dendrite`` loses.
    """

    min_agreement: float | None = None
    max_spike_error: float | None = None

    @property
    def given(self) -> bool:
        """Whether there is any bound."""
        return self != ErrorBudget()

    def words(self) -> str:
        """Return the bounds as the options that ask for them."""
        bounds = (("--min-agreement", self.min_agreement), ("--max-spike-error", self.max_spike_error))
        return " and ".join(f"{option} {bound:g}" for option, bound in bounds if bound is not None)


class Losses(Frozen):
    """A setting on some recordings: shares that equal the float network's, and mean energy and time of a recording.

    A share is None where nothing was compared: all class scores tie, or no neuron spikes. Energy and time are by the
    chip's default profile; an open core has no energy, and exact cycles.
    """

    prediction_agreement: float | None
    spike_agreement: float | None
    energy_pj: float | None
    chip_time_ns: float

    @property
    def cost(self) -> float:
        """What settings are ranked by: energy, or time where no energy is known."""
        return self.chip_time_ns if self.energy_pj is None else self.energy_pj

    @property
    def prediction_error(self) -> float | None:
        """Share of predictions that differ from the float network's."""
        return None if self.prediction_agreement is None else 1 - self.prediction_agreement

    @property
    def spike_error(self) -> float | None:
        """1 less the spike agreement."""
        return None if self.spike_agreement is None else 1 - self.spike_agreement

    def keeps(self, budget: ErrorBudget) -> bool:
        """Tell whether the budget is kept; a bound on what was not compared is not."""
        agreement, error = self.prediction_agreement, self.spike_error
        return (budget.min_agreement is None or (agreement is not None and agreement >= budget.min_agreement)) and (
            budget.max_spike_error is None or (error is not None and error <= budget.max_spike_error)
        )


def default_budget(first: Losses) -> ErrorBudget:
    """Return the bounds where none is given, by what the first strategy loses; none on what it gave no figure for."""
    error = first.spike_error
    return ErrorBudget(first.prediction_agreement, None if error is None else error + SPIKE_TOLERANCE)
