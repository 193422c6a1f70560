"""Read a ``.pt`` file without running anything of it: tensors and plain values only."""

from __future__ import annotations

import io
import pickle
import stat
import warnings
import zipfile
from pathlib import Path

from hw_model.io.zip_directory import check_directory
from locsnn_compile.errors import InputError, check_most

#: Largest file accepted, in bytes, packed and unpacked.
MAX_FILE_BYTES = 1_000_000_000


def read_bytes(path: Path, where: str) -> bytes:
    """Return the bytes of a file; ``InputError`` where it is missing, unreadable, a folder or too large."""
    try:
        found = path.stat()
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
            # A pipe may never come to an end.
            raise InputError(where, "it is no plain file", fix="Write it to a file first.")
        fix = "Give a smaller file."
        check_most(found.st_size, MAX_FILE_BYTES, where, "it is too large", unit="bytes", fix=fix)
        return path.read_bytes()
    except OSError as error:
        raise InputError(where, "it cannot be read", measured=error.strerror or "", fix="Check the path.") from None


def load_plain(data: bytes, where: str, *, fix: str) -> object:
    """Return what the bytes of a torch file hold; ``InputError`` where that is code or the file is damaged.

    Torch reads with ``weights_only=True``: a pickle that would call a function is refused, never followed.
    ``fix`` is the way out to name for a damaged file.
    """
    import torch

    try:
        _check_archive(data, where, fix)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            value: object = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
            return value
    except InputError:
        raise
    # zipfile and torch meet damaged bytes with many kinds of exception; each means the same to the user.
    except Exception as error:
        if isinstance(error, pickle.UnpicklingError) and ("GLOBAL" in str(error) or "Unsupported" in str(error)):
            raise InputError(
                where,
                "it holds objects that would run code when read, so it was not read",
                fix="Save tensors and plain values only.",
            ) from None
        raise InputError(where, "it is damaged, truncated or not a torch file", fix=fix) from None


def _check_archive(data: bytes, where: str, fix: str) -> None:
    """Refuse what is no whole zip archive of torch's kind, before torch takes its sizes on trust."""
    check_directory(io.BytesIO(data))
    archive = zipfile.ZipFile(io.BytesIO(data))
    unpacked = sum(member.file_size for member in archive.infolist())
    # Torch stores its members unpacked; a file that unpacks to far more than it holds is none of torch's.
    if unpacked > 2 * len(data):
        raise InputError(
            where,
            "it unpacks to far more than its size",
            measured=f"{unpacked} bytes from {len(data)}",
            fix=fix,
        )
    # Torch does not look at the checksums it writes; a flipped bit would be a silently different weight.
    if archive.testzip() is not None:
        raise ValueError("a checksum is wrong")
