"""How the host scales and rounds numbers before its first layer, as the input layer of lava-dl's slayer does."""

import numpy as np

from hw_model.values import FloatArray, Frozen

STEP = 1 / 32
"""slayer quantises inputs as it does weights of 8 bits: to even numbers, of which 64 stand for 1."""
LEAST = -4.0
"""The least number that slayer's 8 bits hold: -256 / 64."""
MOST = 127 / 32
"""The largest number that slayer's 8 bits hold: 254 / 64."""


class InputScaling(Frozen):
    """An input layer of lava-dl: numbers are rounded to 8 bits, multiplied by ``weight``, and ``bias`` is added.

    slayer computes this in training (``block.cuba.Input``). lava-dl's netx, which loads the trained file, leaves the
    scaling to whoever sends the numbers.
    """

    weight: float
    bias: float

    def scaled(self, values: FloatArray) -> FloatArray:
        """Return the scaled numbers that reach the neurons, in float64."""
        # Clip first: both ends are multiples of the step, so the result is the same as clipping last, and float32, in
        # which slayer computes, cannot overflow.
        within_range = np.clip(values, LEAST, MOST).astype(np.float32)
        rounded: FloatArray = np.rint(within_range / STEP).astype(np.float64) * STEP
        return rounded * self.weight + self.bias

    def cut_sentences(self, values: FloatArray) -> tuple[str, ...]:
        """Return a sentence about the numbers outside the range, for the assumptions of a report, if there are any."""
        cut = int(((values < LEAST) | (values > MOST)).sum())
        if not cut:
            return ()
        return (
            f"{cut} of {values.size} numbers are outside {LEAST:g} to {MOST:g}, and are cut to these: "
            "give them in the range of the training.",
        )

    @property
    def sentence(self) -> str:
        """A sentence about the rounding, for the assumptions of a report."""
        return (
            f"The host rounds numbers to multiples of 1/32 from {LEAST:g} to {MOST:g}, as slayer's "
            "input layer does."
        )
