"""SANA-FE beside our engine: the same spikes where its currents have nothing to truncate, and what differs where they do."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from make_environments import python_of, why_missing
from numpy.typing import NDArray
from peer_networks import Network
from random_networks import EVENTS, Abilities, random_network

pytestmark = pytest.mark.peers

CAN = Abilities(overflow=False, limits=False, refractory=False, delay="none")
SEEDS = range(12)
"""Few: loading one network takes SANA-FE a second or more."""


def with_whole_currents(network: Network) -> Network:
    """Currents that never decay or never last: in both cases nothing is left to truncate."""
    return replace(
        network,
        name=f"{network.name}, whole currents",
        populations=tuple(
            replace(p, decay_u=np.where(p.decay_u > 1000, 4096, 0)) for p in network.populations
        ),
    )


def play(networks: list[Network], folder: Path) -> Mapping[str, NDArray[np.float64]]:
    reason = why_missing("sanafe")
    if reason:
        pytest.skip(f"sanafe: {reason}")
    job, result = folder / "job.json", folder / "result.npz"
    job.write_text(
        json.dumps([network.job() for network in networks], default=lambda value: value.tolist())
    )
    call = [
        str(python_of("sanafe")),
        str(Path(__file__).with_name("drive_sanafe.py")),
        str(job),
        str(result),
    ]
    done = subprocess.run(call, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    with np.load(result) as arrays:
        return dict(arrays)


def without_truncated_currents(network: Network) -> dict[str, NDArray[np.int64]]:
    """Return the spikes of the chip model, but for currents of any fraction: what SANA-FE is written to do."""
    steps = len(network.spikes)
    spikes = {
        "x": network.spikes,
        **{p.name: np.zeros((steps, p.size), np.int64) for p in network.populations},
    }
    u = {p.name: np.zeros(p.size) for p in network.populations}
    v = {p.name: np.zeros(p.size) for p in network.populations}
    for t in range(steps):
        for p in network.populations:
            u[p.name] *= 1 - p.decay_u / 4096
            for projection in network.projections:
                if projection.target == p.name and t:
                    weights = np.floor(projection.weights * 2.0**projection.exponent) * 64
                    u[p.name] += weights @ spikes[projection.source][t - 1]
            v[p.name] = np.trunc(v[p.name] * (1 - p.decay_v / 4096)) + p.bias + u[p.name]
            spikes[p.name][t] = v[p.name] > p.threshold * 64
            v[p.name][spikes[p.name][t] == 1] = 0
    return spikes


@pytest.fixture(scope="module")
def networks():
    drawn = [random_network(f"sanafe {seed}", seed, CAN) for seed in SEEDS]
    whole = [with_whole_currents(network) for network in drawn]
    return drawn, [n for n in whole if not any(n.simulate().counts[event] for event in EVENTS)]


@pytest.fixture(scope="module")
def found(networks, tmp_path_factory):
    return play(
        [network for kind in networks for network in kind], tmp_path_factory.mktemp("sanafe")
    )


def test_spikes_are_equal_where_currents_are_whole(networks, found):
    _, whole = networks
    assert len(whole) > 5
    spikes = 0
    for network in whole:
        for name, ours in network.simulate().spikes.items():
            assert np.array_equal(ours, found[f"{network.name}/{name}/spikes"]), network.name
            spikes += ours.sum()
    assert spikes > 500


def test_its_currents_are_not_truncated_and_nothing_else_differs(networks, found):
    drawn, _ = networks
    differing = 0
    for network in drawn:
        wanted = without_truncated_currents(network)
        for name, ours in network.simulate().spikes.items():
            theirs = found[f"{network.name}/{name}/spikes"]
            assert np.array_equal(wanted[name], theirs), network.name
            differing += not np.array_equal(ours, theirs)
    assert differing > 0


def test_it_counts_the_same_synaptic_events_where_currents_are_whole(networks, found):
    _, whole = networks
    for network in whole:
        assert network.simulate().counts.synaptic_ops == found[f"{network.name}/counts/spikes"], (
            network.name
        )
