"""The shifts that sPyNNaker chooses by itself, and a network as it would have been with them.

A population may be told the largest sum of weights that a step can bring; our programs do. Otherwise
sPyNNaker 7.4.1 estimates that sum, M_r, for each receptor. With w the weights of its synapses, in nA,
and n the most synapses of one of its neurons, added up over projections:

    all delays of each projection are equal:
        M = sum over projections of max(w) n, and max(w) at the least
    otherwise:
        k   = 30 n / 1000                      spikes of a step, as if each source sent 30 a second
        s   = deviation of all weights, each projection counting n times
        M   = k mean(w) + 5 sqrt(k mean(w)^2 + k s^2 P(N < round(k + 3 sqrt(k))))
        N   a Poisson number of mean k; M is at most the sum above, and at least max(w)

A shift that is too large costs bits of weights; with one that is too small, ring buffers saturate,
and weights of 2^(P + 1) nA lose their high bits.
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

SPIKES_PER_SECOND = 30.0
STEPS_PER_SECOND = 1000.0
SIGMAS = 5.0
POISSON_SIGMAS = 3.0
_SMALLEST_EXPONENT = -701.0
"""Where a logarithm of a probability is below this, sPyNNaker leaves the deviation of weights out."""

Shifts = tuple[int, int]


def own_shifts(network: SpinnakerNetwork) -> dict[str, Shifts]:
    """Return the shifts that sPyNNaker chooses for each population, by receptor."""
    return {population.name: _shifts_of(network, population) for population in network.populations}


def _shifts_of(network: SpinnakerNetwork, population: SpinnakerPopulation) -> Shifts:
    excitatory, inhibitory = (
        spinnaker_inverse.shift_for(expected_sum(_onto(network, population, receptor)))
        for receptor in RECEPTORS
    )
    return excitatory, inhibitory


class Incoming(NamedTuple):
    """A projection as sPyNNaker sees it: ``most_synapses`` of a neuron, weights in nA."""

    most_synapses: int
    weights: FloatArray
    delays_vary: bool


def _onto(
    network: SpinnakerNetwork, population: SpinnakerPopulation, receptor: Receptor
) -> list[Incoming]:
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
    """Return what the weights of a projection mean, in nA."""
    return spinnaker_inverse.currents_of(projection.weight, shift)


def expected_sum(incoming: list[Incoming]) -> float:
    """Return M, the sum of a step that sPyNNaker expects of one receptor, in nA."""
    heaviest = max((float(part.weights.max()) for part in incoming), default=0.0)
    all_at_once = sum(float(part.weights.max()) * part.most_synapses for part in incoming)
    if not any(part.delays_vary for part in incoming):
        return max(all_at_once, heaviest)
    return max(min(poisson_bound(incoming), all_at_once), heaviest)


def poisson_bound(incoming: list[Incoming]) -> float:
    """Return the bound of synapses whose sources send Poisson numbers of spikes."""
    synapses = sum(part.most_synapses for part in incoming)
    mean = sum(part.most_synapses * float(part.weights.mean()) for part in incoming) / synapses
    squares = sum(
        float(part.weights.var()) * (part.most_synapses - 1)
        + part.most_synapses * (float(part.weights.mean()) - mean) ** 2
        for part in incoming
    )
    variance = squares / (synapses - 1) if synapses > 1 else 0.0
    spikes = synapses * SPIKES_PER_SECOND / STEPS_PER_SECOND
    spread = spikes * mean**2 + spikes * variance * _share_counted(spikes)
    return spikes * mean + SIGMAS * math.sqrt(spread)


def _share_counted(spikes: float) -> float:
    """Return P(N < limit) of a Poisson number N, with the limit that sPyNNaker takes."""
    limit = round(spikes + POISSON_SIGMAS * math.sqrt(spikes))
    logarithm = limit * math.log(spikes) - math.lgamma(1 + limit)
    if logarithm == 0.0 or abs(logarithm) >= -_SMALLEST_EXPONENT:
        return 0.0
    terms = (
        math.exp(count * math.log(spikes) - spikes - math.lgamma(1 + count))
        for count in range(limit)
    )
    return math.fsum(terms)


def with_shifts(network: SpinnakerNetwork, shifts: Mapping[str, Shifts]) -> SpinnakerNetwork:
    """Return a network with its weights stored for other shifts."""
    old_shifts = {population.name: population.shifts for population in network.populations}
    populations = tuple(
        replace(population, shifts=shifts[population.name]) for population in network.populations
    )
    projections = []
    for projection in network.projections:
        receptor = RECEPTORS.index(projection.receptor)
        weights = currents(projection, old_shifts[projection.target][receptor])
        shift = shifts[projection.target][receptor]
        stored = spinnaker_inverse.stored_weights(weights, shift)
        projections.append(replace(projection, weight=stored))
    return replace(network, populations=populations, projections=tuple(projections))


def can_be_played(shifts: Mapping[str, Shifts]) -> bool:
    """Tell whether a witness has seen shifts as large as these."""
    return all(max(each) <= spinnaker.SHIFT_MAX for each in shifts.values())
