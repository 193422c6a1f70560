"""Spiking graph convolutions in torch: sparse products with the powers of a graph, then integrate-and-fire neurons."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from locsnn_compile.models.branch_graph import BranchGraph
from locsnn_compile.models.description import LifParameters
from locsnn_compile.models.lif import spike, uniform_weight


class GraphLayer(nn.Module):
    """Topology-adaptive graph convolution (Du et al. 2017) whose outputs are integrate-and-fire neurons.

        drive(node) = sum over k = 0 .. hops of W_k * (A^k x)(node)

    Input (batch, steps, lines), of which ``lines[node, c]`` is input c of a node; output (batch, steps, nodes *
    features), features of a node side by side. ``weight`` [features, (hops + 1) * inputs], W_0 first, is all nodes'.
    """

    hop: Tensor
    lines: Tensor

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
        self._hop = graph.hop.tocoo()
        self.register_buffer("hop", self._sparse(torch.float32), persistent=False)
        self.register_buffer("lines", torch.from_numpy(graph.lines.T.reshape(-1).copy()), persistent=False)

    def _sparse(self, dtype: torch.dtype) -> Tensor:
        places = torch.from_numpy(np.stack(self._hop.coords).astype(np.int64))
        values = torch.from_numpy(self._hop.data).to(dtype)
        return torch.sparse_coo_tensor(places, values, self._hop.shape, check_invariants=False).coalesce()

    def _apply(self, fn: object, recurse: bool = True) -> GraphLayer:
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        # From the double precision original: a float32 matrix made double would stay rounded to float32.
        self.hop = self._sparse(self.hop.dtype).to(self.hop.device)
        return self

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        batch, steps, _ = x.shape
        # (inputs, nodes, recordings and steps): a product of the graph takes all of them as columns.
        at_nodes = x.index_select(2, self.lines).reshape(batch * steps, self.inputs, self.nodes).permute(2, 1, 0)
        heard = torch.sparse.mm(self.hop, at_nodes.reshape(self.nodes, -1))
        terms = heard.reshape(-1, self.nodes, self.inputs, batch * steps).permute(3, 1, 0, 2)
        drive = torch.matmul(terms.reshape(batch, steps, self.nodes, -1), self.weight.T)
        return spike(drive.reshape(batch, steps, -1), self.neuron)
