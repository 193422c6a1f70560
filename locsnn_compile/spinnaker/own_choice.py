"""The shifts that sPyNNaker would choose by itself, and a network as it would be with them, for comparison.

sPyNNaker is the software that runs PyNN networks on SpiNNaker. It stores weights as integers of 16 bits, and chooses a
*shift* per population and receptor that makes them currents. The shift follows from M, the largest sum of weights that
is expected in a step. Our programs tell sPyNNaker M; otherwise sPyNNaker 7.4.1 estimates M for each receptor, as
follows. With w the weights of its synapses, in nA, and n the most synapses of one of its neurons, added up over
projections:

    all delays of each projection are equal:
        M = sum over projections of max(w) n, and max(w) at the least
    otherwise:
        k   = 30 n / 1000                      spikes of a step, as if each source sent 30 a second
        s   = deviation of all weights, each projection counting n times
        M   = k mean(w) + 5 sqrt(k mean(w)^2 + k s^2 P(N < round(k + 3 sqrt(k))))
        N   a Poisson number of mean k; M is at most the sum above, and at least max(w)

A shift that is too large costs low bits of the weights. With a shift P that is too small, ring buffers saturate, and
weights of 2^(P + 1) nA and more lose their high bits.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker, spinnaker_inverse
from hw_model.spinnaker.network import (
    RECEPTORS,
    Receptor,
    SpinnakerNetwork,
    SpinnakerPopulation,
    SpinnakerProjection,
)
from hw_model.values import FloatArray

# Constants of sPyNNaker 7.4.1; 1,000 steps a second is its step of 1 ms.
SPIKES_PER_SECOND = 30.0
STEPS_PER_SECOND = 1000.0
SIGMAS = 5.0
POISSON_SIGMAS = 3.0
_LOGARITHM_LIMIT = 701.0
"""If the logarithm of k^limit / limit! is 0, or at least this far from 0, sPyNNaker leaves out the deviation of the
weights. Floats end at about e^709."""

Shifts = tuple[int, int]
"""The shifts of a population, by receptor in the order of ``RECEPTORS``."""


def own_shifts(network: SpinnakerNetwork) -> dict[str, Shifts]:
    """Return the shifts that sPyNNaker chooses for each population, by receptor."""
    return {population.name: _shifts_of(network, population) for population in network.populations}


def _shifts_of(network: SpinnakerNetwork, population: SpinnakerPopulation) -> Shifts:
    """Return the shifts that sPyNNaker chooses for a population: excitatory, then inhibitory."""
    excitatory_sum = expected_sum(_onto(network, population, "excitatory"))
    inhibitory_sum = expected_sum(_onto(network, population, "inhibitory"))
    return (
        spinnaker_inverse.shift_for(excitatory_sum),
        spinnaker_inverse.shift_for(inhibitory_sum),
    )


class Incoming(NamedTuple):
    """What sPyNNaker's estimate takes of a projection.

    - ``most_synapses``: the most synapses of the projection onto one neuron
    - ``weights`` (synapses,): magnitudes in nA
    - ``delays_vary``: whether its delays differ
    """

    most_synapses: int
    weights: FloatArray
    delays_vary: bool


def _onto(
    network: SpinnakerNetwork, population: SpinnakerPopulation, receptor: Receptor
) -> list[Incoming]:
    """Return the projections of a receptor onto a population."""
    shift = population.shifts[RECEPTORS.index(receptor)]
    return [
        Incoming(
            most_synapses=int(np.bincount(projection.target_index).max()),
            weights=currents(projection, shift),
            delays_vary=bool(np.ptp(projection.delay)),
        )
        for projection in network.projections
        if projection.target == population.name and projection.receptor == receptor
    ]


def currents(projection: SpinnakerProjection, shift: int) -> FloatArray:
    """Return the weights of a projection in nA, (synapses,), given the shift with which they are stored."""
    return spinnaker_inverse.currents_of(projection.weight, shift)


def expected_sum(incoming: list[Incoming]) -> float:
    """Return M, the largest sum of weights that sPyNNaker expects in a step for one receptor, in nA."""
    heaviest_weight = max((float(part.weights.max()) for part in incoming), default=0.0)
    sum_of_all = sum(float(part.weights.max()) * part.most_synapses for part in incoming)
    delays_vary = any(part.delays_vary for part in incoming)
    bound = min(poisson_bound(incoming), sum_of_all) if delays_vary else sum_of_all
    return max(bound, heaviest_weight)


def poisson_bound(incoming: list[Incoming]) -> float:
    """Return the expected sum in nA if sources send Poisson numbers of spikes, plus five standard deviations.

    This is k mean(w) + 5 sqrt(k mean(w)^2 + k s^2 P) of the module's docstring, with k named ``spikes``.
    """
    synapses = sum(part.most_synapses for part in incoming)
    mean = sum(part.most_synapses * float(part.weights.mean()) for part in incoming) / synapses
    variance = _pooled_variance(incoming, synapses, mean)
    spikes = synapses * SPIKES_PER_SECOND / STEPS_PER_SECOND
    variance_of_sum = spikes * mean**2 + spikes * variance * _share_counted(spikes)
    return spikes * mean + SIGMAS * math.sqrt(variance_of_sum)


def _pooled_variance(incoming: list[Incoming], synapses: int, mean: float) -> float:
    """Return s^2 in nA^2: the variance of all weights around their mean, within and between projections."""
    if synapses <= 1:
        return 0.0
    squares = 0.0
    for part in incoming:
        within = float(part.weights.var()) * (part.most_synapses - 1)
        between = part.most_synapses * (float(part.weights.mean()) - mean) ** 2
        squares += within + between
    return squares / (synapses - 1)


def _share_counted(spikes: float) -> float:
    """Return P(N < limit) for a Poisson number N with mean ``spikes``, as sPyNNaker computes it."""
    limit = round(spikes + POISSON_SIGMAS * math.sqrt(spikes))
    logarithm = limit * math.log(spikes) - math.lgamma(1 + limit)
    leaves_deviation_out = logarithm == 0.0 or abs(logarithm) >= _LOGARITHM_LIMIT
    if leaves_deviation_out:
        return 0.0
    probabilities = (
        math.exp(count * math.log(spikes) - spikes - math.lgamma(1 + count))
        for count in range(limit)
    )
    return math.fsum(probabilities)


def with_shifts(network: SpinnakerNetwork, shifts: Mapping[str, Shifts]) -> SpinnakerNetwork:
    """Return a network with its weights stored for other shifts, given by population."""
    old_shifts = {population.name: population.shifts for population in network.populations}
    populations = tuple(
        replace(population, shifts=shifts[population.name]) for population in network.populations
    )
    projections = []
    for projection in network.projections:
        receptor = RECEPTORS.index(projection.receptor)
        old_shift = old_shifts[projection.target][receptor]
        new_shift = shifts[projection.target][receptor]
        weights = spinnaker_inverse.stored_weights(currents(projection, old_shift), new_shift)
        projections.append(replace(projection, weight=weights))
    return replace(network, populations=populations, projections=tuple(projections))


def can_be_played(shifts: Mapping[str, Shifts]) -> bool:
    """Return whether all shifts are small enough for our engine, which was compared with the chip's machine code."""
    largest_shifts = (max(by_receptor) for by_receptor in shifts.values())
    return all(shift <= spinnaker.SHIFT_MAX for shift in largest_shifts)
