"""Networks of lava-dl files spike as their integers say: in the reference, and on the chip in both engines.

The expected spikes are those of ``tests/support/net_files.py: play``, a forward pass in plain integers.
"""

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.net_files import CONV, IMAGE, NETS, RNG, dense, even, neuron, play, write_net

FEWEST_SPIKES = 5
"""The number of spikes that every layer has to exceed. Chosen by hand."""


def spikes(lines, steps=90, rate=0.3):
    """Return random events, (steps, lines)."""
    return (np.random.default_rng(2).random((steps, lines)) < rate).astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("name", NETS)
def test_the_chip_spikes_as_the_files_integers_say(name, tmp_path):
    layers = NETS[name]
    write_net(tmp_path / "model.net", layers)
    network = lc.load(tmp_path / "model.net")
    events = spikes(network.channels)
    expected = play(layers, events)
    compiled = lc.compile(network, events=events[None], diagnosis=False)
    assert compiled.match.spikes.agreement == 1
    assert [p.name for p in network.populations] == [f"layer{i}" for i in expected]
    for engine in ("fast", "reference"):
        result = hw.simulate(compiled.program, events, engine=engine)
        for number, rows in expected.items():
            # A layer that hardly spikes would be compared in nothing but zeros.
            assert rows.sum() > FEWEST_SPIKES
            np.testing.assert_array_equal(result.spikes[f"layer{number}"], rows)
    np.testing.assert_array_equal(
        evaluate(network, events[None]).spikes[f"layer{max(expected)}"][0], expected[max(expected)]
    )


def test_a_conv_of_stride_1_needs_no_input_layer(tmp_path):
    # With stride 1, the size of the output image determines that of the input image; with a stride of 2, as in
    # CONV, two sizes of input images give the same output.
    layer = CONV | {"stride": np.array([1, 1]), "shape": np.array([4, 6, 6])}
    for name, layers in (("with", [IMAGE, layer]), ("without", [layer])):
        write_net(tmp_path / f"{name}.net", layers)
    matrices = [
        lc.load(tmp_path / f"{name}.net").projections[0].mantissa.toarray()
        for name in ("with", "without")
    ]
    np.testing.assert_array_equal(*matrices)


def test_integers_are_kept_as_they_are(tmp_path):
    neuron_entries = neuron(i_decay=RNG.integers(0, 4097, 12), v_decay=77, threshold=4321)
    layer = dense(RNG, outs=12, ins=10, bias=np.arange(12.0), neuron=neuron_entries)
    write_net(tmp_path / "model.net", [layer], {"Ts": 1.0, "tSample": 50})
    network = lc.load(tmp_path / "model.net")
    projection, neurons = network.projections[0], network.populations[0].neuron
    np.testing.assert_array_equal(projection.mantissa, layer["weight"])
    np.testing.assert_array_equal(neurons.decay_u, layer["neuron"]["iDecay"])
    # A file has biases in units of 64 of the registers, as it has weights and thresholds.
    np.testing.assert_array_equal(
        neurons.bias_mantissa * 2**neurons.bias_exponent, 64 * np.arange(12)
    )
    assert (projection.exponent, projection.weight_bits, projection.signs) == (0, 8, "mixed")
    assert (set(neurons.decay_v.tolist()), set(neurons.threshold.tolist())) == ({77}, {4321})
    assert (network.steps, network.usual_step_seconds) == (50, 0.001)


POOL = {
    "type": "pool",
    "shape": np.array([2, 3, 3]),
    "kernelSize": np.array([2, 2]),
    "stride": np.array([2, 2]),
    "weight": np.full((1, 1, 2, 2), 88.0),
    "neuron": neuron(),
}
# The axes of its weights: output channels, input channels, rows, columns, delays.
CONV_OF_ONE_CHANNEL = {**CONV, "inChannels": 1, "groups": 1, "weight": even(RNG, 4, 1, 3, 3, 1)}
# Layers, and the shape of the last one's weights without its axes of length one.
SQUEEZED = {
    "conv of one channel": (
        [{"type": "input", "shape": np.array([1, 6, 6])}, CONV_OF_ONE_CHANNEL],
        (4, 3, 3),
    ),
    "pool": ([IMAGE, POOL], (2, 2)),
    "dense of one neuron": ([dense(RNG, outs=1, ins=10)], (10,)),
}


@pytest.mark.parametrize("name", SQUEEZED)
def test_weights_without_their_axes_of_length_one_read_as_those_with_them(name, tmp_path):
    layers, shape = SQUEEZED[name]
    matrices = []
    for weight in (layers[-1]["weight"], layers[-1]["weight"].reshape(shape)):
        write_net(tmp_path / "model.net", [*layers[:-1], layers[-1] | {"weight": weight}])
        projection = lc.load(tmp_path / "model.net").projections[0].mantissa
        matrices.append(projection if isinstance(projection, np.ndarray) else projection.toarray())
    np.testing.assert_array_equal(*matrices)


def test_pooling_pads_an_image_that_is_not_a_whole_number_of_windows(tmp_path):
    ragged = {"type": "input", "shape": np.array([2, 5, 6])}
    write_net(tmp_path / "model.net", [ragged, POOL])
    projection = (
        lc.load(tmp_path / "model.net").projections[0].mantissa.toarray().reshape(2, 3, 3, 2, 5, 6)
    )
    for channel, row, column in np.ndindex(2, 3, 3):
        expected = np.zeros((2, 5, 6))
        expected[channel, 2 * row : 2 * row + 2, 2 * column : 2 * column + 2] = 88
        np.testing.assert_array_equal(projection[channel, row, column], expected)


REFUSED = [
    pytest.param(
        [dense(RNG, outs=3, ins=4, neuron=neuron(gradedSpike=True))],
        ", layer 0: its spikes are graded. Train with graded_spike=False.",
        id="a graded spike",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4, neuron=neuron(kind="SDNN"))],
        ", layer 0: 'SDNN' neurons do not fit into one compartment of the chip. Use CUBA neurons.",
        id="a neuron of another kind",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4, weight=np.full((3, 4), 300.0))],
        ", layer 0: a weight does not fit an 8-bit synapse (0..300 against -256..254, even, "
        "or -255..255). Export it again, with quantised weights.",
        id="a weight out of range",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4, weight=np.full((3, 4), 0.5))],
        ", layer 0: 'weight' is not made of integers (0.5). Export it again.",
        id="a fraction for a weight",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4, weight=even(RNG, 4, 3))],
        ", layer 0: its weight has the wrong shape ((4, 3) for 3 neurons and an input of "
        "None). Export it again.",
        id="weights the other way around",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4) | {"type": "dense_rec", "weight_rec": even(RNG, 9)}],
        ", layer 0: weight_rec has the wrong size ((9,) for 3). Export it again.",
        id="recurrent weights in a row",
    ),
    pytest.param(
        [{"type": "input", "shape": np.array([5])}, dense(RNG, outs=3, ins=4)],
        ", layer 1: its weight has the wrong shape ((3, 4) for 3 neurons and an input of "
        "(5,)). Export it again.",
        id="another input size",
    ),
    pytest.param(
        [{"type": "convT", "shape": np.array([3])}],
        ", layer 0: 'convT' is a type of layer that the chip cannot run. Replace it with a "
        "convolution.",
        id="convT",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4), {"type": "average", "shape": np.array([3])}],
        ", layer 1: 'average' is a type of layer that the chip cannot run. Count the spikes "
        "of the layer before it.",
        id="average",
    ),
    pytest.param(
        [{"type": "wide", "shape": np.array([3])}],
        ", layer 0: 'wide' is not a known type of layer. Use dense and conv layers.",
        id="a layer of no kind",
    ),
    pytest.param(
        [dense(RNG, outs=3, ins=4, neuron=neuron(i_decay=5000))],
        ", layer 0: iDecay is not a decay (5000..5000 against 0..4096). Correct it.",
        id="a decay out of range",
    ),
    pytest.param(
        [CONV],
        ", layer 0: the shape of its input is not known. Export the input layer as well.",
        id="a conv of stride 2 on its own",
    ),
    pytest.param(
        [CONV | {"stride": np.array([1, 1]), "padding": np.array([9, 9])}],
        ", layer 0: its padding is wider than its input ((9, 9)). Export it again.",
        id="a conv that is all padding",
    ),
    pytest.param(
        [{"type": "input", "shape": np.array([2**40])}],
        ", layer 0: its size is out of range ((1099511627776,) against 1 to 1000000). Correct.",
        id="absurd sizes",
    ),
]


@pytest.mark.parametrize(("layers", "message"), REFUSED)
def test_a_layer_that_the_chip_cannot_run_is_refused_by_its_number(layers, message, tmp_path):
    write_net(tmp_path / "model.net", layers)
    with pytest.raises(lc.InputError) as caught:
        lc.load(tmp_path / "model.net")
    assert str(caught.value) == "model 'model.net'" + message
