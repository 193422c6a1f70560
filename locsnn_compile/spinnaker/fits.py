"""Refuse networks whose neurons SpiNNaker does not have, with an error that names the population.

What can be seen from the float network is refused before any work (:func:`check_neurons`), what depends on its integers
after rounding (:func:`check_compartments`).
"""

import numpy as np

from hw_model.arithmetic import loihi, loihi_bounds
from hw_model.arithmetic.spinnaker_inverse import DECAY_U_MIN, DECAY_V_MIN
from hw_model.errors import TargetError
from hw_model.mapping.graph import CompartmentGraph, Compartments
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.values import FloatArray
from locsnn_compile.network.check import check_network
from locsnn_compile.network.chip_neurons import ChipSrm
from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import SoftCuba

_SHORTER = "Train with a shorter time constant, or take longer steps."


def check_fits_spinnaker(chip: SpinnakerChip, network: Network) -> None:
    """Raise ``TargetError`` for a network that cannot be lowered because of its neurons, whatever the chip's size.

    ``chip`` is not used: it is an argument because every family of chips has such a check, and some of them use it
    (``locsnn_compile/families.py``).
    """
    check_network(network)
    check_neurons(network)


def check_neurons(network: Network) -> None:
    """Raise ``TargetError`` for neurons that need several of SpiNNaker's, or that are reset in another way."""
    for population in network.populations:
        neuron = population.neuron
        if isinstance(neuron, SoftCuba):
            what = "a spike subtracts from its potential, and on SpiNNaker it resets it to 0"
            fix = "Train neurons that reset to 0, such as Cuba."
            raise TargetError(population.where, what, fix=fix)
        if isinstance(neuron, ChipSrm):
            what = "its integers join compartments, and a neuron of SpiNNaker is a single one"
            fix = "Give the network in float, as it was before it was trained in integers."
            raise TargetError(population.where, what, fix=fix)


def check_compartments(graph: CompartmentGraph, charges: dict[str, FloatArray]) -> None:
    """Raise ``TargetError`` for compartments whose decays, joins or floors IF_curr_exp does not have.

    ``charges`` has the lowest and the highest charge of a step for each group, (2, n), in units of the register u.
    """
    for group in graph.groups:
        where = f"population {group.name!r}"
        _check_single(where, group)
        _check_decay_v(where, group)
        _check_decay_u(where, group)
        _check_floor(where, group, charges[group.name])


def _check_single(where: str, group: Compartments) -> None:
    if group.joined_to is not None:
        what = f"it is joined to {group.joined_to!r}, and SpiNNaker joins no compartments"
        raise TargetError(where, what, fix="Use strategy reset.")


def _check_decay_v(where: str, group: Compartments) -> None:
    """Refuse potentials that never decay.

    A decay is the share that a step loses, in 4096ths; ``FORGETS`` is 4096.
    """
    slowest = int(group.decay_v.min())
    if slowest < DECAY_V_MIN:
        what = "its potential never decays, and on SpiNNaker no input would then move it"
        measured = f"decay_v {slowest} against at least {DECAY_V_MIN} of {loihi.FORGETS}"
        raise TargetError(where, what, measured=measured, fix=_SHORTER)


def _check_decay_u(where: str, group: Compartments) -> None:
    """Refuse currents that decay so slowly that what a weight is multiplied by does not fit 32 bits.

    SpiNNaker multiplies a weight by a factor, the initial share, which makes the current of all later steps sum to
    tau_syn times the weight (:func:`hw_model.arithmetic.spinnaker.initial_share`). It grows with tau_syn.
    """
    slowest = int(group.decay_u.min())
    if slowest < DECAY_U_MIN:
        what = "its current decays too slowly: a weight would leave 32 bits on SpiNNaker"
        measured = f"decay_u {slowest} against at least {DECAY_U_MIN} of {loihi.FORGETS}"
        raise TargetError(where, what, measured=measured, fix=_SHORTER)


def _check_floor(where: str, group: Compartments, charges: FloatArray) -> None:
    """Raise ``TargetError`` for a floor of the potential that inputs can reach.

    ``charges`` (2, n) is the lowest and the highest charge of a step, in units of the register u.
    """
    # Without a floor in the network, vmin is the end of the register, which is -vmax.
    has_floor = group.vmin > -group.vmax
    lowest_potential = _lowest_potential(group, charges[0])
    reached = np.flatnonzero(has_floor & (lowest_potential < group.vmin))
    if reached.size:
        neuron = int(reached[0])
        what = "its potential has a floor that inputs can reach, and on SpiNNaker it has none"
        lowest = f"{lowest_potential[neuron]:.0f}"
        measured = f"{lowest} against {group.vmin[neuron]} in neuron {neuron}"
        raise TargetError(where, what, measured=measured, fix="Train without a floor.")


def _lowest_potential(group: Compartments, lowest_charge: FloatArray) -> FloatArray:
    """Return the value at which v settles, (n,), if every step brings the lowest charge (n,).

    ``settles_at`` gives the highest value that v reaches from 0. The lowest is that of the negated drive, negated,
    since truncation treats both signs alike. A drive that never pulls v below 0 gives 0, from which v starts.
    """
    lowest_current = -loihi_bounds.settles_at(-lowest_charge, group.decay_u)
    bias = loihi.bias_of(group.bias_mantissa, group.bias_exponent)
    lowest_drive = lowest_current + bias
    return -loihi_bounds.settles_at(-lowest_drive, group.decay_v)
