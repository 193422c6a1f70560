"""A network whose forward pass is the simulator of the chip Xylo, and whose gradient is that of leaky neurons.

It is trained on the chip's own arithmetic, so that nothing changes when it is compiled. Weights that learn are floats,
called latent; the chip gets the 8-bit integers, called mantissas, to which they are rounded.

Forward: :mod:`hw_model.xylo.fast` simulates every recording, so that every spike and every register is the chip's.
Backward, the neurons count as these, with i the synaptic current, v the potential, s the spikes, weights and potentials
in thresholds, and, with the decays as bit shifts (dashes), ``a = 1 - 2^-dash_syn`` and ``k = 1 - 2^-dash_mem``:

    i(t) = a (i(t - 1) + W_in x(t) + W_rec s(t - 1))
    v(t) = k (v(t - 1) - s(t - 1)) + i(t)
    ds(t) / dv(t) = exp(-(1 - v(t)) / window) below the threshold, and 1 above it

Rounding passes the gradient straight through (Bengio et al. 2013). A neuron sends one spike per threshold of potential,
several in a step, so above the threshold spikes are a staircase over v whose mean slope is 1. The gradient also follows
the potential that a spike takes away, the term -s(t - 1): a charge W x can only cause a certain number of spikes, once.
If that term were treated as a constant, a charge would seem to cause spikes in all steps in which the potential lasts,
dozens of times too many.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.arithmetic import xylo
from hw_model.values import AnyArray, IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.playing import before_spikes, play_all, rows_of
from locsnn_compile.models.description import NetworkDescription, XyloParameters
from locsnn_compile.models.touch_model import (
    TouchModel,
    constants,
    draw_weights,
    to_device,
    to_host,
)
from locsnn_compile.models.xylo_entry import XyloNumbers, XyloSynapses
from locsnn_compile.models.xylo_scan import scan_back

INTO_HIDDEN, AMONG_HIDDEN, ONTO_OUTPUTS = "time_hidden", "time_recurrent", "time_output"
"""The names of the three groups of synapses."""
RECURRENT_SHARE = 0.1
"""The scale of initial weights among hidden neurons, relative to that of other weights: small, so that activity does
not sustain itself."""
RECURRENT_RATE = 0.05
"""The learning rate of weights among hidden neurons, relative to that of others: small for the same reason. A step of
the optimizer moves all weights by about the same amount, and the activity of each hidden neuron comes back to it
through as many of these weights as there are hidden neurons."""


def rounded(weight: Tensor, synapses: XyloSynapses) -> Tensor:
    """Return the mantissas, as floats, of weights in thresholds; d mantissa / d weight = 1 / unit."""
    scaled = weight / synapses.unit
    mantissas = torch.round(scaled.detach()).clamp_(-xylo.WEIGHT_MAX, xylo.WEIGHT_MAX)
    # The difference is 0, and has the gradient of the latent weight.
    return mantissas + (scaled - scaled.detach())


def network_of_integers(
    neuron: XyloParameters, numbers: XyloNumbers, mantissas: dict[str, IntArray]
) -> XyloNetwork:
    """Return the network that the simulator plays, given the mantissas [out, in] by name of weights.

    The chip has two synapses per neuron, of which this network uses one: hence the last axis of one entry.
    """
    hidden_size = len(mantissas[INTO_HIDDEN])
    outputs_size = len(mantissas[ONTO_OUTPUTS])
    synapses = numbers.populations
    hidden_dashes = neuron.hidden_dashes(hidden_size)
    return XyloNetwork(
        hidden=XyloPopulation(
            dash_syn=hidden_dashes.syn[:, None],
            dash_mem=hidden_dashes.mem,
            threshold=np.full(hidden_size, numbers.hidden_threshold),
        ),
        outputs=XyloPopulation(
            dash_syn=np.full((outputs_size, 1), neuron.output_dash_syn),
            dash_mem=np.full(outputs_size, neuron.output_dash_mem),
            threshold=np.full(outputs_size, numbers.output_threshold),
        ),
        weights_in=mantissas[INTO_HIDDEN].T[:, :, None],
        weights_hidden=mantissas[AMONG_HIDDEN].T[:, :, None],
        weights_out=mantissas[ONTO_OUTPUTS].T,
        shift_in=synapses[INTO_HIDDEN].shift,
        shift_hidden=synapses[AMONG_HIDDEN].shift,
        shift_out=synapses[ONTO_OUTPUTS].shift,
    )


class _Played(NamedTuple):
    """The activity of a batch on the chip, each array (batch, steps, n).

    ``rows`` are the input spikes as the chip takes them, ``hidden`` and ``outputs`` the spikes of its neurons, and
    potentials are in thresholds, before any reset.
    """

    rows: Tensor
    hidden: Tensor
    outputs: Tensor
    hidden_potential: Tensor
    output_potential: Tensor


class _Steps(torch.autograd.Function):
    """Spikes of hidden neurons and outputs: the chip's steps forward, leaky neurons backward."""

    @staticmethod
    def forward(
        ctx: Any, into: Tensor, among: Tensor, onto: Tensor, x: Tensor, model: "XyloSnn"
    ) -> tuple[Tensor, Tensor]:
        mantissas = {
            INTO_HIDDEN: _integers(into),
            AMONG_HIDDEN: _integers(among),
            ONTO_OUTPUTS: _integers(onto),
        }
        played = model.play(x, mantissas)
        # Results must be saved in this way: as attributes of ctx they would refer to themselves, and
        # their memory would never be freed.
        ctx.save_for_backward(among, onto, *played)
        ctx.model = model
        return played.hidden, played.outputs

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, ...]:
        of_hidden, of_outputs = grads
        among, onto, *saved = ctx.saved_tensors
        played = _Played(*saved)
        model: XyloSnn = ctx.model
        units = model.units
        kept = model.shares_kept(of_hidden)
        output_slope = model.slope(played.output_potential)
        output_charges = _back_through(of_outputs, output_slope, kept.output_i, kept.output_v)
        # Hidden spikes also act through the outputs, in the next step.
        of_spikes = of_hidden.clone()
        of_spikes[:, :-1] += output_charges[:, 1:] @ (onto * units[ONTO_OUTPUTS])
        hidden_charges = _back_through(
            of_spikes,
            model.slope(played.hidden_potential),
            kept.hidden_i,
            kept.hidden_v,
            recurrent=among * units[AMONG_HIDDEN],
        )
        sent = played.hidden[:, :-1]
        return (
            _of_weights(hidden_charges, played.rows) * units[INTO_HIDDEN],
            _of_weights(hidden_charges[:, 1:], sent) * units[AMONG_HIDDEN],
            _of_weights(output_charges[:, 1:], sent) * units[ONTO_OUTPUTS],
            None,
            None,
        )


def _back_through(
    of_spikes: Tensor,
    slope: Tensor,
    kept_i: Tensor,
    kept_v: Tensor,
    recurrent: Tensor | None = None,
) -> Tensor:
    """Return the gradients of charges (batch, steps, n), from the last step to the first.

    See :func:`locsnn_compile.models.xylo_scan.scan_back`.
    """
    size = of_spikes.shape[2]
    weights = of_spikes.new_zeros((0, size)) if recurrent is None else recurrent
    charges = to_host(torch.empty_like(of_spikes, memory_format=torch.contiguous_format))
    (one,) = constants(charges.dtype, 1.0)
    scan_back(
        to_host(of_spikes),
        to_host(slope),
        to_host(kept_i.expand(size)),
        to_host(kept_v.expand(size)),
        to_host(weights),
        one,
        charges,
    )
    return to_device(charges, of_spikes)


def _of_weights(charges: Tensor, spikes: Tensor) -> Tensor:
    """Return the gradients of weights [out, in], added up over recordings and steps."""
    return charges.flatten(0, 1).T @ spikes.flatten(0, 1)


def _integers(mantissas: Tensor) -> IntArray:
    """Return mantissas, which are floats in torch, as int64."""
    return to_host(mantissas).astype(np.int64)


class _Kept(NamedTuple):
    """The shares of currents (``_i``) and potentials (``_v``) that a step keeps, (n,) or (1,)."""

    hidden_i: Tensor
    hidden_v: Tensor
    output_i: Tensor
    output_v: Tensor


class XyloSnn(TouchModel):
    """``xylo-snn``: inputs, recurrent hidden neurons, and outputs, on the integers of a Xylo.

    Spikes of hidden neurons are counts, up to 31 in a step. Weights [out, in] are latent, in thresholds.
    """

    def __init__(
        self, description: NetworkDescription, numbers: XyloNumbers, seed: int, initial_scale: float
    ) -> None:
        super().__init__(description)
        self.xylo = numbers
        self.numbers = numbers
        self.neuron = description.xylo_neuron
        generator = torch.Generator().manual_seed(seed)
        for name, shape in description.weight_shapes.items():
            weight = nn.Parameter(torch.zeros(shape))
            share = RECURRENT_SHARE if name == AMONG_HIDDEN else 1.0
            draw_weights(weight, share * initial_scale, generator)
            self.register_parameter(name, weight)

    @property
    def units(self) -> dict[str, float]:
        """The weight, in thresholds, of a mantissa of 1, by weight name."""
        return {name: synapses.unit for name, synapses in self.numbers.populations.items()}

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the spikes of hidden neurons and outputs for ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        mantissas = [
            rounded(self.weight(name), self.numbers.populations[name]) for name in self.names
        ]
        hidden, outputs = _Steps.apply(*mantissas, x, self)  # type: ignore[no-untyped-call]
        return {INTO_HIDDEN: hidden, ONTO_OUTPUTS: outputs}

    def play(self, x: Tensor, mantissas: dict[str, IntArray]) -> _Played:
        """Return the activity on the chip for recordings ``x`` and these weights."""
        network = network_of_integers(self.neuron, self.numbers, mantissas)
        rows = [rows_of(recording) for recording in to_host(x).astype(np.int64)]
        results = play_all(network, rows)
        hidden = [before_spikes(network.hidden, r.v, r.spikes) for r in results]
        outputs = [before_spikes(network.outputs, r.output_v, r.output_spikes) for r in results]

        def tensor(arrays: list[AnyArray]) -> Tensor:
            return torch.from_numpy(np.stack(arrays)).to(x)

        return _Played(
            rows=tensor(rows),
            hidden=tensor([r.spikes for r in results]),
            outputs=tensor([r.output_spikes for r in results]),
            hidden_potential=tensor(hidden) / self.numbers.hidden_threshold,
            output_potential=tensor(outputs) / self.numbers.output_threshold,
        )

    def slope(self, potential: Tensor) -> Tensor:
        """Return the surrogate gradient ds / dv at a potential in thresholds."""
        # Above the threshold the distance is 0, so the result is 1.
        below = (1.0 - potential).clamp_(min=0.0)
        return below.div_(-self.neuron.window).exp_()

    def shares_kept(self, like: Tensor) -> _Kept:
        """Return the shares that a step keeps, in the float type and on the device of a tensor."""
        dashes = self.neuron.hidden_dashes(self.description.hidden)

        def kept(dash: IntArray | int) -> Tensor:
            return torch.from_numpy(np.atleast_1d(1.0 - xylo.share_lost(np.asarray(dash)))).to(like)

        return _Kept(
            hidden_i=kept(dashes.syn),
            hidden_v=kept(dashes.mem),
            output_i=kept(self.neuron.output_dash_syn),
            output_v=kept(self.neuron.output_dash_mem),
        )

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return output spikes per class, (batch, classes)."""
        return {"time": activity[ONTO_OUTPUTS].sum(dim=1)}

    def rate_shares(self) -> dict[str, float]:
        """Return the factor of the learning rate of weights among hidden neurons."""
        return {AMONG_HIDDEN: RECURRENT_RATE}

    def hidden_spikes(self, activity: Mapping[str, Tensor]) -> list[Tensor]:
        """Return the spikes of hidden neurons."""
        return [activity[INTO_HIDDEN]]

    def largest_weights(self) -> dict[str, float]:
        """Return the largest weight that 8 bits hold, by weight name."""
        return {name: synapses.largest for name, synapses in self.numbers.populations.items()}

    def snap(self) -> None:
        """Set latent weights to the values that they round to; see :meth:`TouchModel.snap`."""
        self.load_weights(self.numbers.floats(self.mantissas()))

    @torch.no_grad()
    def mantissas(self) -> dict[str, IntArray]:
        """Return the mantissas [out, in] by weight name."""
        populations = self.numbers.populations
        return {
            name: _integers(rounded(self.weight(name), populations[name])) for name in self.names
        }
