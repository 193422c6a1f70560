"""Event files of text: tables with a line per event (CSV), with or without names of the columns."""

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.cli.main import main
from locsnn_compile.data import Recordings, read_recordings, write_recordings

BINS = [[0, 0, 3], [0, 1, 6]]
"""Recording, step of 1 ms and channel of the events below, on 2 x 2 pixels of two polarities."""
TEXTS = {
    "named by faery": "t,x@2,y@2,on\n1000,1,0,1\n2500,1,1,0\n",
    "named in another order": "x;y;polarity;timestamp[us]\n1;0;1;1000\n1;1;0;2500\n",
    "without names": "1000 1 0 1\n2500 1 1 0\n",
    "with comments and empty lines": "# a camera\n\n1 0 1 1000\r\n1\t1\t0\t2500\r\n",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_csv_files_become_bins(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    recordings = read_recordings(tmp_path / "a.csv", grid="2x2", step_seconds=0.001)
    assert [
        list(map(int, place)) for place in zip(*recordings.spikes.nonzero(), strict=True)
    ] == BINS


def test_the_unit_of_times_in_csv_files_can_be_given(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x,y,p\n0.001,1,0,1\n0.0025,1,1,0\n")
    recordings = read_recordings(tmp_path / "a.csv", grid="2x2", step_seconds=0.001, time_unit="s")
    assert [
        list(map(int, place)) for place in zip(*recordings.spikes.nonzero(), strict=True)
    ] == BINS


def test_folders_of_csv_files_have_the_labels_of_their_names(tmp_path: Path) -> None:
    for label in (0, 1):
        (tmp_path / f"r_label_{label}.csv").write_text("t,x,p\n5,0,1\n9,1,0\n")
    recordings = read_recordings(tmp_path, step_seconds=0.02)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1]


@pytest.mark.parametrize("name", ["sample_0.npy", "train.npz", "r.bs1"])
def test_csv_files_next_to_other_recordings_are_not_recordings(name: str, tmp_path: Path) -> None:
    """They may describe the recordings, such as a table of labels."""
    spikes = np.zeros((1, 2, 3), dtype=np.uint8)
    spikes[0, 1, 2] = 1
    write_recordings(
        tmp_path / name, Recordings(spikes, labels=None, step_seconds=0.02, source="made")
    )
    (tmp_path / "labels.csv").write_text("t,x,p\n5,0,1\n")
    assert read_recordings(tmp_path, step_seconds=0.02, channels=3).spikes.sum() == 1


FIX = "Give lines of t,x,y,p, or of t,x,p."
REFUSED: dict[str, tuple[bytes, str]] = {
    "empty": (b"", f"it has no events. {FIX}"),
    "names alone": (b"t,x,y,p\n", f"it has no events. {FIX}"),
    "not text": (b"1,2,3\n\xff", f"it is not plain text (byte 6 is 255). {FIX}"),
    "two columns": (b"1,2\n", f"its lines are not three or four numbers ('1 2'). {FIX}"),
    "names of another number": (
        b"t,x,p\n1,2,3,1\n",
        f"its lines are not three or four numbers ('1 2 3 1'). {FIX}",
    ),
    "words": (
        b"t,x,p\n1,2,hello\n",
        f"its lines are not numbers, as many in each. {FIX}",
    ),
    "ragged": (
        b"t,x,p\n1,2,1\n1,2\n",
        f"its lines are not numbers, as many in each. {FIX}",
    ),
    "only 0 and 1 without names": (
        b"0,0,1\n1,1,0\n",
        "its columns have no names, and no numbers but 0 and 1. "
        "Name them t,x,y,p in the first line.",
    ),
    "unknown names": (
        b"a,b,c\n1,2,1\n",
        "its values are not events (fields a, b, c). "
        "Give the fields t (microseconds), x, y if there is one, and p (0 or 1).",
    ),
    "a time that is no number": (
        b"t,x,p\nnan,2,1\n",
        "its field 't' is out of range (nan of event 0 against whole numbers 0..9007199254740992). "
        "Give the fields t (microseconds), x, y if there is one, and p (0 or 1).",
    ),
}


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED)
def test_text_that_is_no_table_of_events_is_refused(
    text: bytes, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text)
    assert main(["events", str(path)]) == 2
    assert capsys.readouterr() == ("", f"file {str(path)!r}: {message}\n")
