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
FINGERTIP_CHANNELS = 78  # 39 taxels with two polarities
BACKWARDS = ",".join(str(taxel) for taxel in range(39, 0, -1))


def visits(order: str, fingertips: int) -> list[int]:
    """Return the channel of each location: both polarities of a taxel, all taxels of a fingertip, then the next one."""
    _, taxels = location_order(order, neutouch())
    channels = []
    for fingertip in range(fingertips):
        for taxel in taxels:
            for polarity in range(2):
                channels.append(FINGERTIP_CHANNELS * fingertip + 2 * (taxel - 1) + polarity)
    return channels


def alpha(lag: int, tau: float) -> float:
    """The kernel of a spike ``lag`` locations ago."""
    return lag / tau * math.exp(1 - lag / tau)


def spike_response(x: np.ndarray, weight: np.ndarray, channels: list[int]) -> np.ndarray:
    """Return the spikes (locations, neurons) of spike response neurons, given the channel of each location.

    Every event and every own spike goes through its kernel: u = sum w eps + sum nu, and a spike where u >= theta.
    """
    neuron = NeuronParameters()
    spikes = np.zeros((len(channels), len(weight)))
    for location in range(len(channels)):
        u = np.zeros(len(weight))
        for earlier in range(location):
            lag = location - earlier
            for t in range(len(x)):
                u += weight[:, t] * x[t, channels[earlier]] * alpha(lag, neuron.tau_sr)
            u -= spikes[earlier] * neuron.scale_ref * neuron.theta * alpha(lag, neuron.tau_ref)
        spikes[location] = u >= neuron.theta
    return spikes


def integrate_and_fire(x: np.ndarray, weight: np.ndarray, channels: list[int]) -> np.ndarray:
    """Return the spikes (locations, neurons) of integrate-and-fire neurons, given the channel of each location.

    u sums the events since the last own spike, each times its power of the decay; a spike where u > threshold.
    """
    neuron = LifParameters()
    spikes = np.zeros((len(channels), len(weight)))
    for i, row in enumerate(weight):
        last_spike = 0
        for location in range(len(channels)):
            u = sum(
                row @ x[:, channels[earlier]] * neuron.decay ** (location - 1 - earlier)
                for earlier in range(last_spike, location)
            )
            if u > neuron.threshold:
                spikes[location, i] = 1
                last_spike = location
    return spikes


@pytest.mark.slow
@pytest.mark.parametrize("fingertips", [1, 2])
@pytest.mark.parametrize(
    "order", ["loop", "arch", "whorl", BACKWARDS], ids=["loop", "arch", "whorl", "custom"]
)
@pytest.mark.parametrize(
    ("name", "expected", "scale"),
    [
        ("location-tactile-snn", spike_response, 30.0),
        ("location-tactile-snn-lif", integrate_and_fire, 3.0),
    ],
    ids=["LSRM", "LLIF"],
)
def test_a_location_branch_spikes_like_its_sums_of_kernels(
    name, expected, scale, order, fingertips
):
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
