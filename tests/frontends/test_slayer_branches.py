"""slayerPytorch checkpoints with layers that do not run, or that run over the outputs of both branches.

The expected class scores are those of SLAYER's own kernels in numpy (``tests/support/slayer_files.py``).
"""

import numpy as np
import pytest
import torch

import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.slayer_files import normal_weights, sparse_spikes, srm_layer, write

STEPS = 60
LOCATIONS = 78
"""The channels of one fingertip: 39 taxels of two polarities."""
HIDDEN = 8
CLASSES = 4
LAYERS = {
    "fc1": normal_weights(HIDDEN, LOCATIONS, 0.1),
    "fc2": normal_weights(CLASSES, HIDDEN),
    "locationFc1": normal_weights(HIDDEN, STEPS, 0.1),
    "locationFc2": normal_weights(CLASSES, HIDDEN),
}
FUSED = LAYERS | {"outputFc": normal_weights(CLASSES, CLASSES, 3.0)}
TAILS = "The reference has the tails of its kernels, which slayerPytorch cuts in training (--kernels full)."
TS_UNIT = (
    "The Ts of the YAML, 1, was read as milliseconds, which SLAYER does not say (--step-seconds)."
)
LOOP = "The description has no location_order: taxels are visited in the order loop."


def training(steps):
    """Return the part of a YAML that says over how many steps training counts the spikes of an output."""
    return {"error": {"type": "NumSpikes", "tgtSpikeRegion": {"start": 0, "stop": steps}}}


def class_scores(network, events):
    """Return the spike counts of the classes, (classes,), of the float network."""
    trains = evaluate(network, events[None]).spikes
    return sum(trains[name][0].sum(axis=0) for name in network.readout.populations)


def of_time(events):
    """Return the output spikes of the time branch, by SLAYER's own kernels."""
    return srm_layer(LAYERS["fc2"], srm_layer(LAYERS["fc1"], events))


def of_locations(events):
    """Return the output spikes of the location branch, by SLAYER's own kernels: its inputs are time steps."""
    return srm_layer(LAYERS["locationFc2"], srm_layer(LAYERS["locationFc1"], events.T))


EVENTS = sparse_spikes(LOCATIONS, STEPS)


def test_a_location_network_that_keeps_unused_time_layers_counts_locations_alone(tmp_path):
    network = lc.load(*write(tmp_path, LAYERS, steps=STEPS, training=training(LOCATIONS)))
    expected = of_locations(EVENTS).sum(axis=0)
    assert expected.tolist() != (expected + of_time(EVENTS).sum(axis=0)).tolist()
    np.testing.assert_array_equal(class_scores(network, EVENTS), expected)
    assert network.channels == LOCATIONS
    assert network.assumptions == (
        TAILS,
        "The YAML counts the spikes of 78 steps, which are the locations: the location branch runs alone, of the layers "
        "location=locationFc1,locationFc2, and fc1, fc2 are not used (--branches).",
        LOOP,
        TS_UNIT,
    )


def test_an_assumption_lists_every_layer_that_was_taken(tmp_path):
    network = lc.load(*write(tmp_path, LAYERS, steps=STEPS, training=training(STEPS + LOCATIONS)))
    np.testing.assert_array_equal(
        class_scores(network, EVENTS),
        of_time(EVENTS).sum(axis=0) + of_locations(EVENTS).sum(axis=0),
    )
    assert network.assumptions == (
        TAILS,
        "The checkpoint does not say which layers run, nor over what: all were taken by their names and order, "
        "time=fc1,fc2, location=locationFc1,locationFc2 (--branches).",
        LOOP,
        TS_UNIT,
    )


@pytest.mark.parametrize(
    "branches",
    [
        pytest.param("location=locationFc1,locationFc2", id="the option"),
        pytest.param({"location": ["locationFc1", "locationFc2"]}, id="a mapping"),
    ],
)
def test_branches_name_the_layers_that_run(branches, tmp_path):
    files = write(tmp_path, FUSED, steps=STEPS)
    network = lc.load(*files, branches=branches)
    np.testing.assert_array_equal(class_scores(network, EVENTS), of_locations(EVENTS).sum(axis=0))
    assert network.assumptions == (
        TAILS,
        "These layers of the checkpoint are not used, as no branch names them: fc1, fc2, outputFc.",
        "There are 78 channels, the inputs of fc1, which is not used.",
        LOOP,
        TS_UNIT,
    )


def test_the_option_takes_precedence_over_the_branches_of_the_description(tmp_path):
    files = write(tmp_path, LAYERS, steps=STEPS, branches={"time": ["fc1", "fc2"]})
    np.testing.assert_array_equal(
        class_scores(lc.load(*files), EVENTS), of_time(EVENTS).sum(axis=0)
    )
    by_option = lc.load(*files, branches="location=locationFc1,locationFc2")
    np.testing.assert_array_equal(class_scores(by_option, EVENTS), of_locations(EVENTS).sum(axis=0))


def test_a_branch_may_have_layers_of_any_name(tmp_path):
    renamed = dict(zip(("a", "b", "c", "d"), LAYERS.values(), strict=True))
    files = write(tmp_path, renamed, steps=STEPS)
    network = lc.load(*files, branches="time=a,b,location=c,d")
    assert {p.name: p.axis for p in network.populations} == {
        "a": "time",
        "b": "time",
        "c": "location",
        "d": "location",
    }
    np.testing.assert_array_equal(
        class_scores(network, EVENTS),
        of_time(EVENTS).sum(axis=0) + of_locations(EVENTS).sum(axis=0),
    )


def test_delays_of_a_layer_that_does_not_run_stay_with_it(tmp_path):
    delay = {"delay.delay": torch.full((1, HIDDEN, 1, 1, 1), 3.0)}
    files = write(tmp_path, LAYERS, steps=STEPS, extra=delay)
    network = lc.load(*files, branches="location=locationFc1,locationFc2")
    assert [np.max(projection.delay) for projection in network.projections] == [0, 0]


def test_a_layer_after_both_branches_is_not_part_of_the_time_branch(tmp_path):
    """The two readings give other class scores, so guessing would be wrong for one of them."""
    joined = srm_layer(FUSED["outputFc"], np.concatenate([of_time(EVENTS), of_locations(EVENTS)]))
    appended = srm_layer(FUSED["outputFc"], of_time(EVENTS)).sum(axis=0) + of_locations(EVENTS).sum(
        axis=0
    )
    assert joined.sum(axis=0).tolist() != appended.tolist()
    files = write(tmp_path, FUSED, steps=STEPS)
    with pytest.raises(lc.InputError) as caught:
        lc.load(*files)
    assert str(caught.value) == (
        "model 'model.pt', layer 'outputFc': it may run over the outputs of both branches, one after the other, which no "
        "phase of a program does. If it does not run, give --branches time=fc1,fc2,location=locationFc1,locationFc2; if it "
        "is the time branch's, name it there."
    )
    deeper = lc.load(*files, branches="time=fc1,fc2,outputFc,location=locationFc1,locationFc2")
    np.testing.assert_array_equal(class_scores(deeper, EVENTS), appended)


def test_a_time_branch_as_wide_as_its_classes_is_no_layer_after_both(tmp_path):
    square = LAYERS | {
        "fc1": normal_weights(CLASSES, LOCATIONS, 0.1),
        "fc2": normal_weights(CLASSES, CLASSES),
    }
    order = ("locationFc1", "locationFc2", "fc1", "fc2")
    files = write(tmp_path, {name: square[name] for name in order}, steps=STEPS)
    assert lc.load(*files).readout.populations == ("fc2", "locationFc2")


BOTH = "time=fc1,fc2,location=locationFc1,locationFc2"
FORM = "Give them as time=fc1,fc2,location=locationFc1,locationFc2."


@pytest.mark.parametrize(
    ("branches", "message"),
    [
        pytest.param(
            f"{BOTH},joined=outputFc",
            "model 'model.pt', layer 'outputFc': it runs over the outputs of both branches, one after the other, which no "
            "phase of a program does. Train the network without it.",
            id="a layer after both",
        ),
        pytest.param(
            "time=fc1,fc3",
            "model 'model.pt', layer 'fc3': it is not in the checkpoint. Did you mean 'fc2'?",
            id="an unknown layer",
        ),
        pytest.param(
            "time=fc1,fc1",
            "model 'model.pt', layer 'fc1': it is named twice. Name it in one branch.",
            id="a layer twice",
        ),
        pytest.param(
            "time=fc1,time=fc2",
            "branches 'time=fc1,time=fc2': branch 'time' is given twice. Give it once.",
            id="a branch twice",
        ),
        pytest.param(
            "fc1,fc2",
            f"branches 'fc1,fc2': they are not layers of branches. {FORM}",
            id="no branch",
        ),
        pytest.param(
            "space=fc1",
            "branches 'space=fc1': branch 'space' is not known. Choose one of: joined, location, "
            "time.",
            id="an unknown branch",
        ),
        pytest.param(
            "joined=outputFc",
            f"branches 'joined=outputFc': no branch runs along time or location. {FORM}",
            id="no branch of its own",
        ),
        pytest.param(
            {"time": []},
            f"branches: branch 'time' has no list of layers. {FORM}",
            id="no layers",
        ),
    ],
)
def test_branches_that_do_not_fit_the_checkpoint_are_refused(branches, message, tmp_path):
    files = write(tmp_path, FUSED, steps=STEPS)
    with pytest.raises(lc.InputError) as caught:
        lc.load(*files, branches=branches)
    assert str(caught.value) == message


def test_branches_of_the_description_that_are_not_lists_are_refused(tmp_path):
    files = write(tmp_path, LAYERS, steps=STEPS, branches=["fc1"])
    with pytest.raises(lc.InputError) as caught:
        lc.load(*files)
    assert str(caught.value) == (
        "config 'net.yaml', branches: they are not lists of layers. Give {time: [fc1, fc2], location: [locationFc1, "
        "locationFc2]}."
    )
