"""The type ``Recordings``: it copies its arrays and makes them read-only, and refuses arrays that are no recordings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError


def test_arrays_are_copied_and_read_only() -> None:
    spikes = np.zeros((2, 3, 4))
    recordings = Recordings(
        spikes, np.array([0, 1], dtype=np.int32), step_seconds=0.02, source="x.npy"
    )
    spikes[0, 0, 0] = 1
    assert recordings.spikes.sum() == 0
    assert (recordings.spikes.dtype, recordings.spikes.flags.writeable) == (
        np.dtype(np.uint8),
        False,
    )
    assert recordings.labels is not None
    assert (recordings.labels.dtype, recordings.labels.flags.writeable) == (
        np.dtype(np.int64),
        False,
    )
    assert len(recordings) == 2


def test_subset_takes_rows_in_order() -> None:
    spikes = (np.arange(5)[:, None, None] % 2) * np.ones((5, 2, 2))
    part = Recordings(spikes, np.arange(5), step_seconds=0.5, source="x.npy").subset([3, 0])
    assert part.labels is not None
    assert part.labels.tolist() == [3, 0]
    assert part.spikes[:, 0, 0].tolist() == [1, 0]
    assert part.step_seconds == 0.5
    assert part.source == "x.npy"


def one(value: float) -> np.ndarray:
    """Return two recordings of 3 steps and 4 channels, all 0 except the last bin of the last recording."""
    spikes = np.zeros((2, 3, 4))
    spikes[1, 2, 3] = value
    return spikes


FIX = "Give binned recordings of zeros and ones."
NUMBERS = (
    "Give binned recordings of zeros and ones; numbers go to layers on the host (locsnn-compile "
    "--host-layers)."
)


@pytest.mark.parametrize(
    ("spikes", "labels", "seconds", "message"),
    [
        pytest.param(
            one(2),
            None,
            None,
            f"its values are not all 0 or 1 (2.0 at sample 1, channel 3, step 2). {NUMBERS}",
            id="a count",
        ),
        pytest.param(
            one(np.nan),
            None,
            None,
            f"its values are not all 0 or 1 (nan at sample 1, channel 3, step 2). {NUMBERS}",
            id="NaN",
        ),
        pytest.param(
            np.zeros((0, 3, 4)),
            None,
            None,
            f"no recordings inside (shape (0, 3, 4)). {FIX}",
            id="no samples",
        ),
        pytest.param(
            np.zeros((2, 0, 4)),
            None,
            None,
            f"no recordings inside (shape (2, 0, 4)). {FIX}",
            id="no steps",
        ),
        pytest.param(
            np.zeros((3, 4)),
            None,
            None,
            "its number of axes is wrong (2 against 3). Give an array (samples, steps, channels).",
            id="two axes",
        ),
        pytest.param(
            np.zeros((1, 1, 1), dtype=complex),
            None,
            None,
            f"its values are not numbers (dtype complex128). {FIX}",
            id="complex",
        ),
        pytest.param(
            np.zeros((2, 3, 4)),
            np.array([0]),
            None,
            "labels and recordings differ in number ((1,) against (2,)). "
            "Give one class number from 0 up per recording.",
            id="too few labels",
        ),
        pytest.param(
            np.zeros((2, 3, 4)),
            np.array([0, -1]),
            None,
            "its labels are not class numbers (-1 of recording 1 against 0..100000). "
            "Give one class number from 0 up per recording.",
            id="negative label",
        ),
        pytest.param(
            np.zeros((2, 3, 4)),
            np.array([0, np.nan]),
            None,
            "its labels are not class numbers (nan of recording 1 against 0..100000). "
            "Give one class number from 0 up per recording.",
            id="NaN label",
        ),
        pytest.param(
            np.zeros((2, 3, 4)),
            None,
            0.0,
            "step_seconds must be above 0 and at most 1e+06 (got 0.0). Give the width of a bin.",
            id="no bin width",
        ),
        pytest.param(
            np.zeros((2, 3, 4)),
            None,
            1e300,
            "step_seconds must be above 0 and at most 1e+06 (got 1e+300). Give the width of a bin.",
            id="a bin of ages",
        ),
    ],
)
def test_arrays_that_are_no_recordings_are_refused(
    spikes: np.ndarray, labels: Any, seconds: float | None, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        Recordings(spikes, labels, seconds, "x.npy")
    assert str(caught.value) == f"recordings 'x.npy': {message}"
