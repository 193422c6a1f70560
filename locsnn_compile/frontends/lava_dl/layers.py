"""Read a lava-dl file (``.net``, HDF5) as plain frozen data: its layers in order, each with its datasets.

A layer is the group ``layer/<number>``, with its datasets and the groups ``neuron`` and ``weight``. What the datasets
mean is the business of ``to_network.py``.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hw_model.values import AnyArray, Frozen, IntArray
from locsnn_compile.data.hdf5.read import Group, open_hdf5
from locsnn_compile.errors import InputError, counted

MAX_LAYERS = 1000
"""Largest number of layers of a file; a limit for hostile files, chosen by hand."""

Array = AnyArray
Values = Mapping[str, Array | str]
"""Datasets by their path in the layer (``weight``, ``neuron/iDecay``): arrays of int64 or float64, or text."""


class NetLayer(Frozen, eq=False):
    """A layer: its number in the file, its type (``kind``), its datasets, and how errors name it (``where``)."""

    number: int
    kind: str
    values: Values
    where: str = ""

    def whole(self, name: str) -> IntArray:
        """Return a dataset of whole numbers; raise ``InputError`` if it is missing or has other numbers.

        Whole numbers that are stored as floats are converted.
        """
        values = self.values.get(name)
        if values is None or isinstance(values, str):
            raise InputError(
                self.where,
                f"{name!r} is missing or not a number",
                fix="Export it again with lava-dl.",
            )
        # Numbers beyond 2^40 are larger than any register, and might not fit an int64.
        bad = values[(values != np.rint(values)) | (np.abs(values) > 2**40)]
        if bad.size:
            raise self.fault(f"{name!r} is not made of integers", f"{bad.flat[0]:g}")
        return np.asarray(values, dtype=np.int64)

    def one(self, name: str, default: int) -> int:
        """Return a dataset as one whole number; the default if the layer lacks it.

        A dataset may repeat the number, for example per neuron.
        """
        if name not in self.values:
            return default
        values = self.whole(name).reshape(-1)
        if values.size == 0 or (values != values[0]).any():
            raise self.fault(f"{name!r} must be one number", f"{values[:4]}")
        return int(values[0])

    def pair(self, name: str, default: int) -> tuple[int, int]:
        """Return a dataset as two whole numbers, for height and width; one in the file stands for both."""
        values = np.array([default])
        if name in self.values:
            values = self.whole(name).reshape(-1)
        if values.size not in (1, 2):
            raise self.fault(f"{name!r} must be one number or two", f"{values.size}")
        return int(values[0]), int(values[-1])

    def text(self, name: str) -> str:
        """Return a dataset that is text, or '' if the layer lacks it; raise ``InputError`` for numbers."""
        value = self.values.get(name, "")
        if isinstance(value, str):
            return value
        raise self.fault(f"{name!r} is not text", f"{value.dtype}")

    def fault(self, what: str, measured: str) -> InputError:
        """Return the error for a dataset that lava-dl would not have written."""
        return export_again(self.where, what, measured)


class NetFile(Frozen, eq=False):
    """The layers, and the datasets of the group ``simulation``; empty if the file has none."""

    layers: tuple[NetLayer, ...]
    simulation: Values


def export_again(where: str, what: str, measured: str) -> InputError:
    """Return the error for a file that lava-dl would not have written."""
    return InputError(where, what, measured=measured, fix="Export it again.")


def read_net(path: Path, where: str) -> tuple[NetFile, bytes]:
    """Return the content of a file, and its bytes; raise ``InputError`` if it is not a lava-dl network."""
    with open_hdf5(path, where) as (root, data):
        layer_groups = root.group("layer")
        names = layer_groups.names()
        # At most five digits, so that int() is never given a long text of a hostile file.
        if not all(name.isascii() and name.isdecimal() and len(name) < 6 for name in names):
            raise export_again(where, "its layers are not numbered", f"{names[:4]}"[:80])
        numbers = sorted(int(name) for name in names)
        if not 0 < len(names) <= MAX_LAYERS or numbers != list(range(len(names))):
            raise export_again(
                where, "its layers are not numbered 0, 1, 2, ...", counted(len(names), "layer")
            )
        layers = []
        # HDF5 lists names as texts: 0, 1, 10, 2, ...
        for name in sorted(names, key=int):
            group = layer_groups.group(name, f"{where}, layer {name}")
            layers.append(
                NetLayer(
                    number=int(name),
                    kind=group.text("type"),
                    values=_values(group, ""),
                    where=group.where,
                )
            )
        simulation = _values(root.group("simulation"), "") if "simulation" in root else {}
        return NetFile(tuple(layers), simulation), data


def _values(group: Group, prefix: str) -> dict[str, Array | str]:
    """Return the datasets of a group, and of the groups ``neuron`` and ``weight`` in it, by their path."""
    values: dict[str, Array | str] = {}
    for name in group.names():
        if not prefix and name in ("neuron", "weight") and group.is_group(name):
            values |= _values(group.group(name, f"{group.where}, {name}"), f"{name}/")
        else:
            values[prefix + name] = group.value(name)
    return values
