"""Write the output folder of a command, called a build: all of its files, or none.

:func:`check_folder` is called before any work is done, so that a user does not wait minutes for an error about the
folder; :func:`write_build` is called when the files are ready.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from hw_model.errors import InputError
from hw_model.io.arguments import check_path
from hw_model.io.folders import check_entries, replace_entries

LONGEST = 200
"""The most bytes of a folder's name. File systems allow 255, and the folder is first written next to its place under a
longer, temporary name."""

NO_NAMES = r"(?!)"
"""A pattern that matches no name: then every file in a folder that would be replaced counts as the user's own."""


def default_folder(model: str, suffix: str = "") -> Path:
    """Return ``build/<model name>``. Whatever the model's file is called, this is one folder inside ``build``."""
    safe_name = "".join(c if c.isprintable() and c not in "/\\" else "_" for c in Path(model).stem)
    # Cut bytes, not characters, and drop a character that the cut has split.
    safe_name = safe_name.encode()[:LONGEST].decode(errors="ignore")
    if not safe_name.strip("."):
        # Empty, `.` and `..` name no folder inside `build`.
        safe_name = "model"
    return Path("build") / f"{safe_name}{suffix}"


def check_folder(folder: Path, names: Iterable[str] = (), ours: str = NO_NAMES) -> None:
    """Raise InputError if the folder cannot be written, or if writing ``names`` into it would remove a user's files.

    Names that end in / are folders. Files in them that match the pattern ``ours``, such as ``vectors/README.md``, were
    written by an earlier build and may be replaced.
    """
    check_path(folder, f"output {folder.name[:60]!r}")
    # The folder may not exist yet, so its nearest parent that exists must be writable.
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(
            f"output {folder.name!r}",
            f"{existing.name!r} is a file",
            fix="Choose a folder with -o.",
        )
    # Ask for the effective user, as the system does when it writes; not all systems can.
    can_ask_effective = os.access in os.supports_effective_ids
    if not os.access(existing, os.W_OK | os.X_OK, effective_ids=can_ask_effective):
        raise _unwritable(folder, "permission denied")
    try:
        check_entries(folder, names, ours)
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from None


def write_build(folder: Path, files: Mapping[str, bytes], ours: str = NO_NAMES) -> None:
    """Write the files into the folder, all or none; everything else in it stays.

    A file may lie in a subfolder, as in ``vectors/manifest.yaml``. The subfolder then replaces the previous one as a
    whole, provided that all names in the previous one match the pattern ``ours``.
    """
    try:
        replace_entries(folder, files, ours)
    except OSError as error:
        raise _unwritable(folder, error.strerror or "unknown") from error


def _unwritable(folder: Path, reason: str) -> InputError:
    """Return the error for a folder that cannot be written; ``reason`` is the system's, which begins with a capital."""
    where = f"output {folder.name or str(folder)!r}"
    what = f"cannot be written: {reason[:1].lower()}{reason[1:]}"
    return InputError(where, what, fix="With -o, choose a folder that you may write to.")
