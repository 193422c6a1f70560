"""Networks on a selection of a sensor's channels: some taxels or one polarity, or several channels merged into one.

The selection of the training is stored in checkpoints and programs, so that recordings of the sensor are read with the
same selection wherever the network is used.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.recorded import ChannelSelection, RecordedChannels, recorded_of
from hw_model.targets.programs import load_any_program
from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.selection import recorded_in, selected_layout
from locsnn_compile.data.sensor import SensorLayout, asked_layout

TAXELS = 10
STEPS = 12


def touches(samples: int = 8) -> np.ndarray:
    """Return random recordings (samples, channels, steps) of ten taxels with two polarities."""
    r = np.random.default_rng(5)
    return (r.random((samples, 2 * TAXELS, STEPS)) < 0.15).astype(np.uint8)


def by_taxel(spikes: np.ndarray) -> np.ndarray:
    """Return recordings as (samples, taxels, polarities, steps)."""
    return spikes.reshape(len(spikes), TAXELS, 2, STEPS)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of the touches, with two classes in turn."""
    path = tmp_path_factory.mktemp("data") / "touches.npz"
    np.savez(path, spikes=touches(), labels=np.arange(8) % 2)
    return path


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        pytest.param(
            {"only_taxels": "4-6"},
            lambda spikes: by_taxel(spikes)[:, 3:6].reshape(8, 6, STEPS),
            id="some taxels",
        ),
        pytest.param(
            {"only_taxels": "9,2"},
            lambda spikes: by_taxel(spikes)[:, [8, 1]].reshape(8, 4, STEPS),
            id="taxels in another order",
        ),
        pytest.param(
            {"only_polarity": 1}, lambda spikes: by_taxel(spikes)[:, :, 1], id="falling alone"
        ),
        pytest.param(
            {"only_polarity": 0, "only_taxels": "1-2,10"},
            lambda spikes: by_taxel(spikes)[:, [0, 1, 9], 0],
            id="a polarity of some taxels",
        ),
        pytest.param(
            {"merge_polarities": True, "merge_channels": 5},
            lambda spikes: by_taxel(spikes).reshape(8, 5, 4, STEPS).any(axis=2),
            id="pairs of merged taxels",
        ),
        pytest.param(
            {"merge_channels": 4},
            lambda spikes: np.stack(
                [
                    by_taxel(spikes)[:, :5].any(axis=1),
                    by_taxel(spikes)[:, 5:].any(axis=1),
                ],
                axis=1,
            ).reshape(8, 4, STEPS),
            id="halves with their polarities",
        ),
        pytest.param(
            {"only_polarity": 0, "merge_channels": 3},
            lambda spikes: np.stack(
                [
                    by_taxel(spikes)[:, part, 0].any(axis=1)
                    for part in (range(4), range(4, 7), range(7, 10))
                ],
                axis=1,
            ),
            id="parts that differ by one taxel",
        ),
    ],
)
def test_channels_are_picked_and_merged(data, options, expected):
    sensor = asked_layout(f"{TAXELS}x1", polarities=None, channels=None, layout=None)

    recordings = read_recordings(data, sensor=sensor, **options)

    assert (recordings.spikes == expected(touches()).transpose(0, 2, 1)).all()
    layout = selected_layout(sensor, ChannelSelection(**options))
    assert layout.channels == recordings.spikes.shape[2]
    assert layout.inputs == recordings.channels


def test_merged_taxels_have_their_mean_position_and_picked_ones_keep_their_names():
    corners = ((0.0, 0.0), (2.0, 0.0), (0.0, 4.0), (2.0, 6.0))
    layout = SensorLayout(
        "pad", taxels=4, polarities=2, positions=corners, names=("a", "b", "c", "d")
    )

    halves = selected_layout(layout, ChannelSelection(merge_polarities=True, merge_channels=2))
    two = selected_layout(layout, ChannelSelection(only_taxels="2,4"))

    assert halves.positions == ((1.0, 0.0), (1.0, 5.0))
    assert halves.names is None
    assert halves.polarities == 1
    assert two.positions == (corners[1], corners[3])
    assert two.names == ("b", "d")
    assert two.polarities == 2


def test_all_taxels_in_another_order_take_their_positions_and_names_along():
    corners = ((0.0, 0.0), (2.0, 0.0), (0.0, 4.0))
    layout = SensorLayout("pad", taxels=3, positions=corners, names=("a", "b", "c"))

    reversed_pad = selected_layout(layout, ChannelSelection(only_taxels="3,2,1"))

    assert reversed_pad.positions == corners[::-1]
    assert reversed_pad.names == ("c", "b", "a")


def test_all_pixels_of_a_grid_in_another_order_are_no_grid(tmp_path):
    grid = asked_layout("2x2", polarities=1, channels=None, layout=None)
    spikes = np.array([[[1, 0, 0, 0]]], dtype=np.uint8)
    file = tmp_path / "pixel-0.npz"
    np.savez(file, spikes=spikes.transpose(0, 2, 1))
    selection = {"only_taxels": "4,3,2,1"}

    recordings = read_recordings(file, sensor=grid, **selection)

    assert recordings.spikes.tolist() == [[[0, 0, 0, 1]]]
    assert recordings.channels == Channels(columns=4, rows=1, polarities=1)
    assert selected_layout(grid, ChannelSelection(**selection)).columns is None


SENSOR = {"sensor": SensorLayout("grid 10x1", TAXELS, polarities=2, columns=TAXELS)}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            {"only_taxels": "9-11"} | SENSOR,
            "only_taxels: they are not different taxels of the sensor (got '9-11' of 1..10). Give, for "
            "example, 1-12 or 1,5,9.",
            id="beyond the sensor",
        ),
        pytest.param(
            {"only_taxels": "3,1-4"} | SENSOR,
            "only_taxels: they are not different taxels of the sensor (got '3,1-4' of 1..10). Give, for "
            "example, 1-12 or 1,5,9.",
            id="twice",
        ),
        pytest.param(
            {"only_taxels": "one"} | SENSOR,
            "only_taxels: they are not different taxels of the sensor (got 'one' of 1..10). Give, for "
            "example, 1-12 or 1,5,9.",
            id="no number",
        ),
        pytest.param(
            {"only_polarity": 0, "merge_polarities": True} | SENSOR,
            "only_polarity: with one polarity there is nothing to merge. Leave one of both out.",
            id="a polarity, merged",
        ),
        pytest.param(
            {"only_polarity": 0, "sensor": SensorLayout("channels", taxels=20)},
            "only_polarity: the sensor has one polarity, so none can be picked. Leave it out, or add "
            "--polarities 2.",
            id="of one polarity",
        ),
        pytest.param(
            {"merge_channels": 3} | SENSOR,
            "merge_channels: each place has 2 polarities, so channels are a multiple of that (got 3). Give "
            "another number, or add --merge-polarities.",
            id="half a place",
        ),
        pytest.param(
            {"merge_channels": 22} | SENSOR,
            "merge_channels: there are fewer channels to merge (22 against 20). "
            "Give fewer, or leave it out.",
            id="more than there are",
        ),
        pytest.param(
            {"merge_channels": 4},
            "recordings 'touches.npz': it is not known which channels belong to a taxel, so none can be "
            "picked or merged. Give --grid WxH, --layout FILE, or --channels N, with --polarities.",
            id="of an unknown sensor",
        ),
    ],
)
def test_a_selection_that_a_sensor_does_not_have_is_refused(data, options, message):
    with pytest.raises(lc.InputError) as error:
        read_recordings(data, **options)
    assert str(error.value) == message


ASKED = ["--grid", "10x1", "--merge-polarities", "--merge-channels", "5"]


@pytest.fixture(scope="module")
def trained(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network trained for one epoch on some of the channels."""
    path = tmp_path_factory.mktemp("trained") / "model.pt"
    fast = ["--target", "xylo-imu", "--hidden", "6", "--epochs", "1", "--quiet"]
    assert locsnn(["train", "--data", str(data), *ASKED, *fast, "-o", str(path)]) in (0, 3)
    return path


MERGED = RecordedChannels(
    columns=10,
    rows=1,
    polarities=2,
    selection=ChannelSelection(merge_polarities=True, merge_channels=5),
)
SAID = "Channels were read as in the training (--merge-polarities --merge-channels 5)."


@pytest.mark.slow
def test_a_checkpoint_knows_the_sensor_that_it_was_trained_on(trained):
    network = lc.load(trained)
    assert network.channels == 5
    assert network.recorded == MERGED


def test_a_model_reads_its_sensor_as_its_training_did(trained, data):
    recordings = read_recordings(data, model=lc.load(trained).expected)
    expected = by_taxel(touches()).reshape(8, 5, 4, STEPS).any(axis=2)
    assert (recordings.spikes == expected.transpose(0, 2, 1)).all()
    assert recordings.assumed == (SAID,)


def test_a_program_reads_its_sensor_as_the_training_did(trained, data, tmp_path, capsys):
    built = tmp_path / "built"
    build = ["compile", str(trained), "--target", "xylo-imu", "--events", str(data), "--quiet"]
    assert locsnn([*build, "-o", str(built)]) == 0
    assert load_any_program(built).recorded == MERGED
    results = []
    for options in ([], ASKED):
        assert locsnn(["run", str(built), "--events", str(data), "--json", *options]) == 0
        results.append(json.loads(capsys.readouterr().out))
    as_trained, asked = results
    assert as_trained.pop("assumptions") == [SAID]
    asked.pop("assumptions")
    assert as_trained == asked


def test_recordings_of_merged_channels_are_read_as_they_are(trained, data, tmp_path):
    merged = tmp_path / "merged.npz"
    assert locsnn(["events", str(data), *ASKED, "--to", str(merged)]) == 0

    network = lc.load(trained)

    from_merged = read_recordings(merged, model=network.expected)
    from_sensor = read_recordings(data, model=network.expected)
    assert (from_merged.spikes == from_sensor.spikes).all()
    assert SAID not in from_merged.assumed


def test_fine_tuning_goes_on_with_the_channels(trained, data, tmp_path):
    out = tmp_path / "tuned.pt"
    command = ["train", "--data", str(data), "--from", str(trained), "--target", "xylo-imu"]
    assert locsnn([*command, "--epochs", "1", "--quiet", "-o", str(out)]) in (0, 3)
    assert lc.load(out).recorded == MERGED


def test_a_program_of_a_mesh_keeps_the_selection(data, tmp_path, capsys):
    out = tmp_path / "windows.pt"
    picked = ["--grid", "10x1", "--only-taxels", "3-8", "--only-polarity", "1"]
    fast = ["--model", "tactile-snn", "--hidden", "4", "--epochs", "1", "--quiet"]
    assert locsnn(["train", "--data", str(data), *picked, *fast, "-o", str(out)]) in (0, 3)
    built = tmp_path / "built"
    assert locsnn(["compile", str(out), "--events", str(data), "--quiet", "-o", str(built)]) == 0
    recorded = RecordedChannels(
        columns=10, rows=1, polarities=2, selection=ChannelSelection("3-8", 1)
    )
    assert hw.load_program(built).recorded == recorded
    assert locsnn(["run", str(built), "--events", str(data), "--json"]) == 0
    assumptions = json.loads(capsys.readouterr().out)["assumptions"]
    assert assumptions == [
        "Channels were read as in the training (--only-taxels 3-8 --only-polarity 1)."
    ]


def test_a_selection_of_recordings_in_memory_is_refused():
    with pytest.raises(lc.InputError) as error:
        lc.train(
            np.ones((4, 10, 20), np.uint8),
            {"grid": "10x1", "merge_channels": 10, "epochs": 1},
            labels=[0, 1, 0, 1],
        )
    assert str(error.value) == (
        "training option 'merge_channels': recordings 'array' are in memory, as they are (got 10). Leave "
        "it out, or give a file."
    )


ENTRIES = {
    "recorded_columns": 10,
    "recorded_rows": 1,
    "recorded_polarities": 2,
    "merge_polarities": True,
    "only_taxels": None,
    "only_polarity": None,
    "merge_channels": 5,
}


@pytest.mark.parametrize(
    "entries",
    [
        pytest.param({"recorded_rows": None}, id="a size that is missing"),
        pytest.param({"recorded_columns": 0}, id="no columns"),
        pytest.param({"recorded_polarities": "2"}, id="a size that is a text"),
        pytest.param({"merge_channels": 6}, id="another number of channels"),
        pytest.param({"merge_channels": 11}, id="more channels than the sensor has"),
        pytest.param({"only_taxels": "1-99999"}, id="taxels that the sensor has not"),
        pytest.param({"only_polarity": 0}, id="a polarity, merged"),
    ],
)
def test_a_selection_that_contradicts_its_network_is_ignored(entries):
    """Such entries of a checkpoint are damaged, and the network is used without them."""
    assert recorded_in(ENTRIES, 5) == MERGED
    assert recorded_in(ENTRIES | entries, 5) is None


def test_a_program_of_an_impossible_sensor_is_refused():
    document = MERGED.document()
    assert recorded_of("program.yaml", document) == MERGED
    with pytest.raises(lc.InputError) as error:
        recorded_of("program.yaml", document | {"polarities": 3})
    assert str(error.value) == (
        "program.yaml: recorded.polarities: it must be a whole number from 1 to 2 (got 3). Compile again."
    )


def test_a_polarity_of_0_is_kept_in_files():
    rising = RecordedChannels(
        columns=4, rows=4, polarities=2, selection=ChannelSelection(only_polarity=0)
    )
    assert rising.document() == {
        "columns": 4,
        "rows": 4,
        "polarities": 2,
        "selection": {"only_polarity": 0},
    }
    assert recorded_of("program.yaml", rising.document()) == rising
