"""Raw recordings of slips as the VT_SNN data set publishes them, of two fingertips.

Events are lines of text in ``aces_recordings``, times of a robot's motion in ``traj_start_ends``. A slip is read for
0.15 s from the time of reaching.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.cli.main import main
from locsnn_compile.data.read import read_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from tests.support.published_files import REACHING, START, write_slip


@pytest.mark.slow
@pytest.mark.parametrize(
    "folder", [".", "aces_recordings"], ids=["both folders", "the recordings' folder"]
)
@pytest.mark.parametrize("nanoseconds", [True, False], ids=["four columns", "three columns"])
def test_a_folder_of_slips_is_read_with_classes(
    folder: str, nanoseconds: bool, tmp_path: Path
) -> None:
    bins = write_slip(tmp_path / "slip", nanoseconds=nanoseconds)
    recordings = read_recordings(tmp_path / "slip" / folder)
    assert recordings.spikes.shape == (8, 150, 156)
    assert recordings.step_seconds == 0.001
    assert recordings.class_names == ("stable", "rotate")
    assert recordings.labels is not None
    names = [f"{kind}_{k:02}" for k in range(1, 5) for kind in ("rotate", "stable")]
    assert recordings.labels.tolist() == [1, 0] * 4
    for name, spikes in zip(names, recordings.spikes, strict=True):
        assert np.array_equal(spikes, bins[name]), name
    assert recordings.binned is not None
    # Every recording has an event before and one after the 0.15 s.
    assert recordings.binned.outside == 2 * 8


def test_a_single_slip_has_no_label(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bins = write_slip(tmp_path / "slip")
    monkeypatch.chdir(tmp_path / "slip" / "aces_recordings")
    recordings = read_recordings("stable_02.tact")
    assert np.array_equal(recordings.spikes[0], bins["stable_02"])
    assert recordings.labels is None


def test_the_width_of_bins_can_be_given(tmp_path: Path) -> None:
    bins = write_slip(tmp_path / "slip", each=1)
    # 0.15 s hold 21 whole bins of 7 ms.
    recordings = read_recordings(tmp_path / "slip", step_seconds=0.007)
    assert recordings.spikes.shape == (2, 21, 156)
    pooled = bins["rotate_01"][:147].reshape(21, 7, 156).max(axis=1)
    assert np.array_equal(recordings.spikes[0], pooled)


def test_times_next_to_the_recording_come_first(tmp_path: Path) -> None:
    """A ``.startend`` file of six times, next to the recording, makes it a grasp of 6.5 s (325 steps)."""
    write_slip(tmp_path / "slip", each=1)
    (tmp_path / "slip" / "aces_recordings" / "stable_01.startend").write_text("1 2 3 5 6 7")
    recordings = read_recordings(tmp_path / "slip" / "aces_recordings" / "stable_01.tact")
    assert recordings.spikes.shape == (1, 325, 156)
    assert not recordings.spikes.any()


@pytest.mark.parametrize(
    ("times", "message"),
    [
        pytest.param(
            None,
            "folder 'aces_recordings', 'rotate_01.tact': it has no .startend file, although others have one. "
            "Give it in folder 'traj_start_ends', or leave the recording out.",
            id="missing",
        ),
        *(
            pytest.param(
                text,
                f"folder 'aces_recordings', 'rotate_01.startend': it does not give the time of 'grasping' ({numbers} numbers). "
                "Give the times of start, reaching, reached, grasping, lifting, holding.",
                id=name,
            )
            for name, text, numbers in (
                ("three times", f"{START} {REACHING} {REACHING}", 3),
                ("five times", "1 2 3 4 5", 5),
                ("not a number", f"{START} nan {REACHING} {REACHING}", 4),
            )
        ),
    ],
)
def test_times_that_cannot_be_read_are_refused(
    times: str | None, message: str, tmp_path: Path
) -> None:
    write_slip(tmp_path, each=1)
    file = tmp_path / "traj_start_ends" / "rotate_01.startend"
    if times is None:
        file.unlink()
    else:
        file.write_text(times)
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "aces_recordings")
    assert str(caught.value) == message


@given(
    times=st.text("0123456789 -.\n", max_size=14), line=st.text("0123456789 -.\nen", max_size=14)
)
@settings(max_examples=60, deadline=None)
def test_any_text_is_read_or_refused(
    times: str, line: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("slip")
    (folder / "a.tact").write_text(f"1 1 5 250000000\n{line}\n")
    (folder / "a.startend").write_text(times)
    with contextlib.suppress(InputError):
        assert read_recordings(folder).spikes.shape in ((1, 150, 156), (1, 325, 156))


def test_the_class_is_the_name_of_a_file_without_its_number(tmp_path: Path) -> None:
    for name in ("108-a_tuna_fish_can_01", "107-b_pepsi_bottle_02", "107-b_pepsi_bottle_01"):
        (tmp_path / f"{name}.tact").write_text("1 1 1.0\n")
    recordings = read_recordings(tmp_path)
    assert recordings.class_names == ("107-b_pepsi_bottle", "108-a_tuna_fish_can")
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 0, 1]


def test_files_of_a_single_name_have_no_class(tmp_path: Path) -> None:
    for number in (1, 2):
        (tmp_path / f"touch_{number}.tact").write_text("1 1 1.0\n")
    assert read_recordings(tmp_path).labels is None


def test_slips_train_a_network_of_two_fingertips(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_slip(tmp_path / "slip")
    quick = ["--epochs", "1", "--hidden", "4", "--quiet"]
    assert main(["train", "--data", "slip", *quick, "-o", "slip.pt"]) == 0
    description = read_checkpoint("slip.pt").description
    assert description.input.sensor.surfaces == 2
    assert description.input.steps == 150
    assert description.input.step_seconds == 0.001
    assert description.input.channels == 156
    assert description.classes == 2
    assert description.class_names == ("stable", "rotate")
