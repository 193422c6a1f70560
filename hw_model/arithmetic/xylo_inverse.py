"""From numbers of a trained network to settings of :mod:`hw_model.arithmetic.xylo`.

A trained neuron loses a share 0..1 of its current and of its potential in each step. A Xylo loses
2^-dash of them. Functions say where they leave rounding out.
"""

import numpy as np

from hw_model.arithmetic.xylo import DASH_MAX, share_lost
from hw_model.values import FloatArray, IntArray


def nearest_dash(lost: FloatArray) -> IntArray:
    """Return the dashes whose decays are nearest to the shares (0..1) that a step loses, on a scale of octaves."""
    with np.errstate(divide="ignore"):
        dash = np.rint(-np.log2(lost))
    return np.clip(dash, 0, DASH_MAX).astype(np.int64)


def rounding_drift(dash_syn: IntArray, dash_mem: IntArray) -> FloatArray:
    """Return what a potential gains in a step, on average, because decays are rounded down.

    A register in motion has any remainder modulo 2^dash, so a decay takes away (1 - 2^-dash) / 2 too
    little. In a current this adds up to 2^dash as much. Registers at rest, and near it, gain less.
    """
    too_little_i = (1.0 - share_lost(dash_syn)) / 2
    too_little_v = (1.0 - share_lost(dash_mem)) / 2
    drift: FloatArray = too_little_i / share_lost(dash_syn) + too_little_v
    return drift


def peak_response(dash_syn: int, dash_mem: int, steps: int = 4096) -> float:
    """Return the highest potential after a charge of 1 at rest, if nothing is rounded.

    A charge loses its first share in the very step in which it acts, so that with dash 0 none ever reaches v.
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
    """Return what a current stays at or below while at most ``charge`` of its sign arrives in a step.

    A current at (charge + 1) 2^dash - 1 loses in a step what arrives in it.
    """
    return (np.asarray(charge) + 1) * 2.0 ** np.asarray(dash_syn) - 1
