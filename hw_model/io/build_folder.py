"""Write a build: all of its files, or none."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from hw_model.errors import InputError
from hw_model.io.folders import check_entries, replace_entries
from hw_model.io.given import check_path

LONGEST = 200
"""Largest number of bytes of a folder's name: file systems allow 255, and a stage next to it has a longer name."""

NO_NAMES = r"(?!)"
"""Matches no name: a folder inside that holds anything is then somebody's own."""


def default_folder(model: str, suffix: str = "") -> Path:
    """Return ``build/<model name>``: one folder inside ``build``, whatever the file is called."""
    name = "".join(c if c.isprintable() and c not in "/\\" else "_" for c in Path(model).stem)
    name = name.encode()[:LONGEST].decode(errors="ignore")
    return Path("build") / f"{name if name.strip('.') else 'model'}{suffix}"


def check_folder(folder: Path, names: Iterable[str] = (), ours: str = NO_NAMES) -> None:
    """Refuse a folder that cannot be written, before any work is done, and one in which ``names`` would remove files.

    Names that end in / are folders. Files in them that match the pattern ``ours``, such as
    ``vectors/README.md``, are those of an earlier build.
    """
    check_path(folder, f"output {folder.name[:60]!r}")
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(
            f"output {folder.name!r}",
            f"{existing.name!r} is a file",
            fix="Choose a folder with -o.",
        )
    if not os.access(
        existing, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids
    ):
        raise _unwritable(folder, "permission denied")
    try:
        check_entries(folder, names, ours)
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from None


def write_build(folder: Path, files: Mapping[str, bytes], ours: str = NO_NAMES) -> None:
    """Write the files into the folder, all or none; everything else in it stays.

    A name may lie in a folder, as in ``vectors/manifest.yaml``. Such a folder replaces the previous one as a whole, if
    that holds only names that match the pattern ``ours``.
    """
    try:
        replace_entries(folder, files, ours)
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from error


def _unwritable(folder: Path, reason: str) -> InputError:
    where = f"output {folder.name or str(folder)!r}"
    what = f"cannot be written: {reason[:1].lower()}{reason[1:]}"
    return InputError(where, what, fix="With -o, choose a folder that you may write to.")
