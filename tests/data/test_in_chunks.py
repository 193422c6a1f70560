"""Recordings read in chunks are equal to those read at once, with equal errors.

Only ``.npy`` files are read in chunks, which keeps large files out of memory; others come as one chunk.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from locsnn_compile.data.read import read_in_chunks, read_recordings
from locsnn_compile.data.recordings import OPEN, Expected
from locsnn_compile.errors import InputError

TWENTY = (np.random.default_rng(0).random((20, 39, 2, 7)) < 0.3).astype(np.uint8)
NO_OPTIONS = {"step_seconds": None, "threshold": None, "steps": None}


def sizes(path: Path, model: Expected = OPEN, many: int = 6, **options: Any) -> list[int]:
    """Check that chunks of ``many`` recordings are those read at once, and return the size of each chunk."""
    chunks = list(read_in_chunks(str(path), many, model=model, **NO_OPTIONS | options))
    at_once = read_recordings(path, model=model, **options)
    assert np.array_equal(np.concatenate([chunk.spikes for chunk in chunks]), at_once.spikes)
    labels = [chunk.labels for chunk in chunks]
    if at_once.labels is None:
        assert labels == [None] * len(chunks)
    else:
        assert np.array_equal(np.hstack(labels), at_once.labels)
    for chunk in chunks:
        assert chunk.source == at_once.source
        assert chunk.step_seconds == at_once.step_seconds
        assert chunk.origin == at_once.origin
        assert chunk.binned == at_once.binned
    return [len(chunk) for chunk in chunks]


@pytest.mark.parametrize(
    ("array", "chunk_sizes"),
    [
        (TWENTY, [6, 6, 6, 2]),
        (TWENTY.reshape(20, 78, 7), [6, 6, 6, 2]),
        (TWENTY.astype(np.float32), [6, 6, 6, 2]),
        (TWENTY.astype(np.bool_), [6, 6, 6, 2]),
        (np.repeat(TWENTY, 2, axis=0)[:, :, 0], [6, 6, 6, 6, 6, 6, 4]),
        (TWENTY[:6], [6]),
        (TWENTY[0], [1]),
        (TWENTY[0].reshape(78, 7), [1]),
        (np.asfortranarray(TWENTY), [20]),
    ],
    ids=[
        "taxels",
        "channels",
        "floats",
        "booleans",
        "sizes of an order in the last four",
        "one chunk",
        "one recording",
        "one of channels",
        "Fortran's order",
    ],
)
def test_a_file_in_chunks(
    tmp_path: Path, array: np.ndarray[Any, Any], chunk_sizes: list[int]
) -> None:
    np.save(tmp_path / "x.npy", array)
    assert sizes(tmp_path / "x.npy") == chunk_sizes


def test_a_last_chunk_of_two_recordings_is_not_taken_for_polarities(tmp_path: Path) -> None:
    """Two recordings of 39 channels have the sizes of (polarities, taxels, steps); all eight have not."""
    np.save(tmp_path / "x.npy", TWENTY[:8, :, 0])
    assert sizes(tmp_path / "x.npy") == [6, 2]


def test_chunks_have_labels_and_what_a_model_expects(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", TWENTY)
    np.save(tmp_path / "x_labels.npy", np.arange(20) % 3)
    assert sizes(
        tmp_path / "x.npy",
        Expected("model 'm'", step_seconds=0.02, threshold=0, steps=7, channels=78),
    ) == [6, 6, 6, 2]


def test_with_options_or_from_other_files_all_come_in_one_chunk(tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", TWENTY)
    assert sizes(tmp_path / "x.npy", steps=9) == [20]
    np.savez(tmp_path / "x.npz", spikes=TWENTY)
    assert sizes(tmp_path / "x.npz") == [20]


def damaged(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def graded(path: Path) -> None:
    array = np.load(path)
    array[17, 3, 1, 5] = 2
    np.save(path, array)


def labels_of_others(path: Path) -> None:
    np.save(path.with_name("x_labels.npy"), np.arange(19))


def other_order(path: Path) -> None:
    np.save(path, np.load(path).transpose(0, 3, 1, 2))


def gone(path: Path) -> None:
    path.unlink()


def text(path: Path) -> None:
    np.save(path, np.array(["a"] * 20))


@pytest.mark.parametrize(
    "spoil", [damaged, graded, labels_of_others, other_order, gone, text], ids=lambda f: f.__name__
)
def test_errors_are_the_same_in_chunks_and_at_once(tmp_path: Path, spoil: Any) -> None:
    np.save(tmp_path / "x.npy", TWENTY)
    spoil(tmp_path / "x.npy")
    with pytest.raises(InputError) as at_once:
        read_recordings(tmp_path / "x.npy")
    with pytest.raises(InputError) as in_chunks:
        list(read_in_chunks(str(tmp_path / "x.npy"), 6, model=OPEN, **NO_OPTIONS))
    assert str(in_chunks.value) == str(at_once.value)


def test_a_file_that_becomes_shorter_while_it_is_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npy"
    np.save(path, TWENTY)
    chunks = read_in_chunks(str(path), 6, model=OPEN, **NO_OPTIONS)
    assert len(next(chunks)) == 6
    path.write_bytes(path.read_bytes()[:-600])
    with pytest.raises(InputError) as caught:
        list(chunks)
    assert str(caught.value) == "file 'x.npy': it became shorter while it was read. Start again."
