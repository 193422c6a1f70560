"""A fingertip as a picture: where its taxels lie on the 9 x 7 frames of a convolutional network."""

import numpy as np

from hw_model.arithmetic.arrays import IntArray
from locsnn_compile.data.sensor import FRAME_OF_TAXELS, TAXELS


def frame_cells() -> IntArray:
    """Return the cell of every taxel, (taxels,), counted row by row from 0."""
    flat = np.array(FRAME_OF_TAXELS).ravel()
    return np.array([int(np.flatnonzero(flat == taxel)[0]) for taxel in range(1, TAXELS + 1)])
