"""slayerPytorch checkpoints in: against its own forward pass, kernels cut and whole."""

import numpy as np
import pytest
import torch
import yaml
from net_files import play
from slayer_files import LOIHI, kernel, srm_layer, write

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.sensor import LOCATION_ORDERS, channel_walk
from locsnn_compile.frontends.slayer_kernels import alpha_taps, truncated_spikes
from locsnn_compile.reference import evaluate

RNG = np.random.default_rng(4)


def weights(outs, ins, mean=1.0):
    return RNG.normal(mean, 2.0, (outs, ins)).astype(np.float32).astype(np.float64)


def spikes(lines, steps=60, rate=0.15):
    return (np.random.default_rng(8).random((steps, lines)) < rate).astype(np.uint8)


def test_srm_layers_spike_as_slayers_forward_pass_with_whole_kernels(tmp_path):
    first, second = weights(8, 12), weights(4, 8)
    network = lc.load(*write(tmp_path, {"fc1": first, "fc2": second}))
    assert [p.name for p in network.populations] == ["fc1", "fc2"]
    given = spikes(12)
    hidden = srm_layer(first, given)
    found = evaluate(network, given[None]).spikes
    np.testing.assert_array_equal(found["fc1"][0], hidden)
    np.testing.assert_array_equal(found["fc2"][0], srm_layer(second, hidden))
    assert hidden.sum() > 20


def test_the_cut_kernels_are_slayers_and_their_effect_is_measured(tmp_path):
    np.testing.assert_allclose(alpha_taps(10.0, 1.0), kernel(10.0, 1))
    assert (len(alpha_taps(10.0, 1.0)), len(alpha_taps(1.0, -20.0))) == (77, 11)
    first, second = weights(8, 12), weights(4, 8)
    network = lc.load(*write(tmp_path, {"fc1": first, "fc2": second}, steps=200))
    given = spikes(12, steps=200, rate=0.05)
    cut = truncated_spikes(network, given[None])
    hidden = srm_layer(first, given, full=False)
    np.testing.assert_array_equal(cut["fc1"][0], hidden)
    np.testing.assert_array_equal(cut["fc2"][0], srm_layer(second, hidden, full=False))
    whole = evaluate(network, given[None]).spikes["fc1"]
    assert 0.7 < 2 * (whole & cut["fc1"]).sum() / (whole.sum() + cut["fc1"].sum()) <= 1


@pytest.mark.parametrize("order", [None, "arch", "whorl", "loop"])
def test_the_authors_hybrid_walks_its_location_order(order, tmp_path):
    steps = 40
    named = {
        "fc1": weights(6, 156, 0.1),
        "fc2": weights(3, 6),
        "locationFc1": weights(6, steps, 0.3),
        "locationFc2": weights(3, 6),
    }
    more = {} if order is None else {"location_order": order}
    network = lc.load(*write(tmp_path, named, steps=steps, **more))
    assert [p.name for p in network.populations] == ["fc1", "fc2", "locationFc1", "locationFc2"]
    given = spikes(156, steps)
    walk = channel_walk(LOCATION_ORDERS[order or "loop"], 2)
    hidden = srm_layer(named["locationFc1"], given[:, walk].T)
    found = evaluate(network, given[None]).spikes
    np.testing.assert_array_equal(found["locationFc1"][0], hidden)
    np.testing.assert_array_equal(found["locationFc2"][0], srm_layer(named["locationFc2"], hidden))
    np.testing.assert_array_equal(found["fc1"][0], srm_layer(named["fc1"], given))
    assert network.readout.populations == ("fc2", "locationFc2")


def test_loihi_layers_are_integers_and_spike_as_these_mean(tmp_path):
    first, second = RNG.normal(0, 60, (9, 12)), RNG.normal(10, 60, (4, 9))
    network = lc.load(*write(tmp_path, {"fc1": first, "fc2": second}, LOIHI))
    layers = [
        {"type": "dense", "shape": [len(w)], "weight": 2 * np.round(np.float32(w).astype(float) / 2), "neuron": LOIHI}
        for w in (first, second)
    ]
    given = spikes(12, 80)
    wanted = play(layers, given)
    compiled = lc.compile(network, events=given[None], diagnosis=False)
    result = hw.simulate(compiled.program, given)
    for number, name in enumerate(("fc1", "fc2")):
        np.testing.assert_array_equal(network.projections[number].mantissa, layers[number]["weight"])
        np.testing.assert_array_equal(result.spikes[name], wanted[number])
    assert wanted[1].sum() > 10
    assert compiled.match.spikes.agreement == 1


def test_half_goes_to_the_even_step(tmp_path):
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
    wanted = (g * v / (v**2).sum(dim=(1, 2, 3, 4), keepdim=True).sqrt()).reshape(5, 7)
    np.testing.assert_allclose(network.projections[0].weights, wanted, rtol=1e-6)


def test_delays_belong_to_the_spikes_of_the_layer_of_their_size(tmp_path):
    delay = torch.tensor([0.0, 1.2, 2.9, 70.0]).reshape(1, 4, 1, 1, 1)
    network = lc.load(*write(tmp_path, {"fc1": weights(4, 6), "fc2": weights(3, 4)}, extra={"delay.delay": delay}))
    np.testing.assert_array_equal(network.projections[1].delay, np.tile([0, 1, 2, 62], (3, 1)))
    assert np.max(network.projections[0].delay) == 0


def test_weights_of_images_are_read_in_their_order(tmp_path):
    weight = torch.randn(3, 2, 4, 5, 1)
    network = lc.load(*write(tmp_path, {}, extra={"fc1.weight": weight}))
    np.testing.assert_array_equal(network.projections[0].weights, weight.reshape(3, 40).double())


def other_kernel(folder):
    path, config = write(folder, {"fc1": weights(4, 6)})
    values = yaml.safe_load(config.read_text())
    values["neuron"]["tauSr"] = 5.0
    config.write_text(yaml.safe_dump(values))
    return path, config


def yaml_text(text):
    def made(folder):
        path, config = write(folder, {"fc1": weights(4, 6)})
        config.write_text(text)
        return path, config

    return made


REFUSED = [
    ("another kernel", other_kernel, "model 'model.pt', entry 'slayer.srmKernel': the kernel is not that of the config (0.541 apart). Give the YAML that this checkpoint was trained with."),
    ("a gap in the chain", lambda f: write(f, {"fc1": weights(4, 6), "fc2": weights(3, 5)}), "model 'model.pt', layer 'fc2': it does not follow 'fc1' (5 inputs against 4). Save the layers of one chain in their order."),
    ("a convolution", lambda f: write(f, {}, extra={"conv1.weight": torch.randn(3, 2, 4, 5, 2)}), "model 'model.pt', layer 'conv1': it is no dense layer (weight (3, 2, 4, 5, 2)). Use slayer.dense layers; convolutions are read from NIR and .net files."),
    ("no weights", lambda f: write(f, {}), "model 'model.pt': it holds no weights (['slayer.srmKernel', 'slayer.refKernel']). Save net.state_dict() with torch.save."),
    ("a heavy weight", lambda f: write(f, {"fc1": np.full((2, 2), 300.0)}, LOIHI), "model 'model.pt', layer 'fc1': a weight is out of an 8-bit synapse's range (300..300 against -256..254). Clamp the weights in training."),
    ("another neuron", yaml_text("simulation: {Ts: 1}\nneuron: {type: SRMALPHAA}"), "config 'net.yaml', neuron.type: 'SRMALPHAA' is not known. Did you mean 'SRMALPHA'?"),
    ("no neuron", yaml_text("simulation: {Ts: 1}"), "config 'net.yaml': section 'neuron' is missing. Give slayerPytorch's network description."),
    ("a python object", yaml_text("!!python/object/apply:os.system ['true']"), "config 'net.yaml': it is no YAML. Give slayerPytorch's network description."),
    ("text for a number", yaml_text("simulation: {Ts: one}\nneuron: {type: SRMALPHA}"), "config 'net.yaml': Ts must be a number from 1e-06 on ('one'). Correct it."),
]  # fmt: skip


@pytest.mark.parametrize(("made", "message"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED])
def test_what_cannot_be_used_is_said_in_a_line(made, message, tmp_path):
    with pytest.raises(lc.InputError) as caught:
        lc.load(*made(tmp_path))
    assert str(caught.value) == message
