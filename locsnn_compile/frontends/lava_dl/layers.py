"""A lava-dl file (``.net``) as plain frozen data: its layers in order, each with its datasets."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hw_model.values import AnyArray, Frozen, IntArray
from locsnn_compile.data.hdf5.read import Group, open_hdf5
from locsnn_compile.errors import InputError, counted

MAX_LAYERS = 1000

Array = AnyArray
Values = Mapping[str, Array | str]
"""Datasets by their path inside the layer (``weight``, ``neuron/iDecay``), arrays of int64 or float64, or text."""


class NetLayer(Frozen, eq=False):
    """A layer: its number in the file, its type, its datasets, and how errors name it."""

    number: int
    kind: str
    values: Values
    where: str = ""

    def whole(self, name: str) -> IntArray:
        """Return a dataset of whole numbers; ``InputError`` for other numbers."""
        values = self.values[name] if name in self.values else None
        if values is None or isinstance(values, str):
            raise InputError(
                self.where,
                f"{name!r} is missing or not a number",
                fix="Export it again with lava-dl.",
            )
        bad = values[(values != np.rint(values)) | (np.abs(values) > 2**40)]
        if bad.size:
            raise self.fault(f"{name!r} is not made of integers", f"{bad.flat[0]:g}")
        return np.asarray(values, dtype=np.int64)

    def one(self, name: str, default: int) -> int:
        """Return a single whole number, or the default if the layer has none of this name."""
        if name not in self.values:
            return default
        values = self.whole(name).reshape(-1)
        if values.size == 0 or (values != values[0]).any():
            raise self.fault(f"{name!r} must be one number", f"{values[:4]}")
        return int(values[0])

    def pair(self, name: str, default: int) -> tuple[int, int]:
        """Return two whole numbers, for height and width; one in the file stands for both."""
        values = self.whole(name).reshape(-1) if name in self.values else np.array([default])
        if values.size not in (1, 2):
            raise self.fault(f"{name!r} must be one number or two", f"{values.size}")
        return int(values[0]), int(values[-1])

    def text(self, name: str) -> str:
        """Return a text, or '' if there is none; ``InputError`` for numbers."""
        value = self.values.get(name, "")
        if isinstance(value, str):
            return value
        raise self.fault(f"{name!r} is not text", f"{value.dtype}")

    def fault(self, what: str, measured: str) -> InputError:
        """Return the error for a layer that lava-dl would not have written."""
        return export_again(self.where, what, measured)


class NetFile(Frozen, eq=False):
    """The layers, and the numbers of ``simulation``, if the file has them."""

    layers: tuple[NetLayer, ...]
    simulation: Values


def export_again(where: str, what: str, measured: str) -> InputError:
    """Return the error for a file that lava-dl would not have written."""
    return InputError(where, what, measured=measured, fix="Export it again.")


def read_net(path: Path, where: str) -> tuple[NetFile, bytes]:
    """Return the layers of a file, and its bytes; ``InputError`` if it is not a lava-dl network."""
    with open_hdf5(path, where) as (root, data):
        layer_groups = root.group("layer")
        names = layer_groups.names()
        if not all(name.isascii() and name.isdecimal() and len(name) < 6 for name in names):
            raise export_again(where, "its layers are not numbered", f"{names[:4]}"[:80])
        numbers = sorted(int(name) for name in names)
        if not 0 < len(names) <= MAX_LAYERS or numbers != list(range(len(names))):
            raise export_again(
                where, "its layers are not numbered 0, 1, 2, ...", counted(len(names), "layer")
            )
        layers = []
        for name in sorted(names, key=int):
            group = layer_groups.group(name, f"{where}, layer {name}")
            layers.append(NetLayer(int(name), group.text("type"), _values(group, ""), group.where))
        simulation = _values(root.group("simulation"), "") if "simulation" in root else {}
        return NetFile(tuple(layers), simulation), data


def _values(group: Group, prefix: str) -> dict[str, Array | str]:
    values: dict[str, Array | str] = {}
    for name in group.names():
        if not prefix and name in ("neuron", "weight") and group.is_group(name):
            values |= _values(group.group(name, f"{group.where}, {name}"), f"{name}/")
        else:
            values[prefix + name] = group.value(name)
    return values
