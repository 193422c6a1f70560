"""Recordings of a file some at a time: memory does not grow with their number."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from locsnn_compile.data.arrays import labels_beside
from locsnn_compile.data.axes import check_axes, is_one
from locsnn_compile.data.expected import Expected
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import MAX_ELEMENTS, Recordings
from locsnn_compile.errors import InputError


def read_in_chunks(path: str, many: int, *, model: Expected, **asked: Any) -> Iterator[Recordings]:
    """Yield the recordings that :func:`read_recordings` returns, at most so many at a time from a ``.npy`` of bins.

    Other files are read at once: the longest of their recordings decides the steps of all. What is wrong with a
    recording is found when its turn comes.
    """
    chunks = _chunks(Path(path), many, model) if {*asked.values()} == {None} else None
    return iter([read_recordings(path, model=model, **asked)]) if chunks is None else chunks


def _chunks(path: Path, many: int, model: Expected) -> Iterator[Recordings] | None:
    """Return the chunks of a file; None where it is of another kind, or :func:`read_recordings` says what is wrong."""
    try:
        mapped = np.load(path, mmap_mode="r")
        shape, dtype, begin = mapped.shape, mapped.dtype, mapped.offset
        one = math.prod(shape[1:])
        if (
            len(shape) not in (3, 4)
            or is_one(shape, model.channels)
            or not (mapped.flags.c_contiguous and 0 < one * many)
        ):
            return None
    # A hostile header meets numpy's parser in many ways.
    except Exception:
        return None
    labels = labels_beside(path, shape[0])
    if dtype.kind not in "biuf" or one * many > MAX_ELEMENTS or (labels is not None and len(labels) != shape[0]):
        return None
    # Sizes tell an order where all recordings are seen, not where a few are.
    check_axes(mapped, f"file {path.name!r}", model.channels)

    def chunks() -> Iterator[Recordings]:
        for start in range(0, shape[0], many):
            count = min(many, shape[0] - start)
            read = np.fromfile(path, dtype, count * one, offset=begin + start * one * dtype.itemsize)
            if len(read) < count * one:
                raise InputError(f"file {path.name!r}", "it became shorter while it was read", fix="Start again.")
            bins = read.reshape(count, -1, shape[-1]).transpose(0, 2, 1)
            its = None if labels is None else labels[start : start + count]
            yield Recordings(bins, its, model.step_seconds, path.name, first=start)

    return chunks()
