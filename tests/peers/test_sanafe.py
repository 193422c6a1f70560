"""Spikes and counts of SANA-FE against those of our engine, on random networks.

SANA-FE does not truncate currents, and a Loihi does. So spikes must be equal if currents have nothing
to truncate; otherwise SANA-FE must spike as :func:`without_truncated_currents`, written here, does.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from make_environments import python_of, why_missing
from numpy.typing import NDArray
from peer_networks import Network
from random_networks import EVENTS, Abilities, random_network

pytestmark = pytest.mark.peers

CAN = Abilities(overflow=False, limits=False, refractory=False, delay="none")
DECAY_ONE = 4096
"""The decay that leaves nothing of a current or a voltage."""
UNIT = 64
"""Units of a register in a mantissa of 1, of weights and of thresholds."""
SEEDS = range(12)
"""A few networks only, because loading one takes SANA-FE a second or more."""


def with_whole_currents(network: Network) -> Network:
    """Return the network with currents that never decay or never last: nothing is left to truncate."""
    populations = []
    for population in network.populations:
        # About half of the decays that are drawn are above, half below.
        is_fast = population.decay_u > 1000
        all_or_nothing = np.where(is_fast, DECAY_ONE, 0)
        populations.append(replace(population, decay_u=all_or_nothing))
    name = f"{network.name}, whole currents"
    return replace(network, name=name, populations=tuple(populations))


def play_on_sanafe(networks: list[Network], folder: Path) -> Mapping[str, NDArray[np.float64]]:
    """Play networks in SANA-FE; return the arrays of ``drive_sanafe.py``, by network, population and name."""
    reason = why_missing("sanafe")
    if reason:
        pytest.skip(f"sanafe: {reason}")
    job, result = folder / "job.json", folder / "result.npz"
    jobs = [network.job() for network in networks]
    job.write_text(json.dumps(jobs, default=lambda array: array.tolist()))
    driver = Path(__file__).with_name("drive_sanafe.py")
    command = [str(python_of("sanafe")), str(driver), str(job), str(result)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert process.returncode == 0, process.stderr
    with np.load(result) as arrays:
        return dict(arrays)


def without_truncated_currents(network: Network) -> dict[str, NDArray[Any]]:
    """Return the spikes (steps, n) of the chip model if it kept fractions of currents.

    That is what SANA-FE is written to do.
    """
    steps = len(network.spikes)
    spikes: dict[str, NDArray[Any]] = {"x": network.spikes}
    u: dict[str, NDArray[np.float64]] = {}
    v: dict[str, NDArray[np.float64]] = {}
    for p in network.populations:
        spikes[p.name] = np.zeros((steps, p.size), np.int64)
        u[p.name] = np.zeros(p.size)
        v[p.name] = np.zeros(p.size)
    for t in range(steps):
        for p in network.populations:
            u[p.name] *= 1 - p.decay_u / DECAY_ONE
            if t > 0:
                for charge in charges(network, p.name, spikes, t - 1):
                    u[p.name] += charge
            kept_v = np.trunc(v[p.name] * (1 - p.decay_v / DECAY_ONE))
            v[p.name] = kept_v + p.bias + u[p.name]
            spikes[p.name][t] = v[p.name] > p.threshold * UNIT
            v[p.name][spikes[p.name][t] == 1] = 0
    return spikes


def charges(
    network: Network, target: str, spikes: Mapping[str, NDArray[Any]], t: int
) -> Iterator[NDArray[np.float64]]:
    """Yield the charge (n,) that each projection onto a population brings from the spikes of step t."""
    for projection in network.projections:
        if projection.target == target:
            weights = np.floor(projection.weights * 2.0**projection.exponent) * UNIT
            yield weights @ spikes[projection.source][t]


@pytest.fixture(scope="module")
def drawn_networks():
    return [random_network(f"sanafe {seed}", seed, CAN) for seed in SEEDS]


@pytest.fixture(scope="module")
def whole_networks(drawn_networks):
    """Return the networks with whole currents whose registers do not overflow; with whole currents more do than without."""
    networks = [with_whole_currents(network) for network in drawn_networks]
    return [network for network in networks if not overflows(network)]


def overflows(network: Network) -> bool:
    """Return whether a register of our engine wraps or clips, which SANA-FE does not model."""
    counts = network.simulate().counts
    return any(counts[event] for event in EVENTS)


@pytest.fixture(scope="module")
def measured(drawn_networks, whole_networks, tmp_path_factory):
    return play_on_sanafe([*drawn_networks, *whole_networks], tmp_path_factory.mktemp("sanafe"))


def test_spikes_are_equal_where_currents_are_whole(whole_networks, measured):
    assert len(whole_networks) > 5
    spikes = 0
    for network in whole_networks:
        for name, ours in network.simulate().spikes.items():
            assert np.array_equal(ours, measured[f"{network.name}/{name}/spikes"]), network.name
            spikes += ours.sum()
    assert spikes > 500


def test_its_currents_are_not_truncated_and_nothing_else_differs(drawn_networks, measured):
    populations_that_differ = 0
    for network in drawn_networks:
        untruncated = without_truncated_currents(network)
        for name, ours in network.simulate().spikes.items():
            theirs = measured[f"{network.name}/{name}/spikes"]
            assert np.array_equal(untruncated[name], theirs), network.name
            populations_that_differ += not np.array_equal(ours, theirs)
    assert populations_that_differ > 0


def test_it_counts_the_same_synaptic_events_where_currents_are_whole(whole_networks, measured):
    for network in whole_networks:
        ours = network.simulate().counts.synaptic_ops
        # SANA-FE's count of "spikes" is of synaptic events.
        assert ours == measured[f"{network.name}/counts/spikes"], network.name
