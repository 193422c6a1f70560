"""A surface of a sensor as a picture: a grid as it is, the taxels of a NeuTouch fingertip on a frame of 9 x 7 cells."""

import numpy as np

from hw_model.values import IntArray
from locsnn_compile.data.sensor import FRAME_OF_TAXELS, SensorLayout
from locsnn_compile.errors import InputError

LEAST = 5
"""Rows and columns of which two kernels of 3 leave any."""


def frame_size(layout: SensorLayout) -> tuple[int, int]:
    """Return the rows and columns of the frame that a surface is laid out on: those of a grid, or 9 x 7 of NeuTouch.

    Raises ``InputError`` for any other sensor, and for a grid that is too small to convolve twice.
    """
    if layout.is_neutouch:
        return len(FRAME_OF_TAXELS), len(FRAME_OF_TAXELS[0])
    rows = layout.taxels // (layout.columns or layout.taxels)
    if layout.columns is None or min(rows, layout.columns) < LEAST:
        what = f"its frames need a grid of at least {LEAST} x {LEAST} taxels"
        fix = "Give --grid WxH of the sensor, or take another network."
        raise InputError("network 'cnn-3d'", what, measured=f"sensor {layout.name!r}", fix=fix)
    return rows, layout.columns


def frame_cells(layout: SensorLayout) -> IntArray:
    """Return the cell of every taxel of a surface that has a frame, (taxels,), counted row by row from 0."""
    if layout.columns is not None:
        return np.arange(layout.taxels)
    flat = np.array(FRAME_OF_TAXELS).ravel()
    return np.array([int(np.flatnonzero(flat == taxel)[0]) for taxel in range(1, layout.taxels + 1)])
