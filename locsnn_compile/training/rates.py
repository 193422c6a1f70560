"""The learning rate that a run of few updates needs.

In a module of its own, apart from :mod:`.schedule`, so that options can be chosen without importing torch.
"""

USUAL_UPDATES = 8_000
"""Updates of the weights with which a run learns well at the usual rate, measured on Ev-Objects."""
USUAL_RATE = 0.003
"""The default learning rate of the optimizers adamw and rmsprop."""
LARGEST_RATE = 0.1
"""The largest rate that is suggested: larger ones did not help in any run that was tried."""


def rate_for_updates(updates: int) -> float:
    """Return the learning rate for a run of so many ``updates`` of its weights.

    These optimizers move a weight by about the rate in each update. So the product of rate and updates, how far weights
    can move, is kept at that of a usual run, within the usual and the largest rate.
    """
    return min(max(USUAL_RATE * USUAL_UPDATES / max(updates, 1), USUAL_RATE), LARGEST_RATE)
