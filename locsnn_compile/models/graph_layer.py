"""Spiking graph convolutions in torch: one spread weight for every line and neuron, then integrate-and-fire neurons.

The powers of the graph and the weights that all nodes share are joined first, once a batch: events are then multiplied
once, by the weights of those that came.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from locsnn_compile.models.branch_graph import BranchGraph
from locsnn_compile.models.dense_layer import uniform_weight
from locsnn_compile.models.description import LifParameters
from locsnn_compile.models.lif import spike_of_spikes


class GraphLayer(nn.Module):
    """Topology-adaptive graph convolution (Du et al. 2017) whose outputs are integrate-and-fire neurons.

        drive(node) = sum over k = 0 .. hops of W_k * (A^k x)(node)

    Input (batch, steps, lines), of which ``lines[node, c]`` is input c of a node; output (batch, steps, nodes *
    features), features of a node side by side. ``weight`` [features, (hops + 1) * inputs], W_0 first, is all nodes'.
    """

    hop: Tensor
    places: Tensor

    def __init__(
        self,
        graph: BranchGraph,
        features: int,
        neuron: LifParameters,
        *,
        generator: torch.Generator,
        initial_scale: float,
    ) -> None:
        super().__init__()
        self.neuron = neuron
        self.nodes, self.inputs = graph.lines.shape
        terms = graph.hop.shape[0] // self.nodes * self.inputs
        self.weight = uniform_weight((features, terms), terms, initial_scale, generator)
        heard, self._hop = _heard(graph)
        # Row ``line * nodes + node`` of the spread weights, for every input of a node that is heard.
        places = (graph.lines[heard[1]] * self.nodes + heard[0][:, np.newaxis]).reshape(-1)
        self.register_buffer("places", torch.from_numpy(places), persistent=False)
        self.register_buffer("hop", torch.from_numpy(self._hop).to(torch.float32), persistent=False)

    def _apply(self, fn: object, recurse: bool = True) -> GraphLayer:
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        # From the double precision original: a float32 matrix made double would stay rounded to float32.
        self.hop = torch.from_numpy(self._hop).to(self.hop)
        return self

    def spread(self) -> Tensor:
        """Return the weights that every neuron has for every line, (lines, nodes * features)."""
        features = len(self.weight)
        # (pairs, hops) times (hops, inputs * features).
        by_hop = self.weight.T.reshape(self.hop.shape[1], -1)
        joined = torch.mm(self.hop, by_hop).reshape(-1, features)
        lines = self.nodes * self.inputs
        spread = torch.zeros(lines * self.nodes, features, dtype=joined.dtype, device=joined.device)
        return spread.index_copy(0, self.places, joined).reshape(lines, -1)

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        return spike_of_spikes(x, self.spread(), self.neuron)


def _heard(graph: BranchGraph) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float64]]:
    """Return the pairs of nodes of which the first hears the second, and how loud after each hop, (pairs, hops + 1)."""
    nodes = len(graph.lines)
    powers = [graph.hop[start : start + nodes] for start in range(0, graph.hop.shape[0], nodes)]
    pairs = sum(abs(power) for power in powers).nonzero()
    first, second = (ends.astype(np.int64) for ends in pairs)
    return (first, second), np.stack([power[first, second] for power in powers], axis=1)
