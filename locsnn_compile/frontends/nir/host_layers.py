"""Divide a flat NIR graph into the layers that run on the host, and the remainder, which runs on the chip.

A layer on the host is a neuron node with all nodes that feed it. In the chip's graph, an Input replaces each neuron
node of the host whose spikes the chip takes.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from hw_model.values import Frozen
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.host_choice import chosen_layers, none_left
from locsnn_compile.frontends.linear_maps import Shape
from locsnn_compile.frontends.nir.flat import NEURONS, READOUTS, FlatGraph
from locsnn_compile.frontends.nir.graph import NirNode

SPIKING = tuple(kind for kind in NEURONS if kind not in READOUTS)
WITH_MEMORY = tuple(kind for kind in SPIKING if kind != "Threshold")
"""The kinds of neurons that ``--host-layers N`` counts as layers."""
SENT = "nir/host"
"""The name of the Output of the host's graph; names of nodes have no slash, so it is free."""


class Divided(Frozen, eq=False):
    """A divided graph: the part on the host and the part on the chip.

    ``sent`` are the neuron nodes whose spikes the host sends, in the order of the chip's lines. ``input_shape`` is the
    shape of the host's input.
    """

    host: FlatGraph
    chip: FlatGraph
    sent: tuple[str, ...]
    input_shape: Shape


def divide_graph(flat: FlatGraph, host_layers: str, order: list[str], where: str) -> Divided:
    """Return the graph divided behind the layers that the option ``host_layers`` names.

    The option is a number of layers, counted from the input, or names of neuron nodes, separated by commas. ``order``
    has all neuron nodes, those nearest to the input first. Raises ``InputError`` for layers that do not exist or do not
    spike, if nothing is left for the chip, and if the input also reaches the chip past the host.
    """
    place = f"{where}, --host-layers"
    inputs = flat.named("Input")
    if len(inputs) != 1:
        what = "layers on the host need one Input"
        raise InputError(place, what, measured=f"{len(inputs)}", fix="Leave it out.")
    with_memory = [name for name in order if flat.nodes[name].kind in WITH_MEMORY]
    chosen = chosen_layers(host_layers, order, with_memory, place)
    on_host = _up_to(flat, chosen, stop=())
    neurons_left = [name for name in order if name not in on_host]
    if not neurons_left:
        raise none_left(place)
    _check_host(flat, on_host, place)
    # The chip has all nodes that lead to its neurons and outputs, back to the neurons of the host, which it is sent.
    neurons_of_host = [name for name in order if name in on_host]
    ends = [*neurons_left, *flat.named("Output")]
    on_chip = _up_to(flat, ends, stop=neurons_of_host)
    if inputs[0] in on_chip:
        what = "the input also reaches the chip past these layers, and it is not made of spikes"
        raise InputError(place, what, fix="Name more layers, up to where all paths meet.")
    sent = tuple(name for name in flat.nodes if name in on_chip and name in neurons_of_host)
    return Divided(
        # A graph must have an Output; which of the neurons it follows does not matter, as ``sent`` names them.
        host=_with_output(_nodes_of(flat, on_host), sent[0]),
        chip=_with_inputs(_nodes_of(flat, on_chip), sent),
        sent=sent,
        input_shape=flat.shapes[inputs[0]],
    )


def _with_output(host: FlatGraph, name: str) -> FlatGraph:
    """Return the graph with an Output behind a node."""
    output = NirNode("Output", {"shape": np.array(())})
    return replace(
        host,
        nodes={**host.nodes, SENT: output},
        sources={**host.sources, SENT: (name,)},
        shapes={**host.shapes, SENT: host.shapes[name]},
    )


def _with_inputs(chip: FlatGraph, sent: Collection[str]) -> FlatGraph:
    """Return the graph with an Input in place of each node whose spikes the host sends."""
    nodes = dict(chip.nodes)
    sources = dict(chip.sources)
    for name in sent:
        nodes[name] = NirNode("Input", {"shape": np.array(chip.shapes[name])})
        sources[name] = ()
    return replace(chip, nodes=nodes, sources=sources)


def _check_host(flat: FlatGraph, on_host: Collection[str], place: str) -> None:
    """Raise ``InputError`` for readouts on the host, which send no spikes."""
    for name in on_host:
        kind = flat.nodes[name].kind
        if kind in READOUTS:
            what = f"{name!r} sends no spikes"
            raise InputError(place, what, fix="Name layers that spike.")


def _up_to(flat: FlatGraph, names: Collection[str], stop: Collection[str]) -> set[str]:
    """Return the nodes ``names`` and all nodes that lead to them, back to and including the nodes of ``stop``."""
    reached: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name in reached:
            continue
        reached.add(name)
        if name not in stop:
            waiting.extend(flat.sources[name])
    return reached


def _nodes_of(flat: FlatGraph, names: Collection[str]) -> FlatGraph:
    """Return the graph of some of the nodes, in file order."""
    return FlatGraph(
        nodes={name: node for name, node in flat.nodes.items() if name in names},
        sources={name: feeding for name, feeding in flat.sources.items() if name in names},
        shapes={name: shape for name, shape in flat.shapes.items() if name in names},
        layers={name: layer for name, layer in flat.layers.items() if name in names},
    )
