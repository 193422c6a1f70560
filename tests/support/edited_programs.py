"""Edit the files of a saved program the way a person, or damage, would: its entries, or one of its arrays."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from hw_model.io.files import pack_arrays


def replace_text(folder: Path, old: str, new: str) -> None:
    """Replace a text in ``program.yaml``, and remove its last line, the checksum of the entries."""
    path = folder / "program.yaml"
    text = path.read_text().rpartition("# SHA-256")[0]
    assert old in text
    path.write_text(text.replace(old, new))


def replace_array(folder: Path, name: str, array: np.ndarray | None) -> None:
    """Replace or add an array of ``program.npz``, or leave it out if None, and correct the checksum in the entries."""
    path = folder / "program.npz"
    with np.load(path) as stored:
        arrays = dict(stored.items())
    digest_before = hashlib.sha256(path.read_bytes()).hexdigest()
    if array is None:
        del arrays[name]
    else:
        arrays[name] = array
    packed = pack_arrays(arrays, compressed=True)
    path.write_bytes(packed)
    replace_text(folder, digest_before, hashlib.sha256(packed).hexdigest())
