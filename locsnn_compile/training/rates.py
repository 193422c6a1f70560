"""The learning rate that a run of few updates needs. Apart from the schedule, so that torch is not needed for it."""

USUAL_UPDATES, USUAL_RATE, LARGEST_RATE = 8_000, 0.003, 0.1
"""A run of so many updates learns well at the usual rate, on Ev-Objects; no rate above the largest was of use."""


def rate_for_updates(updates: int) -> float:
    """Return the rate at which a run of so few updates still moves its weights as far: lr * updates stays the same."""
    return min(max(USUAL_RATE * USUAL_UPDATES / max(updates, 1), USUAL_RATE), LARGEST_RATE)
