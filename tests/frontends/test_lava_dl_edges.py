"""Numbers of a lava-dl file at the ends of their range: the last one that is read, and the first that is not."""

import numpy as np
import pytest

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
