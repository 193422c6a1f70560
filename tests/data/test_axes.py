"""Arrays with axes in an unusual order: recognised by the sizes of the axes, and refused by an error that names the order.

A NeuTouch fingertip has 39 taxels with two polarities, 78 channels; two fingertips have 156. Where sizes leave the order
open, an array is read in the usual order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings
from locsnn_compile.errors import InputError


@pytest.mark.parametrize(
    ("shape", "channels", "order", "usual_order"),
    [
        pytest.param((100, 78), None, "steps, channels", "channels, steps", id="one recording"),
        pytest.param(
            (48, 100, 78),
            None,
            "samples, steps, channels",
            "samples, channels, steps",
            id="step-major",
        ),
        pytest.param(
            (2, 39, 100),
            None,
            "polarities, taxels, steps",
            "taxels, polarities, steps",
            id="polarity before taxel",
        ),
        pytest.param(
            (100, 39, 2),
            None,
            "steps, taxels, polarities",
            "taxels, polarities, steps",
            id="steps first",
        ),
        pytest.param(
            (100, 2, 39),
            None,
            "steps, polarities, taxels",
            "taxels, polarities, steps",
            id="backwards",
        ),
        pytest.param(
            (78, 48, 100),
            None,
            "channels, samples, steps",
            "samples, channels, steps",
            id="channels first",
        ),
        pytest.param(
            (48, 2, 39, 100),
            None,
            "samples, polarities, taxels, steps",
            "samples, taxels, polarities, steps",
            id="polarity-major",
        ),
        pytest.param(
            (48, 100, 39, 2),
            78,
            "samples, steps, taxels, polarities",
            "samples, taxels, polarities, steps",
            id="taxels last",
        ),
        pytest.param(
            (9, 30, 20),
            20,
            "samples, steps, channels",
            "samples, channels, steps",
            id="another sensor",
        ),
        pytest.param(
            (30, 20), 20, "steps, channels", "channels, steps", id="one recording of another sensor"
        ),
    ],
)
def test_an_unusual_order_is_recognised_and_named(
    tmp_path: Path, shape: tuple[int, ...], channels: int | None, order: str, usual_order: str
) -> None:
    np.save(tmp_path / "a.npy", np.zeros(shape, dtype=np.uint8))
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.npy", channels=channels)
    sizes = " x ".join(map(str, shape))
    assert str(caught.value) == (
        f"file 'a.npy': its axes look like ({order}) ({sizes} values). "
        f"Give --axes {order.replace(', ', ',')}, or transpose it to ({usual_order}), as files have it."
    )


@pytest.mark.parametrize(
    ("shape", "channels", "shape_read"),
    [
        pytest.param((48, 78, 156), None, (48, 156, 78), id="both may be channels"),
        pytest.param((48, 100, 78), 100, (48, 78, 100), id="channels are given"),
        pytest.param((5, 30, 20), None, (5, 20, 30), id="no fingertip at all"),
        pytest.param((39, 2, 100), None, (1, 100, 78), id="one recording by taxels"),
        pytest.param((6, 100, 2, 50), None, (6, 50, 200), id="taxels of another sensor"),
    ],
)
def test_an_array_is_read_in_the_usual_order_if_its_sizes_leave_the_order_open(
    tmp_path: Path, shape: tuple[int, ...], channels: int | None, shape_read: tuple[int, ...]
) -> None:
    np.save(tmp_path / "a.npy", np.zeros(shape, dtype=np.uint8))
    assert read_recordings(tmp_path / "a.npy", channels=channels).spikes.shape == shape_read


def test_the_error_names_the_file_of_a_folder(tmp_path: Path) -> None:
    for i, shape in enumerate([(78, 40), (50, 78)]):
        np.save(tmp_path / f"sample_{i}_label_0.npy", np.zeros(shape, dtype=np.uint8))
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path)
    assert str(caught.value) == (
        f"folder {tmp_path.name!r}, 'sample_1_label_0.npy': its axes look like (steps, channels) (50 x 78 values). "
        "Give --axes steps,channels, or transpose it to (channels, steps), as files have it."
    )
