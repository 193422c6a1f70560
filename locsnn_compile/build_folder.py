"""Write a build: all of its files, or none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from locsnn_compile.errors import InputError

LAST = "program.yaml"
"""Replaced last: it holds the checksum of the arrays, so a mixture of two builds is never taken for one."""


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be written, before any work is done."""
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(f"output {folder.name!r}", f"{existing.name!r} is a file", fix="Choose a folder with -o.")
    if not os.access(existing, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids):
        raise _unwritable(folder, "permission denied")


def write_build(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files into a stage beside the folder, then move them: a new folder at once, an old one entry by entry.

    A name may lie in a folder, ``vectors/manifest.yaml``; such a folder replaces the one before as a whole.
    """
    stage = folder.absolute().parent / f".{folder.name}.partial-{os.getpid()}"
    try:
        stage.parent.mkdir(parents=True, exist_ok=True)
        stage.mkdir()
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from error
    try:
        for name, content in files.items():
            (stage / name).parent.mkdir(parents=True, exist_ok=True)
            (stage / name).write_bytes(content)
        if folder.exists():
            entries = dict.fromkeys(name.split("/")[0] for name in files)
            for entry in sorted(entries, key=lambda entry: entry == LAST):
                if (folder / entry).is_dir():
                    os.rename(folder / entry, stage / f".old-{entry}")
                os.replace(stage / entry, folder / entry)
        else:
            os.rename(stage, folder)
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _unwritable(folder: Path, reason: str) -> InputError:
    return InputError(
        f"output {folder.name!r}",
        f"cannot be written: {reason.lower()}",
        fix="Choose a folder you may write to with -o.",
    )
