"""Datasets of HDF5 files, compared path by path."""

from __future__ import annotations

import h5py
import numpy as np


def datasets_of(path, root):
    """Return every dataset under a group, by path, but for metadata."""
    found = {}
    with h5py.File(path) as file:
        file[root].visititems(
            lambda name, item: (
                found.update({name: item[()]})
                if isinstance(item, h5py.Dataset) and "metadata" not in name
                else None
            )
        )
    return found


def assert_equal_datasets(before, after):
    assert sorted(before) == sorted(after)
    for name, value in before.items():
        if name.endswith("edges"):
            assert {tuple(edge) for edge in value.tolist()} == {
                tuple(edge) for edge in after[name].tolist()
            }
        else:
            np.testing.assert_array_equal(after[name], value, err_msg=name)
