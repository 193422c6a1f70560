"""Read the YAML next to a slayerPytorch checkpoint: its neuron, step, layers, and location order, if it has one.

It is slayerPytorch's network description, with a few keys of the networks with location neurons (Kang et al. 2022). The
option ``--config`` names its file, so the code calls it the *config*; texts also say the YAML, or the description.
"""

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
"""Largest size of a description; a limit for hostile files, chosen by hand."""
_GIVE_A_DESCRIPTION = "Give slayerPytorch's network description, or a list of layers."
MAX_LAYERS = 1000
"""Largest number of listed layers; a limit for hostile files, chosen by hand."""
SMALLEST_PARAMETER = 1e-6
"""Smallest step, threshold or time constant that is taken: smaller ones are a mistake, and must not be 0."""
MAX_STEPS = 1_000_000
"""Largest number of steps of a recording that is taken from a description."""
MAX_STOP = 1_000_000
"""Latest end of a region in which training counts spikes, in milliseconds."""
DEFAULT_ORDER = "loop"
"""The location order if a description has none: taxels in the order of their numbers, as when a recording is simply
transposed. The other published orders, ``arch`` and ``whorl``, walk over a fingertip in other ways
(:mod:`locsnn_compile.data.orders`)."""

_MARKS = {"c": "conv", "avg": "average", "a": "pool", "x": "input"}
"""The kind of a layer by a mark in its ``dim``, such as 16c5z; the first mark that occurs decides, so ``avg`` comes
before ``a``. A dense layer has no mark."""
_NUMBERS = {"conv": 2, "pool": 1, "input": 3, "dense": 1}
"""How many numbers the ``dim`` of each supported kind has."""


class LoihiNeuron(Frozen):
    """slayerPytorch's LOIHI neuron, in the chip's integers.

    A weight w charges ``w * 2^(6 + weight_exponent)`` counts of a register.
    """

    decay_u: int
    decay_v: int
    threshold: int
    refractory: int
    weight_exponent: int


class LayerEntry(Frozen):
    """An entry of the list ``layer``: the content of its ``dim``, and the options of a convolution.

    ``kind`` is input, conv, pool or dense; ``numbers`` are those in ``dim``: (width, height, channels) of an input,
    (channels, kernel size) of a convolution, (kernel size,) of pooling, (neurons,) of a dense layer.
    """

    kind: str
    numbers: tuple[int, ...]
    stride: int = 1
    padding: int = 0
    dilation: int = 1
    groups: int = 1


class SlayerConfig(Frozen):
    """The content of the description.

    - ``neuron``: that of layers along time, and ``location_neuron``, that of layers along locations; time constants are
      in steps already
    - ``ts``: the length of a step in milliseconds
    - ``steps``: the number of steps of a recording; None if unknown
    - ``order``: the location order, a name or taxel numbers; None if the description has none
    - ``layers``: the entries of its list ``layer``, the input first; () if it has none
    - ``branches``: the layers that run; None if the description does not name them
    - ``counted_steps``: over how many steps training counts the spikes of an output; None if unknown
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
        """Return the neuron of a module by its name, see :func:`axis_of`."""
        return self.neuron_along(axis_of(name))


def axis_of(name: str) -> Axis:
    """Return the axis of a layer: location if the last part of its name begins with ``location``, else time."""
    return "location" if name.rpartition(".")[2].lower().startswith("location") else "time"


def read_config(path: Path) -> SlayerConfig:
    """Read a description and check every entry; raise ``InputError`` for other files."""
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
    ts = _number(simulation, "Ts", where, least=SMALLEST_PARAMETER)
    recording_ms = math.nan
    if "tSample" in simulation:
        recording_ms = _number(simulation, "tSample", where, least=0)
    # False for nan, and for a recording that is shorter than a step or too long: its steps are unknown.
    is_usable = ts <= recording_ms and recording_ms / ts <= MAX_STEPS
    # Rounded down, as slayerPytorch's examples do: a step that the recording does not fill is not played.
    steps = int(recording_ms / ts) if is_usable else None
    section = _section(values, "neuron", where)
    key = next((key for key in ("location_neuron", "locationNeuron") if key in values), "neuron")
    # What the section of location neurons leaves out is as for the others.
    location = {**section, **_section(values, key, where)}
    if location.get("type") != section.get("type"):
        raise InputError(
            f"{where}, {key}.type",
            "it differs from the type of the other neurons",
            fix="Leave it out.",
        )
    layers = parse_layers(values["layer"], where) if "layer" in values else ()
    return SlayerConfig(
        neuron=_neuron(section, ts, where),
        location_neuron=_neuron(location, ts, where),
        ts=ts,
        steps=steps,
        order=_order(values, where),
        layers=layers,
        branches=_branches(values, where),
        counted_steps=_counted_steps(values, ts),
    )


def _branches(values: Mapping[Any, Any], where: str) -> Branches | None:
    """Return the layers that run, by the key ``branches``; None if there is no such key."""
    if "branches" not in values:
        return None
    branches = values["branches"]
    if not isinstance(branches, dict):
        fix = "Give {time: [fc1, fc2], location: [locationFc1, locationFc2]}."
        raise InputError(f"{where}, branches", "they are not lists of layers", fix=fix)
    return checked_branches(branches, f"{where}, branches")


def _counted_steps(values: Mapping[Any, Any], ts: float) -> int | None:
    """Return the steps of the region in which training counts spikes; None unless there is one that begins at 0.

    The key is not part of the network, so unexpected content is ignored instead of refused.
    """
    region: Any = values
    for key in ("training", "error", "tgtSpikeRegion"):
        region = region.get(key) if isinstance(region, dict) else None
    if not isinstance(region, dict) or region.get("start") != 0:
        return None
    stop = region.get("stop")
    if isinstance(stop, bool) or not isinstance(stop, int | float) or not 0 < stop <= MAX_STOP:
        return None
    # Rounded to the nearest step, as slayerPytorch's loss does.
    return round(stop / ts)


def _neuron(section: Mapping[Any, Any], ts: float, where: str) -> SrmAlpha | LoihiNeuron:
    """Return the neuron of a section ``neuron``; ``ts`` is the length of a step, in the unit of the time constants."""
    kind = section.get("type")
    if kind == "SRMALPHA":
        return SrmAlpha(
            theta=_number(section, "theta", where, least=SMALLEST_PARAMETER),
            tau_sr=_number(section, "tauSr", where, least=SMALLEST_PARAMETER) / ts,
            tau_ref=_number(section, "tauRef", where, least=SMALLEST_PARAMETER) / ts,
            scale_ref=_number(section, "scaleRef", where, least=0),
        )
    if kind == "LOIHI":
        return LoihiNeuron(
            threshold=_whole(section, "vThMant", where),
            decay_v=_whole(section, "vDecay", where),
            decay_u=_whole(section, "iDecay", where),
            # A refDelay of 0 is the same as 1: no step is blocked.
            refractory=max(_whole(section, "refDelay", where, 1), 1),
            weight_exponent=_whole(section, "wgtExp", where, 0),
        )
    fix = did_you_mean(str(kind), ("SRMALPHA", "LOIHI"))
    raise InputError(f"{where}, neuron.type", f"{str(kind)[:40]!r} is not known", fix=fix)


def parse_layers(entries: Any, where: str) -> tuple[LayerEntry, ...]:
    """Return the entries of a list ``layer``, which slayerPytorch's Loihi networks use: ``34x34x2, 16c5z, 2a, 10``."""
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
    """Return one entry of a list ``layer``; the ``first`` must be the input, and no other."""
    dim = str(entry.get("dim", ""))[:60]
    kind = next((kind for mark, kind in _MARKS.items() if mark in dim), "dense")
    numbers = tuple(int(n) for n in re.findall("[0-9]{1,7}", dim))
    if first and kind == "dense":
        # An input that is not an image is one pixel with many channels.
        kind = "input"
        numbers = (1, 1, *numbers)
    if first and kind == "input" and len(numbers) == 2:
        # An image without a third number has one channel.
        numbers = (*numbers, 1)
    is_in_place = first == (kind == "input")
    is_complete = len(numbers) == _NUMBERS.get(kind)
    # A layer may bring its own parameters of the neuron; here all layers share one section `neuron`.
    is_known = is_in_place and is_complete and "neuron" not in entry
    if not is_known or min(numbers) < 1:
        fix = "Give the input first, as 34x34x2, then 16c5z, 2a or 10."
        raise InputError(where, f"dim {dim!r} is not supported there", fix=fix)
    if kind == "pool":
        return LayerEntry(kind, numbers, stride=numbers[0])
    if kind != "conv":
        return LayerEntry(kind, numbers)
    # If no padding is given, slayerPytorch's Loihi networks pad by half a kernel.
    options = {"padding": numbers[1] // 2}
    for key in ("stride", "padding", "dilation", "groups"):
        if key in entry:
            options[key] = _whole(entry, key, where)
    return LayerEntry(kind, numbers, **options)


def _order(values: Mapping[Any, Any], where: str) -> str | None:
    """Return the location order, by the key ``location_order`` or ``locationOrder``: a name, or taxels with commas.

    Long texts and lists are cut; they fail later, with a short message, as no order has as many taxels.
    """
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
    """Return a section of the description; raise ``InputError`` if it is missing."""
    section = values.get(name)
    if not isinstance(section, dict):
        raise InputError(where, f"section {name!r} is missing", fix=_GIVE_A_DESCRIPTION)
    return section


def _number(section: Mapping[Any, Any], key: str, where: str, *, least: float) -> float:
    """Return a number of a section; raise ``InputError`` if it is missing, not finite, or below ``least``."""
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
    """Return a whole number of a section, or the default; raise ``InputError`` for other values."""
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
