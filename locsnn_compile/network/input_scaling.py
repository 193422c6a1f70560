"""How the host scales numbers before its first layer."""

import numpy as np

from hw_model.values import FloatArray, Frozen

STEP = 1 / 32
"""slayer's weights of 8 bits are even, and 64 of their units are 1."""
LEAST = -4.0
MOST = 127 / 32


class InputScaling(Frozen):
    """An input layer of lava-dl: numbers are rounded to 8 bits, multiplied by ``weight``, and ``bias`` is added.

    As slayer computes it (``block.cuba.Input``); netx leaves the scaling to those who send the numbers.
    """

    weight: float
    bias: float

    def scaled(self, values: FloatArray) -> FloatArray:
        """Return what reaches the neurons, in float64; its multiples of 1/1024 are exact."""
        # Both ends are multiples themselves: numbers may be cut before slayer's float32, which ends sooner.
        within_range = np.clip(values, LEAST, MOST).astype(np.float32)
        rounded: FloatArray = np.rint(within_range / STEP).astype(np.float64) * STEP
        return rounded * self.weight + self.bias

    def cut_sentences(self, values: FloatArray) -> tuple[str, ...]:
        """Return a sentence on the numbers that are outside the range, if any are."""
        cut = int(((values < LEAST) | (values > MOST)).sum())
        if not cut:
            return ()
        return (
            f"{cut} of {values.size} numbers are outside {LEAST:g} to {MOST:g}, and are cut to these: "
            "give them in the range of the training.",
        )

    @property
    def sentence(self) -> str:
        """What is lost of the numbers, for the assumptions of a report."""
        return (
            f"The host rounds numbers to multiples of 1/32 from {LEAST:g} to {MOST:g}, as slayer's "
            "input layer does."
        )
