"""Place the floor of a potential on the chip, whose voltage register can only end at ``1 - 2^k`` below.

A floor is the lowest value of a neuron's potential. Both k and the scale of the potential can be chosen: the scale is
lowered until the float floor lies at one of the limits, or nearly so.
"""

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.values import FloatArray, Frozen, IntArray
from locsnn_compile.passes.rounding.task import Task

TOLERANCE = 0.01
"""The floor may move by this share of the threshold, or of itself if it is deeper, to reach ``1 - 2^k``.

Chosen by hand.
"""


class FloorScale(Frozen, eq=False):
    """Threshold mantissas that put the floors of neurons onto a lower limit of the register; both (n,)."""

    threshold: IntArray
    vmin: IntArray


def floor_scale(task: Task, depth: FloatArray, mantissa_max: int, over: int) -> FloorScale:
    """Return the largest thresholds, at most ``mantissa_max``, with which floors are nearest to one ``1 - 2^k``.

    ``depth`` (n,): how far floors are below 0, in thresholds. In the register, the float threshold is ``over`` more
    than that of the mantissa. All neurons with a floor below 0 get the same limit, since a core has one. Raises
    ``TargetError`` if a floor would move by more than :data:`TOLERANCE`.
    """
    # A floor of 0 is exact at any scale.
    below = depth > 0
    threshold = np.full(len(depth), mantissa_max, dtype=np.int64)
    vmin = np.zeros(len(depth), dtype=np.int64)
    if not below.any():
        return FloorScale(threshold, vmin)
    # At the largest scale, the shallowest floor lies here. A deeper limit would need a larger threshold for it.
    shallowest = (loihi.threshold_of(mantissa_max) + over) * float(depth[below].min())
    limit = -loihi_inverse.deepest_minimum(shallowest, task.chip.registers)
    if limit > 0:
        # Lower each threshold until the neuron's floor lies at the limit.
        exact_threshold = loihi.in_units(limit / depth[below] - over)
        threshold[below] = np.clip(np.rint(exact_threshold), 1, mantissa_max).astype(np.int64)
    vmin[below] = -limit
    moved = np.abs(limit / (loihi.threshold_of(threshold[below]) + over) - depth[below])
    allowed = TOLERANCE * np.maximum(depth[below], 1)
    if (moved > allowed).any():
        worst = int(np.argmax(moved / allowed))
        measured = (
            f"a floor of {-depth[below][worst]:.4g} thresholds would move by {moved[worst]:.3g}"
        )
        fix = "Use a floor nearer to the threshold, or thresholds that differ less."
        raise task.no_scale("floor of the potential", measured, fix)
    return FloorScale(threshold, vmin)
