"""A fingertip as a picture: where its taxels lie on the 9 x 7 frames of a convolutional network."""

import numpy as np
import numpy.typing as npt

from locsnn_compile.data.sensor import FRAME_OF_TAXELS, TAXELS


def frame_cells() -> npt.NDArray[np.int64]:
    """Return the cell of every taxel, (taxels,), counted row by row from 0."""
    flat = np.array(FRAME_OF_TAXELS).ravel()
    return np.array([int(np.flatnonzero(flat == taxel)[0]) for taxel in range(1, TAXELS + 1)])
