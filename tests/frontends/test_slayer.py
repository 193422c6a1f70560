"""Networks of slayerPytorch checkpoints spike as slayerPytorch's forward pass, with whole and with cut kernels.

``tests/support/slayer_files.py`` has this forward pass in numpy, ``net_files.py`` that of integers.
"""

import numpy as np
import pytest
import torch
import yaml
from scipy import sparse

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.orders import channel_walk
from locsnn_compile.data.sensor import LOCATION_ORDERS, neutouch
from locsnn_compile.network.neurons import alpha_taps
from locsnn_compile.network.projections import values_of
from locsnn_compile.network.text import network_text
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from tests.support.net_files import play, play_layer
from tests.support.slayer_files import (
    LOIHI,
    SRM,
    kernel,
    normal_weights,
    sparse_spikes,
    srm_layer,
    write,
)


def test_srm_layers_spike_as_slayers_forward_pass_with_whole_kernels(tmp_path):
    first, second = normal_weights(outs=8, ins=12), normal_weights(outs=4, ins=8)
    network = lc.load(*write(tmp_path, {"fc1": first, "fc2": second}))
    assert [p.name for p in network.populations] == ["fc1", "fc2"]
    events = sparse_spikes(12)
    hidden = srm_layer(first, events)
    ours = evaluate(network, events[None]).spikes
    np.testing.assert_array_equal(ours["fc1"][0], hidden)
    np.testing.assert_array_equal(ours["fc2"][0], srm_layer(second, hidden))
    assert hidden.sum() > 20


def test_the_cut_kernels_are_slayers():
    # For the published neuron: tau_sr 10, tau_ref 1, and scale_ref * theta 20.
    np.testing.assert_allclose(alpha_taps(tau=10.0, factor=1.0), kernel(tau=10.0, factor=1))
    assert (len(alpha_taps(tau=10.0, factor=1.0)), len(alpha_taps(tau=1.0, factor=-20.0))) == (
        77,
        11,
    )


def test_kernels_may_be_cut_in_the_reference_and_the_chip_keeps_them(tmp_path):
    first, second = normal_weights(outs=8, ins=12), normal_weights(outs=4, ins=8)
    files = write(tmp_path, {"fc1": first, "fc2": second}, steps=200)
    network, full = lc.load(*files, kernels="cut"), lc.load(*files)
    events = sparse_spikes(12, steps=200, rate=0.05)
    hidden = srm_layer(first, events, full=False)
    ours = evaluate(network, events[None]).spikes
    np.testing.assert_array_equal(ours["fc1"][0], hidden)
    np.testing.assert_array_equal(ours["fc2"][0], srm_layer(second, hidden, full=False))
    whole = evaluate(full, events[None]).spikes["fc1"]
    cut = ours["fc1"]
    assert 0.7 < 2 * (whole & cut).sum() / (whole.sum() + cut.sum()) < 1
    # Lowered without calibration recordings: rounding for recordings depends on the kernels of the reference.
    lowered = [
        lower(either, hw.chip("loihi-sim"), weight_bits=8).program for either in (network, full)
    ]
    played = [hw.simulate(program, events).spikes["fc2"] for program in lowered]
    np.testing.assert_array_equal(*played)
    compiled = lc.compile(network, events=events[None], strategy="dendrite", diagnosis=False)
    assert compiled.match.by_population["fc1"].reference_spikes == hidden.sum()
    assert "kernels cut after 77 and 11" in network_text(network)


def test_tails_of_kernels_are_a_stage_where_the_reference_cuts_them(tmp_path):
    """The error budget and the cause compare with the network as it is, whose kernels are cut, and so include tails."""
    network = lc.load(
        *write(
            tmp_path,
            {"fc1": normal_weights(outs=8, ins=12), "fc2": normal_weights(outs=4, ins=8)},
            steps=200,
        ),
        kernels="cut",
    )
    report = lc.compile(
        network, events=sparse_spikes(12, steps=200, rate=0.05)[None], strategy="dendrite"
    ).report
    match = report["match"]
    budget = report["error_budget"]
    first = match["first_divergence"]
    assert budget["together"]["spike_agreement"] == match["spike_agreement"] < 1
    assert (
        budget["alone"]["tails"]["spike_agreement"] < budget["all_but"]["tails"]["spike_agreement"]
    )
    assert (budget["unexplained_spikes"], budget["kernel_tail"]) == (0, None)
    moved = first["chip_potential"] - first["reference_potential"]
    assert first["cause"]["moved_together"] == pytest.approx(moved, abs=1e-9)
    moved_by = first["cause"]["moved_by"]
    assert moved_by["tails"]
    # Stages that alone move the potential to the other side of the threshold.
    start = first["reference_potential"]
    threshold = first["threshold"]
    enough_alone = {
        stage
        for stage, distance in moved_by.items()
        if (start + distance >= threshold) != (start >= threshold)
    }
    assert enough_alone == set(first["cause"]["enough_alone"])


@pytest.mark.parametrize("order", [None, "arch", "whorl", "loop"])
def test_the_authors_hybrid_walks_its_location_order(order, tmp_path):
    steps = 40
    layers_by_name = {
        "fc1": normal_weights(outs=6, ins=156, mean=0.1),
        "fc2": normal_weights(outs=3, ins=6),
        "locationFc1": normal_weights(outs=6, ins=steps, mean=0.3),
        "locationFc2": normal_weights(outs=3, ins=6),
    }
    options = {} if order is None else {"location_order": order}
    network = lc.load(*write(tmp_path, layers_by_name, steps=steps, **options))
    assert [p.name for p in network.populations] == ["fc1", "fc2", "locationFc1", "locationFc2"]
    events = sparse_spikes(156, steps)
    walk = channel_walk(LOCATION_ORDERS[order or "loop"], neutouch(2))
    hidden = srm_layer(layers_by_name["locationFc1"], events[:, walk].T)
    ours = evaluate(network, events[None]).spikes
    np.testing.assert_array_equal(ours["locationFc1"][0], hidden)
    np.testing.assert_array_equal(
        ours["locationFc2"][0], srm_layer(layers_by_name["locationFc2"], hidden)
    )
    np.testing.assert_array_equal(ours["fc1"][0], srm_layer(layers_by_name["fc1"], events))
    assert network.readout.populations == ("fc2", "locationFc2")


def test_loihi_layers_are_integers_and_spike_as_these_mean(tmp_path):
    rng = np.random.default_rng(4)
    first, second = rng.normal(0, 60, (9, 12)), rng.normal(10, 60, (4, 9))
    network = lc.load(*write(tmp_path, {"fc1": first, "fc2": second}, LOIHI))
    layers = [
        {
            "type": "dense",
            "shape": [len(w)],
            "weight": 2 * np.round(np.float32(w).astype(float) / 2),
            "neuron": LOIHI,
        }
        for w in (first, second)
    ]
    events = sparse_spikes(12, 80)
    expected = play(layers, events)
    compiled = lc.compile(network, events=events[None], diagnosis=False)
    result = hw.simulate(compiled.program, events)
    for number, name in enumerate(("fc1", "fc2")):
        np.testing.assert_array_equal(
            network.projections[number].mantissa, layers[number]["weight"]
        )
        np.testing.assert_array_equal(result.spikes[name], expected[number])
    assert expected[1].sum() > 10
    assert compiled.match.spikes.agreement == 1


def test_weights_are_rounded_to_even_numbers_and_ties_to_multiples_of_four(tmp_path):
    network = lc.load(*write(tmp_path, {"fc1": np.array([[1.0, 3.0, 5.0, -1.0, -3.0]])}, LOIHI))
    np.testing.assert_array_equal(network.projections[0].mantissa, [[0, 4, 4, 0, -4]])


@pytest.mark.parametrize(
    "names",
    [
        ("fc1.weight_g", "fc1.weight_v"),
        ("fc1.parametrizations.weight.original0", "fc1.parametrizations.weight.original1"),
    ],
)
def test_weight_normalisation_is_multiplied_out(names, tmp_path):
    v, g = torch.randn(5, 7, 1, 1, 1), torch.rand(5, 1, 1, 1, 1)
    network = lc.load(*write(tmp_path, {}, extra=dict(zip(names, (g, v), strict=True))))
    expected = (g * v / (v**2).sum(dim=(1, 2, 3, 4), keepdim=True).sqrt()).reshape(5, 7)
    np.testing.assert_allclose(network.projections[0].weights, expected, rtol=1e-6)


def test_delays_belong_to_the_spikes_of_the_layer_of_their_size(tmp_path):
    delay = torch.tensor([0.0, 1.2, 2.9, 70.0]).reshape(1, 4, 1, 1, 1)
    network = lc.load(
        *write(
            tmp_path,
            {"fc1": normal_weights(outs=4, ins=6), "fc2": normal_weights(outs=3, ins=4)},
            extra={"delay.delay": delay},
        )
    )
    np.testing.assert_array_equal(network.projections[1].delay, np.tile([0, 1, 2, 62], (3, 1)))
    assert np.max(network.projections[0].delay) == 0


LOCATION = {"theta": 4.0, "tauSr": 3.0, "tauRef": 2.0}
"""Constants of location neurons that differ from those of time neurons."""


def hybrid_weights():
    """Return weights of both branches, for one fingertip (78 channels) and 60 time steps."""
    return {
        "fc1": normal_weights(outs=4, ins=78),
        "fc2": normal_weights(outs=3, ins=4),
        "locationFc1": normal_weights(outs=4, ins=60),
        "locationFc2": normal_weights(outs=3, ins=4),
    }


@pytest.mark.parametrize("key", ["location_neuron", "locationNeuron"])
def test_location_neurons_have_their_own_constants_and_delays(key, tmp_path):
    weights_by_name = hybrid_weights()
    delay = torch.tensor([0.0, 1.2, 2.9, 70.0]).reshape(1, 4, 1, 1, 1)
    kernels = {f"locationSlayer.{n}": torch.tensor(kernel(t, f)).float() for n, t, f in KERNELS}
    network = lc.load(
        *write(
            tmp_path,
            weights_by_name,
            extra={"locationDelay.delay": delay, **kernels},
            **{key: LOCATION},
        )
    )
    assert [p.neuron.theta for p in network.populations] == [10.0, 10.0, 4.0, 4.0]
    delays = np.array([0, 1, 2, 62])
    assert [np.max(p.delay) for p in network.projections] == [0, 0, 0, 62]
    np.testing.assert_array_equal(network.projections[3].delay, np.tile(delays, (3, 1)))
    events = sparse_spikes(78, 60)
    first = srm_layer(weights_by_name["locationFc1"], events.T, SRM | LOCATION)
    ours = evaluate(network, events[np.newaxis]).spikes
    np.testing.assert_array_equal(ours["locationFc1"][0], first)
    delayed_spikes = np.stack(
        [np.pad(first[:, i], (d, 0))[: len(first)] for i, d in enumerate(delays)], axis=1
    )
    np.testing.assert_array_equal(
        ours["locationFc2"][0],
        srm_layer(weights_by_name["locationFc2"], delayed_spikes, SRM | LOCATION),
    )
    assert ours["locationFc2"].sum() > 0


KERNELS = (("srmKernel", 3.0, 1), ("refKernel", 2.0, -2.0 * 4.0))
"""The kernels of these location neurons: name in the checkpoint, time constant, and factor."""


@pytest.mark.parametrize(
    ("location", "message"),
    [
        pytest.param(
            {"type": "LOIHI"},
            "config 'net.yaml', location_neuron.type: it differs from the type of the other "
            "neurons. Leave it out.",
            id="another kind",
        ),
        pytest.param(
            3, "config 'net.yaml': section 'location_neuron' is missing. {fix}", id="no section"
        ),
        pytest.param(
            {"tauSr": 4.0},
            "model 'model.pt', entry 'locationSlayer.srmKernel': the kernel is not that of the YAML (0.239 apart). "
            "Give the YAML that this checkpoint was trained with.",
            id="another kernel",
        ),
    ],
)
def test_location_neurons_that_differ_too_much_are_refused(location, message, tmp_path):
    kernels = {f"locationSlayer.{n}": torch.tensor(kernel(t, f)).float() for n, t, f in KERNELS[:1]}
    with pytest.raises(lc.InputError) as caught:
        lc.load(*write(tmp_path, hybrid_weights(), extra=kernels, location_neuron=location))
    assert str(caught.value) == message.replace(
        "{fix}", "Give slayerPytorch's network description, or a list of layers."
    )


def test_cut_kernels_are_cut_along_both_axes(tmp_path):
    files = write(tmp_path, hybrid_weights(), location_neuron=LOCATION)
    network = lc.load(*files, kernels="cut")
    lengths = [(p.neuron.eps_taps, p.neuron.nu_taps) for p in network.populations]
    assert lengths == [(77, 11)] * 2 + [tuple(len(kernel(t, f)) for _, t, f in KERNELS)] * 2


def test_weights_of_images_are_read_in_their_order(tmp_path):
    weight = torch.randn(3, 2, 4, 5, 1)
    network = lc.load(*write(tmp_path, {}, extra={"fc1.weight": weight}))
    np.testing.assert_array_equal(network.projections[0].weights, weight.reshape(3, 40).double())


# A list of layers with convolutions, pooling, delays and a dense layer.
LISTED = [
    {"dim": "7x6x2"},
    {"dim": "4c3z", "delay": True},
    {"dim": "2a"},
    {"dim": "3c2z", "stride": 2, "padding": 0},
    {"dim": 5},
]


def listed(folder, entries=LISTED, neuron=LOIHI, **options):
    """Write a network of a list of layers, as slayerPytorch's Loihi networks name them."""
    shapes = {0: (4, 2, 3, 3, 1), 1: (1, 1, 2, 2, 1), 2: (3, 4, 2, 2, 1), 4: (5, 6, 1, 1, 1)}
    rng = np.random.default_rng(5)
    state = {
        f"blocks.{i}.weightOp.weight": torch.tensor(rng.normal(40, 60, s)).float()
        for i, s in shapes.items()
    }
    state["blocks.0.delayOp.delay"] = torch.tensor([0.0, 3.2, 1.0, 2.0]).reshape(1, 4, 1, 1, 1)
    return (*write(folder, {}, neuron, extra={**state, **options}, layer=entries), state)


def test_listed_convolutions_and_pooling_spike_as_their_integers_mean(tmp_path):
    path, config, state = listed(tmp_path)
    network = lc.load(path, config)
    weights_by_name = [
        2 * np.round(w.double().numpy() / 2) for name, w in state.items() if "weight" in name
    ]
    # Pooling pads the last window of a row with zeros, and sees each channel by itself.
    layers = [
        {
            "type": "conv",
            "shape": (4, 6, 7),
            "weight": weights_by_name[0],
            "padding": 1,
            "neuron": LOIHI,
        },
        {
            "type": "conv",
            "shape": (4, 3, 4),
            "weight": np.tile(weights_by_name[1], (4, 1, 1, 1, 1)),
            "stride": 2,
            "groups": 4,
            "neuron": LOIHI,
        },
        {
            "type": "conv",
            "shape": (3, 1, 2),
            "weight": weights_by_name[2],
            "stride": 2,
            "neuron": LOIHI,
        },
        {
            "type": "dense",
            "shape": (5,),
            "weight": weights_by_name[3].reshape(5, 6),
            "neuron": LOIHI,
        },
    ]
    events = sparse_spikes(2 * 6 * 7, 60)
    first = play_layer(layers[0], events, (2, 6, 7)).reshape(60, 4, 6, 7)
    delays = np.stack(
        [
            np.roll(first[:, c], d, axis=0) * (np.arange(60) >= d)[:, None, None]
            for c, d in enumerate((0, 3, 1, 2))
        ],
        axis=1,
    )
    padded = np.pad(delays, [(0, 0), (0, 0), (0, 0), (0, 1)])
    second = play_layer(layers[1], padded.reshape(60, -1), (4, 6, 8))
    third = play_layer(layers[2], second, (4, 3, 4))
    last = play_layer(layers[3], third, (3, 1, 2))
    compiled = lc.compile(network, events=events[None], diagnosis=False)
    ours = hw.simulate(compiled.program, events).spikes
    for name, expected in zip(
        [p.name for p in network.populations],
        (first.reshape(60, -1), second, third, last),
        strict=True,
    ):
        np.testing.assert_array_equal(ours[name], expected, err_msg=name)
        assert expected.sum() > 5
    assert compiled.match.spikes.agreement == 1


def test_srm_convolutions_are_linear_layers(tmp_path):
    path, config, state = listed(tmp_path, neuron=SRM)
    weights = lc.load(path, config).projections[1].weights
    assert set(values_of(weights).tolist()) == set(
        state["blocks.1.weightOp.weight"].double().ravel().tolist()
    )


def other_kernel(tau):
    """Return a function that writes a checkpoint whose YAML has another time constant than its kernels."""

    def write_files(folder):
        path, config = write(folder, {"fc1": normal_weights(outs=4, ins=6)})
        values = yaml.safe_load(config.read_text())
        values["neuron"]["tauSr"] = tau
        config.write_text(yaml.safe_dump(values))
        return path, config

    return write_files


def yaml_text(text):
    """Return a function that writes a checkpoint with this text as its YAML, and returns both paths."""

    def write_files(folder):
        path, config = write(folder, {"fc1": normal_weights(outs=4, ins=6)})
        config.write_text(text)
        return path, config

    return write_files


def replaced(folder, name, value):
    """Write a checkpoint in which one entry has another value, and return its path and that of its YAML."""
    path, config = write(
        folder, {"fc1": normal_weights(outs=4, ins=6), "fc2": normal_weights(outs=3, ins=4)}
    )
    torch.save(torch.load(path) | {name: value}, path)
    return path, config


def turned(folder):
    """Write a checkpoint whose first convolution has the axes of inputs and outputs exchanged."""
    path, config, state = listed(folder)
    name = "blocks.0.weightOp.weight"
    torch.save(state | {name: state[name].transpose(0, 1)}, path)
    return path, config


REFUSED = [
    pytest.param(
        other_kernel(10.1),
        "model 'model.pt', entry 'slayer.srmKernel': the kernel is not that of the YAML "
        "(0.00836 apart). Give the YAML that this checkpoint was trained with.",
        id="a kernel nearly the same",
    ),
    pytest.param(
        other_kernel(5.0),
        "model 'model.pt', entry 'slayer.srmKernel': the kernel is not that of the YAML "
        "(0.541 apart). Give the YAML that this checkpoint was trained with.",
        id="another kernel",
    ),
    pytest.param(
        lambda f: write(f, {"fc1": normal_weights(outs=4, ins=6)}),
        "kernels 'short': are not known. Choose one of: cut, full.",
        id="kernels of no name",
    ),
    pytest.param(
        lambda f: write(f, {"fc1": normal_weights(outs=4, ins=6)}, LOIHI),
        "kernels 'cut': LOIHI neurons have no kernels. Leave the option out.",
        id="kernels of integers",
    ),
    pytest.param(
        lambda f: write(
            f, {"fc1": normal_weights(outs=4, ins=6), "fc2": normal_weights(outs=3, ins=5)}
        ),
        "model 'model.pt', layer 'fc2': its inputs are not the neurons of 'fc1' (5 against "
        "4). Save the layers of one chain in their order.",
        id="a gap in the chain",
    ),
    pytest.param(
        lambda f: write(f, {}, extra={"conv1.weight": torch.randn(3, 2, 4, 5, 2)}),
        "model 'model.pt', layer 'conv1': it is not a dense layer (weight (3, 2, 4, 5, 2)). "
        "Use slayer.dense layers, or list all layers in the YAML, as layer: [{dim: 34x34x2}, "
        "{dim: 16c5z}, ...].",
        id="a convolution",
    ),
    pytest.param(
        lambda f: listed(f, LISTED[1:])[:2],
        "config 'net.yaml', layer 0: dim '4c3z' is not supported there. Give the input "
        "first, as 34x34x2, then 16c5z, 2a or 10.",
        id="a list without an input",
    ),
    pytest.param(
        lambda f: listed(f, LISTED[:3])[:2],
        "model 'model.pt': the YAML lists a different number of layers (2 against 4). List "
        "the input and every layer that has weights.",
        id="a list of fewer layers",
    ),
    pytest.param(
        lambda f: listed(f, [*LISTED[:1], {"dim": "4c5z"}, *LISTED[2:]])[:2],
        "model 'model.pt', layer 'blocks.0.weightOp': its weights are not those that the "
        "YAML lists ((4, 2, 3, 3, 1) against (4, 2, 5, 5)). Give the YAML that this "
        "checkpoint was trained with.",
        id="a list of other layers",
    ),
    pytest.param(
        turned,
        "model 'model.pt', layer 'blocks.0.weightOp': its weights are not those that the "
        "YAML lists ((2, 4, 3, 3, 1) against (4, 2, 3, 3)). Give the YAML that this "
        "checkpoint was trained with.",
        id="kernels the other way around",
    ),
    pytest.param(
        lambda f: replaced(f, "fc1.weight", [[1.0]]),
        "model 'model.pt', entry 'fc1.weight': it is not a dense float tensor (list). Save "
        "net.state_dict() with torch.save.",
        id="a layer that is a list",
    ),
    pytest.param(
        lambda f: replaced(f, "fc1.bias", torch.tensor([0.0, 1, 0, 0])),
        "model 'model.pt', entry 'fc1.bias': layers of slayerPytorch have no biases. Train "
        "without biases, or export the network as NIR.",
        id="biases",
    ),
    pytest.param(
        lambda f: replaced(f, "x" * 300 + ".weight", torch.zeros(3, 4)),
        f"model 'model.pt', entry '{'x' * 80}': its name is too long (307 characters against "
        "200). Rename it.",
        id="a layer of a long name",
    ),
    pytest.param(
        yaml_text(f"simulation: {{Ts: {10**400}}}\nneuron: {{type: SRMALPHA}}"),
        f"config 'net.yaml': Ts must be a number from 1e-06 on (1{'0' * 39}). Correct it.",
        id="a number beyond floats",
    ),
    pytest.param(
        lambda f: write(f, {}),
        "model 'model.pt': it has no weights (['slayer.srmKernel', 'slayer.refKernel']). "
        "Save net.state_dict() with torch.save.",
        id="no weights",
    ),
    pytest.param(
        lambda f: write(f, {"fc1": np.full((2, 2), 300.0)}, LOIHI),
        "model 'model.pt', layer 'fc1': a weight does not fit an 8-bit synapse (0..300 "
        "against -256..254). Clamp the weights in training.",
        id="a heavy weight",
    ),
    pytest.param(
        yaml_text("simulation: {Ts: 1}\nneuron: {type: SRMALPHAA}"),
        "config 'net.yaml', neuron.type: 'SRMALPHAA' is not known. Did you mean 'SRMALPHA'?",
        id="another neuron",
    ),
    pytest.param(
        yaml_text("simulation: {Ts: 1}"),
        "config 'net.yaml': section 'neuron' is missing. Give slayerPytorch's network "
        "description, or a list of layers.",
        id="no neuron",
    ),
    pytest.param(
        yaml_text("!!python/object/apply:os.system ['true']"),
        "config 'net.yaml': it is not YAML. Give slayerPytorch's network description, or a "
        "list of layers.",
        id="a python object",
    ),
    pytest.param(
        yaml_text("simulation: {Ts: one}\nneuron: {type: SRMALPHA}"),
        "config 'net.yaml': Ts must be a number from 1e-06 on ('one'). Correct it.",
        id="text for a number",
    ),
]


@pytest.mark.parametrize(("write_files", "message"), REFUSED)
def test_a_checkpoint_or_description_that_cannot_be_used_is_refused_in_one_line(
    write_files, message, tmp_path
):
    kernels = {"kernels 'short'": "short", "kernels 'cut'": "cut"}.get(message.partition(":")[0])
    with pytest.raises(lc.InputError) as caught:
        lc.load(*write_files(tmp_path), kernels=kernels)
    assert str(caught.value) == message


def test_biases_of_zero_change_nothing(tmp_path):
    assert [
        p.name for p in lc.load(*replaced(tmp_path, "fc1.bias", torch.zeros(4))).populations
    ] == ["fc1", "fc2"]


def one_row(folder, kernel):
    """Write a list of layers for an image of one row of 6 pixels and 2 channels, with a convolution of 3 pixels."""
    state = {"blocks.0.weightOp.weight": torch.tensor(kernel).float()}
    return write(folder, {}, LOIHI, extra=state, layer=[{"dim": "6x1x2"}, {"dim": "1c3z"}])


def test_a_convolution_on_an_image_of_one_row_has_kernels_of_one_row(tmp_path):
    """Weights are even: 2 and 4 for one channel, and 6 for the other. Without rows above and below, none is padded."""
    kernel = np.array([[2.0, 4.0, 0.0], [0.0, 6.0, 0.0]]).reshape(1, 2, 1, 3, 1)
    (projection,) = lc.load(*one_row(tmp_path, kernel)).projections
    weights = sparse.csr_array(projection.mantissa).toarray()
    first = 2 * np.eye(6, k=-1) + 4 * np.eye(6)
    assert weights.tolist() == np.hstack((first, 6 * np.eye(6))).tolist()


def test_a_convolution_on_an_image_of_one_column_keeps_its_square_kernels(tmp_path):
    kernel = np.zeros((1, 1, 3, 3, 1))
    kernel[0, 0, :, 1, 0] = [2.0, 4.0, 6.0]
    state = {"blocks.0.weightOp.weight": torch.tensor(kernel).float()}
    layers = [{"dim": "1x4x1"}, {"dim": "1c3z"}]
    (projection,) = lc.load(*write(tmp_path, {}, LOIHI, extra=state, layer=layers)).projections
    weights = sparse.csr_array(projection.mantissa).toarray()
    assert weights.tolist() == (2 * np.eye(4, k=-1) + 4 * np.eye(4) + 6 * np.eye(4, k=1)).tolist()


@pytest.mark.parametrize(
    "shape", [(5, 12, 1, 1, 1), (5, 2, 3, 2, 1), (5, 12)], ids=["flat", "an image", "a matrix"]
)
def test_a_dense_layer_may_join_the_axes_of_an_image(shape, tmp_path):
    kernel = 2.0 * np.arange(60).reshape(shape)
    state = {"blocks.0.weightOp.weight": torch.tensor(kernel).float()}
    layers = [{"dim": "2x3x2"}, {"dim": 5}]
    (projection,) = lc.load(*write(tmp_path, {}, LOIHI, extra=state, layer=layers)).projections
    assert np.asarray(projection.mantissa).tolist() == (2 * np.arange(60).reshape(5, 12)).tolist()


def test_a_dense_layer_of_another_order_of_axes_is_refused(tmp_path):
    state = {"blocks.0.weightOp.weight": torch.ones(12, 5, 1, 1, 1)}
    layers = [{"dim": "2x3x2"}, {"dim": 5}]
    with pytest.raises(lc.InputError) as caught:
        lc.load(*write(tmp_path, {}, LOIHI, extra=state, layer=layers))
    assert str(caught.value) == (
        "model 'model.pt', layer 'blocks.0.weightOp': its weights are not those that the YAML lists "
        "((12, 5, 1, 1, 1) against 5 x 12). Give the YAML that this checkpoint was trained with."
    )


def test_kernels_in_a_checkpoint_of_integer_neurons_are_not_compared(tmp_path):
    extra = {"slayer.srmKernel": torch.ones(1, 1, 1, 1, 9)}
    network = lc.load(*write(tmp_path, {"fc1": normal_weights(outs=3, ins=6)}, LOIHI, extra=extra))
    assert [population.name for population in network.populations] == ["fc1"]
