"""Leaky integrate-and-fire (LIF) layers in torch: the steps of all neurons are one compiled loop, a *scan*.

Large layers add the weights of active inputs inside this scan, because most inputs are silent in most steps. Small
layers use one matrix product for all steps. The *drive* of a neuron is the sum of weights that the inputs of a step
send to it.

What step t - 1 sends arrives at step t, as on the chip, and as with ``eps(0) = 0`` for spike response neurons:

    u(t) = decay * u(t - 1) * (1 - o(t - 1)) + sum over j of w_ij x_j(t - 1),      o(t) = 1 where u(t) > threshold

The published form takes ``x_j(t)``, so there each layer runs one step earlier; nothing else differs. Backward: the
exact gradient of this recursion, with a rectangle for the derivative of a spike by u: 1 if |u - threshold| < window,
else 0 (Wu et al. 2018, as in TactileSGNet). This ``window`` is a range of potentials; it has nothing to do with the
windows in time of ``window-snn``.

A graph convolution is computed as an ordinary layer of these neurons whose weights are *spread*: the powers of the
graph's matrix and the weights that all nodes share are first combined, once per batch, to one weight for every input
line and neuron. Events are then multiplied only once, and not once per power.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.values import AnyArray, FloatArray, IntArray
from locsnn_compile.models.description import LifParameters
from locsnn_compile.models.graph_and_windows import BranchGraph
from locsnn_compile.models.lif_scan import (
    list_active,
    scan,
    scan_active,
    scan_active_back,
    scan_back,
)
from locsnn_compile.models.touch_model import DenseLayer, applied, constants, to_device, to_host

_WORTH_LISTING = 1 << 14
"""Number of weights of a layer from which adding those of active inputs is faster than a matrix product (measured)."""


def scan_spikes(drive: AnyArray, neuron: LifParameters) -> tuple[AnyArray, AnyArray]:
    """Return (spikes, u), both (batch, steps, n), given the drive of every step, of the same shape.

    The results have the float type of the drive; u is taken before the reset.
    """
    drive = np.ascontiguousarray(drive)
    potential = np.empty_like(drive)
    spikes = np.empty_like(drive)
    scan(drive, constants(drive.dtype, neuron.keep, neuron.threshold, 0, 1), potential, spikes)
    return spikes, potential


class _Spike(torch.autograd.Function):
    """Spikes of a drive. With g(t) the gradient by o(t), and D(t) the total derivative of the loss by u(t), backward is

    D(t) = (g(t) - decay * u(t) * D(t + 1)) * rectangle(u(t)) + decay * (1 - o(t)) * D(t + 1)
    and the gradient by the drive of step t is D(t + 1), because it arrives one step later.
    """

    @staticmethod
    def forward(ctx: Any, drive: Tensor, neuron: LifParameters) -> Tensor:
        spikes, u = scan_spikes(to_host(drive), neuron)
        ctx.neuron, ctx.u = neuron, u
        return to_device(spikes, drive)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        neuron: LifParameters = ctx.neuron
        gradient = to_host(grads[0])
        by_drive = np.empty_like(gradient)
        scan_back(
            gradient,
            ctx.u,
            constants(gradient.dtype, neuron.keep, neuron.threshold, neuron.window, 0),
            by_drive,
        )
        return to_device(by_drive, grads[0]), None


def spike(drive: Tensor, neuron: LifParameters) -> Tensor:
    """Return the spikes (0 or 1) of a drive (batch, steps, n), differentiable as above."""
    return applied(_Spike, drive, neuron)


class _SpikeOfSpikes(torch.autograd.Function):
    """The same for input spikes x and their weights, without storing the drive in between.

    ``active`` lists the inputs that are not 0, as ``models.lif_scan.list_active`` does. The lists of the forward pass
    serve the backward pass as well.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, neuron: LifParameters) -> Tensor:
        batch, steps, size = x.shape
        rows = np.ascontiguousarray(x.detach().numpy()).reshape(batch * steps, size)
        by_input = np.ascontiguousarray(weight.detach().numpy())
        ends = np.empty(len(rows), np.int64)
        room = np.empty(rows.size + 1, np.int32)
        active_count = list_active(rows, ends, room)
        # A copy, so that the rest of the room is freed before the backward pass.
        active = rows, ends, room[:active_count].copy()
        u = np.empty((batch, steps, by_input.shape[1]), by_input.dtype)
        spikes = np.empty_like(u)
        scan_active(
            *active, by_input, constants(u.dtype, neuron.keep, neuron.threshold, 0, 1), u, spikes
        )
        ctx.neuron, ctx.u, ctx.active = neuron, u, active
        ctx.save_for_backward(weight)
        return torch.from_numpy(spikes)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, Tensor, None]:
        (weight,) = ctx.saved_tensors
        gradient = np.ascontiguousarray(grads[0].numpy())
        batch, steps, size = gradient.shape
        by_weight = np.zeros(tuple(weight.shape), gradient.dtype)
        # The gradient by x is not needed in a first layer, whose input is the recording. The scan then
        # writes all rows of by_drive to the same one.
        rows = batch * steps if ctx.needs_input_grad[0] else 1
        by_drive = np.empty((rows, size), gradient.dtype)
        neuron_constants = constants(
            gradient.dtype, ctx.neuron.keep, ctx.neuron.threshold, ctx.neuron.window, 0
        )
        scan_active_back(gradient, ctx.u, neuron_constants, *ctx.active, by_weight, by_drive)
        by_x = None
        if ctx.needs_input_grad[0]:
            # Into numpy's memory, which uses large pages: torch would take half the time of the product to allocate it.
            by_x = torch.from_numpy(np.empty((batch * steps, len(weight)), gradient.dtype))
            torch.mm(torch.from_numpy(by_drive), weight.T, out=by_x)
            by_x = by_x.reshape(batch, steps, len(weight))
        return by_x, torch.from_numpy(by_weight), None


def spike_of_spikes(x: Tensor, weight: Tensor, neuron: LifParameters) -> Tensor:
    """Return the spikes (batch, steps, n) of inputs x (batch, steps, inputs) by ``weight`` (inputs, n).

    It equals ``spike(x @ weight, neuron)`` except for the order of sums, which goes from the first active input to the
    last. It is fast if most of x is 0. On a GPU, it is that product.
    """
    if x.device.type != "cpu":
        return spike(torch.matmul(x, weight), neuron)
    return applied(_SpikeOfSpikes, x, weight, neuron)


class LifLayer(DenseLayer[LifParameters]):
    """A fully connected layer of LIF neurons: TLIF if its steps are time steps, LLIF if they are locations."""

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        weight = self.weight.T
        if weight.numel() >= _WORTH_LISTING:
            return spike_of_spikes(x, weight, self.neuron)
        return spike(torch.matmul(x, weight), self.neuron)


class GraphLayer(nn.Module):
    """Topology-adaptive graph convolution (Du et al. 2017) whose outputs are integrate-and-fire neurons.

        drive(node) = sum over k = 0 .. hops of W_k * (A^k x)(node)

    A is the normalised adjacency matrix of the graph (see :func:`.graph_and_windows.hop_powers`), so that a node
    receives the inputs of all nodes up to ``hops`` edges away.

    Input (batch, steps, lines), of which ``graph.lines[node, c]`` is input c of a node; output (batch, steps, nodes *
    features), features of a node side by side. ``weight`` [features, (hops + 1) * inputs], W_0 first, is shared by all
    nodes.
    """

    hop: Tensor
    """For each pair of nodes at most ``hops`` edges apart, its entry in every power of A, (pairs, hops + 1)."""
    places: Tensor
    """Where the weights of each pair and input lie among the rows of the spread weights, (pairs * inputs,)."""

    def __init__(self, graph: BranchGraph, features: int, neuron: LifParameters) -> None:
        super().__init__()
        self.neuron = neuron
        self.nodes, self.inputs = graph.lines.shape
        self.weight = nn.Parameter(torch.zeros(features, len(graph.powers) * self.inputs))
        (receivers, senders), self._hop = _pairs_in_reach(graph)
        # Row ``line * nodes + receiver`` of the spread weights, for every input line of each sender.
        places = (graph.lines[senders] * self.nodes + receivers[:, np.newaxis]).reshape(-1)
        # Both follow from the graph, so they are not stored with the weights (persistent=False).
        self.register_buffer("places", torch.from_numpy(places), persistent=False)
        self.register_buffer("hop", torch.from_numpy(self._hop).to(torch.float32), persistent=False)

    def _apply(self, fn: object, recurse: bool = True) -> "GraphLayer":
        """Follow ``fn``, such as a conversion to another float type; torch calls this in ``to()`` and ``double()``."""
        super()._apply(fn, recurse)  # type: ignore[no-untyped-call]
        # From the double precision original: a float32 matrix made double would stay rounded to float32.
        self.hop = torch.from_numpy(self._hop).to(self.hop)
        return self

    def spread(self) -> Tensor:
        """Return the weights that every neuron has for every line, (lines, nodes * features)."""
        features = len(self.weight)
        # (pairs, hops + 1) times (hops + 1, inputs * features): the weights of each pair, summed over hops.
        by_hop = self.weight.T.reshape(self.hop.shape[1], -1)
        of_pairs = torch.mm(self.hop, by_hop).reshape(-1, features)
        lines = self.nodes * self.inputs
        # Pairs that are further apart have no weights: these rows stay 0.
        spread = torch.zeros(
            lines * self.nodes, features, dtype=of_pairs.dtype, device=of_pairs.device
        )
        return spread.index_copy(0, self.places, of_pairs).reshape(lines, -1)

    def forward(self, x: Tensor) -> Tensor:
        """Return the spikes of this layer for spikes ``x``."""
        return spike_of_spikes(x, self.spread(), self.neuron)


def _pairs_in_reach(graph: BranchGraph) -> tuple[tuple[IntArray, IntArray], FloatArray]:
    """Return ((receivers, senders), strengths): the pairs of nodes of which the first receives from the second.

    ``strengths`` (pairs, hops + 1) are the entries of the pair in A^0, A^1, ...
    """
    # Absolute values, so that no sum of entries cancels to 0.
    pairs = sum(abs(power) for power in graph.powers).nonzero()
    receivers, senders = (ends.astype(np.int64) for ends in pairs)
    strengths = np.stack([power[receivers, senders] for power in graph.powers], axis=1)
    return (receivers, senders), strengths
