"""Where the floor of a potential comes to lie on the chip, whose registers end below at ``1 - 2^k``."""

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.values import FloatArray, Frozen, IntArray
from locsnn_compile.passes.rounding.task import Task

TOLERANCE = 0.01
"""The floor may move by this share of the threshold, or of itself if it is deeper, to reach ``1 - 2^k``."""


class FloorScale(Frozen, eq=False):
    """Threshold mantissas that put the floors of neurons onto a lower limit of the register; both (n,)."""

    threshold: IntArray
    vmin: IntArray


def floor_scale(task: Task, depth: FloatArray, mantissa_max: int, over: int) -> FloorScale:
    """Return the largest thresholds, at most ``mantissa_max``, with which floors are nearest to one ``1 - 2^k``.

    ``depth`` (n,): how far floors are below 0, in thresholds. A threshold is ``over`` more than
    its mantissa says in the register. All neurons with a floor below 0 get the same limit, since a core has one.
    Refuses floors that would move by more than :data:`TOLERANCE`.
    """
    below = depth > 0
    threshold = np.full(len(depth), mantissa_max, dtype=np.int64)
    vmin = np.zeros(len(depth), dtype=np.int64)
    if not below.any():
        return FloorScale(threshold, vmin)
    deepest_room = (loihi.threshold_of(mantissa_max) + over) * float(depth[below].min())
    lowest = -loihi_inverse.deepest_minimum(deepest_room, task.chip.registers)
    if lowest > 0:
        wanted = loihi.in_units(lowest / depth[below] - over)
        threshold[below] = np.clip(np.rint(wanted), 1, mantissa_max).astype(np.int64)
    vmin[below] = -lowest
    moved = np.abs(lowest / (loihi.threshold_of(threshold[below]) + over) - depth[below])
    allowed = TOLERANCE * np.maximum(depth[below], 1)
    if (moved > allowed).any():
        worst = int(np.argmax(moved / allowed))
        measured = (
            f"a floor of {-depth[below][worst]:.4g} thresholds would move by {moved[worst]:.3g}"
        )
        fix = "Use a floor nearer to the threshold, or thresholds that differ less."
        raise task.no_scale("floor of the potential", measured, fix)
    return FloorScale(threshold, vmin)
