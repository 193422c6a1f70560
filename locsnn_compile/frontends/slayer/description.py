"""The YAML next to a slayerPytorch checkpoint: neuron, step, location order, and the layers that weights belong to.

The layers become matrices: dense ones, or those of the YAML's list. slayerPytorch samples ``k / tau * exp(1 - k /
tau)``, times a factor, and stops at the first step beyond tau whose value is below 0.01: of the published neuron, 77
taps of the input kernel and 11 of the refractory one remain. Recursive dendrites hold the whole tail, and a chip's
delays (62 steps) could not cut it.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.io.yaml_text import load_yaml
from hw_model.mapping.graph import Axis
from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import InputError, check_same, did_you_mean
from locsnn_compile.frontends.linear_maps import Shape, Window, convolution, pooling
from locsnn_compile.network.neurons import SrmAlpha, alpha_taps
from locsnn_compile.network.projections import Matrix

MAX_CONFIG_BYTES = 200_000
MAX_LAYERS = 1000
DEFAULT_ORDER = "loop"
"""Taxels by their numbers: what transposing a recording gives when nothing is said."""

_MARKS = {"c": "conv", "avg": "average", "a": "pool", "x": "input"}
"""What tells the kind of a layer in its ``dim``, by the first that is there; a dense layer has none of them."""
_NUMBERS = {"conv": 2, "pool": 1, "input": 3, "dense": 1}
"""How many numbers stand in the ``dim`` of each kind that is read."""


class LoihiNeuron(Frozen):
    """slayerPytorch's LOIHI neuron: integers of the chip; weights act as ``w * 2^(6 + weight_exponent)``."""

    decay_u: int
    decay_v: int
    threshold: int
    refractory: int
    weight_exponent: int


class LayerEntry(Frozen):
    """An entry of ``layer``: what ``dim`` says, and the numbers of a convolution.

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
    """What the description says: the neurons, the step, steps of a recording, and a location order.

    ``location_neuron`` is that of layers along locations. ``ts`` is in milliseconds; SRM time constants are in steps
    already. ``order`` is a name or taxel numbers, None where it has none. ``layers`` are those of the description's own
    ``layer`` list, the input first; () where it has none.
    """

    neuron: SrmAlpha | LoihiNeuron
    location_neuron: SrmAlpha | LoihiNeuron
    ts: float
    steps: int | None
    order: str | None
    layers: tuple[LayerEntry, ...] = ()

    def neuron_of(self, name: str) -> SrmAlpha | LoihiNeuron:
        """Return the neuron of a layer or entry by its name: the location neuron where that begins with location."""
        return self.location_neuron if axis_of(name) == "location" else self.neuron


def axis_of(name: str) -> Axis:
    """Return the axis of a layer by the last part of its name."""
    return "location" if name.rpartition(".")[2].lower().startswith("location") else "time"


def read_config(path: Path) -> SlayerConfig:
    """Read a description; ``InputError`` for what is none."""
    where = f"config {path.name!r}"
    fix = "Give slayerPytorch's network description."
    values = load_yaml(read_bytes(path, where, MAX_CONFIG_BYTES, "Give the YAML alone."), where, "it is not YAML", fix)
    if not isinstance(values, dict):
        raise InputError(where, "it is not a description", fix=fix)
    return parse_config(values, where)


def parse_config(values: Mapping[Any, Any], where: str) -> SlayerConfig:
    """Return the description that plain values hold, every entry checked."""
    simulation = _section(values, "simulation", where)
    ts = _number(simulation, "Ts", where, least=1e-6)
    samples = _number(simulation, "tSample", where, least=0) if "tSample" in simulation else math.nan
    steps = int(samples / ts) if samples >= ts and samples / ts <= 1_000_000 else None
    section = _section(values, "neuron", where)
    key = next((key for key in ("location_neuron", "locationNeuron") if key in values), "neuron")
    location = {**section, **_section(values, key, where)}
    if location.get("type") != section.get("type"):
        raise InputError(f"{where}, {key}.type", "it is not that of the other neurons", fix="Leave it out.")
    layers = parse_layers(values["layer"], where) if "layer" in values else ()
    neurons = _neuron(section, ts, where), _neuron(location, ts, where)
    return SlayerConfig(*neurons, ts, steps, _order(values, where), layers)


def _neuron(section: Mapping[Any, Any], ts: float, where: str) -> SrmAlpha | LoihiNeuron:
    kind = section.get("type")
    if kind == "SRMALPHA":
        theta, tau_sr, tau_ref = (_number(section, key, where, least=1e-6) for key in ("theta", "tauSr", "tauRef"))
        return SrmAlpha(theta, tau_sr / ts, tau_ref / ts, _number(section, "scaleRef", where, least=0))
    if kind == "LOIHI":
        threshold, decay_v, decay_u = (_whole(section, key, where) for key in ("vThMant", "vDecay", "iDecay"))
        refractory = max(_whole(section, "refDelay", where, 1), 1)
        return LoihiNeuron(decay_u, decay_v, threshold, refractory, _whole(section, "wgtExp", where, 0))
    fix = did_you_mean(str(kind), ("SRMALPHA", "LOIHI"))
    raise InputError(f"{where}, neuron.type", f"{str(kind)[:40]!r} is not known", fix=fix)


def parse_layers(held: Any, where: str) -> tuple[LayerEntry, ...]:
    """Return the entries of a ``layer`` list as slayerPytorch's Loihi networks read it: ``34x34x2, 16c5z, 2a, 10``."""
    if not isinstance(held, list) or not 0 < len(held) <= MAX_LAYERS or not all(isinstance(e, dict) for e in held):
        raise InputError(f"{where}, layer", "it is not a list of layers", fix="Give entries such as {dim: 16c5z}.")
    return tuple(_entry(entry, f"{where}, layer {i}", first=i == 0) for i, entry in enumerate(held))


def _entry(entry: Mapping[Any, Any], where: str, *, first: bool) -> LayerEntry:
    dim = str(entry.get("dim", ""))[:60]
    kind = next((kind for mark, kind in _MARKS.items() if mark in dim), "dense")
    numbers = tuple(int(n) for n in re.findall("[0-9]{1,7}", dim))
    if first and kind == "dense":
        kind, numbers = "input", (1, 1, *numbers)
    if first and kind == "input" and len(numbers) == 2:
        numbers = (*numbers, 1)
    known = first == (kind == "input") and len(numbers) == _NUMBERS.get(kind) and "neuron" not in entry
    if not known or min(numbers) < 1:
        fix = "Give the input first, as 34x34x2, then 16c5z, 2a or 10."
        raise InputError(where, f"dim {dim!r} is not read there", fix=fix)
    if kind == "pool":
        return LayerEntry(kind, numbers, stride=numbers[0])
    if kind != "conv":
        return LayerEntry(kind, numbers)
    given = {key: _whole(entry, key, where) for key in ("stride", "padding", "dilation", "groups") if key in entry}
    return LayerEntry(kind, numbers, **{"padding": numbers[1] // 2, **given})


def _order(values: Mapping[Any, Any], where: str) -> str | None:
    """Return the location order: ``location_order`` or ``locationOrder``, a name or a list of taxels."""
    for key in ("location_order", "locationOrder"):
        if key in values:
            order = values[key]
            if isinstance(order, list) and all(isinstance(n, int) and not isinstance(n, bool) for n in order):
                return ",".join(str(n) for n in order[:1000])
            if isinstance(order, str):
                return order[:4000]
            raise InputError(f"{where}, {key}", "it is not an order", fix="Give arch, whorl, loop or a list of taxels.")
    return None


def _section(values: Mapping[Any, Any], name: str, where: str) -> Mapping[Any, Any]:
    section = values.get(name)
    if not isinstance(section, dict):
        raise InputError(where, f"section {name!r} is missing", fix="Give slayerPytorch's network description.")
    return section


def _number(section: Mapping[Any, Any], key: str, where: str, *, least: float) -> float:
    value = section.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        fix = "Correct it."
        raise InputError(where, f"{key} must be a number from {least:g} on", measured=f"{value!r}"[:40], fix=fix)
    return float(value)


def _whole(section: Mapping[Any, Any], key: str, where: str, default: int | None = None) -> int:
    value = section.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value // 1 or abs(value) > 2**31:
        raise InputError(where, f"{key} must be a whole number", measured=f"{value!r}"[:40], fix="Correct it.")
    return int(value)


_CLOSE = 1e-3


def dense_layer(kernel: FloatArray, where: str) -> tuple[Matrix, int]:
    """Return the matrix (out, in) and the channels of a layer that sees its whole input.

    That may be an image (channels, height, width).
    """
    if kernel.ndim == 2 or (kernel.ndim == 5 and kernel.shape[4] == 1):
        if math.prod(kernel.shape):
            return kernel.reshape(len(kernel), -1), len(kernel)
    fix = "Use slayer.dense layers, or list all layers in the YAML, as layer: [{dim: 34x34x2}, {dim: 16c5z}, ...]."
    raise InputError(where, "it is not a dense layer", measured=f"weight {kernel.shape}", fix=fix)


def listed_layers(
    kernels: Mapping[str, FloatArray], entries: tuple[LayerEntry, ...], where: str
) -> dict[str, tuple[Matrix, int]]:
    """Return the matrix and the channels of every kernel, which are those of the list behind its input, in order."""
    weighted = entries[1:]
    what, fix = "the YAML lists another number of layers", "List the input and every layer that has weights."
    check_same(len(weighted), len(kernels), where, what, fix=fix)
    width, height, channels = entries[0].numbers
    shape: Shape = (channels, height, width)
    found: dict[str, tuple[Matrix, int]] = {}
    for (name, kernel), entry in zip(kernels.items(), weighted, strict=True):
        matrix, shape = _listed(kernel, entry, shape, f"{where}, layer {name!r}")
        found[name] = matrix, shape[0]
    return found


def _listed(kernel: FloatArray, entry: LayerEntry, given: Shape, where: str) -> tuple[Matrix, Shape]:
    if entry.kind == "dense":
        (size,), inputs = entry.numbers, math.prod(given)
        return _shaped(kernel, (size, inputs), f"{size} x {inputs}", where), (size, 1, 1)
    # Of an image of one row, convolutions have kernels of one row.
    flat = given[1] == 1 and entry.kind == "conv"
    side, stride, padding, dilation = entry.numbers[-1], entry.stride, entry.padding, entry.dilation
    shape = (1 if flat else side, side)
    row = (1, 0, 1) if flat else (stride, padding, dilation)
    window = Window((row[0], stride), (row[1], padding), (row[2], dilation))
    if entry.kind == "pool":
        fill = tuple(-n % side for n in given[1:])
        return pooling(_shaped(kernel, shape, f"{shape}", where), given, window, fill=fill, where=where)
    whole = (entry.numbers[0], given[0] // max(entry.groups, 1), *shape)
    return convolution(_shaped(kernel, whole, f"{whole}", where), given, window, groups=entry.groups, where=where)


def _shaped(kernel: FloatArray, shape: Shape, wanted: str, where: str) -> FloatArray:
    """Return weights in a shape; refuse another number of them."""
    if kernel.size == math.prod(shape):
        return kernel.reshape(shape)
    what, fix = "its weights are not those that the YAML lists", "Give the YAML that this checkpoint was trained with."
    raise InputError(where, what, measured=f"{kernel.shape} against {wanted}", fix=fix)


def cut(neuron: SrmAlpha | LoihiNeuron) -> SrmAlpha:
    """Return neurons whose kernels end where slayerPytorch ends them; others have none, an ``InputError``."""
    if not isinstance(neuron, SrmAlpha):
        raise InputError("kernels 'cut'", "LOIHI neurons have no kernels", fix="Leave the option out.")
    return neuron.cut()


def check_kernels(tensors: Mapping[str, Any], config: SlayerConfig, where: str) -> None:
    """Compare the kernels that a checkpoint holds with those of the description: they must be one model's."""
    for key, values in tensors.items():
        module, _, name = key.rpartition(".")
        neuron = config.neuron_of(module)
        if name not in ("srmKernel", "refKernel") or not isinstance(neuron, SrmAlpha):
            continue
        constants = (neuron.tau_sr, 1.0) if name == "srmKernel" else (neuron.tau_ref, -neuron.scale_ref * neuron.theta)
        held, made = values.reshape(-1), alpha_taps(*constants)
        shared = min(len(held), len(made))
        scale = max(float(np.abs(made).max(initial=0)), 1e-9)
        apart = np.abs(held[:shared] - made[:shared]).max(initial=0.0)
        if apart > _CLOSE * scale:
            what, fix = "the kernel is not that of the config", "Give the YAML that this checkpoint was trained with."
            raise InputError(f"{where}, entry {key!r}", what, measured=f"{apart:.3g} apart", fix=fix)
