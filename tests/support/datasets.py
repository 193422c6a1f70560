"""Read the datasets of HDF5 files and compare those of two files, path by path."""

from __future__ import annotations

import h5py
import numpy as np


def datasets_of(path, root):
    """Return every dataset under a group by its path, except metadata."""
    datasets = {}

    def collect(name, item):
        if isinstance(item, h5py.Dataset) and "metadata" not in name:
            datasets[name] = item[()]

    with h5py.File(path) as file:
        file[root].visititems(collect)
    return datasets


def assert_equal_datasets(before, after):
    """Check that two files have equal datasets; edges of a graph may come in any order."""
    assert sorted(before) == sorted(after)
    for name, value in before.items():
        if name.endswith("edges"):
            edges_before = {tuple(edge) for edge in value.tolist()}
            edges_after = {tuple(edge) for edge in after[name].tolist()}
            assert edges_before == edges_after
        else:
            np.testing.assert_array_equal(after[name], value, err_msg=name)
