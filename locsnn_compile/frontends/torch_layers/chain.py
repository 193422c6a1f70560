"""Collect a chain of torch layers as nodes of a NIR graph in memory.

Each layer class of ``layers.py`` and ``neurons.py`` adds itself to a :class:`Chain`. The graph is then read like that
of a NIR file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hw_model.values import FloatArray
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir.flat import NEURONS
from locsnn_compile.frontends.nir.graph import Edge, NirGraph, NirNode
from locsnn_compile.frontends.nir.neurons import Reading

INPUT = "input"
"""The name of the graph's Input."""
OUTPUT = "output"
"""The name of the graph's Output."""
DT_SECONDS = 1.0
"""The length of a step in the unit of the time constants, which are counted in steps."""
PLAIN = Reading(dt=DT_SECONDS, discretisation="euler", reset="zero")
"""How neurons without memory are read; only the step matters to them."""


@dataclass(eq=False)
class Chain:
    """The layers so far, each connected to the one before it.

    - ``where``: how errors name the file
    - ``tensors``: those of the state dict, by name
    - ``axes``: the number of axes of the last layer's output: 3 for an image (channels, height, width)
    - ``nodes`` and ``edges``: those of the graph; ``last`` is the last node
    - ``readings``: how the neurons of each neuron node are read
    - ``assumed``: sentences about assumptions
    - ``weighted``: whether the last layer has weights, into which a factor and a bias per channel can be folded
    - ``spiking``: whether the last layer sends spikes, not numbers
    """

    where: str
    tensors: Mapping[str, FloatArray]
    axes: int
    nodes: dict[str, NirNode] = field(default_factory=dict)
    edges: list[Edge] = field(default_factory=list)
    readings: dict[str, Reading] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)
    last: str = INPUT
    weighted: bool = False
    spiking: bool = True

    def place(self, name: str) -> str:
        """Return how errors name a layer."""
        return f"{self.where}, layer {name!r}"

    def tensor(self, name: str, key: str) -> FloatArray:
        """Return a tensor of a layer; raise ``InputError`` if the state dict lacks it."""
        if f"{name}.{key}" not in self.tensors:
            what = f"the state dict has no {name}.{key}"
            raise InputError(self.place(name), what, fix="Name the layer as the state dict does.")
        return self.tensors[f"{name}.{key}"]

    def optional(self, name: str, key: str) -> FloatArray | None:
        """Return a tensor of a layer, or None if the state dict lacks it."""
        return self.tensors.get(f"{name}.{key}")

    def add_weights(self, name: str, node: NirNode, axes: int) -> None:
        """Add a layer with weights, whose output has ``axes`` axes."""
        self._add(name, node)
        self.axes = axes
        self.weighted = True
        self.spiking = False

    def add_linear(self, name: str, node: NirNode) -> None:
        """Add a pooling layer, which sums without weights of its own: nothing can be folded into it."""
        self._add(name, node)
        self.weighted = False
        self.spiking = False

    def add_order(self, name: str, node: NirNode, axes: int) -> None:
        """Add a layer that only changes the shape of its input to ``axes`` axes: spikes stay spikes."""
        self._add(name, node)
        self.axes = axes
        self.weighted = False

    def add_neurons(self, name: str, node: NirNode, reading: Reading = PLAIN) -> None:
        """Add neurons; ``reading`` says how their equations become steps."""
        self._add(name, node)
        self.readings[name] = reading
        self.weighted = False
        self.spiking = True

    def fold(self, factor: FloatArray, bias: FloatArray) -> None:
        """Multiply the output of the last weights by a factor per channel, (n,), and add a bias, (n,)."""
        before = self.nodes[self.last]
        weight = before.array("weight")
        constant = before.parameters.get("bias", np.zeros(len(weight)))
        assert not isinstance(constant, str)
        kind = "Affine" if before.kind == "Linear" else before.kind
        parameters = dict(before.parameters)
        factor_of_rows = factor.reshape(-1, *(1,) * (weight.ndim - 1))
        parameters["weight"] = weight * factor_of_rows
        parameters["bias"] = constant * factor + bias
        self.nodes[self.last] = NirNode(kind, parameters)

    def graph(self, shape: tuple[int, ...]) -> NirGraph:
        """Return the graph of an input with a ``shape``, such as (C, H, W), all layers, and the output."""
        ends = {
            INPUT: NirNode("Input", {"shape": np.array(shape)}),
            OUTPUT: NirNode("Output", {"shape": np.array(())}),
        }
        edges = (*self.edges, (self.last, OUTPUT))
        return NirGraph({**ends, **self.nodes}, edges)

    def _add(self, name: str, node: NirNode) -> None:
        """Add a node after the last one; raise ``InputError`` if its name is taken."""
        if name in (INPUT, OUTPUT, *self.nodes):
            fix = "Name the layer otherwise in the state dict and here."
            raise InputError(self.place(name), "another node has this name", fix=fix)
        self.nodes[name] = node
        self.edges.append((self.last, name))
        self.last = name


def readings_of(chain: Chain) -> dict[str, Reading]:
    """Return the reading of every node; nodes without neurons have the plain one, of which only the step is used."""
    neuron_nodes = {name for name, node in chain.nodes.items() if node.kind in NEURONS}
    assert neuron_nodes == set(chain.readings)
    return {name: chain.readings.get(name, PLAIN) for name in (INPUT, OUTPUT, *chain.nodes)}
