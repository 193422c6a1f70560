"""Find the first spike that differs between a network and its program: later ones may only follow from it."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hw_model.values import ByteArray
from locsnn_compile.network.network import Network


class SpikePlace(NamedTuple):
    """The place of a spike: the number of the recording, the population, the number of the neuron, and the step."""

    recording: int
    population: str
    neuron: int
    step: int


class _Rank(NamedTuple):
    """The place of a spike as a tuple that sorts by time; phases and populations are numbered in network order."""

    recording: int
    phase: int
    step: int
    population: int
    neuron: int


def first_difference(
    network: Network, reference: Mapping[str, ByteArray], chip: Mapping[str, ByteArray]
) -> SpikePlace | None:
    """Return the first place where spikes (batch, steps, n) of both sides differ; None if none do.

    Recordings come first, then phases, steps, populations in network order, and neurons. Populations
    that a frontend added are not compared.
    """
    phases = [phase.name for phase in network.phases]
    populations = network.own_populations
    ranks = []
    for number, population in enumerate(populations):
        differs = np.argwhere(reference[population.name] != chip[population.name])
        if len(differs):
            # argwhere goes through recordings, then steps, then neurons, so the first row is the earliest.
            recording, step, neuron = differs[0].tolist()
            phase = phases.index(population.phase)
            ranks.append(_Rank(recording, phase, step, number, neuron))
    if not ranks:
        return None
    first = min(ranks)
    name = populations[first.population].name
    return SpikePlace(first.recording, name, first.neuron, first.step)
