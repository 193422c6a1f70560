"""The table of recording formats: a new format needs only a row with its reader and writer.

The tests add a format ``.lines`` of text, with a line of microseconds and channel per event.
"""

import numpy as np
import pytest

from locsnn_compile.cli.main import main
from locsnn_compile.data import formats, read_recordings, write_recordings
from locsnn_compile.data.event_formats import timed_events
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.format_rows import EventFormat
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError


def read_lines(file):
    """Return the events of a file."""
    rows = [line.split() for line in file.data.decode().splitlines()]
    times, channels = np.array(rows, dtype=np.int64).reshape(-1, 2).T
    return EventStream(times, channels, y=None, polarity=None, place=file.where)


def write_lines(events):
    """Return the content of the file of a recording, by its name."""
    times, cell, polarity = timed_events(events)
    channels = events.polarities * cell + polarity
    lines = [f"{time} {channel}\n" for time, channel in zip(times, channels, strict=True)]
    return {f"{events.stem}.lines": "".join(lines).encode()}


LINES = EventFormat(".lines", read_lines, write_lines, most_bytes=100)


@pytest.fixture(autouse=True)
def with_lines(monkeypatch):
    """Add the format to the table in every test."""
    monkeypatch.setattr(formats, "EVENT_FORMATS", (*formats.EVENT_FORMATS, LINES))


def test_a_row_adds_a_format_of_events(tmp_path):
    (tmp_path / "a.lines").write_text("0 1\n25000 0\n")
    recordings = read_recordings(tmp_path / "a.lines", step_seconds=0.02)
    assert recordings.spikes.tolist() == [[[0, 1], [1, 0]]]


def test_folders_of_the_format_are_read_with_their_labels(tmp_path):
    for number, label in enumerate((1, 0)):
        (tmp_path / f"r{number}_label_{label}.lines").write_text(f"0 {number}\n")
    recordings = read_recordings(tmp_path, step_seconds=0.02)
    assert recordings.labels.tolist() == [1, 0]
    assert recordings.spikes.shape == (2, 1, 2)


def test_recordings_are_written_in_the_format_and_read_back(tmp_path):
    spikes = np.array([[[1, 0, 0], [0, 0, 1], [0, 1, 1]]], dtype=np.uint8)
    write_recordings(
        tmp_path / "a.lines", Recordings(spikes, labels=None, step_seconds=0.02, source="made")
    )
    assert read_recordings(tmp_path / "a.lines", step_seconds=0.02).spikes.tolist() == (
        spikes.tolist()
    )


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (
            "0 1\n" * 26,
            {},
            "file 'a.lines': it is too large (104 bytes against 100). Give one recording.",
        ),
        (
            "0 1\n",
            {"time_unit": "ms"},
            "time_unit: times in 'a.lines' are in microseconds, as its format has them. "
            "Leave it out.",
        ),
    ],
    ids=["too large", "another unit"],
)
def test_limits_of_the_row_are_kept(tmp_path, text, options, message):
    (tmp_path / "a.lines").write_text(text)
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.lines", **options)
    assert str(caught.value) == message


def test_the_error_for_an_unknown_ending_lists_the_format(tmp_path, capsys):
    (tmp_path / "a.xyz").write_text("")
    assert main(["events", str(tmp_path / "a.xyz")]) == 2
    assert capsys.readouterr().err == (
        f"file {str(tmp_path / 'a.xyz')!r}: its kind is not known (ending '.xyz'). Give one of: "
        ".zip, .npy, .npz, .pt, .h5, .hdf5, .tact, .bs1, .bs2, .bin, .aedat4, .aedat, .raw, .dat, .csv, .lines, "
        "or a folder.\n"
    )
