"""Write a build: all of its files, or none."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from hw_model.errors import InputError
from hw_model.io.folders import replace_entries

LONGEST = 200
"""Bytes of a folder's name; file systems allow 255, and a stage beside it has a longer one."""


def default_folder(model: str, suffix: str = "") -> Path:
    """Return ``build/<model name>``: one folder inside ``build``, whatever the file is called."""
    name = "".join(c if c.isprintable() and c not in "/\\" else "_" for c in Path(model).stem)
    name = name.encode()[:LONGEST].decode(errors="ignore")
    return Path("build") / f"{name if name.strip('.') else 'model'}{suffix}"


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be written, before any work is done."""
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(f"output {folder.name!r}", f"{existing.name!r} is a file", fix="Choose a folder with -o.")
    if not os.access(existing, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids):
        raise _unwritable(folder, "permission denied")


def write_build(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files into the folder, all or none; the rest of what it holds stays.

    A name may lie in a folder, ``vectors/manifest.yaml``; such a folder replaces the one before as a whole.
    """
    try:
        replace_entries(folder, files)
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from error


def _unwritable(folder: Path, reason: str) -> InputError:
    return InputError(
        f"output {folder.name!r}",
        f"cannot be written: {reason.lower()}",
        fix="Choose a folder you may write to with -o.",
    )
