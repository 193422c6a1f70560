"""Read recordings of any supported format."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.io.files import near
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
    """Return the recordings at ``path``, in any supported format.

    ``path`` is a ``.zip`` or folder with one recording per file (``.npy`` or events), one such file, or a ``.npz``,
    ``.pt`` or HDF5 file.

    - ``split``: ``train`` or ``test`` of an archive or folder that has these parts (None: ``test``). Recordings without
      parts are divided by ``test_share`` and ``fold``: see :class:`locsnn_compile.data.division.Division`.
    - Events are put into bins as :class:`locsnn_compile.data.event_stream.Binning` describes, according to the options
      and to what ``model`` expects. Arrays hold bins already: (samples, channels, steps), unless ``axes`` or the file
      names another order, such as ``samples,steps,channels``. ``step_seconds`` is their width if the file does not
      give it.
    - ``steps``: shorter recordings are padded with silence, longer ones are cut. Without it, all recordings of an
      archive or folder get the length of the longest.
    - ``sensor`` sets ``channels``, ``polarities`` and ``columns`` at once. Other channels are refused.

    Raises ``InputError`` for anything that cannot be used, and for an option that contradicts the model or the file.
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
            raise InputError(name, f"{found.source!r} holds bins, not single events to count", fix="Leave it out.")
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
    """Return which of the parts ``train`` and ``test`` the recordings at ``path`` have, or get from ``test_share``."""
    path = _file_of(Path(path))
    if Division(test_share).divides(path):
        return PARTS
    if path.is_dir() or path.suffix == ".zip":
        return archive_parts(path)
    _check_file(path)
    return ()


def _file_of(path: Path) -> Path:
    """Return the file inside a folder of preprocessed recordings; any other path as it is."""
    return path / PREPROCESSED if (path / PREPROCESSED).is_file() else path


def _check_file(path: Path) -> None:
    if not path.exists():
        raise InputError(f"file {path.name!r}", "it does not exist", fix=near(path, "Check the path."))
    if path.suffix not in _SUFFIXES:
        fix = f"Give one of: {', '.join(_SUFFIXES)}, or a folder."
        raise InputError(f"file {path.name!r}", "its kind is not known", measured=f"ending {path.suffix!r}", fix=fix)


def read_in_chunks(path: str, many: int, *, model: Expected, **asked: Any) -> Iterator[Recordings]:
    """Yield what :func:`read_recordings` returns, at most ``many`` recordings at a time if a ``.npy`` file holds bins.

    Other files are read at once, because their longest recording decides the length of all. A faulty recording is found
    when its turn comes.
    """
    chunks = _chunks(Path(path), many, model) if {*asked.values()} == {None} else None
    return iter([read_recordings(path, model=model, **asked)]) if chunks is None else chunks


def _chunks(path: Path, many: int, model: Expected) -> Iterator[Recordings] | None:
    """Return the chunks of a file; None for other files, and for those that :func:`read_recordings` will refuse."""
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
    # numpy's parser raises many kinds of exception on a damaged header.
    except Exception:
        return None
    labels = labels_beside(path, shape[0])
    if dtype.kind not in "biuf" or one * many > MAX_ELEMENTS or (labels is not None and len(labels) != shape[0]):
        return None
    # The whole array shows in which order its axes are; a chunk does not.
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
