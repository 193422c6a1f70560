"""Turn a slayerPytorch checkpoint (a dict of tensors) and its YAML into a :class:`Network`.

A checkpoint contains layers and their weights in the order in which they were created, but no structure:
``choose_layers.py`` decides which of them run, in one chain along time and one that walks the channels. A list
``layer`` in the YAML says which layers are convolutions and pooling. A delay belongs to the layer of its own block,
or else to the first layer that has as many outputs and no delay yet. The YAML, read by ``config.py``, is called the
*config* in the code, as the option ``--config`` is; a user's messages call it the YAML or the description.

SRMALPHA layers become float neurons, whose kernels have their whole tails unless ``--kernels cut`` ends them where
slayerPytorch does. LOIHI layers become integer neurons with the weights ``2 round(w / 2)``, half to even, as
slayerPytorch quantises them in every forward pass.

A spike of step t acts on the next layer at step ``t + 1 + delay``. The one step that every layer takes is the same in
slayerPytorch, so a layer without delays has delay 0.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.io.files import read_bytes
from hw_model.mapping.graph import Axis
from hw_model.values import FloatArray
from locsnn_compile.data.channels import Channels, image_channels
from locsnn_compile.data.orders import channel_walk, location_order
from locsnn_compile.data.sensor import POLARITIES, TAXELS, neutouch
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError, check_known, check_same, counted
from locsnn_compile.frontends.parts import (
    DEFAULT_STEPS,
    VIEW_NAMES,
    FileFacts,
    Parts,
    choose_eight_bit_signs,
    touch_fingertips,
)
from locsnn_compile.frontends.relays import DELAY_MAX
from locsnn_compile.frontends.slayer.branches import Branches
from locsnn_compile.frontends.slayer.choose_layers import Chosen, choose_layers
from locsnn_compile.frontends.slayer.config import (
    DEFAULT_ORDER,
    LoihiNeuron,
    SlayerConfig,
    axis_of,
    read_config,
)
from locsnn_compile.frontends.slayer.layers import check_kernels, cut, dense_layer, listed_layers
from locsnn_compile.frontends.state_dict import (
    SAVE_A_STATE_DICT,
    WEIGHT_ENDS,
    state_tensors,
)
from locsnn_compile.models.checkpoint import FORMAT
from locsnn_compile.network import projections
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.network.projections import (
    ChipProjection,
    Matrix,
    Projection,
    matrix,
    values_of,
    with_values,
)

KERNELS = ("full", "cut")
"""The values of the option ``--kernels``."""
_TWO_FINGERTIPS = 2 * TAXELS * POLARITIES
"""Channels of the recordings that the networks with location neurons of Kang et al. 2022 were trained on."""


@dataclass(eq=False)
class _Layer:
    """A layer with weights (n, n_source), its number of output channels, and the axis along which it runs.

    ``delays`` (n,) are those of the spikes that it sends, in steps; None for no delays. ``assumed`` are sentences about
    assumptions on these delays.
    """

    name: str
    axis: Axis
    weights: Matrix
    channels: int
    delays: Any = None
    assumed: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """The number of neurons."""
        return int(self.weights.shape[0])


def load_slayer(
    path: Path, config: Path, kernels: str | None = None, branches: Branches | None = None
) -> Network:
    """Read a checkpoint and its YAML ``config``, and return the network; raise ``InputError`` if they cannot be used.

    ``kernels`` is a value of :data:`KERNELS`, None if the user gives none. ``branches`` are the layers that run,
    instead of those that the YAML names.
    """
    check_known(f"kernels {kernels!r}", "are not known", kernels, KERNELS)
    where = f"model {path.name!r}"
    data = read_bytes(path, where)
    content = load_plain(data, where, fix=SAVE_A_STATE_DICT)
    if isinstance(content, dict) and content.get("format") == FORMAT:
        raise InputError(
            where,
            "config was given, but a checkpoint contains this itself",
            fix="Leave config out.",
        )
    slayer_config, kernel_assumptions = _with_kernels(read_config(config), kernels)
    tensors = state_tensors(content, where)
    check_kernels(tensors, slayer_config, where)
    weights = _layer_weights(tensors, where)
    shapes = {name: kernel.shape for name, kernel in weights.items()}
    chosen = choose_layers(shapes, slayer_config, branches, where)
    layers = _layers(tensors, weights, chosen, slayer_config, where)
    chains = {axis: [layers[name] for name in names] for axis, names in chosen.chains.items()}
    for chain in chains.values():
        _check_chain(chain, where)
    # The weights show what a branch takes in: a time branch has a column per channel, a location branch one per time
    # step. Only a network without a location branch can run for any number of steps.
    steps = slayer_config.steps or DEFAULT_STEPS
    if "location" in chains:
        steps = chains["location"][0].weights.shape[1]
    channels = _channels(chosen, chains)
    parts = Parts()
    for axis, chain in chains.items():
        walk = None
        if axis == "location":
            walk = _walk(slayer_config.order or DEFAULT_ORDER, channels, where)
        lines = chain[0].weights.shape[1]
        parts.views.append(InputView(VIEW_NAMES[axis], axis, lines=lines, walk=walk))
        _add_chain(parts, axis, chain, slayer_config, where)
    sizes = [p.size for p in parts.populations if p.name in parts.outputs]
    if len(set(sizes)) > 1:
        raise InputError(
            where,
            "its branches differ in class count",
            measured=f"{sizes}",
            fix="Train them together.",
        )
    facts = FileFacts(
        any_length="location" not in chains,
        inputs=_image(weights, chains, slayer_config),
        assumptions=(*kernel_assumptions, *_assumed(chosen, chains, slayer_config, channels)),
    )
    return parts.network_of_file(
        path,
        data,
        channels=channels,
        steps=steps,
        step_seconds=slayer_config.ts / 1000,  # Ts is in milliseconds
        facts=facts,
    )


def _channels(chosen: Chosen, chains: Mapping[Axis, list[_Layer]]) -> int:
    """Return the number of channels of the recordings: those of two fingertips, if nothing in the files tells it."""
    if "time" in chains:
        return int(chains["time"][0].weights.shape[1])
    if chosen.channels is not None:
        return chosen.channels
    return _TWO_FINGERTIPS


def _check_chain(chain: list[_Layer], where: str) -> None:
    """Raise ``InputError`` for a layer that has other inputs than the layer before it has neurons."""
    for before, after in pairwise(chain):
        what = f"its inputs are not the neurons of {before.name!r}"
        fix = "Save the layers of one chain in their order."
        inputs = after.weights.shape[1]
        check_same(inputs, before.size, f"{where}, layer {after.name!r}", what, fix=fix)


def _image(
    weights: Mapping[str, FloatArray], chains: Mapping[Axis, list[_Layer]], config: SlayerConfig
) -> Channels | None:
    """Return the pixels of the input, from the YAML or the axes of the first weights; None if neither has them.

    ``weights`` have their axes as in the checkpoint.
    """
    if "time" not in chains:
        return None
    if config.layers:
        # The first entry of the list is the input, as the YAML writes images: 34x34x2.
        width, height, polarities = config.layers[0].numbers
        return image_channels((polarities, height, width))
    # slayerPytorch's kernels are (out, channels, height, width, time).
    kernel = weights[chains["time"][0].name]
    return image_channels(kernel.shape[1:4])


def _assumed(
    chosen: Chosen,
    chains: Mapping[Axis, list[_Layer]],
    config: SlayerConfig,
    channels: int,
) -> Iterator[str]:
    """Yield a sentence for each assumption: a value that neither the checkpoint nor its YAML states."""
    yield from chosen.assumed
    if "location" in chains and config.order is None:
        yield f"The description has no location_order: taxels are visited in the order {DEFAULT_ORDER}."
    if "time" not in chains and chosen.channels is None:
        yield f"No layer along time says how many channels there are: {channels}, those of two fingertips."
    for chain in chains.values():
        for layer in chain:
            yield from layer.assumed
    yield f"The Ts of the YAML, {config.ts:g}, was read as milliseconds, which SLAYER does not say (--step-seconds)."


def _walk(order: str, channels: int, where: str) -> Any:
    """Return the walk over the channels: the channel of each step of the location branch, in a location order."""
    fingertips = touch_fingertips(channels)
    if fingertips is None:
        if order != "loop":
            what = f"order {order[:40]!r} is only for fingertips"
            raise InputError(where, what, measured=counted(channels, "channel"), fix="Use loop.")
        return np.arange(channels)
    # An order numbers the taxels of one fingertip. The walk follows it on each fingertip in turn.
    _, taxels = location_order(order, neutouch(1))
    return channel_walk(taxels, neutouch(fingertips))


def _with_kernels(
    config: SlayerConfig, kernels: str | None
) -> tuple[SlayerConfig, tuple[str, ...]]:
    """Return the config with kernels ``full`` or ``cut``, and the assumption, if one is made: a sentence in a tuple.

    Kernels are full unless the user asks for ``cut``. Nothing is assumed if the user states either.
    """
    if kernels == "cut":
        neuron = cut(config.neuron)
        location_neuron = cut(config.location_neuron)
        return replace(config, neuron=neuron, location_neuron=location_neuron), ()
    if kernels is None and isinstance(config.neuron, SrmAlpha):
        sentence = "The reference has the tails of its kernels, which slayerPytorch cuts in training (--kernels full)."
        return config, (sentence,)
    return config, ()


def _add_chain(
    parts: Parts, axis: Axis, chain: list[_Layer], config: SlayerConfig, where: str
) -> None:
    """Add the layers of a branch, each behind the one before it; the last one is an output."""
    source = VIEW_NAMES[axis]
    delays = None
    for layer in chain:
        population, projection = _parts_of(layer, axis, source, delays, config, where)
        parts.populations.append(population)
        parts.projections.append(projection)
        # The delays of a layer are those of its outputs, so they act on the projection onto the next layer.
        source = layer.name
        delays = layer.delays
    # The spikes of an output count (None); other frontends have outputs whose potentials count, from a step on.
    parts.outputs[source] = None


def _parts_of(
    layer: _Layer, axis: Axis, source: str, delays: Any, config: SlayerConfig, where: str
) -> tuple[Population, Projection | ChipProjection]:
    """Return a population and the weights onto it; ``delays`` (n_source,) are those of the spikes of its source."""
    size = layer.size
    delay = _projection_delay(layer.weights, delays)
    neuron = config.neuron_along(axis)
    if not isinstance(neuron, LoihiNeuron):
        population = Population(layer.name, axis, size, neuron)
        return population, Projection(source, layer.name, layer.weights, delay)
    # slayerPytorch's Loihi layers round weights to even numbers in every forward pass: with signs mixed, a synapse of 8
    # bits has no bit for odd ones.
    even = (2 * np.rint(values_of(layer.weights) / 2)).astype(np.int64)
    mantissa = with_values(layer.weights, even)
    place = f"{where}, layer {layer.name!r}"
    signs = choose_eight_bit_signs(
        mantissa, place, limits="-256..254", fix="Clamp the weights in training."
    )
    chip_neuron = ChipCuba.of(
        size,
        decay_u=neuron.decay_u,
        decay_v=neuron.decay_v,
        threshold=neuron.threshold,
        refractory=neuron.refractory,
    )
    projection = ChipProjection(
        source,
        layer.name,
        matrix(mantissa, np.int64),
        exponent=neuron.weight_exponent,
        weight_bits=8,
        signs=signs,
        delay=delay,
    )
    return Population(layer.name, axis, size, chip_neuron), projection


def _projection_delay(weights: Matrix, delays: Any) -> Any:
    """Return the delay of a projection: one number if all sources have the same, else one for each weight.

    ``delays`` (n_source,) are those of the sources; None for no delays.
    """
    if delays is None:
        return 0
    first = int(delays[0])
    if (delays == first).all():
        return first
    delay_of_weight = projections.of_source(weights, delays)
    # A copy, because a broadcast array repeats one row in memory, and must not be written to.
    return np.array(np.broadcast_to(delay_of_weight, values_of(weights).shape))


def _layer_weights(tensors: Mapping[str, Any], where: str) -> dict[str, FloatArray]:
    """Return the weights of every layer, with their axes as in the checkpoint, and in its order."""
    names = dict.fromkeys(
        key.removesuffix(end) for key in tensors for end in WEIGHT_ENDS if key.endswith(end)
    )
    weights = {name: _weights(tensors, name, where) for name in names}
    if not weights:
        raise InputError(
            where, "it has no weights", measured=f"{list(tensors)[:3]}"[:80], fix=SAVE_A_STATE_DICT
        )
    return weights


def _layers(
    tensors: Mapping[str, Any],
    weights: Mapping[str, FloatArray],
    chosen: Chosen,
    config: SlayerConfig,
    where: str,
) -> dict[str, _Layer]:
    """Return all layers by name, also those that do not run, because delays may belong to them."""
    running = {name: kernel for name, kernel in weights.items() if name in chosen.names}
    if config.layers:
        matrices = listed_layers(running, config.layers, where)
    else:
        matrices = {
            name: dense_layer(kernel, f"{where}, layer {name!r}")
            for name, kernel in running.items()
        }
    axes = {name: axis for axis, names in chosen.chains.items() for name in names}
    layers: dict[str, _Layer] = {}
    for name, kernel in weights.items():
        if name in matrices:
            flat, channels = matrices[name]
        else:
            # It does not run, so only its number of outputs matters, to which delays may belong.
            flat = kernel.reshape(len(kernel), -1)
            channels = len(kernel)
        axis = axes.get(name) or axis_of(name)
        layers[name] = _Layer(name, axis, matrix(flat, np.float64), channels)
    for key, values in tensors.items():
        if key.endswith(".bias") and values.any() and key.removesuffix(".bias") in chosen.names:
            fix = "Train without biases, or export the network as NIR."
            raise InputError(
                f"{where}, entry {key!r}", "layers of slayerPytorch have no biases", fix=fix
            )
        if key == "delay" or key.endswith(".delay"):
            place = f"{where}, entry {key!r}"
            _attach_delays(list(layers.values()), key, values.reshape(-1), config, place)
    return layers


def _attach_delays(
    layers: list[_Layer], key: str, delays_ms: Any, config: SlayerConfig, where: str
) -> None:
    """Set the delays of one layer to those of the checkpoint's entry ``key``.

    The layer is one of the same block, such as ``block1.fc`` for ``block1.delay.delay``, or else the first one that
    has as many outputs and no delays; layers of the axis in the name of the entry come first. A convolution has one
    delay per channel.
    """
    # slayerPytorch shifts spikes by whole steps, rounded down (its CUDA kernel casts to int). The reference of a check
    # gets the delays as they are cut here, so the check cannot show the cut; it is listed as an assumption instead.
    whole_steps = np.floor(delays_ms / config.ts)
    steps = np.clip(whole_steps, 0, DELAY_MAX).astype(np.int64)
    module = key.rpartition(".")[0]
    block = module.rpartition(".")[0]
    of_block = [layer for layer in layers if block and layer.name.rpartition(".")[0] == block]
    axis = axis_of(module)
    # False sorts before True: layers of the same axis come first, each group in the order of the checkpoint.
    for layer in of_block or sorted(layers, key=lambda layer: layer.axis != axis):
        if layer.delays is None and steps.size in (1, layer.size, layer.channels):
            # One delay for all neurons, one for each channel of a convolution, or one for each neuron.
            layer.delays = np.repeat(steps, layer.size // steps.size)
            if not of_block:
                layer.assumed += (
                    f"Delays {key!r} are used for layer {layer.name!r}, the first with as many outputs.",
                )
            if (whole_steps > DELAY_MAX).any():
                layer.assumed += (
                    f"Delays {key!r} above {DELAY_MAX} steps were cut to {DELAY_MAX}.",
                )
            return
    fix = "Give one per neuron."
    raise InputError(
        where, "no layer has as many outputs", measured=counted(steps.size, "delay"), fix=fix
    )


def _weights(tensors: Mapping[str, Any], name: str, where: str) -> FloatArray:
    """Return a layer's weights, with their axes as in the checkpoint, and weight normalisation multiplied out.

    With weight normalisation, row i of the weights is ``gains[i] * directions[i] / |directions[i]|``.
    """
    plain, *normalised = [tensors.get(name + end) for end in WEIGHT_ENDS]
    if plain is not None:
        return np.asarray(plain, dtype=np.float64)
    # Torch has two pairs of names for gains and directions, an old and a new one; WEIGHT_ENDS lists them in turns.
    gains = next((tensor for tensor in normalised[0::2] if tensor is not None), None)
    directions = next((tensor for tensor in normalised[1::2] if tensor is not None), None)
    place = f"{where}, layer {name!r}"
    if gains is None or directions is None:
        what = "half of its weight normalisation is missing"
        raise InputError(place, what, fix=SAVE_A_STATE_DICT)
    axes_of_a_row = tuple(range(1, directions.ndim))
    norms = np.sqrt((directions**2).sum(axis=axes_of_a_row, keepdims=True))
    if gains.size != len(directions) or (norms == 0).any():
        raise InputError(place, "its weight normalisation is not valid", fix=SAVE_A_STATE_DICT)
    return np.asarray(gains.reshape(norms.shape) * directions / norms, dtype=np.float64)
