"""EvTouch recordings, one ``sample_<i>_label_<k>.npy`` a recording, in a zip archive or a folder.

The published archives have the members ``Ev-*/train/...`` and ``Ev-*/test/...``; each member is one
recording, (taxels, polarities, steps). They are read straight from the archive and sorted by their sample
number.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locsnn_compile.data.npy import load_npy, to_step_major
from locsnn_compile.data.recordings import MAX_ELEMENTS, Recordings
from locsnn_compile.data.torch_file import read_bytes
from locsnn_compile.errors import InputError, did_you_mean

PARTS = ("train", "test")
#: Largest number of recordings, and of bytes of one of them unpacked.
MAX_MEMBERS, MAX_MEMBER_BYTES = 100_000, 100_000_000

_MEMBER = re.compile(r"sample_(\d{1,9})_label_(\d{1,6})\.npy")


def archive_parts(path: Path) -> tuple[str, ...]:
    """Return which of ``train`` and ``test`` the archive or folder has; empty where it is not divided."""
    with _opened(path) as (names, _):
        found = {_part(name) for name in names if _MEMBER.fullmatch(PurePosixPath(name).name)}
    return tuple(part for part in PARTS if part in found)


def read_archive(path: Path, *, split: str | None, step_seconds: float | None) -> Recordings:
    """Return one part of a ``.zip`` archive or of a folder of EvTouch files.

    ``split`` is a part; None takes ``test`` of a divided archive and everything of one that is not. Raises
    ``InputError`` for a damaged archive or member, members of different shapes, and nothing to read.
    """
    where = f"{'folder' if path.is_dir() else 'archive'} {path.name!r}"
    parts = archive_parts(path)
    if split is None and parts:
        split = "test" if "test" in parts else parts[0]
    if split is not None and split not in parts:
        has = f"it has {' and '.join(parts)}" if parts else "it is not divided"
        raise InputError(where, f"there is no part {split!r}", measured=has, fix=did_you_mean(split, parts or PARTS))
    with _opened(path) as (names, read):
        chosen: list[tuple[int, int, str]] = []
        for name in names:
            match = _MEMBER.fullmatch(PurePosixPath(name).name)
            if match and (split is None or _part(name) == split):
                chosen.append((int(match[1]), int(match[2]), name))
        if not chosen:
            raise InputError(
                where,
                "no recordings inside",
                fix="Give files named sample_<i>_label_<k>.npy.",
            )
        if len(chosen) > MAX_MEMBERS:
            raise InputError(
                where,
                "it holds too many recordings",
                measured=f"{len(chosen)} against {MAX_MEMBERS}",
                fix="Give fewer.",
            )
        chosen.sort()
        spikes = _stack(where, [name for *_, name in chosen], read)
    labels = np.array([label for _, label, _ in chosen], dtype=np.int64)
    return Recordings(spikes, labels, step_seconds, path.name)


def _stack(where: str, names: list[str], read: Callable[[str], bytes]) -> NDArray[np.uint8]:
    spikes: NDArray[np.uint8] | None = None
    for index, name in enumerate(names):
        place = f"{where}, {PurePosixPath(name).name!r}"
        array = to_step_major(load_npy(read(name), place), place)
        if len(array) != 1:
            raise InputError(place, "it is not one recording", measured=f"{len(array)} inside", fix="Give one a file.")
        one = _checked(array, place)
        if spikes is None:
            if one.size * len(names) > MAX_ELEMENTS:
                raise InputError(
                    where,
                    "its recordings are too large together",
                    measured=f"{one.size * len(names)} values against {MAX_ELEMENTS}",
                    fix="Give fewer recordings.",
                )
            spikes = np.empty((len(names), *one.shape), dtype=np.uint8)
        if one.shape != spikes.shape[1:]:
            raise InputError(
                place,
                "its shape is not that of the other recordings",
                measured=f"got {_size(one)} against {_size(spikes[0])} steps x channels",
                fix="Give recordings of one sensor and duration.",
            )
        spikes[index] = one
    assert spikes is not None
    return spikes


def _checked(array: NDArray[Any], place: str) -> NDArray[np.uint8]:
    # Member by member, so that the message names the file.
    try:
        spikes: NDArray[np.uint8] = Recordings(array, None, None, "").spikes[0]
        return spikes
    except InputError as error:
        raise InputError(place, error.what, measured=error.measured, fix=error.fix) from None


def _size(one: NDArray[np.uint8]) -> str:
    return " x ".join(str(size) for size in one.shape)


def _part(name: str) -> str:
    parents = PurePosixPath(name).parent
    return parents.name if parents.name in PARTS else ""


@contextmanager
def _opened(path: Path) -> Iterator[tuple[list[str], Callable[[str], bytes]]]:
    """Open a folder or archive: its files' names with forward slashes, and a reader of one of them."""
    if path.is_dir():
        files = {file.relative_to(path).as_posix(): file for file in sorted(path.rglob("*.npy"))}
        yield list(files), lambda name: _limited(files[name], name)
        return
    where = f"archive {path.name!r}"
    fix = "Fetch the archive again."
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None
    # zipfile raises more kinds on hostile bytes than it documents.
    except Exception:
        raise InputError(where, "it is damaged, truncated or not a zip archive", fix=fix) from None

    def read(name: str) -> bytes:
        place = f"{where}, {PurePosixPath(name).name!r}"
        size = archive.getinfo(name).file_size
        if size > MAX_MEMBER_BYTES:
            raise InputError(
                place, "it is too large", measured=f"{size} bytes against {MAX_MEMBER_BYTES}", fix="Give one recording."
            )
        try:
            return archive.read(name)
        except Exception:
            raise InputError(place, "it is damaged", fix=fix) from None

    with archive:
        yield archive.namelist(), read


def _limited(file: Path, name: str) -> bytes:
    place = f"file {name!r}"
    if file.stat().st_size > MAX_MEMBER_BYTES:
        raise InputError(
            place,
            "it is too large",
            measured=f"{file.stat().st_size} bytes against {MAX_MEMBER_BYTES}",
            fix="Give one recording.",
        )
    return read_bytes(file, place)
