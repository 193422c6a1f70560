"""Location branches against sums over taxels, polarities and time steps written out, for every order of the taxels."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from locsnn_compile.data.orders import location_order
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.models.description import (
    InputLayout,
    LifParameters,
    NetworkDescription,
    NeuronParameters,
)
from locsnn_compile.models.networks import build_network

STEPS, HIDDEN = 8, 4
BACKWARDS = ",".join(str(taxel) for taxel in range(39, 0, -1))


def visits(order: str, fingertips: int) -> list[int]:
    """Return the channel of each location: both polarities of a taxel, all taxels of a fingertip, then the next one."""
    found = []
    for fingertip in range(fingertips):
        for taxel in location_order(order, neutouch())[1]:
            for polarity in range(2):
                found.append(78 * fingertip + 2 * (taxel - 1) + polarity)
    return found


def alpha(lag: int, tau: float) -> float:
    return lag / tau * math.exp(1 - lag / tau)


def spike_response(x: np.ndarray, weight: np.ndarray, places: list[int]) -> np.ndarray:
    """Every event and every own spike through its kernel: u = sum w eps + sum nu, a spike where u >= theta."""
    n = NeuronParameters()
    spikes = np.zeros((len(places), len(weight)))
    for here in range(len(places)):
        u = np.zeros(len(weight))
        for before in range(here):
            for t in range(len(x)):
                u += weight[:, t] * x[t, places[before]] * alpha(here - before, n.tau_sr)
            u -= spikes[before] * n.scale_ref * n.theta * alpha(here - before, n.tau_ref)
        spikes[here] = u >= n.theta
    return spikes


def integrate_and_fire(x: np.ndarray, weight: np.ndarray, places: list[int]) -> np.ndarray:
    """What has come since the last own spike, each event with its own power of the decay; a spike above the threshold."""
    n = LifParameters()
    spikes = np.zeros((len(places), len(weight)))
    for i, row in enumerate(weight):
        last = 0
        for here in range(len(places)):
            u = sum(
                row @ x[:, places[before]] * n.decay ** (here - 1 - before)
                for before in range(last, here)
            )
            if u > n.threshold:
                spikes[here, i], last = 1, here
    return spikes


@pytest.mark.slow
@pytest.mark.parametrize("fingertips", [1, 2])
@pytest.mark.parametrize(
    "order", ["loop", "arch", "whorl", BACKWARDS], ids=["loop", "arch", "whorl", "one's own"]
)
@pytest.mark.parametrize(
    ("name", "expected", "scale"),
    [
        ("location-tactile-snn", spike_response, 30.0),
        ("location-tactile-snn-lif", integrate_and_fire, 3.0),
    ],
    ids=["LSRM", "LLIF"],
)
def test_a_location_branch_is_its_sum_of_kernels(name, expected, scale, order, fingertips):
    order_name, taxels = location_order(order, neutouch())
    layout = InputLayout(neutouch(fingertips), steps=STEPS, step_seconds=0.02)
    description = NetworkDescription(
        name, layout, classes=3, hidden=HIDDEN, location_order=order_name, location_taxels=taxels
    )
    network = build_network(description, seed=1, initial_scale=scale).double()
    x = (np.random.default_rng(3).random((STEPS, layout.channels)) < 0.2).astype(np.float64)
    spikes = network(torch.from_numpy(x[None]))["location_hidden"][0].detach().numpy()
    weight = network.weight("location_hidden").detach().numpy()
    assert spikes.sum() > 10
    assert np.array_equal(spikes, expected(x, weight, visits(order, fingertips)))
