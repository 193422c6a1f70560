"""The share of the location branch while a recording plays."""

import sys

import numpy as np

from hw_model.errors import InputError
from hw_model.values import FloatArray, IntArray


def location_share(psi: float, step: IntArray, steps: int) -> FloatArray:
    """Return w = 1 / (1 + exp(-psi (t / T - 1))) after step t of T, which rises to 1/2 (Kang et al. 2022)."""
    with np.errstate(over="ignore"):  # a large psi counts as 0 what is early
        return 1.0 / (1.0 + np.exp(-float(psi) * (np.minimum(step, steps) / steps - 1.0)))


def check_psi(psi: float) -> None:
    """Refuse a psi that is negative or not a number."""
    if not 0 <= psi <= sys.float_info.max:
        raise InputError(
            "psi",
            "it is not a valid rate",
            measured=f"got {psi}",
            fix="Give 0 or more, such as 10.",
        )
