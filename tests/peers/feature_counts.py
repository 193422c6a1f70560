"""How often each feature of the chip occurs in the networks that a peer is compared on.

A comparison without a difference says something only about what its networks contain. ``test_peers.py`` asks that each
feature occurs, or that a quirk explains why not. Run as a script, this writes ``docs/research/peers.csv``; the first rows
are in ``docs/research/peers.md`` too.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from peer_networks import Network, Population, Projection
from peer_runs import networks_of, our_result
from quirks import PEERS, Peer
from random_networks import VOLTAGE_MAX

import hw_model as hw

TABLE = Path(__file__).parents[2] / "docs/research/peers.csv"
IN_THE_PAGE = 5
"""The first features, sizes and spikes, are also in a table of the page."""


@dataclass(frozen=True)
class Feature:
    """Something that networks do or have. ``topic``: the topic of the quirk (quirks.py) of a peer that does not have it."""

    name: str
    topic: str | None
    count: Callable[[Network, hw.SimulationResult], int]


def compartments(
    test: Callable[[Population], NDArray[np.bool_]],
) -> Callable[[Network, hw.SimulationResult], int]:
    """Count the compartments that pass a test."""
    return lambda network, _: sum(int(np.sum(test(p))) for p in network.populations)


def synapses(
    test: Callable[[Projection], NDArray[np.bool_] | bool],
) -> Callable[[Network, hw.SimulationResult], int]:
    """Count the synapses that pass a test."""
    return lambda network, _: sum(
        int(np.sum((p.weights != 0) & test(p))) for p in network.projections
    )


def event(name: str) -> Callable[[Network, hw.SimulationResult], int]:
    """Count one of the engine's events."""
    return lambda _, result: int(result.counts[name])


def negative_roundings(register: str) -> Callable[[Network, hw.SimulationResult], int]:
    """Count the decays of a negative register that lose a fraction: there rounding toward zero differs from rounding down."""

    def count(network: Network, result: hw.SimulationResult) -> int:
        total = 0
        for population in network.populations:
            state = getattr(result, register)[population.name]
            kept = 4096 - getattr(population, f"decay_{register}")
            total += int(np.sum((state < 0) & (np.abs(state) * kept % 4096 != 0)))
        return total

    return count


def spikes(network: Network, result: hw.SimulationResult) -> int:
    """Count spikes."""
    return sum(int(array.sum()) for array in result.spikes.values())


def spikes_with_refractory(network: Network, result: hw.SimulationResult) -> int:
    """Count the spikes that block their compartment for a step or more."""
    return sum(int(result.spikes[p.name][:, p.refractory > 1].sum()) for p in network.populations)


def register_ends(network: Network, result: hw.SimulationResult) -> int:
    """Count the steps after which v is at an end of its register."""
    return sum(int((np.abs(array) == VOLTAGE_MAX).sum()) for array in result.v.values())


FEATURES = (
    Feature("networks", None, lambda network, _: 1),
    Feature("steps", None, lambda network, _: len(network.spikes)),
    Feature("compartments", None, compartments(lambda p: np.ones(p.size, bool))),
    Feature("synapses", None, synapses(lambda p: True)),
    Feature("spikes", None, spikes),
    *(
        Feature(f"compartments with {register} decay {decay}", None, compartments(test))
        for register, key in (("u", "decay_u"), ("v", "decay_v"))
        for decay, test in (
            (d, lambda p, key=key, d=d: getattr(p, key) == d)  # defaults bind the loop's values
            for d in (0, 1, 4095, 4096)
        )
    ),
    Feature("roundings of a negative u", None, negative_roundings("u")),
    Feature("roundings of a negative v", None, negative_roundings("v")),
    Feature("compartments with threshold 0", None, compartments(lambda p: p.threshold == 0)),
    Feature(
        "compartments with threshold 4096 or more",
        "threshold",
        compartments(lambda p: p.threshold >= 4096),
    ),
    Feature("compartments with a bias", "bias", compartments(lambda p: p.bias != 0)),
    Feature(
        "compartments with narrow voltage limits",
        "voltage limits",
        compartments(lambda p: np.full(p.size, p.vmin != -VOLTAGE_MAX or p.vmax != VOLTAGE_MAX)),
    ),
    Feature("spikes followed by blocked steps", "refractory", spikes_with_refractory),
    Feature("synapses of mixed sign", None, synapses(lambda p: p.sign_mode == "mixed")),
    Feature("excitatory synapses", None, synapses(lambda p: p.sign_mode == "excitatory")),
    Feature("inhibitory synapses", None, synapses(lambda p: p.sign_mode == "inhibitory")),
    Feature("synapses of fewer than 8 bits", None, synapses(lambda p: p.weight_bits < 8)),
    Feature("synapses of an odd mantissa", "odd weights", synapses(lambda p: p.weights % 2 == 1)),
    Feature(
        "synapses of mantissa -256", "lowest mixed weight", synapses(lambda p: p.weights == -256)
    ),
    Feature(
        "synapses with a positive exponent", "weight exponent", synapses(lambda p: p.exponent > 0)
    ),
    Feature(
        "synapses with a negative exponent", "weight exponent", synapses(lambda p: p.exponent < 0)
    ),
    Feature(
        "synapses that lose bits to it",
        "negative exponent",
        synapses(lambda p: p.weights % 2.0 ** max(-p.exponent, 0) != 0),
    ),
    Feature("synapses with a delay", "delay", synapses(lambda p: p.delay > 0)),
    Feature("recurrent synapses", None, synapses(lambda p: p.source == p.target)),
    Feature(
        "synapses to an earlier population",
        "recurrence",
        synapses(lambda p: (p.source, p.target) == ("y", "h")),
    ),
    Feature("wraps of q", "overflow", event("charge_wraps")),
    Feature("wraps of u or u + bias", "overflow", event("current_wraps")),
    Feature("clips of v", "overflow", event("voltage_clips")),
    Feature("values of v at an end of its register", "overflow", register_ends),
)


@cache
def total(feature: Feature, peer: Peer) -> int:
    """Count a feature over all random networks of a peer."""
    return sum(feature.count(network, our_result(network)) for network in networks_of(peer))


def table() -> str:
    """Return the counts of the first features, sizes and spikes, as a Markdown table."""
    lines = [["", *(peer.name for peer in PEERS)], ["---", *("---:" for _ in PEERS)]]
    lines += [
        [feature.name, *(f"{total(feature, peer):,}" for peer in PEERS)]
        for feature in FEATURES[:IN_THE_PAGE]
    ]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def rows() -> list[list[str]]:
    """Return all counts as rows of text; what is left out is empty."""
    counts = [
        [feature.name, *(str(total(feature, peer) or "") for peer in PEERS)] for feature in FEATURES
    ]
    return [["counted", *(peer.name for peer in PEERS)], *counts]


if __name__ == "__main__":
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows())
