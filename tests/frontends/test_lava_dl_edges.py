"""Numbers of a lava-dl file at the ends of their range: the last one that is read, and the first that is not.

Also what may be left out of a file, and layers of images whose shapes, kernels and delays a file may give in several ways.
"""

import numpy as np
import pytest
from scipy import sparse

import locsnn_compile as lc
from tests.support.net_files import neuron, write_net


def layer(weight, **settings):
    """Return one dense layer with these weights, as entries of a file; settings are those of its neurons."""
    weight = np.array(weight, dtype=np.float32)
    outs, ins = weight.shape
    parts = {"inFeatures": ins, "outFeatures": outs, "weight": weight, "neuron": neuron(**settings)}
    return {"type": "dense", "shape": np.array([outs]), **parts}


def loaded(folder, layer_entries, simulation=None):
    """Load a ``.net`` file of one layer."""
    write_net(folder / "model.net", [layer_entries], simulation)
    return lc.load(folder / "model.net")


# The threshold in the file, the threshold of the network, and the step from which potentials are read.
THRESHOLDS = [(2**17 - 2, 2**17 - 2, None), (2**18 - 2, 2**17 - 1, None), (2**18 - 1, 2**17 - 1, 1)]


@pytest.mark.parametrize(
    ("threshold_of_file", "threshold", "read_from"),
    THRESHOLDS,
    ids=["fits", "cut off", "never spikes"],
)
def test_thresholds_at_the_end_of_the_register(threshold_of_file, threshold, read_from, tmp_path):
    network = loaded(tmp_path, layer([[2]], threshold=threshold_of_file))
    assert network.populations[0].neuron.threshold.tolist() == [threshold]
    assert network.readout.potentials_from == read_from


@pytest.mark.parametrize(
    ("samples", "steps"), [(0.5, 100), (1, 1), (10_000, 10_000), (10_001, 100)]
)
def test_steps_of_a_recording(samples, steps, tmp_path):
    assert loaded(tmp_path, layer([[2]]), {"Ts": 1.0, "tSample": samples}).steps == steps


def test_a_refractory_delay_of_0_blocks_no_step(tmp_path):
    assert loaded(tmp_path, layer([[2]], refDelay=0)).populations[0].neuron.refractory.tolist() == [
        1
    ]


@pytest.mark.parametrize(
    "weights", [[-256, 254], [-255, 255], [1, 254]], ids=["even", "odd", "one odd"]
)
def test_weights_at_the_ends_of_their_range(weights, tmp_path):
    (projection,) = loaded(tmp_path, layer([weights])).projections
    assert projection.signs == ("mixed" if weights[0] % 2 == 0 else "apart")
    assert projection.mantissa.tolist() == [weights]


def test_the_lowest_weight_next_to_an_odd_one(tmp_path):
    with pytest.raises(lc.InputError) as caught:
        loaded(tmp_path, layer([[-256, 1]]))
    assert str(caught.value) == (
        "model 'model.net', layer 0: a weight does not fit an 8-bit synapse "
        "(-256..1 against -256..254, even, or -255..255). Export it again, with quantised weights."
    )


@pytest.mark.parametrize(
    ("settings", "simulation", "message"),
    [
        (
            {"kind": 7},
            {},
            "model 'model.net', layer 0: 'neuron/type' is not text (int64). Export it again.",
        ),
        (
            {},
            {"tSample": "fifty"},
            "model 'model.net', simulation: 'tSample' must be one number above 0 ('fifty'). "
            "Export it again.",
        ),
        (
            {},
            {"tSample": [5, 6]},
            "model 'model.net', simulation: 'tSample' must be one number above 0 ([5 6]). Export "
            "it again.",
        ),
        (
            {},
            {"Ts": -1.0},
            "model 'model.net', simulation: 'Ts' must be one number above 0 ([-1.]). Export it "
            "again.",
        ),
    ],
    ids=[
        "a type that is a number",
        "steps that are text",
        "two numbers of steps",
        "a step before it began",
    ],
)
def test_an_entry_of_another_type_is_refused(settings, simulation, message, tmp_path):
    """A type that is a number must not be read as CUBA, nor steps that are text as the default number of steps."""
    with pytest.raises(lc.InputError) as caught:
        loaded(tmp_path, layer([[2]], **settings), simulation)
    assert str(caught.value) == message


def image_layers(kind, **changes):
    """Return an input of two channels of 4 x 4 pixels, and a layer of 2 x 2 windows; ``changes`` are in the layer."""
    entries = {
        "type": kind,
        "shape": np.array([2, 2, 2]),
        "stride": [2, 2],
        "kernelSize": [2, 2],
        "weight": np.full((2, 2, 2, 2) if kind == "conv" else (1, 1, 2, 2), 20.0),
        "neuron": neuron(),
    }
    if kind == "conv":
        entries |= {"inChannels": 2, "outChannels": 2}
    entries |= changes
    present = {key: value for key, value in entries.items() if value is not None}
    return [{"type": "input", "shape": np.array([2, 4, 4])}, present]


def loaded_layers(folder, layers):
    """Load a ``.net`` file of some layers."""
    write_net(folder / "model.net", layers)
    return lc.load(folder / "model.net")


def refused(folder, layers) -> str:
    """Return the message with which a ``.net`` file of some layers is refused."""
    with pytest.raises(lc.InputError) as caught:
        loaded_layers(folder, layers)
    return str(caught.value)


def weights_of(network):
    """Return the weights of the only projection as a dense array."""
    (projection,) = network.projections
    return sparse.csr_array(projection.mantissa).toarray()


@pytest.mark.parametrize(
    ("changes", "channels_read"),
    [
        pytest.param({"weight": np.full((2, 2, 2, 2, 1), 20.0)}, 2, id="a fifth axis"),
        pytest.param(
            {"weight": np.full((2, 2), 20.0), "shape": np.array([1, 2, 2]), "outChannels": None, "inChannels": 2, "groups": 1, "kernelSize": [1, 2], "stride": [2, 2]},
            2,
            id="without the axis of one output",
        ),
        pytest.param(
            {"weight": np.full((2, 2, 2), 20.0), "groups": 2}, 1, id="without the axis of a group"
        ),
    ],
)  # fmt: skip
def test_kernels_get_back_their_axes_of_length_one(changes, channels_read, tmp_path):
    """Each output reads two rows or columns of each channel that it sees."""
    layers = image_layers("conv", **changes)
    weights = weights_of(loaded_layers(tmp_path, layers))
    pixels = np.prod(layers[1]["kernelSize"])
    assert set(weights.ravel()) == {0, 20}
    assert ((weights != 0).sum(axis=1) == channels_read * pixels).all()


def test_a_kernel_of_another_size_is_refused(tmp_path):
    message = refused(tmp_path, image_layers("conv", weight=np.full((2, 2, 3), 20.0)))
    assert message == (
        "model 'model.net', layer 1: it is not a layer of images (weight (2, 2, 3)). Export it again."
    )


@pytest.mark.parametrize(
    ("columns", "out"), [(3, 1), (3, 2), (4, 2)], ids=["rounded down", "rounded up", "whole"]
)
def test_pooling_is_filled_up_only_where_the_output_needs_it(columns, out, tmp_path):
    """slayerPytorch fills up the last window, other tools leave the last column out."""
    layers = image_layers("pool", shape=np.array([2, 2, out]))
    layers[0]["shape"] = np.array([2, 4, columns])
    weights = weights_of(loaded_layers(tmp_path, layers))
    assert weights.shape == (2 * 2 * out, 2 * 4 * columns)
    read_columns = (weights != 0).any(axis=0).reshape(2, 4, columns).all(axis=(0, 1))
    assert read_columns.tolist() == [column < 2 * out for column in range(columns)]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stride": [0, 2]}, "stride or dilation is below 1 ((0, 2), (1, 1)). Correct it."),
        ({"shape": np.array([8])}, "its shape and its output differ ((8,) against (2, 2, 1)). Export again."),
    ],
    ids=["stride", "shape"],
)  # fmt: skip
def test_pooling_that_does_not_fit_is_refused(changes, message, tmp_path):
    layers = image_layers("pool", **changes)
    layers[0]["shape"] = np.array([2, 4, 3])
    assert refused(tmp_path, layers) == f"model 'model.net', layer 1: {message}"


@pytest.mark.parametrize(
    ("delays", "expected"),
    [
        pytest.param([3, 1], [3, 3, 3, 3, 1, 1, 1, 1], id="of a channel"),
        pytest.param([*range(8)], [*range(8)], id="of a neuron"),
    ],
)
def test_a_convolution_has_delays_by_channel_or_by_neuron(delays, expected, tmp_path):
    network = loaded_layers(tmp_path, image_layers("conv", delay=np.array(delays, dtype=float)))
    (projection,) = network.projections
    mantissa = sparse.csr_array(projection.mantissa)
    rows = np.repeat(np.arange(8), np.diff(mantissa.indptr))
    assert np.asarray(projection.delay).ravel().tolist() == [expected[row] for row in rows]


@pytest.mark.parametrize(
    ("delay", "sentences"),
    [
        (62.0, ()),
        (62.5, ("Of layer 0, 1 of 1 delay lose a fraction of a step, as in netx.",)),
        (63.0, ("Of layer 0, 1 of 1 delay, up to 63 steps, are cut to 62 steps, as in netx (--relay-delays keeps them).",)),
    ],
    ids=["the longest", "with a fraction", "longer"],
)  # fmt: skip
def test_delays_that_are_cut_are_listed_as_assumptions(delay, sentences, tmp_path):
    """A layer without biases has no sentence about delays that hold them back."""
    network = loaded(tmp_path, {**layer([[2]]), "delay": delay})
    assert tuple(sentence for sentence in network.assumptions if "delay" in sentence) == sentences
    assert network.projections[0].delay == 62


def test_neurons_of_a_file_without_their_type_are_cuba(tmp_path):
    entries = layer([[2]])
    del entries["neuron"]["type"]
    neurons = loaded(tmp_path, entries).populations[0].neuron
    assert (neurons.decay_u.tolist(), neurons.decay_v.tolist()) == ([1024], [128])
    assert (neurons.bias_mantissa.tolist(), neurons.bias_exponent.tolist()) == ([0], [0])


@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (4,)])
def test_recurrent_weights_of_another_shape_are_refused(shape, tmp_path):
    entries = {**layer([[2], [4]]), "type": "dense_rec", "weight_rec": np.full(shape, 2.0)}
    with pytest.raises(lc.InputError) as caught:
        loaded(tmp_path, entries)
    assert str(caught.value) == (
        f"model 'model.net', layer 0: weight_rec has the wrong size ({shape} for 2). Export it again."
    )


def test_a_long_text_in_place_of_a_number_is_cut_after_40_characters(tmp_path):
    with pytest.raises(lc.InputError) as caught:
        loaded(tmp_path, layer([[2]]), {"tSample": "x" * 41})
    assert str(caught.value) == (
        f"model 'model.net', simulation: 'tSample' must be one number above 0 ('{'x' * 40}'). Export it again."
    )


def test_a_file_without_recordings_gets_eight_made_up_ones(tmp_path):
    recordings = loaded(tmp_path, layer([[2]])).recordings
    assert (recordings.spikes.shape, recordings.origin) == ((8, 100, 1), "made up")


def test_only_the_first_layer_on_the_host_takes_numbers(tmp_path):
    """Its weights are charges in float, 64 counts per unit; the second layer takes spikes, and is in integers."""
    layers = [layer([[2, 4]]), layer([[6]]), layer([[8]])]
    write_net(tmp_path / "model.net", layers)
    network = lc.load(tmp_path / "model.net", host_layers=2)
    host = network.host.network
    assert [type(p.neuron).__name__ for p in host.populations] == ["HostCuba", "ChipCuba"]
    first, second = host.projections
    assert np.asarray(first.weights).tolist() == [[2 * 64.0, 4 * 64.0]]
    assert np.asarray(second.mantissa).tolist() == [[6]]
    assert [p.name for p in network.populations] == ["layer2"]
