"""Operations per recording: of conventional networks, to the last digit as published, and of spiking networks.

The published networks classify recordings of 325 steps (36 objects or 20 containers) and of 150 steps (slip or none).
"""

import pytest

from locsnn_compile.baselines.operations import ann_operations, network_additions
from locsnn_compile.errors import InputError
from locsnn_compile.reference.evaluate import evaluate
from tests.support.networks import hybrid, recordings


@pytest.mark.parametrize(
    ("name", "steps", "classes", "operations"),
    [
        ("cnn-3d", 325, 36, 8_340_480),
        ("cnn-3d", 325, 20, 8_140_800),
        ("cnn-3d", 150, 2, 3_501_120),
        ("gru-mlp", 325, 36, 11_868_704),
        ("gru-mlp", 325, 20, 11_867_680),
        ("gru-mlp", 150, 2, 5_476_928),
    ],
    ids=["cnn objects", "cnn containers", "cnn slip", "gru objects", "gru containers", "gru slip"],
)
def test_operations_are_those_published(name, steps, classes, operations):
    assert ann_operations(name, fingertips=2, steps=steps, classes=classes) == operations


@pytest.mark.parametrize(
    ("name", "steps", "message"),
    [
        ("cnn3d", 325, "network 'cnn3d': its operations are not known. Did you mean 'cnn-3d'?"),
        (
            "cnn-3d",
            22,
            "network 'cnn-3d': the recording is too short for its two convolutions (22 steps against at least 23). "
            "Use longer recordings.",
        ),
    ],
)
def test_networks_that_cannot_be_counted_are_refused(name, steps, message):
    with pytest.raises(InputError) as caught:
        ann_operations(name, fingertips=1, steps=steps, classes=2)
    assert str(caught.value) == message


def test_the_shortest_recording_of_cnn_3d_is_counted():
    assert ann_operations("cnn-3d", fingertips=1, steps=23, classes=2) > 0


def test_additions_are_spikes_times_fan_out():
    hidden = 3
    classes = 2
    network = hybrid(hidden=hidden, classes=classes)
    spikes = evaluate(network, recordings(network)).spikes
    count = {name: int(array.sum()) for name, array in spikes.items()}
    assert network_additions(network, spikes) == {
        "time": hidden * count["touch"] + classes * count["time_hidden"],
        "location": hidden * count["touch_transposed"] + classes * count["location_hidden"],
    }
    assert count["touch"] == count["touch_transposed"]
