"""The option ``tie``: the class that a network, its checkpoint and its program predict if all scores are equal.

In the recordings here, silence is a class of its own. A network without spikes has equal scores of 0, a tie, which
predicts no class unless the option names one.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.graph import decided
from locsnn_compile.cli.main import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.network.committee import committee

STEPS, CHANNELS = 20, 6
NAMES = ("left", "right", "nothing")
LABELS = np.tile([0, 1, 2], 8)


def recordings() -> Recordings:
    """Return recordings with events on the first channels (class 0), on the last channels (1), or without events (2)."""
    rng = np.random.default_rng(3)
    spikes = np.zeros((len(LABELS), STEPS, CHANNELS), dtype=np.uint8)
    for row, label in enumerate(LABELS):
        if label < 2:
            spikes[row, :, 3 * label : 3 * label + 3] = rng.random((STEPS, 3)) < 0.5
    return Recordings(spikes, LABELS, step_seconds=None, source="three classes", class_names=NAMES)


OPTIONS = {
    "model": "tactile-snn",
    "channels": CHANNELS,
    "hidden": 8,
    "epochs": 60,
    "batch_size": 4,
    "learning_rate": 0.03,
    "event_dropout": 0.0,
    "channel_dropout": 0.0,
    "initial_scale": 10.0,
}


def trained(**further_options: object) -> lc.Checkpoint:
    """Return a network trained, and measured, on these recordings."""
    options = OPTIONS | further_options
    return lc.train(recordings(), options, test=recordings(), carried=len(LABELS))


@pytest.fixture(scope="module")
def with_ties() -> lc.Checkpoint:
    """Return a network whose ties predict the class of silence."""
    return trained(tie="nothing")


@pytest.mark.slow
def test_silent_recordings_are_right_if_ties_predict_their_class(with_ties: lc.Checkpoint) -> None:
    without = trained()
    assert with_ties.tie_class == 2
    assert without.tie_class is None
    # Rows of a confusion matrix are labels, columns predictions. Without a class for ties, its last column is that of
    # ties: all silent recordings, a third, count as wrong.
    assert without.training["test_accuracy"] == pytest.approx(2 / 3)
    assert without.training["test_confusion"] == "8 0 0 0; 0 8 0 0; 0 0 0 8"
    assert with_ties.training["test_accuracy"] == 1.0
    assert with_ties.training["test_confusion"] == "8 0 0; 0 8 0; 0 0 8"


def test_the_program_keeps_the_class_of_ties(with_ties: lc.Checkpoint, tmp_path: Path) -> None:
    with_ties.save(tmp_path / "ties.pt")
    compiled = lc.compile(
        lc.load(tmp_path / "ties.pt"), events=recordings(), strategy="dendrite", diagnosis=False
    )
    assert compiled.report["accuracy"] == {"reference": 1.0, "chip": 1.0}
    assert compiled.report["match"]["tied_predictions"] == 0
    compiled.save(tmp_path / "build")
    program = hw.load_program(tmp_path / "build")
    assert program.readout is not None
    assert program.readout.tie_class == 2
    spikes = recordings().spikes
    np.testing.assert_array_equal(hw.simulate(program, spikes).prediction, LABELS)
    session = hw.Session(program)
    # Recording 2 is the first silent one.
    assert session.push(spikes[2]).prediction.tolist() == [2] * STEPS


def test_early_stops_are_right_with_a_class_of_ties(with_ties: lc.Checkpoint) -> None:
    """After a proven stop, the prediction must be that of the whole recording, in every further step."""
    program = lc.compile(lc.load(with_ties), diagnosis=False).program
    spikes = recordings().spikes
    proven = hw.stop_when_proven(program, spikes)
    np.testing.assert_array_equal(proven.final, LABELS)
    scores = np.stack([hw.Session(program).push(rows).scores for rows in spikes])
    for row, (stop, final) in enumerate(zip(proven.steps, proven.final, strict=True)):
        scores_from_stop = scores[row, stop - 1 :] if stop else scores[row, :0]
        assert (decided(scores_from_stop, 2) == final).all()
    margin = hw.calibrate_margin(program, spikes, 1.0)
    # No finite margin may be safe. A margin of 1e9 is one that no lead reaches, so that nothing stops early.
    stops = hw.stop_at_margin(program, spikes, margin if np.isfinite(margin) else 1e9)
    np.testing.assert_array_equal(stops.final, LABELS)


def test_a_committee_has_a_class_of_ties_if_all_members_have_the_same(
    with_ties: lc.Checkpoint,
) -> None:
    network = lc.load(with_ties)
    without = replace(network, readout=replace(network.readout, tie_class=None))
    assert committee([network, network], [1.0, 2.0]).readout.tie_class == 2
    assert committee([network, without], [1.0, 2.0]).readout.tie_class is None


def test_a_network_trained_further_keeps_its_class_of_ties(
    with_ties: lc.Checkpoint, tmp_path: Path
) -> None:
    start, further = tmp_path / "start.pt", tmp_path / "further.pt"
    with_ties.save(start)
    np.savez(tmp_path / "a.npz", spikes=recordings().spikes.transpose(0, 2, 1), labels=LABELS)
    common = ["train", "--data", str(tmp_path / "a.npz"), "--epochs", "1", "--quiet"]
    assert main([*common, "--from", str(start), "-o", str(further)]) in (0, 3)
    assert read_checkpoint(further).tie_class == 2


def test_the_command_shows_how_many_recordings_tie_and_takes_a_class_for_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spikes = recordings().spikes.transpose(0, 2, 1)
    names = np.array(NAMES)
    for part in ("train", "test"):
        np.savez(tmp_path / f"{part}.npz", spikes=spikes, labels=LABELS, class_names=names)
    output = tmp_path / "model.pt"
    common = ["train", "--data", str(tmp_path), "--model", "tactile-snn", "--channels", "6"]
    common += ["--hidden", "4", "--epochs", "1", "-o", str(output)]
    main(common)
    printed = capsys.readouterr().out
    assert "label \\ predicted" in printed
    assert "tie\n" in printed
    assert "they predict no class (column 'tie') and count as wrong." in printed
    main([*common, "--tie", "nothing"])
    printed = capsys.readouterr().out
    assert "tie\n" not in printed
    assert read_checkpoint(output).tie_class == 2


@pytest.mark.parametrize(
    ("tie", "message"),
    [
        (
            "never",
            "training option 'tie': no class is called 'never'. Give a class: left, right, nothing; numbers from 0 to 2.",
        ),
        (
            "3",
            "training option 'tie': no class is called '3'. Give a class: left, right, nothing; numbers from 0 to 2.",
        ),
    ],
)
def test_an_unknown_class_for_ties_is_refused(tie: str, message: str) -> None:
    with pytest.raises(lc.InputError) as caught:
        trained(tie=tie)
    assert str(caught.value) == message


def test_a_class_of_ties_may_be_a_number() -> None:
    assert trained(tie="1", epochs=1).tie_class == 1


def test_a_readout_with_an_unknown_class_of_ties_is_refused(with_ties: lc.Checkpoint) -> None:
    network = lc.load(with_ties)
    with pytest.raises(lc.InputError) as caught:
        lc.compile(replace(network, readout=replace(network.readout, tie_class=3)))
    assert str(caught.value) == (
        "readout: tie_class is not a class (3 against 0..2). Give the number of a class, or None."
    )


def test_a_checkpoint_without_a_valid_class_of_ties_has_none(with_ties: lc.Checkpoint) -> None:
    without = {name: value for name, value in with_ties.training.items() if name != "tie"}
    assert replace(with_ties, training=without).tie_class is None
    assert replace(with_ties, training=without | {"tie": 9}).tie_class is None
