"""From a lava-dl network (``.net``) to a Network on the grid, which keeps the integers of weights and parameters.

The meaning of the file is that of lava-dl 0.6 (``netx.hdf5``, ``slayer.block``): ``iDecay`` is the effective decay of
the current (the register holds one less), and ``vDecay`` that of the voltage. Weights, biases and ``vThMant`` count
units of :mod:`hw_model.arithmetic.loihi`, and each layer takes one step. Delays are rounded down and cut to 62 steps,
unless relays are to carry longer ones. A last layer without neurons is read out: its potential is the charge of a
step. A ``flatten`` reads the image (channels, height, width) of the layer before it, in this order.

The first layers may run on the host, on numbers: there, the charge of the first neurons is a sum of floats, truncated
to an integer as slayer does. Layers take a step each on the host too, so its spikes are sent in the same steps as in
slayer.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi
from hw_model.values import FloatArray, IntArray, sealed
from locsnn_compile.data.channels import image_channels
from locsnn_compile.errors import InputError, check_same, counted
from locsnn_compile.frontends.host_choice import chosen_layers, none_left
from locsnn_compile.frontends.lava_dl.layers import Array, NetFile, NetLayer, export_again, read_net
from locsnn_compile.frontends.linear_maps import (
    Ints,
    Shape,
    Window,
    check_entries,
    check_shape,
    convolution,
    pooling,
)
from locsnn_compile.frontends.parts import DEFAULT_STEPS, FileFacts, Parts, choose_eight_bit_signs
from locsnn_compile.frontends.relays import DELAY_MAX, add_relays
from locsnn_compile.network.chip_neurons import ChipCuba, HostCuba, integers
from locsnn_compile.network.input_scaling import InputScaling
from locsnn_compile.network.network import (
    HostLayers,
    HostOutput,
    InputView,
    Network,
    Population,
)
from locsnn_compile.network.projections import (
    ChipProjection,
    Matrix,
    Projection,
    matrix,
    of_source,
    of_target,
    values_of,
    with_values,
)

INPUT = "input"
"""The name of the input view."""
LONGEST_DELAY = 1000
"""Longest delay that relays carry, in steps, chosen by hand; longer ones are cut, which is listed as an assumption."""
THRESHOLD_MAX = 2**17 - 1
"""Largest threshold mantissa: times 64, it is 2^23 - 64 units, just below the end of the voltage register."""
BIAS_EXPONENT = 6
"""Biases of a file are in units of weights, which are 2^6 counts of the register."""
NEVER_SPIKES = 2**18 - 1
"""The threshold mantissa that lava-dl writes for neurons that must not spike: more than its register holds."""
MAX_STATED_STEPS = 10_000
"""Largest number of steps that is taken from a file: longer synthetic recordings take too long to play."""
INPUT_WEIGHT = 64
"""The weight of an event onto the neurons of an input layer: it is the number 1, in slayer's scale of weights.

The input layer's own weight, if it has one, replaces it.
"""
_REFUSED = {
    "convT": "Replace it with a convolution.",
    "unpool": "Train without it.",
    "average": "Count the spikes of the layer before it.",
    "concat": "Join the inputs before the network.",
}
"""Types of layers that the chip cannot run, each with advice."""


@dataclass(eq=False)
class _Built(Parts):
    """The parts of the network so far.

    - ``source`` and ``shape``: the name and shape of the last layer, whose spikes the next layer takes
    - ``input_shape``: the shape of the input; empty if unknown
    - ``relay_delays``: whether delays that a synapse cannot have are kept, for relays
    - ``assumed``: sentences about assumptions
    - ``on_host``: whether the input is made of numbers
    - ``scaling``: how an input layer with neurons scales these numbers
    """

    source: str = INPUT
    shape: Shape | None = None
    input_shape: Shape = ()
    relay_delays: bool = False
    assumed: list[str] = field(default_factory=list)
    on_host: bool = False
    scaling: InputScaling | None = None

    @property
    def takes_numbers(self) -> bool:
        """Whether the next layer of neurons is the first one on the host, which takes numbers."""
        return self.on_host and not self.populations


def load_lava_dl(
    path: Path, *, relay_delays: bool = False, host_layers: str | None = None
) -> Network:
    """Read a ``.net`` file and return its network; populations are called ``layer<i>``, the input ``input``.

    ``host_layers``: the first layers that run on the host, as :func:`chosen_layers` reads it.
    Raises ``InputError`` for a file that cannot be used.
    """
    where = f"model {path.name!r}"
    file, data = read_net(path, where)
    built = _Built(relay_delays=relay_delays)
    host = None
    chip_layers = file.layers
    if host_layers is not None:
        border = _border(file, host_layers, f"{where}, --host-layers")
        host = _host_layers(built, file.layers[:border])
        chip_layers = file.layers[border:]
    for layer in chip_layers:
        _add(built, layer, last=layer is file.layers[-1])
    if not built.populations:
        raise InputError(
            where, "it has no layer of neurons", fix="Export a network with a dense or conv layer."
        )
    seconds, steps = _simulation(file, f"{where}, simulation")
    built.outputs = {built.source: _potentials_from(file, built)}
    relayed = add_relays(built) if relay_delays else ()
    facts = FileFacts(
        any_length=True,
        inputs=image_channels(built.input_shape),
        origin=file,
        assumptions=(*built.assumed, *relayed),
    )
    return built.network_of_file(
        path,
        data,
        channels=built.views[0].lines,
        steps=steps,
        step_seconds=seconds,
        facts=facts if host is None else facts.behind(host),
    )


def _border(file: NetFile, host_layers: str, place: str) -> int:
    """Return how many layers of the file run on the host: all up to the last one that the option names."""
    numbers = {f"layer{layer.number}": layer.number for layer in file.layers if _has_neurons(layer)}
    names = list(numbers)
    chosen = chosen_layers(host_layers, names, names, place)
    border = max(numbers[name] for name in chosen) + 1
    if border > max(numbers.values()):
        raise none_left(place)
    return border


def _host_layers(chip: _Built, layers: Sequence[NetLayer]) -> HostLayers:
    """Return the first layers of a file as layers on the host; the chip's layers get the shape of their output."""
    on_host = _Built(relay_delays=chip.relay_delays, on_host=True)
    for layer in layers:
        _add(on_host, layer, last=False)
    on_host.outputs = {on_host.source: None}
    numbers = on_host.views[0].lines
    network = on_host.network(name="host", channels=numbers, steps=DEFAULT_STEPS, any_length=True)
    chip.shape = on_host.shape
    chip.assumed += on_host.assumed
    if on_host.scaling is not None:
        chip.assumed.append(on_host.scaling.sentence)
    # slayer's layers take a step each, as ours do.
    sends = (HostOutput(on_host.source, depth=0),)
    return HostLayers(network, sends, on_host.input_shape or (numbers,), on_host.scaling)


def _potentials_from(file: NetFile, built: _Built) -> int | None:
    """Return the first step of potentials if the last layer never spikes, as an affine block of slayer; else None.

    Input takes a step per layer to reach the last one, so earlier potentials are empty.
    """
    last = next(layer for layer in reversed(file.layers) if f"layer{layer.number}" == built.source)
    if not _has_neurons(last):
        return len(built.populations)
    threshold = last.values["neuron/vThMant"]
    silent = not isinstance(threshold, str) and bool((threshold >= NEVER_SPIKES).all())
    return len(built.populations) if silent else None


def _simulation(file: NetFile, where: str) -> tuple[float | None, int]:
    """Return the seconds per step (Ts is in milliseconds), None if unknown, and the steps of a recording."""
    entries = {key: file.simulation.get(key, np.array(math.nan)) for key in ("Ts", "tSample")}
    for key, value in entries.items():
        if isinstance(value, str) or value.size != 1 or (value <= 0).any():
            measured = repr(value[:40]) if isinstance(value, str) else f"{value.reshape(-1)[:4]}"
            raise export_again(where, f"{key!r} must be one number above 0", measured)
    ts = float(np.asarray(entries["Ts"]).reshape(-1)[0])
    recording_ms = float(np.asarray(entries["tSample"]).reshape(-1)[0])
    seconds = ts / 1000 if ts > 0 else None
    # nan if either is missing, and nan is not usable.
    steps = recording_ms / ts
    is_usable = 1 <= steps <= MAX_STATED_STEPS
    return seconds, int(steps) if is_usable else DEFAULT_STEPS


def _add(built: _Built, layer: NetLayer, *, last: bool) -> None:
    """Add a layer of any type; ``last``: it is the last of the file."""
    kind = layer.kind
    if kind == "input":
        built.shape = _shape(layer)
        built.input_shape = built.shape
        built.views.append(InputView(INPUT, "time", math.prod(built.shape)))
        if _has_neurons(layer):
            _add_input_neurons(built, layer, built.shape)
    elif kind == "flatten":
        built.shape = None if built.shape is None else (math.prod(built.shape),)
    elif kind in ("dense", "dense_rec", "conv", "pool"):
        _add_weights(built, layer, last=last)
    elif kind in _REFUSED:
        raise InputError(
            layer.where, f"{kind!r} is a type of layer that the chip cannot run", fix=_REFUSED[kind]
        )
    else:
        raise InputError(
            layer.where,
            f"{kind[:40]!r} is not a known type of layer",
            fix="Use dense and conv layers.",
        )


def _add_input_neurons(built: _Built, layer: NetLayer, shape: Shape) -> None:
    """Add the neurons of an input layer; an event counts as the value 1."""
    weight = layer.one("weight", INPUT_WEIGHT)
    bias = layer.one("bias", 0)
    if built.takes_numbers:
        # The host scales the numbers themselves, so the synapses have the weight of 1.
        built.scaling = InputScaling(weight / INPUT_WEIGHT, bias / INPUT_WEIGHT)
        weight = INPUT_WEIGHT
    elif bias:
        what = "it adds a bias to the numbers before its neurons, and events have none"
        fix = "Run the layer on the host, and give numbers: --host-layers 1."
        raise InputError(layer.where, what, measured=f"{bias}", fix=fix)
    one_to_one = weight * sparse.eye_array(math.prod(shape), dtype=np.int64)
    _append(built, layer, shape, matrix(sparse.csr_array(one_to_one), np.int64))


def _add_weights(built: _Built, layer: NetLayer, *, last: bool) -> None:
    """Add a layer with weights, and its recurrent weights if it has any."""
    if "weight/real" in layer.values or "weight/imag" in layer.values:
        raise InputError(layer.where, "its weights are complex", fix="Use CUBA neurons.")
    mantissa, shape, source = _weights(built, layer)
    if not built.views:
        # Without an input layer, the first weights determine the number of lines.
        built.views.append(InputView(INPUT, "time", source))
    _append(built, layer, shape, mantissa, read_out=last and not _has_neurons(layer))
    if layer.kind == "dense_rec":
        name = built.source
        size = math.prod(shape)
        recurrent = layer.whole("weight_rec")
        check_entries(recurrent.size, layer.where)
        if recurrent.size != size * size or (size > 1 and len(recurrent) != size):
            raise layer.fault("weight_rec has the wrong size", f"{recurrent.shape} for {size}")
        mantissa = matrix(recurrent.reshape(size, size), np.int64)
        built.projections.append(_projection(name, name, mantissa, 0, layer.where))


def _has_neurons(layer: NetLayer) -> bool:
    """Return whether a layer has a group of neurons."""
    return any(key.startswith("neuron/") for key in layer.values)


def _append(
    built: _Built, layer: NetLayer, shape: Shape, mantissa: Matrix, *, read_out: bool = False
) -> None:
    """Add the neurons of a layer, and the weights onto them from the last layer.

    ``read_out``: the layer has no neurons, and the charge of each step is read out.
    """
    name = f"layer{layer.number}"
    size = math.prod(shape)
    takes_numbers = built.takes_numbers
    if read_out:
        neurons = _sums_of_arriving_weights(layer, size)
    else:
        neurons = _neurons(layer, shape, takes_numbers=takes_numbers)
    built.populations.append(Population(name, "time", size, neurons))
    delay = 0 if layer.kind == "input" else _delay(built, layer, mantissa)
    if np.any(delay) and neurons.biased.any():
        built.assumed.append(
            f"The delays of layer {layer.number} hold back its inputs and not its biases, as in netx; "
            "slayer delays what it sends."
        )
    projection = _projection(built.source, name, mantissa, delay, layer.where)
    built.projections.append(_in_float(projection) if takes_numbers else projection)
    built.source = name
    built.shape = shape


def _weights(built: _Built, layer: NetLayer) -> tuple[Matrix, Shape, int]:
    """Return the mantissas (n, n_source), the shape of the layer, and n_source."""
    weight = layer.whole("weight")
    shape = _shape(layer)
    where = layer.where
    check_entries(weight.size, where)
    if layer.kind in ("dense", "dense_rec"):
        size = math.prod(shape)
        rows = len(weight) if weight.ndim else 1
        # A layer of one neuron may have lost its axis of one row.
        has_row_per_neuron = weight.size > 0 and size in (1, rows)
        inputs = weight.size // size if has_row_per_neuron else 0
        is_other_input = built.shape is not None and math.prod(built.shape) != inputs
        if inputs < 1 or is_other_input:
            measured = f"{weight.shape} for {counted(size, 'neuron')} and an input of {built.shape}"
            raise layer.fault("its weight has the wrong shape", measured)
        return matrix(weight.reshape(size, inputs), np.int64), shape, inputs
    image = built.shape or _image_before(layer, weight.shape, shape)
    built.input_shape = built.input_shape or image
    kernel = _kernel(layer, weight)
    stride, padding, dilation = _strides(layer)
    if kernel.ndim != 4 or len(image) != 3:
        raise layer.fault("it is not a layer of images", f"weight {weight.shape}")
    if layer.kind == "pool":
        window = Window.padded(stride, padding, dilation, _fill(image, shape, stride))
        # All channels have the same kernel.
        mantissas, out = pooling(kernel[:1, :1], image, window, where=where)
    else:
        window = Window.padded(stride, padding, dilation)
        groups = layer.one("groups", 1)
        mantissas, out = convolution(kernel, image, window, groups=groups, where=where)
    check_same(shape, out, where, "its shape and its output differ", fix="Export again.")
    return matrix(mantissas, np.int64), shape, math.prod(image)


def _kernel(layer: NetLayer, weight: IntArray) -> IntArray:
    """Return the kernel (out, in / groups, height, width).

    lava-dl writes a fifth axis, of time, with one entry. slayerPytorch writes kernels without their axes of length one,
    which other datasets restore. A weight that fits neither is returned as it is; the caller refuses it.
    """
    if weight.ndim == 5 and weight.shape[4] == 1:
        return weight.reshape(weight.shape[:4])
    if weight.ndim >= 4 or "kernelSize" not in layer.values:
        return weight
    height, width = layer.pair("kernelSize", 1)
    shape: Shape = (1, 1, height, width)
    if layer.kind != "pool":
        groups = max(layer.one("groups", 1), 1)
        outputs = layer.one("outChannels", 1)
        shape = (outputs, layer.one("inChannels", 1) // groups, height, width)
    return weight.reshape(shape) if weight.size == math.prod(shape) else weight


def _fill(input_shape: Shape, shape: Shape, stride: Ints) -> Ints:
    """Return how many rows and columns of 0 slayerPytorch's pooling adds after an image, to get whole windows.

    Other pooling adds none. The output ``shape`` tells them apart: slayerPytorch rounds its size up.
    """
    if len(shape) != 3 or min(stride) < 1:
        return (0, 0)
    return tuple(
        -n % s if out == -(-n // s) else 0
        for n, out, s in zip(input_shape[1:], shape[1:], stride, strict=True)
    )


def _image_before(layer: NetLayer, kernel: Shape, shape: Shape) -> Shape:
    """Return the input shape of a convolution if no layer states it: with stride 1, its output shape determines it.

    Raises ``InputError`` for other strides, with which several input shapes have the same output shape.
    """
    stride, padding, dilation = _strides(layer)
    if layer.kind != "conv" or len(kernel) < 4 or len(shape) != 3 or set(stride) != {1}:
        raise InputError(
            layer.where,
            "the shape of its input is not known",
            fix="Export the input layer as well.",
        )
    axes = zip(shape[1:], dilation, kernel[2:4], padding, strict=True)
    rows, columns = (n + d * (k - 1) - 2 * p for n, d, k, p in axes)
    if min(rows, columns) < 1:
        raise layer.fault("its padding is wider than its input", f"{padding}")
    return (kernel[1] * layer.one("groups", 1), rows, columns)


def _strides(layer: NetLayer) -> tuple[Ints, Ints, Ints]:
    """Return stride, padding and dilation, each for height and width."""
    return layer.pair("stride", 1), layer.pair("padding", 0), layer.pair("dilation", 1)


def _shape(layer: NetLayer) -> Shape:
    """Return the output shape of a layer."""
    shape = tuple(layer.whole("shape").reshape(-1).tolist())
    check_shape(shape, layer.where)
    return shape


def _projection(
    source: str, target: str, mantissa: Matrix, delay: int | IntArray, where: str
) -> ChipProjection:
    """Return weights as a projection in the chip's integers; raise ``InputError`` if no 8-bit format holds them."""
    fix = "Export it again, with quantised weights."
    signs = choose_eight_bit_signs(mantissa, where, limits="-256..254, even, or -255..255", fix=fix)
    return ChipProjection(
        source, target, mantissa, exponent=0, weight_bits=8, signs=signs, delay=delay
    )


def _in_float(projection: ChipProjection) -> Projection:
    """Return a projection in float whose weights are the charges, in counts of the registers, of an input of 1."""
    charges: FloatArray = loihi.in_registers(values_of(projection.mantissa).astype(np.float64))
    return Projection(
        projection.source,
        projection.target,
        with_values(projection.mantissa, charges),
        projection.delay,
    )


def _delay(built: _Built, layer: NetLayer, mantissa: Matrix) -> int | IntArray:
    """Return the delays of a layer's weights, in whole steps: one number, or an array like the values of ``mantissa``.

    A file has one for all, one per neuron, or one per input, as netx reads it; layers of images may have one per output
    channel. Like netx, cut delays to whole steps and to the longest delay of a synapse; sentences about what that
    changes are added to the assumptions.
    """
    if "delay" not in layer.values:
        return 0
    values = layer.values["delay"]
    if isinstance(values, str) or (values < 0).any():
        raise InputError(
            layer.where, "a delay is below 0", fix="Clamp the delays before the export."
        )
    longest = LONGEST_DELAY if built.relay_delays else DELAY_MAX
    built.assumed += _changed_delays(layer, values, longest)
    delay = np.minimum(np.floor(values), longest).astype(np.int64).reshape(-1)
    rows, columns = mantissa.shape
    if (delay == delay[:1]).all() and delay.size in (1, rows, columns):
        return int(delay[0])
    channels = _shape(layer)[0]
    if layer.kind in ("conv", "pool") and delay.size == channels:
        delay = np.repeat(delay, rows // channels)
    if delay.size not in (rows, columns):
        raise layer.fault(
            "the delays have the wrong size",
            f"{delay.size} against {rows} outputs or {columns} inputs",
        )
    if delay.size == rows:
        delay_of_weight = of_target(mantissa, delay)
    else:
        delay_of_weight = of_source(mantissa, delay)
    return sealed(np.broadcast_to(delay_of_weight, values_of(mantissa).shape).astype(np.int64))


def _changed_delays(layer: NetLayer, delays: Array, longest: int) -> list[str]:
    """Return sentences about the delays of a layer that are cut to whole steps, or to the longest one."""
    sentences = []
    fractions = int((delays != np.floor(delays)).sum())
    if fractions:
        sentences.append(
            f"Of layer {layer.number}, {fractions} of {counted(delays.size, 'delay')} lose a fraction of "
            "a step, as in netx."
        )
    long = int((np.floor(delays) > longest).sum())
    if long:
        way_out = "" if longest == LONGEST_DELAY else " (--relay-delays keeps them)"
        sentences.append(
            f"Of layer {layer.number}, {long} of {counted(delays.size, 'delay')}, up to "
            f"{delays.max():g} steps, are cut to {longest} steps, as in netx{way_out}."
        )
    return sentences


def _sums_of_arriving_weights(layer: NetLayer, size: int) -> ChipCuba:
    """Return neurons without memory that never spike: their potential is the charge of a step."""
    if "bias" in layer.values:
        what = "a layer without neurons has a bias"
        raise InputError(layer.where, what, fix="Give it neurons that do not spike.")
    return ChipCuba.of(size, decay_u=loihi.FORGETS, decay_v=loihi.FORGETS, threshold=THRESHOLD_MAX)


def _neurons(layer: NetLayer, shape: Shape, *, takes_numbers: bool) -> ChipCuba:
    """Return the neurons of a layer; raise ``InputError`` for neurons that are not like the chip's.

    ``takes_numbers``: they are the first layer on the host.
    """
    kind = layer.text("neuron/type") or ("CUBA" if "neuron/vThMant" in layer.values else "")
    if kind not in ("CUBA", "LOIHI"):
        what = "it has no neurons"
        if kind:
            what = f"{kind[:40]!r} neurons do not fit into one compartment of the chip"
        raise InputError(layer.where, what, fix="Use CUBA neurons.")
    if layer.one("neuron/gradedSpike", 0):
        raise InputError(layer.where, "its spikes are graded", fix="Train with graded_spike=False.")
    if layer.one("neuron/wgtExp", 0):
        raise InputError(
            layer.where, "wgtExp is not 0, and lava-dl ignores it", fix="Export with wgtExp 0."
        )
    size = math.prod(shape)

    def per_neuron(name: str, default: int | None = None) -> IntArray:
        """Return a dataset with one number per neuron, (size,); a file may have one for all, or one per channel."""
        if name not in layer.values and default is not None:
            values = np.array([default])
        else:
            values = layer.whole(name).reshape(-1)
        if values.size not in (1, shape[0], size):
            raise layer.fault(f"{name!r} has the wrong size", f"{values.size} for {shape}")
        return integers(np.repeat(values, size // values.size), size)

    decays = {key: per_neuron(f"neuron/{key}") for key in ("iDecay", "vDecay")}
    for key, values in decays.items():
        low, high = loihi.DECAYS
        if not loihi.DECAYS.holds(values).all():
            measured = f"{values.min()}..{values.max()} against {low}..{high}"
            raise InputError(
                layer.where, f"{key} is not a decay", measured=measured, fix="Correct it."
            )
    # The bias of an input layer is added to its numbers, see InputScaling.
    has_bias = "bias" in layer.values and layer.kind != "input"
    model = HostCuba if takes_numbers else ChipCuba
    return model.of(
        size,
        decay_u=decays["iDecay"],
        decay_v=decays["vDecay"],
        # Neurons that must not spike have more than the register holds (NEVER_SPIKES).
        threshold=np.minimum(per_neuron("neuron/vThMant"), THRESHOLD_MAX),
        bias_mantissa=per_neuron("bias") if has_bias else 0,
        bias_exponent=BIAS_EXPONENT if has_bias else 0,
        # A refDelay of 0 is the same as 1: no step is blocked.
        refractory=np.maximum(per_neuron("neuron/refDelay", 1), 1),
    )
