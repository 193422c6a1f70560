"""Play the networks of a peer, in our engine and in the peer's own environment."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from make_environments import python_of
from numpy.typing import NDArray
from peer_networks import Network
from quirks import Peer
from random_networks import random_network

import hw_model as hw

DRIVERS = Path(__file__).parent
TIME_LIMIT_S = 1800


@cache
def networks_of(peer: Peer) -> tuple[Network, ...]:
    """Return the random networks of a peer, in the order of its seeds."""
    return tuple(random_network(f"{peer.name} {seed}", seed, peer.can) for seed in peer.seeds)


@cache
def our_result(network: Network) -> hw.SimulationResult:
    """Return the result of our engine; networks are compared and counted several times, so it is kept."""
    return network.simulate()


def play(peer: Peer, folder: Path) -> Mapping[str, NDArray[np.float64]]:
    """Run a peer's driver once, over its random networks and the witnesses of its quirks."""
    witnesses = [quirk.witness for quirk in peer.quirks if quirk.witness]
    jobs = [network.job() for network in [*networks_of(peer), *witnesses]]
    job, result = folder / "job.json", folder / "result.npz"
    job.write_text(json.dumps(jobs, default=lambda value: value.tolist()))
    call = [str(python_of(peer.name)), str(DRIVERS / peer.driver), str(job), str(result)]
    run = subprocess.run(call, capture_output=True, text=True, timeout=TIME_LIMIT_S)
    assert run.returncode == 0, run.stderr
    with np.load(result) as arrays:
        return dict(arrays)
