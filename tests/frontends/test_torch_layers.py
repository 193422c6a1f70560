"""State dicts with a list of their layers compute what the framework computes, batch normalisation and pooling too.

The expected spikes were recorded with snnTorch and sinabs; linear layers are compared with torch itself.
"""

import numpy as np
import pytest
import torch
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.io.records import RecordReader
from locsnn_compile.frontends.nir.flat import flatten_graph
from locsnn_compile.frontends.torch_layers.chain import Chain
from locsnn_compile.frontends.torch_layers.layers import LAYERS
from locsnn_compile.reference.evaluate import evaluate
from tests.support.recorded_torch_layers import STEPS, write_recorded


@pytest.mark.parametrize(
    "framework",
    [
        pytest.param("snntorch", id="snnTorch with batch normalisation"),
        pytest.param("sinabs", id="sinabs with max pooling"),
    ],
)
def test_every_spike_is_that_of_the_framework(framework, tmp_path):
    state, description, recorded = write_recorded(framework, tmp_path)
    inputs = recorded.pop("inputs")
    network = lc.load(state, config=description)
    ours = evaluate(network, inputs.reshape(1, len(inputs), -1)).spikes
    assert list(recorded) == [population.name for population in network.own_populations]
    for depth, (name, expected) in enumerate(recorded.items(), start=1):
        assert expected.sum() > 10
        np.testing.assert_array_equal(ours[name][0][depth:], expected[:-depth])


def test_the_chip_pools_as_the_network_does(tmp_path):
    state, description, recorded = write_recorded("sinabs", tmp_path)
    events = recorded["inputs"].reshape(1, STEPS, -1)
    compiled = lc.compile(lc.load(state, config=description), events=events)
    spikes = hw.simulate(compiled.program, events).spikes
    # Windows of 2 x 2 pixels of 4 images of 6 x 6; the pooling takes a step.
    windows = spikes["1"].reshape(STEPS, 4, 3, 2, 3, 2)
    pooled = windows.max(axis=(3, 5)).reshape(STEPS, -1)
    assert pooled.any()
    np.testing.assert_array_equal(spikes["2"][0, 1:], pooled[:-1])
    sentence = "Max pooling '2' runs as neurons that spike a step after any spike of their window."
    assert sentence in compiled.report["assumptions"]


def graph_of(layers: dict[str, torch.nn.Module], types: dict[str, dict], *shape: int):
    """Return the flat NIR graph of layers of torch for an input of a shape; ``types`` describe them."""
    network = torch.nn.Module()
    for name, layer in layers.items():
        network.add_module(name, layer)
    tensors = {key: value.double().numpy() for key, value in network.state_dict().items()}
    chain = Chain("model 'net.pt'", tensors, axes=len(shape))
    for name, options in types.items():
        kind = LAYERS[options["type"]]
        other_options = {option: value for option, value in options.items() if option != "type"}
        RecordReader("config").record(kind, other_options).add_to(chain, name)
    return flatten_graph(chain.graph(shape), "model 'net.pt'")


def trained(layer: torch.nn.Module) -> torch.nn.Module:
    """Give a batch normalisation statistics and parameters that change its input, and return it."""
    torch.manual_seed(3)
    layer.running_mean.normal_()
    layer.running_var.uniform_(0.2, 2.0)
    torch.nn.init.normal_(layer.weight)
    torch.nn.init.normal_(layer.bias)
    return layer


# Layers of torch, and the shape of their input.
NORMALISED = {
    "behind a convolution": (
        (torch.nn.Conv2d(3, 4, 3), trained(torch.nn.BatchNorm2d(4))),
        (3, 6, 5),
    ),
    "behind a grouped convolution without a bias": (
        (
            torch.nn.Conv2d(4, 6, 3, groups=2, bias=False),
            trained(torch.nn.BatchNorm2d(6, eps=1e-3)),
        ),
        (4, 6, 5),
    ),
    "behind a dense layer": ((torch.nn.Linear(7, 5), trained(torch.nn.BatchNorm1d(5))), (7,)),
    "behind a convolution along time": (
        (torch.nn.Conv1d(2, 3, 3), trained(torch.nn.BatchNorm1d(3))),
        (2, 9),
    ),
    "before a padded convolution": (
        (trained(torch.nn.BatchNorm2d(3)), torch.nn.Conv2d(3, 4, 3, padding=1)),
        (3, 6, 5),
    ),
    "before a dense layer": ((trained(torch.nn.BatchNorm1d(7)), torch.nn.Linear(7, 5)), (7,)),
    "behind another one": (
        (trained(torch.nn.BatchNorm1d(7)), trained(torch.nn.BatchNorm1d(7))),
        (7,),
    ),
}


@pytest.mark.parametrize("case", NORMALISED)
def test_normalised_layers_compute_what_torch_computes(case):
    layers, shape = NORMALISED[case]
    named = {f"layer{number}": layer.double().eval() for number, layer in enumerate(layers)}
    types = {}
    for name, layer in named.items():
        types[name] = {"type": type(layer).__name__}
        if "BatchNorm" in type(layer).__name__:
            types[name]["eps"] = layer.eps
        if "Conv" in type(layer).__name__:
            types[name] |= {"padding": layer.padding[0], "groups": layer.groups}
    flat = graph_of(named, types, *shape)
    x = np.random.default_rng(1).normal(size=shape)
    ours = x.ravel()
    for layer in flat.layers.values():
        ours = layer.weights @ ours + layer.constant
    with torch.no_grad():
        expected = torch.nn.Sequential(*layers)(torch.tensor(x)[None])[0]
    np.testing.assert_allclose(ours, expected.numpy().ravel(), rtol=1e-12, atol=1e-12)


CONV = {"type": "Conv2d", "padding": 1}
LEAKY = {"type": "snntorch.Leaky", "reset_delay": False}
# The layers of a description, and the error.
REFUSED = {
    "max pooling of sums": (
        {"conv1": CONV, "pool": {"type": "MaxPool2d", "kernel_size": 2}},
        "model 'net.pt', layer 'pool': max pooling is exact for spikes, and 'conv1' sends "
        "numbers. Train with the pooling behind the neurons, or with AvgPool2d.",
    ),
    "a type that is not read": (
        {"conv1": {"type": "Conv2D"}},
        "config 'net.yaml': layers.conv1: 'Conv2D' is not read. Did you mean 'Conv2d'?",
    ),
    "an unknown option": (
        {"conv1": {"type": "Conv2d", "pading": 1}},
        "config 'net.yaml': layers.conv1: unknown key 'pading'. Did you mean 'padding'?",
    ),
    "an option of a type without any": (
        {"conv1": CONV, "pad": {"type": "Linear", "bias": False}},
        "config 'net.yaml': layers.pad: unknown key 'bias'. Leave it out.",
    ),
    "axes that it does not have": (
        {"conv1": CONV, "flatten": {"type": "Flatten", "start_dim": 9}},
        "model 'net.pt', layer 'flatten': it joins axes 9 to -1, but 3 follow the batch. "
        "Correct start_dim and end_dim.",
    ),
    "axes in the wrong order": (
        {"conv1": CONV, "flatten": {"type": "Flatten", "start_dim": 3, "end_dim": 2}},
        "model 'net.pt', layer 'flatten': it joins axes 3 to 2, but 3 follow the batch. "
        "Correct start_dim and end_dim.",
    ),
    "a layer without a type": (
        {"conv1": 3},
        "config 'net.yaml': layers.conv1: it has no type. Write 'name: {type: Linear}'.",
    ),
    "no layers": (
        {},
        "config 'net.yaml': layers: there are none. Give 'input: [channels, height, width]' and "
        "'layers: {name: {type: ...}, ...}'.",
    ),
    "a layer without weights": (
        {"conv3": CONV},
        "model 'net.pt', layer 'conv3': the state dict has no conv3.weight. Name the layer as the "
        "state dict does.",
    ),
    "another value than that of the state dict": (
        {"conv1": CONV, "lif1": {**LEAKY, "beta": 0.5}},
        "model 'net.pt', layer 'lif1', beta: the state dict has another value (0.5 against 0.9). "
        "Leave it out.",
    ),
    "another reset than that of the state dict": (
        {"conv1": CONV, "lif1": {**LEAKY, "reset_mechanism": "none"}},
        "model 'net.pt', layer 'lif1': the state dict has another reset_mechanism (none against "
        "zero). Leave it out.",
    ),
    "statistics of another layer": (
        {"conv1": CONV, "bn2": {"type": "BatchNorm2d"}},
        "model 'net.pt', layer 'bn2': it has another number of channels than the layer before it "
        "(10 against 4). List the layers in the order in which they run.",
    ),
    "no neurons": (
        {"conv1": CONV},
        "model 'net.pt': it has no neurons. Export a network with LIF neurons.",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_description_that_does_not_fit_is_refused_by_name(case, tmp_path):
    layers, message = REFUSED[case]
    state, _, _ = write_recorded("snntorch", tmp_path)
    state = state.rename(tmp_path / "net.pt")
    description = tmp_path / "net.yaml"
    description.write_text(yaml.safe_dump({"input": [2, 6, 6], "layers": layers}, sort_keys=False))
    with pytest.raises(lc.InputError) as refused:
        lc.load(state, config=description)
    assert str(refused.value) == message


def test_leaky_neurons_keep_their_own_reset_and_rule(tmp_path):
    torch.save({"fc1.weight": torch.eye(2), "fc2.weight": torch.eye(2)}, tmp_path / "net.pt")
    description = tmp_path / "net.yaml"
    description.write_text(
        "input: 2\n"
        "layers:\n"
        "  fc1: {type: Linear}\n"
        "  first: {type: spikingjelly.IFNode}\n"
        "  fc2: {type: Linear}\n"
        "  last: {type: snntorch.Leaky, beta: 0.5, reset_mechanism: zero}\n"
    )
    network = lc.load(tmp_path / "net.pt", config=description)
    spikes = evaluate(network, np.ones((1, 6, 2), np.uint8)).spikes
    # spikingjelly's neurons spike at their threshold of 1, which a weight of 1 reaches; snnTorch's only above it.
    assert spikes["first"][0, :, 0].tolist() == [0, 1, 1, 1, 1, 1]
    assert spikes["last"][0, :, 0].tolist() == [0, 0, 0, 1, 0, 1]
