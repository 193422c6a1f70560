"""A flat graph in two: the layers that run on the host, and the rest, which takes their spikes as its input.

A layer on the host is a node of neurons with all that feeds it. The rest has an Input in place of each such
node whose spikes it takes.
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
SENT = "nir/host"
"""The Output of the layers on the host; names of nodes have no slash."""


class Divided(Frozen, eq=False):
    """Both graphs; ``sent`` are the nodes whose spikes the host sends, in the order of the chip's lines."""

    host: FlatGraph
    chip: FlatGraph
    sent: tuple[str, ...]
    input_shape: Shape


def divide_graph(flat: FlatGraph, host_layers: str, order: list[str], where: str) -> Divided:
    """Return the graph divided behind the layers that ``host_layers`` names.

    It is a number of layers, counted from the input, or names of nodes of neurons, separated by commas.
    ``order`` has all nodes of neurons, those nearest to the input first. Raises ``InputError`` for layers
    that do not exist or do not spike, if nothing is left for the chip, and if the input reaches the chip
    past the host.
    """
    place = f"{where}, --host-layers"
    inputs = flat.named("Input")
    if len(inputs) != 1:
        what = "layers on the host need one Input"
        raise InputError(place, what, measured=f"{len(inputs)}", fix="Leave it out.")
    with_memory = [name for name in order if flat.nodes[name].kind in WITH_MEMORY]
    chosen = chosen_layers(host_layers, order, with_memory, place)
    on_host = _before(flat, chosen, stop=())
    neurons_left = [name for name in order if name not in on_host]
    if not neurons_left:
        raise none_left(place)
    _check_host(flat, on_host, place)
    borders = [name for name in order if name in on_host]
    ends = [*neurons_left, *flat.named("Output")]
    on_chip = _before(flat, ends, stop=borders)
    if inputs[0] in on_chip:
        what = "the input also reaches the chip past these layers, and it is not made of spikes"
        raise InputError(place, what, fix="Name more layers, up to where all paths meet.")
    sent = tuple(name for name in flat.nodes if name in on_chip and name in borders)
    chip = _part(flat, on_chip)
    nodes = dict(chip.nodes)
    sources = dict(chip.sources)
    for name in sent:
        nodes[name] = NirNode("Input", {"shape": np.array(flat.shapes[name])})
        sources[name] = ()
    host = _part(flat, on_host)
    host_nodes = {**host.nodes, SENT: NirNode("Output", {"shape": np.array(())})}
    host_sources = {**host.sources, SENT: sent[:1]}
    host_shapes = {**host.shapes, SENT: flat.shapes[sent[0]]}
    host = replace(host, nodes=host_nodes, sources=host_sources, shapes=host_shapes)
    return Divided(host, replace(chip, nodes=nodes, sources=sources), sent, flat.shapes[inputs[0]])


def _check_host(flat: FlatGraph, on_host: Collection[str], place: str) -> None:
    """Refuse readouts, which send no spikes."""
    for name in on_host:
        kind = flat.nodes[name].kind
        if kind in READOUTS:
            what = f"{name!r} sends no spikes"
            raise InputError(place, what, fix="Name layers that spike.")


def _before(flat: FlatGraph, names: Collection[str], stop: Collection[str]) -> set[str]:
    """Return nodes and all that leads to them, up to and with the nodes where the search stops."""
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


def _part(flat: FlatGraph, names: Collection[str]) -> FlatGraph:
    """Return some of the nodes, in file order, and what is known of them."""
    return FlatGraph(
        {name: node for name, node in flat.nodes.items() if name in names},
        {name: found for name, found in flat.sources.items() if name in names},
        {name: shape for name, shape in flat.shapes.items() if name in names},
        {name: layer for name, layer in flat.layers.items() if name in names},
    )
