"""Convert numbers of a trained network to settings of :mod:`hw_model.arithmetic.xylo`, for the compiler.

A trained neuron loses a share 0..1 of its current i and of its potential v in each step. Xylo can
only lose 2^-dash of them, with one integer *dash* for i and one for v (``dash_syn``, ``dash_mem``).
Docstrings say where rounding is ignored.
"""

import numpy as np

from hw_model.arithmetic.xylo import DASH_MAX, share_lost
from hw_model.values import FloatArray, IntArray


def nearest_dash(lost: FloatArray) -> IntArray:
    """Return the dashes whose shares 2^-dash are nearest to the shares lost per step, 0..1, on a logarithmic scale."""
    # A share of 0 gives a dash of infinity, which is clipped below.
    with np.errstate(divide="ignore"):
        dash = np.rint(-np.log2(lost))
    return np.clip(dash, 0, DASH_MAX).astype(np.int64)


def rounding_drift(dash_syn: IntArray, dash_mem: IntArray) -> FloatArray:
    """Return what a potential gains per step, on average, because decays are rounded down.

    x >> dash drops a remainder below 1. For a register that keeps moving, the low dash bits are
    0 .. 2^dash - 1 with equal probability, so the decay subtracts (1 - 2^-dash) / 2 too little on
    average. In a current, which keeps 1 - 2^-dash of it from step to step, this accumulates to
    2^dash times as much, and all of that reaches the potential. Registers at rest, or near it,
    gain less.
    """
    too_little_i = (1.0 - share_lost(dash_syn)) / 2
    too_little_v = (1.0 - share_lost(dash_mem)) / 2
    drift: FloatArray = too_little_i / share_lost(dash_syn) + too_little_v
    return drift


def peak_response(dash_syn: int, dash_mem: int, steps: int = 4096) -> float:
    """Return the highest potential within ``steps`` steps after a single charge of 1, ignoring rounding.

    A current decays before it is added to v in the same step, so with dash_syn 0 nothing ever
    reaches v. With a and b for the shares that i and v keep in a step, n steps after the charge i
    is a^n, and v is the sum over k = 1..n of a^k b^(n-k), for which there is a closed form. The
    compiler compares the peak with that of a float neuron over the same 4096 steps.
    """
    kept_i = 1.0 - 2.0**-dash_syn
    kept_v = 1.0 - 2.0**-dash_mem
    row = np.arange(1, steps + 1, dtype=np.float64)
    i = kept_i**row
    if kept_i == kept_v:
        v = row * i
    else:
        v = kept_i * (kept_i**row - kept_v**row) / (kept_i - kept_v)
    return float(v.max())


def largest_current(charge: IntArray | int, dash_syn: IntArray | int) -> FloatArray:
    """Return a bound of a current to which at most ``charge`` of one sign is added in each step.

    A current decays by ``taken``, current >> dash, rounded down. The largest current from which this
    still subtracts no more than ``charge`` is (charge + 1) 2^dash - 1: from there it cannot grow.
    """
    return (np.asarray(charge) + 1) * 2.0 ** np.asarray(dash_syn) - 1
