"""A fingertip as a picture: where its taxels lie on the 9 x 7 frames of a convolutional network."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from locsnn_compile.data.sensor import TAXELS

#: Taxel numbers by row (y from -8.9 to 8.9 mm) and column (x from -6 to 6 mm); 0 where there is none. Every taxel has a
#: cell of its own, so that the squared distances between taxels and the middles of their cells add up to the least.
FRAME_OF_TAXELS: tuple[tuple[int, ...], ...] = (
    (0, 4, 11, 0, 25, 35, 0),
    (0, 0, 0, 18, 0, 0, 0),
    (0, 7, 0, 20, 29, 30, 0),
    (2, 9, 12, 16, 23, 33, 37),
    (1, 6, 15, 21, 27, 34, 39),
    (3, 10, 14, 17, 24, 31, 38),
    (0, 8, 0, 22, 28, 32, 0),
    (0, 0, 0, 19, 0, 0, 0),
    (0, 5, 13, 0, 26, 36, 0),
)


def frame_cells() -> npt.NDArray[np.int64]:
    """Return the cell of every taxel, (taxels,), counted row by row from 0."""
    flat = np.array(FRAME_OF_TAXELS).ravel()
    return np.array([int(np.flatnonzero(flat == taxel)[0]) for taxel in range(1, TAXELS + 1)])
