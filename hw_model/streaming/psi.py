"""The time-weighted prediction of hybrid networks: how the two branches share the scores while a recording plays.

A hybrid network has a time branch and a location branch. While a recording arrives, the location branch has seen only a
part of it, so it counts little at first: scores are ``(1 - w) * time + w * location``, where w rises to 1/2 at the end.
*psi* is the steepness of that rise (Kang et al. 2022, who use 2 to 15; see docs/how-to/streaming.md).
"""

import sys

import numpy as np

from hw_model.errors import InputError
from hw_model.values import FloatArray, IntArray


def location_share(psi: float, step: IntArray, steps: int) -> FloatArray:
    """Return w = 1 / (1 + exp(-psi (t / T - 1))) after step t of T, which rises to 1/2 (Kang et al. 2022).

    After the recording's last step, w stays at 1/2.
    """
    progress = np.minimum(step, steps) / steps
    # With a large psi, exp overflows to infinity in early steps, which gives the right limit: a share of 0.
    with np.errstate(over="ignore"):
        return 1.0 / (1.0 + np.exp(-float(psi) * (progress - 1.0)))


def check_psi(psi: float) -> None:
    """Raise InputError for a psi that is negative, infinite or not a number."""
    # Written as `not ...`, since NaN fails every comparison.
    if not 0 <= psi <= sys.float_info.max:
        raise InputError(
            "psi",
            "it is not a valid rate",
            measured=f"got {psi}",
            fix="Give 0 or more, such as 10.",
        )
