"""Raw text of the NeuTouch sensor (``.tact``): a line per event with a polarity, a cell and a time in seconds.

Tested are the channels of cells, bins and thresholds, the time of the grasp from a ``.startend`` file, and errors that
name the line.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Binned
from locsnn_compile.errors import InputError


def write(path: Path, events: list[tuple[int, int, float]]) -> Path:
    """Write events (polarity, cell, seconds) as lines of a ``.tact`` file."""
    path.write_text("".join(f"{p} {c} {t}\n" for p, c, t in events))
    return path


# A fingertip has 39 taxels of 2 polarities: 78 channels, the rising one of a taxel first. Cells are counted from 1 over both
# fingertips, and cells 17 and 49 do not exist, so channel 2 * (cell - 1) loses 2 behind each of these gaps.
@pytest.mark.parametrize(
    ("cell", "polarity", "channel"),
    [
        pytest.param(1, 1, 0, id="first cell, rising"),
        pytest.param(1, 0, 1, id="first cell, falling"),
        pytest.param(1, -1, 1, id="first cell, falling as -1"),
        pytest.param(16, 1, 30, id="before the first gap"),
        pytest.param(18, 1, 32, id="after the first gap"),
        pytest.param(40, 0, 77, id="end of the first fingertip"),
        pytest.param(41, 1, 78, id="start of the second fingertip"),
        pytest.param(50, 1, 94, id="after the second gap"),
        pytest.param(80, 0, 155, id="last cell"),
    ],
)
def test_cells_become_channels(tmp_path: Path, cell: int, polarity: int, channel: int) -> None:
    recordings = read_recordings(
        write(tmp_path / "a.tact", [(polarity, cell, 5.0), (polarity, cell, 5.001)])
    )
    assert recordings.spikes.shape == (1, 1, 156)
    assert np.flatnonzero(recordings.spikes[0, 0]).tolist() == [channel]
    assert recordings.step_seconds == 0.02
    assert recordings.labels is None


def test_a_bin_spikes_if_it_has_more_events_than_the_threshold(tmp_path: Path) -> None:
    # Cell 1 has one event in bin 0, two in bin 1, and three in bin 3; the order of the lines does not matter.
    times = [10.07, 10.0, 10.025, 10.03, 10.071, 10.072]
    path = write(tmp_path / "grasp_label_4.tact", [(1, 1, t) for t in times])
    assert read_recordings(path).spikes[0, :, 0].tolist() == [1, 1, 0, 1]
    assert read_recordings(path, threshold=1).spikes[0, :, 0].tolist() == [0, 1, 0, 1]
    assert read_recordings(path, threshold=2).spikes[0, :, 0].tolist() == [0, 0, 0, 1]
    assert read_recordings(path, threshold=0, step_seconds=0.04).spikes[0, :, 0].tolist() == [1, 1]
    labels = read_recordings(path).labels
    assert labels is not None
    assert labels.tolist() == [4]


@pytest.mark.parametrize("start", [0, 5, 1_583_850_000])
@pytest.mark.parametrize(("milliseconds", "columns"), [(1, 1), (1, 2), (20, 1), (20, 2)])
def test_an_event_on_the_edge_of_a_bin_is_the_first_in_it(
    tmp_path: Path, start: int, milliseconds: int, columns: int
) -> None:
    lines = [f"1 1 {start + k // 1000}.{k % 1000:03}000000\n" for k in range(0, 6500, milliseconds)]
    text = "".join(lines) if columns == 1 else "".join(lines).replace(".", " ")
    (tmp_path / "a.tact").write_text(text)
    for startend in ("", f"grasping {start}.0"):
        if startend:
            (tmp_path / "a.startend").write_text(startend)
        spikes = read_recordings(tmp_path / "a.tact", step_seconds=milliseconds / 1000).spikes[0]
        assert spikes[:, 0].all()
        assert len(spikes) == len(lines)
    # A nanosecond earlier, the event belongs to the bin before.
    (tmp_path / "a.tact").write_text(
        f"1 1 {start}.{milliseconds - 1:03}999999\n1 1 {start}.{milliseconds:03}\n"
    )
    spikes = read_recordings(tmp_path / "a.tact", step_seconds=milliseconds / 1000).spikes[0]
    assert np.flatnonzero(spikes[:, 0]).tolist() == [0, 1]


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("1 2 3 100.0 105 110", id="six numbers"),
        pytest.param(
            "start 1\nreaching 2\nreached 3\ngrasping 100.0\nlifting 105\nholding 110\n", id="named"
        ),
        pytest.param("start: 1, grasping: 100.0", id="named, in part"),
    ],
)
def test_recordings_start_at_the_time_of_the_grasp(tmp_path: Path, text: str) -> None:
    events = [
        (1, 2, 99.9),
        (1, 2, 99.91),
        (1, 3, 100.0),
        (1, 3, 100.01),
        (0, 3, 106.49),
        (0, 3, 106.495),
        (0, 4, 106.6),
    ]
    path = write(tmp_path / "a.tact", events)
    (tmp_path / "a.startend").write_text(text)
    spikes = read_recordings(path).spikes[0]
    # A grasp is read for 6.5 s from its start, in bins of 20 ms.
    assert spikes.shape == (325, 156)
    assert [tuple(map(int, where)) for where in np.argwhere(spikes)] == [(0, 4), (324, 5)]


def test_recordings_of_a_folder_have_the_labels_of_their_names(tmp_path: Path) -> None:
    for name, cell in (("b_label_1", 2), ("a_label_0", 1)):
        write(tmp_path / f"{name}.tact", [(1, cell, 1.0), (1, cell, 1.0)])
    recordings = read_recordings(tmp_path)
    assert recordings.labels is not None
    assert recordings.labels.tolist() == [0, 1]
    assert [int(c) for c in recordings.spikes.argmax(axis=2)[:, 0]] == [0, 2]


def message_of(path: Path) -> str:
    """Return the message with which a file is refused."""
    with pytest.raises(InputError) as caught:
        read_recordings(path)
    return str(caught.value)


FIX = "Write 'polarity cell_index timestamp_seconds' on it: a polarity of 1, 0 or -1, a cell of 1 to 80 without 17 and 49."


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(
            "1 1 1.0\n\n1 x 1.0\n",
            f"file 'a.tact', line 3: it is not an event (got '1 x 1.0'). {FIX}",
            id="word",
        ),
        pytest.param(
            "1 1\n",
            f"file 'a.tact', line 1: it is not an event (got '1 1'). {FIX}",
            id="two fields",
        ),
        pytest.param(
            "1 1 1 1 1\n",
            f"file 'a.tact', line 1: it is not an event (got '1 1 1 1 1'). {FIX}",
            id="five fields",
        ),
        pytest.param(
            "1 1 1 x\n",
            f"file 'a.tact', line 1: it is not an event (got '1 1 1 x'). {FIX}",
            id="nanoseconds",
        ),
        pytest.param(
            f"1 1 1 {'9' * 400}\n",
            "file 'a.tact', line 1: it is not an event (got '1 1 1 "
            f"9999999999999999999999999999999999'). {FIX}",
            id="absurd nanoseconds",
        ),
        pytest.param(
            "1 1 1e-99999999999999999999\n",
            f"file 'a.tact', line 1: it is not an event (got '1 1 1e-99999999999999999999'). {FIX}",
            id="absurd exponent",
        ),
        pytest.param(
            "2 1 1\n",
            f"file 'a.tact', line 1: it is not an event (got '2 1 1'). {FIX}",
            id="polarity",
        ),
        pytest.param(
            "1 17 1\n",
            f"file 'a.tact', line 1: it is not an event (got '1 17 1'). {FIX}",
            id="cell that does not exist",
        ),
        pytest.param(
            "1 1 nan\n",
            f"file 'a.tact', line 1: it is not an event (got '1 1 nan'). {FIX}",
            id="NaN",
        ),
        pytest.param(
            "\n", "file 'a.tact': no events inside. Give a recording with events.", id="empty"
        ),
        pytest.param(
            "1 1 0\n1 1 1e9\n",
            "file 'a.tact': it lasts too long for its bins (1e+09 s in bins of 0.02 s against 20000 bins). "
            "Give a .startend file next to it, or wider bins.",
            id="too long",
        ),
        pytest.param(
            "1 1 -1e308\n1 1 1e308\n",
            "file 'a.tact': it lasts too long for its bins (inf s in bins of 0.02 s against 20000 bins). "
            "Give a .startend file next to it, or wider bins.",
            id="absurd times",
        ),
    ],
)
def test_text_that_is_no_recording_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.tact").write_text(text)
    assert message_of(tmp_path / "a.tact") == message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            {"step_seconds": 0.0},
            "recordings, step_seconds: it must be a number from 1e-06 to 1000 (got 0.0). Correct it.",
            id="no width",
        ),
        pytest.param(
            {"step_seconds": float("nan")},
            "recordings, step_seconds: it must be a number from 1e-06 to 1000 (got nan). Correct it.",
            id="NaN",
        ),
        pytest.param(
            {"threshold": -1},
            "recordings, threshold: it must be a whole number from 0 to 20000000 (got -1). "
            "Correct it.",
            id="negative threshold",
        ),
    ],
)
def test_impossible_options_are_refused(
    tmp_path: Path, options: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_recordings(write(tmp_path / "a.tact", [(1, 1, 0.0)]), **options)  # type: ignore[arg-type]
    assert str(caught.value) == message


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.tact").write_bytes(b"\xff\xfe\x00garbage")
    assert message_of(tmp_path / "a.tact").startswith(
        "file 'a.tact', line 1: it is not an event (got "
    )


def test_a_startend_file_without_the_time_of_grasping_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "a.tact", [(1, 1, 0.0)])
    (tmp_path / "a.startend").write_text("1 2 3")
    assert message_of(tmp_path / "a.tact") == (
        "file 'a.startend': it does not give the time of 'grasping' (3 numbers). "
        "Give the times of start, reaching, reached, grasping, lifting, holding."
    )


def test_recordings_of_different_lengths_are_padded_with_silence(tmp_path: Path) -> None:
    folder = tmp_path / "grasps"
    folder.mkdir()
    write(folder / "a.tact", [(1, 1, 0.0), (1, 1, 0.1)])
    write(folder / "b.tact", [(1, 1, 0.0)])
    assert read_recordings(folder).spikes[:, :, 0].tolist() == [
        [1, 0, 0, 0, 0, 1],
        [1, 0, 0, 0, 0, 0],
    ]
    assert read_recordings(folder, steps=3).spikes[:, :, 0].tolist() == [[1, 0, 0], [1, 0, 0]]


def test_events_that_bins_drop_are_counted(tmp_path: Path) -> None:
    # Two events in the first bin, one in the second, and one in the third, which a recording of two steps does not have.
    path = write(tmp_path / "a.tact", [(1, 1, 0.0), (1, 1, 0.001), (1, 1, 0.02), (1, 2, 0.045)])
    assert read_recordings(path).binned == Binned(threshold=0, events=4, outside=0, below=0)
    assert read_recordings(path, threshold=1).binned == Binned(
        threshold=1, events=4, outside=0, below=2
    )
    assert read_recordings(path, threshold=1, steps=2).binned == Binned(
        threshold=1, events=4, outside=1, below=1
    )
    (tmp_path / "a.startend").write_text("grasping 0.01")
    assert read_recordings(path).binned == Binned(threshold=0, events=4, outside=2, below=0)
