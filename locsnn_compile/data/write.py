"""Write recordings in every format that is read, whole or not at all; equal recordings give equal bytes."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw_model.io.build_folder import check_folder, write_build
from hw_model.io.files import pack_arrays, replace_file
from locsnn_compile.data.arrays import label_in_name
from locsnn_compile.data.event_stream import STEP_SECONDS, recording_events
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.data.slayer_events import COLUMNS, pack_slayer_events
from locsnn_compile.data.structured import structured_events
from locsnn_compile.data.tact import CHANNELS, GRASP_SECONDS, tact_text
from locsnn_compile.errors import InputError, did_you_mean

MEMBER_KINDS = ("npy", "events", "bs1", "bs2", "tact")
"""What the files of a folder or archive may be; ``events`` are structured arrays in ``.npy`` files."""
SUFFIXES = (".npz", ".npy", ".pt", ".tact", ".bs1", ".bs2", ".zip")
#: Narrowest bin that times in whole microseconds tell apart.
MIN_EVENT_STEP_SECONDS = 2e-6


@dataclass(frozen=True)
class NotHeld:
    """What the format does not say, by the option of ``read_recordings`` that gives it back."""

    options: dict[str, int | float]


def write_recordings(
    path: Path | str, recordings: Recordings, *, members: str = "npy", structured: bool = False
) -> NotHeld:
    """Write ``recordings`` in the format that the ending of ``path`` names; without one, a folder.

    ``.npz`` and ``.pt`` hold everything. ``.npy``, ``.tact``, ``.bs1`` and ``.bs2`` hold one array or recording, with a
    label where the name has it (``_label_<k>``). A folder or ``.zip`` gets a file for each recording, of the kind
    ``members``. ``structured``: ``.npy`` and ``.npz`` of one recording hold its events as Tonic does.

    Returns what has to be given to read the same recordings again. Raises ``InputError`` for what a format cannot hold,
    and where the file cannot be written.
    """
    path = Path(path)
    where = f"file {path.name!r}"
    _check_kinds(where, path.suffix, members)
    if path.suffix in ("", ".zip"):
        files = _member_files(recordings, members, where)
        if path.suffix == ".zip":
            replace_file(path, _zip(files), where)
        else:
            _write_folder(path, files)
        return _not_held(recordings, members, startend=True)
    kind = "events" if structured and path.suffix in (".npy", ".npz") else path.suffix[1:]
    if path.suffix in (".npz", ".pt") and kind != "events":
        entries = _entries(recordings)
        content = pack_arrays(entries, compressed=False) if kind == "npz" else _torch_bytes(entries)
        replace_file(path, content, where)
        return NotHeld({})
    _check_label(path, recordings, where)
    if path.suffix == ".npz":
        replace_file(path, _structured_npz(recordings, where), where)
        return _not_held(recordings, kind, width_held=True)
    if path.suffix == ".npy" and kind == "npy":
        replace_file(path, _npy(_channel_major(recordings.spikes)), where)
        return _not_held(recordings, kind)
    files = _one_file(recordings, 0, kind, path.stem, where)
    if kind == "tact":
        _check_starts_at_once(recordings, where)
    replace_file(path, files[path.name], where)
    return _not_held(recordings, kind)


def _check_kinds(where: str, suffix: str, members: str) -> None:
    if suffix and suffix not in SUFFIXES:
        raise InputError(where, f"files ending in {suffix!r} are not written", fix=did_you_mean(suffix, SUFFIXES))
    if members not in MEMBER_KINDS:
        raise InputError("members", f"{members!r} is not known", fix=did_you_mean(members, MEMBER_KINDS))


def _check_label(path: Path, recordings: Recordings, where: str) -> None:
    """Refuse a single file for several recordings of events, and labels that its name does not say."""
    binned = path.suffix == ".npy"
    if len(recordings) > 1 and not binned:
        raise InputError(
            where,
            "it holds one recording",
            measured=f"got {len(recordings)}",
            fix="Write a folder or .zip, with members.",
        )
    label = label_in_name(path.name) if len(recordings) == 1 else None
    wanted = None if recordings.labels is None else recordings.labels.tolist()
    if wanted != (None if label is None else [label]):
        raise InputError(
            where,
            "labels are not held by it, and its name does not say these",
            measured="none" if wanted is None else f"{len(wanted)} of them" if len(wanted) > 1 else f"{wanted[0]}",
            fix="Write .npz, .pt, a folder or .zip, or one recording with _label_<k> in its name.",
        )


def _entries(recordings: Recordings) -> dict[str, NDArray[Any]]:
    entries: dict[str, NDArray[Any]] = {"spikes": _channel_major(recordings.spikes)}
    if recordings.labels is not None:
        entries["labels"] = recordings.labels
    if recordings.step_seconds is not None:
        entries["step_seconds"] = np.array(recordings.step_seconds, dtype=np.float64)
    return entries


def _channel_major(spikes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(spikes.swapaxes(-1, -2))


def _torch_bytes(entries: dict[str, NDArray[Any]]) -> bytes:
    import torch

    content = io.BytesIO()
    torch.save({name: torch.tensor(entry) for name, entry in entries.items()}, content)
    return content.getvalue()


def _structured_npz(recordings: Recordings, where: str) -> bytes:
    entries: dict[str, NDArray[Any]] = {"events": _structured(recordings, 0, where)}
    if recordings.labels is not None:
        entries["labels"] = recordings.labels
    entries["step_seconds"] = np.array(_width(recordings), dtype=np.float64)
    return pack_arrays(entries, compressed=False)


def _npy(array: NDArray[Any]) -> bytes:
    content = io.BytesIO()
    np.lib.format.write_array(content, array, version=(1, 0), allow_pickle=False)
    return content.getvalue()


def _polarities(recordings: Recordings) -> int:
    """Return the polarities of a cell: those of the sensor, where there are channels of whole fingertips."""
    return POLARITIES if recordings.spikes.shape[2] % (TAXELS * POLARITIES) == 0 else 1


def _width(recordings: Recordings) -> float:
    return STEP_SECONDS if recordings.step_seconds is None else recordings.step_seconds


def _structured(recordings: Recordings, index: int, where: str) -> NDArray[np.void]:
    times, cell, polarity = _timed(recordings, index, where)
    return structured_events(times, cell, polarity)


def _timed(
    recordings: Recordings, index: int, where: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    width = _width(recordings)
    if width < MIN_EVENT_STEP_SECONDS:
        raise InputError(
            where,
            "its bins are too narrow for times in microseconds",
            measured=f"{width:g} s against {MIN_EVENT_STEP_SECONDS:g}",
            fix="Write .npz.",
        )
    return recording_events(recordings.spikes[index], _polarities(recordings), width)


def _one_file(recordings: Recordings, index: int, kind: str, stem: str, where: str) -> dict[str, bytes]:
    """Return the files of one recording by name."""
    spikes = recordings.spikes[index]
    if kind == "npy":
        return {f"{stem}.npy": _npy(_channel_major(spikes))}
    if kind == "events":
        return {f"{stem}.npy": _npy(_structured(recordings, index, where))}
    if kind == "tact":
        return _tact_files(recordings, index, stem, where)
    times, cell, polarity = _timed(recordings, index, where)
    if kind == "bs1":
        return {f"{stem}.bs1": pack_slayer_events(times, cell, None, polarity, where)}
    return {f"{stem}.bs2": pack_slayer_events(times, cell % COLUMNS, cell // COLUMNS, polarity, where)}


def _tact_files(recordings: Recordings, index: int, stem: str, where: str) -> dict[str, bytes]:
    spikes = recordings.spikes[index]
    if spikes.shape[1] not in (CHANNELS, CHANNELS // 2):
        raise InputError(
            where,
            "raw text is of one or two fingertips",
            measured=f"{spikes.shape[1]} channels against {CHANNELS // 2} or {CHANNELS}",
            fix="Write .npz.",
        )
    if not spikes.any():
        raise InputError(where, f"recording {index} is silent, which raw text cannot say", fix="Write .npz.")
    return {f"{stem}.tact": tact_text(spikes, _width(recordings)), f"{stem}.startend": b"grasping 0\n"}


def _check_starts_at_once(recordings: Recordings, where: str) -> None:
    if not recordings.spikes[0, 0].any():
        raise InputError(
            where,
            "its first steps are silent, and without a .startend file a recording begins with its first event",
            fix="Write a folder or .zip with members tact.",
        )


def _member_files(recordings: Recordings, kind: str, where: str) -> dict[str, bytes]:
    digits = len(str(len(recordings) - 1))
    files: dict[str, bytes] = {}
    for index in range(len(recordings)):
        label = "" if recordings.labels is None else f"_label_{recordings.labels[index]}"
        files |= _one_file(recordings, index, kind, f"sample_{index:0{digits}}{label}", where)
    return files


def _zip(files: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0)), content)
    return packed.getvalue()


def _write_folder(path: Path, files: dict[str, bytes]) -> None:
    check_folder(path)
    if path.is_dir() and any(path.iterdir()):
        raise InputError(
            f"folder {path.name!r}", "it is not empty, and recordings would mix", fix="Name a new folder, or a .zip."
        )
    write_build(path, files)


def _not_held(recordings: Recordings, kind: str, *, width_held: bool = False, startend: bool = False) -> NotHeld:
    """Return what a file of this kind leaves open: what would be read otherwise without it."""
    _, steps, channels = recordings.spikes.shape
    width = _width(recordings)
    options: dict[str, int | float] = {}
    if recordings.step_seconds is not None and not width_held and (kind == "npy" or width != STEP_SECONDS):
        options["step_seconds"] = recordings.step_seconds
    if kind == "npy":
        return NotHeld(options)
    active_channels = int(np.flatnonzero(recordings.spikes.any(axis=(0, 1))).max(initial=-1)) + 1
    active_steps = int(np.flatnonzero(recordings.spikes.any(axis=(0, 2))).max(initial=-1)) + 1
    if kind == "tact":
        if channels != CHANNELS:
            options["channels"] = channels
        if steps != (round(GRASP_SECONDS / width) if startend else active_steps):
            options["steps"] = steps
        return NotHeld(options)
    if -(-active_channels // _polarities(recordings)) * _polarities(recordings) != channels:
        options["channels"] = channels
    if active_steps != steps:
        options["steps"] = steps
    if _polarities(recordings) == 2 and not recordings.spikes[:, :, 1::2].any():
        options["polarities"] = 2
    if kind == "bs2" and channels > COLUMNS * _polarities(recordings) and not _last_column_active(recordings):
        options["columns"] = COLUMNS
    return NotHeld(options)


def _last_column_active(recordings: Recordings) -> bool:
    cells = np.flatnonzero(recordings.spikes.any(axis=(0, 1))) // _polarities(recordings)
    return bool((cells % COLUMNS == COLUMNS - 1).any())
