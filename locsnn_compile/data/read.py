"""Read recordings of any supported format."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.io.given import checked
from locsnn_compile.data.archives import archive_parts, read_archive
from locsnn_compile.data.arrays import HDF5_SUFFIXES, labels_beside, read_arrays
from locsnn_compile.data.axes import check_axes, is_one, parse_axes
from locsnn_compile.data.division import PREPROCESSED, Division
from locsnn_compile.data.event_stream import Binning
from locsnn_compile.data.member_names import EVENT_SUFFIXES, PARTS
from locsnn_compile.data.recordings import MAX_ELEMENTS, OPEN, Expected, Recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError, check_known

_SUFFIXES = (".zip", ".npy", ".npz", ".pt", *HDF5_SUFFIXES, *EVENT_SUFFIXES)


@checked
def read_recordings(
    path: Path | str,
    *,
    split: str | None = None,
    step_seconds: float | None = None,
    threshold: int | None = None,
    channels: int | None = None,
    steps: int | None = None,
    polarities: int | None = None,
    columns: int | None = None,
    axes: str | None = None,
    sensor: SensorLayout | None = None,
    test_share: float | None = None,
    fold: int | None = None,
    model: Expected = OPEN,
) -> Recordings:
    """Return the recordings at ``path``, of whatever supported format.

    A ``.zip`` or folder of ``.npy`` or files of events, one recording each, or one file of these, or ``.npz``,
    ``.pt`` or HDF5. ``split`` is ``train`` or ``test`` of an archive or folder that is so divided (None: ``test``);
    what has no parts is divided by ``test_share`` and ``fold``: see :class:`locsnn_compile.data.division.Division`.
    Events are binned as :class:`locsnn_compile.data.event_stream.Binning` says, by the options and by what ``model``
    expects. Arrays are bins already, (samples, channels, steps) unless ``axes`` or the file names another order, such
    as ``samples,steps,channels``; ``step_seconds`` is their width where the file does not say it. ``steps`` of a
    recording: a shorter one is followed by silence, of a longer one the end is cut; without, all of an archive or
    folder are as long as the longest. ``sensor`` says ``channels``, ``polarities`` and ``columns`` at once; what has
    other channels is refused. Every unusable input, and an option that contradicts the model or the file, is one
    ``InputError``.
    """
    path = _file_of(Path(path))
    division = Division(test_share, fold)
    counts = {"threshold": threshold, "polarities": polarities, "columns": columns}
    if sensor is not None:
        channels, polarities, columns = sensor.channels, sensor.polarities, sensor.columns
        counts = {"threshold": threshold}
    order = None if axes is None else parse_axes(axes, "axes")
    asked = Binning(step_seconds, threshold, channels, steps, polarities, columns, axes=order)
    asked.check()
    check_known("split", f"{split!r} is not known", split, PARTS)
    said = {name: getattr(asked, name) for name in ("step_seconds", "threshold", "channels", "polarities", "columns")}
    agreed = model.agreed(**said, steps=steps) | {"steps": steps}
    divided = division.divides(path)
    found = _read(path, None if divided else split, replace(asked, **agreed, most_steps=model.steps), step_seconds)
    if divided:
        found = division.part(found, path, split or "test")
    if found.threshold is None:
        for name in (name for name, value in counts.items() if value is not None):
            raise InputError(name, f"{found.source!r} holds bins and no single events to count", fix="Leave it out.")
    held = found.spikes.shape[2]
    if channels is not None and held != channels:
        (sensor or SensorLayout(f"{channels} channels", channels)).check_channels(held, f"recordings {found.source!r}")
    model.check(found)
    return found if steps is None else found.with_steps(steps)


def _read(path: Path, split: str | None, binning: Binning, asked: float | None) -> Recordings:
    if not (path.is_dir() or path.suffix == ".zip"):
        _check_file(path)
        if split is not None:
            measured = "a single file is not divided"
            fix = "Leave the part out."
            raise InputError(f"file {path.name!r}", f"there is no part {split!r}", measured=measured, fix=fix)
        if path.suffix not in EVENT_SUFFIXES:
            return read_arrays(path, binning, asked)
    return read_archive(path, split=split, binning=binning)


@checked
def recording_parts(path: Path | str, *, test_share: float | None = None) -> tuple[str, ...]:
    """Return the parts that ``path`` is divided into, of ``train`` and ``test``, by itself or by ``test_share``."""
    path = _file_of(Path(path))
    if Division(test_share).divides(path):
        return PARTS
    if path.is_dir() or path.suffix == ".zip":
        return archive_parts(path)
    _check_file(path)
    return ()


def _file_of(path: Path) -> Path:
    """Return the file of a folder of preprocessed recordings, or the path as it is."""
    return path / PREPROCESSED if (path / PREPROCESSED).is_file() else path


def _check_file(path: Path) -> None:
    if not path.exists():
        raise InputError(f"file {path.name!r}", "it does not exist", fix="Check the path.")
    if path.suffix not in _SUFFIXES:
        fix = f"Give one of: {', '.join(_SUFFIXES)}, or a folder."
        raise InputError(f"file {path.name!r}", "its kind is not known", measured=f"ending {path.suffix!r}", fix=fix)


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
