"""A chain of layers that grows, as nodes of a NIR graph."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hw_model.values import FloatArray
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir.flat import NEURONS
from locsnn_compile.frontends.nir.graph import Edge, NirGraph, NirNode
from locsnn_compile.frontends.nir.neurons import Reading

INPUT = "input"
OUTPUT = "output"
DT_SECONDS = 1.0
"""Time constants are counted in steps, so a step lasts 1."""
PLAIN = Reading(dt=DT_SECONDS, discretisation="euler", reset="zero")
"""How neurons without memory are read."""


@dataclass(eq=False)
class Chain:
    """Layers so far, each behind the one before it.

    - ``where``: how errors name the file; ``tensors``: those of the state dict, by name
    - ``axes``: the axes of what the last layer sends: 3 of an image (channels, height, width)
    - ``weighted``: the last layer has weights, into which a factor and a bias per channel can be folded
    - ``spiking``: the last layer sends spikes
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
        """Return a tensor of a layer; ``InputError`` if the state dict lacks it."""
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
        """Add a layer that sums, into which nothing can be folded."""
        self._add(name, node)
        self.weighted = False
        self.spiking = False

    def add_order(self, name: str, node: NirNode, axes: int) -> None:
        """Add a layer that only changes the shape: spikes stay spikes."""
        self._add(name, node)
        self.axes = axes
        self.weighted = False

    def add_neurons(self, name: str, node: NirNode, reading: Reading = PLAIN) -> None:
        """Add neurons, and how their equations become steps."""
        self._add(name, node)
        self.readings[name] = reading
        self.weighted = False
        self.spiking = True

    def fold(self, factor: FloatArray, bias: FloatArray) -> None:
        """Multiply the output of the last weights by a factor for each channel (n,), and add a bias (n,)."""
        before = self.nodes[self.last]
        weight = before.array("weight")
        constant = before.parameters.get("bias", np.zeros(len(weight)))
        assert not isinstance(constant, str)
        kind = "Affine" if before.kind == "Linear" else before.kind
        parameters = dict(before.parameters)
        parameters["weight"] = weight * factor.reshape(-1, *(1,) * (weight.ndim - 1))
        parameters["bias"] = constant * factor + bias
        self.nodes[self.last] = NirNode(kind, parameters)

    def graph(self, shape: tuple[int, ...]) -> NirGraph:
        """Return the graph of an input (C, H, W), or of another shape, all layers, and the output."""
        ends = {
            INPUT: NirNode("Input", {"shape": np.array(shape)}),
            OUTPUT: NirNode("Output", {"shape": np.array(())}),
        }
        edges = (*self.edges, (self.last, OUTPUT))
        return NirGraph({**ends, **self.nodes}, edges)

    def _add(self, name: str, node: NirNode) -> None:
        if name in (INPUT, OUTPUT, *self.nodes):
            fix = "Name the layer otherwise in the state dict and here."
            raise InputError(self.place(name), "another node has this name", fix=fix)
        self.nodes[name] = node
        self.edges.append((self.last, name))
        self.last = name


def readings_of(chain: Chain) -> dict[str, Reading]:
    """Return the reading of every node; those without neurons have the plain one."""
    known = {name for name, node in chain.nodes.items() if node.kind in NEURONS}
    assert known == set(chain.readings)
    return {name: chain.readings.get(name, PLAIN) for name in (INPUT, OUTPUT, *chain.nodes)}
