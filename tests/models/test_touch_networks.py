"""The three networks of spike response neurons: their populations, shapes and branches, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from locsnn_compile.data.orders import channel_walk
from locsnn_compile.data.sensor import LOCATION_ORDERS, neutouch
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import InputLayout, NetworkDescription, NeuronParameters
from locsnn_compile.models.networks import TouchNetwork, build_network
from locsnn_compile.models.srm import SRMLayer

LAYOUT = InputLayout(neutouch(1), steps=30, step_seconds=0.02)
# Numbers in the shapes below: 3 recordings, 30 steps, 78 channels (39 taxels with two polarities), 7 hidden neurons and
# 5 classes.


def description(
    architecture: str, layout: InputLayout = LAYOUT, order: str = "whorl"
) -> NetworkDescription:
    """A network of an architecture of 7 hidden neurons and 5 classes; one without a location branch has no order."""
    located = architecture != "tactile-snn"
    return NetworkDescription(
        architecture,
        layout,
        classes=5,
        hidden=7,
        location_order=order if located else None,
        location_taxels=LOCATION_ORDERS[order] if located else None,
    )


def recording(layout: InputLayout = LAYOUT, samples: int = 3) -> torch.Tensor:
    """Random recordings of a layout, as floats of 0 and 1."""
    generator = torch.Generator().manual_seed(11)
    return (torch.rand(samples, layout.steps, layout.channels, generator=generator) < 0.15).float()


@pytest.mark.parametrize(
    ("architecture", "shapes"),
    [
        pytest.param(
            "tactile-snn", {"time_hidden": (3, 30, 7), "time_output": (3, 30, 5)}, id="tactile-snn"
        ),
        pytest.param(
            "location-tactile-snn",
            {"location_hidden": (3, 78, 7), "location_output": (3, 78, 5)},
            id="location",
        ),
        pytest.param(
            "hybrid",
            {
                "time_hidden": (3, 30, 7),
                "time_output": (3, 30, 5),
                "location_hidden": (3, 78, 7),
                "location_output": (3, 78, 5),
            },
            id="hybrid",
        ),
    ],
)
def test_the_spikes_of_populations_have_these_shapes(
    architecture: str, shapes: dict[str, tuple[int, ...]]
) -> None:
    network = build_network(description(architecture))
    spikes = network(recording())
    assert {name: tuple(value.shape) for name, value in spikes.items()} == shapes
    assert type(network) is TouchNetwork
    assert tuple(network.counts(recording()).shape) == (3, 5)
    assert all(set(np.unique(value.detach())) <= {0.0, 1.0} for value in spikes.values())


def test_the_branches_of_a_hybrid_spike_like_the_single_networks() -> None:
    hybrid = build_network(description("hybrid"), seed=4)
    x = recording()
    together = hybrid(x)
    for architecture in ("tactile-snn", "location-tactile-snn"):
        alone = build_network(description(architecture), seed=9)
        alone.load_weights(hybrid.weights())
        for name, spikes in alone(x).items():
            assert torch.equal(spikes, together[name])
    assert torch.equal(
        hybrid.counts(x), together["time_output"].sum(1) + together["location_output"].sum(1)
    )


def test_a_location_branch_steps_through_the_channels_of_the_walk() -> None:
    network = build_network(description("location-tactile-snn"), seed=2)
    x = recording(samples=1)
    walk = channel_walk(LOCATION_ORDERS["whorl"], neutouch(1))
    # The inputs of a location neuron are the steps of a recording.
    layer = SRMLayer(LAYOUT.steps, 7, NeuronParameters())
    layer.weight = network.get_submodule("location_hidden").weight
    by_hand = torch.stack([x[0, :, channel] for channel in walk]).unsqueeze(0)
    assert torch.equal(network(x)["location_hidden"], layer(by_hand))


def test_the_walk_goes_over_all_channels_of_two_fingertips() -> None:
    layout = InputLayout(neutouch(2), steps=12, step_seconds=0.02)
    spikes = build_network(description("hybrid", layout, "arch"))(recording(layout, 2))
    assert tuple(spikes["location_output"].shape) == (2, 2 * LAYOUT.channels, 5)


def test_a_seed_gives_the_same_weights_and_another_does_not() -> None:
    first, again, other = (
        build_network(description("hybrid"), seed=seed).weights() for seed in (1, 1, 2)
    )
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["time_hidden"], other["time_hidden"])


def fails(call: object, *args: object) -> str:
    """Return the message of the InputError that a call raises."""
    with pytest.raises(InputError) as caught:
        call(*args)  # type: ignore[operator]
    return str(caught.value)


def test_recordings_of_another_shape_are_refused() -> None:
    network = build_network(description("hybrid"))
    assert fails(network, torch.zeros(1, 31, 78)) == (
        "recordings: their steps and channels are not the network's ((31, 78) against (30, 78)). "
        "Give recordings of the network's sensor and duration."
    )


def test_weights_of_another_shape_are_refused() -> None:
    network = build_network(description("tactile-snn"))
    weights = network.weights() | {"time_output": np.zeros((5, 8), dtype=np.float32)}
    assert fails(network.load_weights, weights) == (
        "population 'time_output': its weights do not fit the network ((5, 8) against (5, 7)). "
        "Give the weights of a network of this description."
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        pytest.param(
            {"architecture": "hybird"},
            "architecture: 'hybird' is not known. Did you mean 'hybrid'?",
            id="unknown architecture",
        ),
        pytest.param(
            {"location_taxels": None},
            "architecture 'hybrid': its location branch needs a location order. "
            "Give its name, such as loop or snake, or a list of taxel numbers.",
            id="no order",
        ),
        pytest.param(
            {"architecture": "tactile-snn"},
            "architecture 'tactile-snn': it has no location branch, so it takes no location order. "
            "Leave the order out.",
            id="order without a location branch",
        ),
        pytest.param(
            {"classes": 0},
            "classes: it must be a whole number from 1 to 4096 (got 0). Correct it.",
            id="no classes",
        ),
        pytest.param(
            {"hidden": True},
            "hidden: it must be a whole number from 1 to 4096 (got True). Correct it.",
            id="hidden is a truth value",
        ),
    ],
)
def test_descriptions_that_contradict_themselves_are_refused(
    values: dict[str, object], message: str
) -> None:
    good: dict[str, object] = {
        "architecture": "hybrid",
        "input": LAYOUT,
        "classes": 5,
        "location_order": "loop",
        "location_taxels": LOCATION_ORDERS["loop"],
    }
    with pytest.raises(InputError) as caught:
        NetworkDescription(**{**good, **values})  # type: ignore[arg-type]
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        pytest.param(
            NeuronParameters,
            {"tau_sr": 0.0},
            "neuron 'tau_sr': it must be a number above 0 (got 0.0). Correct it.",
            id="tau of 0",
        ),
        pytest.param(
            NeuronParameters,
            {"theta": float("nan")},
            "neuron 'theta': it must be a number above 0 (got nan). Correct it.",
            id="theta NaN",
        ),
        pytest.param(
            NeuronParameters,
            {"scale_ref": -1.0},
            "neuron 'scale_ref': it must be a number of at least 0 (got -1.0). Correct it.",
            id="negative refractory scale",
        ),
        pytest.param(
            InputLayout,
            {"sensor": neutouch(), "steps": 0, "step_seconds": 0.02},
            "input 'steps': it must be a whole number from 1 to 1000000 (got 0). Correct it.",
            id="no steps",
        ),
        pytest.param(
            neutouch,
            {"fingertips": 500},
            "sensor 'neutouch': its channels are out of range (got 39000 against 1..32768). "
            "Correct the layout of the sensor.",
            id="too many channels",
        ),
    ],
)
def test_constants_and_sizes_out_of_range_are_refused(
    kind: type, values: dict[str, object], message: str
) -> None:
    assert fails(lambda: kind(**values)) == message


def test_neurons_still_spike_at_the_end_of_a_long_recording() -> None:
    """A response computed with a^t for step t would vanish in float32 after some thousand steps."""
    steps = 5000
    layout = InputLayout(neutouch(1), steps=steps, step_seconds=0.02)
    loud = 10.0  # at which untrained neurons spike
    network = build_network(description("tactile-snn", layout), initial_scale=loud)
    spikes = network(torch.ones(1, steps, layout.channels))["time_hidden"]
    assert spikes.shape == (1, steps, network.description.hidden)
    assert spikes[0, -1000:].sum() > 0
