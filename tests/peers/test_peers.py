"""Our engine against public simulators, spike for spike and register for register, on random networks.

No difference is allowed. What a peer cannot be asked for is in ``quirks.py``; ``docs/research/peers.md`` is the summary.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from feature_counts import FEATURES, TABLE, rows, table, total
from make_environments import why_missing
from numpy.typing import NDArray
from peer_networks import PROBES, arrays_by_key
from peer_runs import networks_of, our_result, play
from quirks import PEERS, Peer

pytestmark = pytest.mark.peers

RESEARCH = Path(__file__).parents[2] / "docs/research"
PAGE = RESEARCH / "peers.md"
DIFFERENCES = RESEARCH / "peers-differences.csv"

Found = Callable[[Peer], Mapping[str, NDArray[np.float64]]]


@pytest.fixture(scope="session")
def found(tmp_path_factory: pytest.TempPathFactory) -> Found:
    """Return a function that gives a peer's arrays for all its networks; each peer is run once."""

    @cache
    def run(peer: Peer) -> Mapping[str, NDArray[np.float64]]:
        reason = why_missing(peer.name)
        if reason:
            pytest.skip(f"{peer.name}: {reason}")
        return play(peer, tmp_path_factory.mktemp(peer.name))

    return run


@pytest.mark.parametrize(
    ("peer", "seed"),
    [pytest.param(peer, seed, id=f"{peer.name}-{seed}") for peer in PEERS for seed in peer.seeds],
)
def test_spikes_u_and_v_are_equal(peer, seed, found):
    network = networks_of(peer)[seed]
    for key, ours in arrays_by_key(network, our_result(network)).items():
        assert np.array_equal(ours, found(peer)[key]), key


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
def test_networks_of_a_peer_spike_and_fill_a_good_part_of_their_registers(peer, found):
    probes = {
        probe: [array for key, array in found(peer).items() if key.endswith(f"/{probe}")]
        for probe in PROBES
    }
    assert sum(array.sum() for array in probes["spikes"]) > 1000
    # An eighth of the registers, which have 23 bits and a sign.
    for probe in ("u", "v"):
        assert min(array.min() for array in probes[probe]) < -(2**20)
        assert max(array.max() for array in probes[probe]) > 2**20


@pytest.mark.parametrize(
    ("peer", "quirk"),
    [
        pytest.param(peer, quirk, id=f"{peer.name}-{quirk.topic}")
        for peer in PEERS
        for quirk in peer.quirks
        if quirk.witness
    ],
)
def test_a_quirk_is_still_there(peer, quirk, found):
    ours = arrays_by_key(quirk.witness, quirk.witness.simulate())
    assert any(not np.array_equal(array, found(peer)[key]) for key, array in ours.items())


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.name)
def test_every_feature_is_compared_or_has_a_quirk(peer):
    missing = {feature.topic for feature in FEATURES if not total(feature, peer)}
    assert missing <= {quirk.topic for quirk in peer.quirks}


def test_the_page_has_the_counts():
    assert table() in PAGE.read_text()
    with TABLE.open(encoding="utf-8", newline="") as file:
        assert list(csv.reader(file)) == rows()


def test_the_table_of_differences_has_every_quirk_and_no_more():
    with DIFFERENCES.open(encoding="utf-8", newline="") as file:
        listed = [tuple(row) for row in csv.reader(file)][1:]
    assert listed == [
        (peer.name, quirk.topic, quirk.peer, quirk.handling, quirk.ours)
        for peer in PEERS
        for quirk in peer.quirks
    ]
