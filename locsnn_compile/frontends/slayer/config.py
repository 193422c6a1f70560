"""The YAML next to a slayerPytorch checkpoint: neuron, step, and the location order, if the network has one."""

import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hw_model.io.files import read_bytes
from hw_model.io.yaml_text import load_yaml
from hw_model.mapping.graph import Axis
from hw_model.values import Frozen
from locsnn_compile.errors import InputError, did_you_mean
from locsnn_compile.frontends.slayer.branches import Branches, checked_branches
from locsnn_compile.network.neurons import SrmAlpha

MAX_CONFIG_BYTES = 200_000
_GIVE_A_DESCRIPTION = "Give slayerPytorch's network description, or a list of layers."
MAX_LAYERS = 1000
MAX_STOP = 1_000_000
"""Latest end of a region in which training counts spikes, in milliseconds."""
DEFAULT_ORDER = "loop"
"""Taxels by number, which is what transposing a recording gives."""

_MARKS = {"c": "conv", "avg": "average", "a": "pool", "x": "input"}
"""Marks in a layer's ``dim`` that tell its kind; the first one present decides. A dense layer has none of them."""
_NUMBERS = {"conv": 2, "pool": 1, "input": 3, "dense": 1}
"""How many numbers the ``dim`` of each supported kind has."""


class LoihiNeuron(Frozen):
    """slayerPytorch's LOIHI neuron, in the chip's integers; weights act as ``w * 2^(6 + weight_exponent)``."""

    decay_u: int
    decay_v: int
    threshold: int
    refractory: int
    weight_exponent: int


class LayerEntry(Frozen):
    """An entry of ``layer``: the content of ``dim``, and the numbers of a convolution.

    ``kind`` is input, conv, pool or dense; ``numbers`` are those in ``dim``: (width, height, channels) of an input,
    (channels, kernel) of a convolution, (kernel,) of pooling, (neurons,) of a dense layer.
    """

    kind: str
    numbers: tuple[int, ...]
    stride: int = 1
    padding: int = 0
    dilation: int = 1
    groups: int = 1


class SlayerConfig(Frozen):
    """The content of the description: neurons, the step, the steps of a recording, and a location order.

    ``location_neuron`` is that of layers along locations. ``ts`` is in milliseconds; SRM time constants are in steps
    already. ``order`` is a name or taxel numbers, None if there is none. ``layers`` come from the description's own
    ``layer`` list, the input first; () if there is none. ``branches`` name the layers that run, None if nothing does.
    ``counted_steps``: at how many steps training counts the spikes of an output, None if that is not told.
    """

    neuron: SrmAlpha | LoihiNeuron
    location_neuron: SrmAlpha | LoihiNeuron
    ts: float
    steps: int | None
    order: str | None
    layers: tuple[LayerEntry, ...] = ()
    branches: Branches | None = None
    counted_steps: int | None = None

    def neuron_along(self, axis: Axis) -> SrmAlpha | LoihiNeuron:
        """Return the neuron of the layers along an axis."""
        return self.location_neuron if axis == "location" else self.neuron

    def neuron_of(self, name: str) -> SrmAlpha | LoihiNeuron:
        """Return the neuron of an entry by its name: the location neuron if the name begins with location."""
        return self.neuron_along(axis_of(name))


def axis_of(name: str) -> Axis:
    """Return the axis of a layer by the last part of its name."""
    return "location" if name.rpartition(".")[2].lower().startswith("location") else "time"


def read_config(path: Path) -> SlayerConfig:
    """Read a description, every entry checked; ``InputError`` for other files."""
    where = f"config {path.name!r}"
    fix = _GIVE_A_DESCRIPTION
    values = load_yaml(
        read_bytes(path, where, MAX_CONFIG_BYTES, "Give only the YAML."),
        where,
        "it is not YAML",
        fix,
    )
    if not isinstance(values, dict):
        raise InputError(where, "it does not describe a network", fix=fix)
    simulation = _section(values, "simulation", where)
    ts = _number(simulation, "Ts", where, least=1e-6)
    samples = (
        _number(simulation, "tSample", where, least=0) if "tSample" in simulation else math.nan
    )
    steps = int(samples / ts) if samples >= ts and samples / ts <= 1_000_000 else None
    section = _section(values, "neuron", where)
    key = next((key for key in ("location_neuron", "locationNeuron") if key in values), "neuron")
    location = {**section, **_section(values, key, where)}
    if location.get("type") != section.get("type"):
        raise InputError(
            f"{where}, {key}.type",
            "it differs from the type of the other neurons",
            fix="Leave it out.",
        )
    layers = parse_layers(values["layer"], where) if "layer" in values else ()
    return SlayerConfig(
        _neuron(section, ts, where),
        _neuron(location, ts, where),
        ts,
        steps,
        _order(values, where),
        layers,
        _branches(values, where),
        _counted_steps(values, ts),
    )


def _branches(values: Mapping[Any, Any], where: str) -> Branches | None:
    """Return the layers that run, as the key ``branches`` names them; None without it."""
    if "branches" not in values:
        return None
    branches = values["branches"]
    if not isinstance(branches, dict):
        fix = "Give {time: [fc1, fc2], location: [locationFc1, locationFc2]}."
        raise InputError(f"{where}, branches", "they are not lists of layers", fix=fix)
    return checked_branches(branches, f"{where}, branches")


def _counted_steps(values: Mapping[Any, Any], ts: float) -> int | None:
    """Return the steps of the region in which training counts spikes; None where it does not begin at 0.

    It is no part of the network, so whatever else stands there is left alone.
    """
    region: Any = values
    for key in ("training", "error", "tgtSpikeRegion"):
        region = region.get(key) if isinstance(region, dict) else None
    if not isinstance(region, dict) or region.get("start") != 0:
        return None
    stop = region.get("stop")
    if isinstance(stop, bool) or not isinstance(stop, int | float) or not 0 < stop <= MAX_STOP:
        return None
    return round(stop / ts)


def _neuron(section: Mapping[Any, Any], ts: float, where: str) -> SrmAlpha | LoihiNeuron:
    kind = section.get("type")
    if kind == "SRMALPHA":
        theta, tau_sr, tau_ref = (
            _number(section, key, where, least=1e-6) for key in ("theta", "tauSr", "tauRef")
        )
        return SrmAlpha(
            theta, tau_sr / ts, tau_ref / ts, _number(section, "scaleRef", where, least=0)
        )
    if kind == "LOIHI":
        threshold, decay_v, decay_u = (
            _whole(section, key, where) for key in ("vThMant", "vDecay", "iDecay")
        )
        refractory = max(_whole(section, "refDelay", where, 1), 1)
        return LoihiNeuron(
            decay_u, decay_v, threshold, refractory, _whole(section, "wgtExp", where, 0)
        )
    fix = did_you_mean(str(kind), ("SRMALPHA", "LOIHI"))
    raise InputError(f"{where}, neuron.type", f"{str(kind)[:40]!r} is not known", fix=fix)


def parse_layers(entries: Any, where: str) -> tuple[LayerEntry, ...]:
    """Return the entries of a ``layer`` list, as slayerPytorch's Loihi networks read it: ``34x34x2, 16c5z, 2a, 10``."""
    is_list = isinstance(entries, list) and 0 < len(entries) <= MAX_LAYERS
    if not is_list or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(
            f"{where}, layer",
            "it is not a list of layers",
            fix="Give entries such as {dim: 16c5z}.",
        )
    return tuple(
        _entry(entry, f"{where}, layer {i}", first=i == 0) for i, entry in enumerate(entries)
    )


def _entry(entry: Mapping[Any, Any], where: str, *, first: bool) -> LayerEntry:
    dim = str(entry.get("dim", ""))[:60]
    kind = next((kind for mark, kind in _MARKS.items() if mark in dim), "dense")
    numbers = tuple(int(n) for n in re.findall("[0-9]{1,7}", dim))
    if first and kind == "dense":
        kind, numbers = "input", (1, 1, *numbers)
    if first and kind == "input" and len(numbers) == 2:
        numbers = (*numbers, 1)
    is_in_place = first == (kind == "input")
    is_complete = len(numbers) == _NUMBERS.get(kind)
    is_known = is_in_place and is_complete and "neuron" not in entry
    if not is_known or min(numbers) < 1:
        fix = "Give the input first, as 34x34x2, then 16c5z, 2a or 10."
        raise InputError(where, f"dim {dim!r} is not supported there", fix=fix)
    if kind == "pool":
        return LayerEntry(kind, numbers, stride=numbers[0])
    if kind != "conv":
        return LayerEntry(kind, numbers)
    # Without one, slayerPytorch's Loihi networks pad by half a kernel.
    options = {"padding": numbers[1] // 2}
    for key in ("stride", "padding", "dilation", "groups"):
        if key in entry:
            options[key] = _whole(entry, key, where)
    return LayerEntry(kind, numbers, **options)


def _order(values: Mapping[Any, Any], where: str) -> str | None:
    """Return the location order: ``location_order`` or ``locationOrder``, a name or a list of taxels."""
    for key in ("location_order", "locationOrder"):
        if key in values:
            order = values[key]
            if isinstance(order, list) and all(
                isinstance(n, int) and not isinstance(n, bool) for n in order
            ):
                return ",".join(str(n) for n in order[:1000])
            if isinstance(order, str):
                return order[:4000]
            raise InputError(
                f"{where}, {key}",
                "it is not an order",
                fix="Give arch, whorl, loop or a list of taxels.",
            )
    return None


def _section(values: Mapping[Any, Any], name: str, where: str) -> Mapping[Any, Any]:
    section = values.get(name)
    if not isinstance(section, dict):
        raise InputError(where, f"section {name!r} is missing", fix=_GIVE_A_DESCRIPTION)
    return section


def _number(section: Mapping[Any, Any], key: str, where: str, *, least: float) -> float:
    value = section.get(key)
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not least <= value <= sys.float_info.max
    ):
        fix = "Correct it."
        raise InputError(
            where, f"{key} must be a number from {least:g} on", measured=f"{value!r}"[:40], fix=fix
        )
    return float(value)


def _whole(section: Mapping[Any, Any], key: str, where: str, default: int | None = None) -> int:
    value = section.get(key, default)
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or value != value // 1
        or abs(value) > 2**31
    ):
        raise InputError(
            where, f"{key} must be a whole number", measured=f"{value!r}"[:40], fix="Correct it."
        )
    return int(value)
