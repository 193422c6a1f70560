"""What a program may lose, and what a setting loses: the same bounds for ``auto`` and for ``locsnn explore``."""

from hw_model.io.records import Checked
from hw_model.values import Frozen

SPIKE_TOLERANCE = 0.01
"""Without a budget, a setting may lose this share of spikes more than the first strategy, and no more predictions."""


class ErrorBudget(Checked):
    """What a program may lose: at least ``min_agreement`` of the predictions stay, and no more than ``max_spike_error``
    of the spikes differ.

    The spike error is 1 minus the spike agreement. If neither is given, the budget is what ``dendrite`` loses.
    """

    called = "budget"
    min_agreement: float | None = None
    max_spike_error: float | None = None

    @property
    def given(self) -> bool:
        """Whether there is any bound."""
        return self != ErrorBudget()

    def words(self) -> str:
        """Return the bounds as options of the command line."""
        bounds = (("--min-agreement", self.min_agreement), ("--max-spike-error", self.max_spike_error))
        return " and ".join(f"{option} {bound:g}" for option, bound in bounds if bound is not None)


class Losses(Frozen):
    """How a setting does on some recordings: agreement with the float network, and mean energy and time per recording.

    An agreement is None if nothing was compared, because all class scores tie or no neuron spikes. Energy and time come
    from the chip's default profile; an open core has exact cycles and may have no energy.
    """

    prediction_agreement: float | None
    spike_agreement: float | None
    energy_pj: float | None
    chip_time_ns: float

    @property
    def cost(self) -> float:
        """What settings are ranked by: energy, or time if no energy is known."""
        return self.chip_time_ns if self.energy_pj is None else self.energy_pj

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
        agreement, error = self.prediction_agreement, self.spike_error
        return (budget.min_agreement is None or (agreement is not None and agreement >= budget.min_agreement)) and (
            budget.max_spike_error is None or (error is not None and error <= budget.max_spike_error)
        )


def default_budget(first: Losses) -> ErrorBudget:
    """Return the bounds to use if none is given: what the first strategy loses, with no bound on what is not known."""
    error = first.spike_error
    return ErrorBudget(first.prediction_agreement, None if error is None else error + SPIKE_TOLERANCE)
