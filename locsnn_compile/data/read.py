"""Read recordings of any supported format."""

from __future__ import annotations

from pathlib import Path

from locsnn_compile.data.archives import PARTS, archive_parts, read_archive
from locsnn_compile.data.arrays import read_arrays
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.tact import read_tact, read_tact_folder
from locsnn_compile.errors import InputError, did_you_mean

#: Widths of a time bin that are accepted.
MIN_STEP_SECONDS, MAX_STEP_SECONDS = 1e-6, 1e3

_SUFFIXES = (".zip", ".npy", ".npz", ".pt", ".tact")


def read_recordings(
    path: Path | str, *, split: str | None = None, step_seconds: float | None = None, threshold: int = 1
) -> Recordings:
    """Return the recordings at ``path``, of whatever supported format.

    A ``.zip`` or folder of EvTouch files, a folder of ``.tact``, or one ``.npy``, ``.npz``, ``.pt`` or ``.tact``.
    ``split`` is ``train`` or ``test`` of an archive or folder that is so divided (None: ``test``); a single
    file has no parts. ``step_seconds`` is the width of a bin where the file does not say it (``.tact``: the
    width to bin with, and ``threshold`` the events a bin must exceed). Every unusable input is one
    ``InputError``.
    """
    path = Path(path)
    if split is not None and split not in PARTS:
        raise InputError("split", f"{split!r} is not known", fix=did_you_mean(split, PARTS))
    if step_seconds is not None and not MIN_STEP_SECONDS <= step_seconds <= MAX_STEP_SECONDS:
        raise InputError(
            "step_seconds",
            "it is out of range",
            measured=f"got {step_seconds!r} against {MIN_STEP_SECONDS:g}..{MAX_STEP_SECONDS:g}",
            fix="Give the width of a bin in seconds.",
        )
    if threshold < 0:
        raise InputError(
            "threshold", "it is negative", measured=f"got {threshold}", fix="Give the events that a bin must exceed."
        )
    if path.is_dir() and split is None and any(path.glob("*.tact")):
        return read_tact_folder(path, step_seconds=step_seconds, threshold=threshold)
    if path.is_dir() or path.suffix == ".zip":
        return read_archive(path, split=split, step_seconds=step_seconds)
    _check_file(path)
    if split is not None:
        raise InputError(
            f"file {path.name!r}",
            f"there is no part {split!r}",
            measured="a single file is not divided",
            fix="Leave the part out.",
        )
    if path.suffix == ".tact":
        return read_tact(path, step_seconds=step_seconds, threshold=threshold)
    return read_arrays(path, step_seconds=step_seconds)


def recording_parts(path: Path | str) -> tuple[str, ...]:
    """Return the parts that ``path`` is divided into, of ``train`` and ``test``; empty for a single file."""
    path = Path(path)
    if path.is_dir() or path.suffix == ".zip":
        return archive_parts(path)
    _check_file(path)
    return ()


def _check_file(path: Path) -> None:
    if not path.exists():
        raise InputError(f"file {path.name!r}", "it does not exist", fix="Check the path.")
    if path.suffix not in _SUFFIXES:
        raise InputError(
            f"file {path.name!r}",
            "its kind is not known",
            measured=f"ending {path.suffix!r}",
            fix=f"Give one of: {', '.join(_SUFFIXES)}, or a folder.",
        )
