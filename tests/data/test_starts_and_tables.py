"""Options of event files: when step 0 begins, tables of events, the unit of times, and the largest number of steps."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data import from_tonic
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError

UNIX_MICROSECONDS = 1_700_000_000_000_000
TXP = [("t", "i8"), ("x", "i8"), ("p", "i1")]
EVENTS = [(0, 2, 0), (25_000, 0, 1), (59_999, 1, 0)]
"""Microseconds, x and polarity."""
PLACES = [(0, 4), (1, 1), (2, 2)]
"""Step of 20 ms and channel, 2 x + polarity, of each of the events."""


def fields(offset: int) -> np.ndarray:
    """Return the events as a structured array, with an offset added to their times."""
    return np.array([(t + offset, x, p) for t, x, p in EVENTS], dtype=TXP)


def slayer(offset: int) -> bytes:
    return b"".join((x << 24 | p << 23 | t + offset).to_bytes(5, "big") for t, x, p in EVENTS)


def places(recordings: Recordings, index: int = 0) -> list[tuple[int, int]]:
    """Return the (step, channel) of every event of a recording."""
    return [(int(step), int(channel)) for step, channel in np.argwhere(recordings.spikes[index])]


def late(steps: int) -> list[tuple[int, int]]:
    """Return the (step, channel) of the events some steps later."""
    return [(step + steps, channel) for step, channel in PLACES]


def put_fields(path: Path, offset: int) -> None:
    np.save(path, fields(offset))


def put_slayer(path: Path, offset: int) -> None:
    path.write_bytes(slayer(offset))


def put_spike_times(path: Path, offset: int) -> None:
    """Write spike times, whose units are channels: they have no polarity."""
    with h5py.File(path, "w") as file:
        kind = h5py.vlen_dtype(np.float64)
        times = [(t + offset) / 1e6 for t, _, _ in EVENTS]
        for name, row in (("times", times), ("units", [channel for _, channel in PLACES])):
            file.create_dataset(f"spikes/{name}", (1,), dtype=kind)[0] = np.array(row)


@pytest.mark.parametrize(
    ("name", "put", "silent_steps"),
    [
        pytest.param("a.npy", put_fields, 0, id="fields"),
        pytest.param("a.bs1", put_slayer, 100, id="SLAYER counts from time 0"),
        pytest.param("a.h5", put_spike_times, 100, id="spike times count from time 0"),
    ],
)
def test_recordings_start_at_their_first_event_unless_the_format_counts_from_0(
    tmp_path: Path, name: str, put: Callable[[Path, int], None], silent_steps: int
) -> None:
    put(tmp_path / name, 2_000_000)
    recordings = read_recordings(tmp_path / name)
    steps = [step for step, _ in places(recordings)]
    expected = [step for step, _ in late(silent_steps)]
    if name == "a.bs1":
        # SLAYER rounds times to the nearest step.
        expected = [silent_steps + step for step in (0, 1, 3)]
    assert steps == expected
    assert recordings.spikes.shape[1] == 1 + steps[-1]


def test_times_since_1970_and_an_offset_of_10_s_are_not_silence(tmp_path: Path) -> None:
    for index, offset in enumerate((UNIX_MICROSECONDS, 10_000_000)):
        np.save(tmp_path / f"sample_{index}.npy", fields(offset))
    recordings = read_recordings(tmp_path)
    assert recordings.spikes.shape == (2, 3, 6)
    assert places(recordings, 0) == places(recordings, 1) == PLACES
    assert recordings.assumed == (
        "Recordings start at their first event, "
        "up to 1.7e+09 s after time 0 of their files (--start).",
    )


def test_a_data_set_of_tonic_starts_at_its_first_event() -> None:
    recordings = from_tonic([(fields(10_000_000), 0)], step_seconds=0.02)
    assert places(recordings) == PLACES


@pytest.mark.parametrize(
    ("name", "put", "start", "expected"),
    [
        pytest.param("a.npy", put_fields, 0, late(100), id="as in the file"),
        pytest.param("a.npy", put_fields, 1.98, late(1), id="at a time"),
        pytest.param("a.h5", put_spike_times, "first", PLACES, id="at the first event"),
    ],
)
def test_the_start_of_recordings_can_be_given(
    tmp_path: Path, name: str, put: Callable[[Path, int], None], start: Any, expected: Any
) -> None:
    put(tmp_path / name, 2_000_000)
    recordings = read_recordings(tmp_path / name, start=start)
    assert places(recordings) == expected
    assert recordings.assumed == ()


def test_events_before_the_start_are_counted_as_dropped(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", fields(0))
    recordings = read_recordings(tmp_path / "a.npy", start=0.02)
    assert recordings.binned is not None
    assert recordings.binned.outside == 1
    assert recordings.binned.dropped == 1


def test_a_recording_whose_events_all_lie_before_its_start_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", fields(0))
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.npy", start=0.2)
    assert str(caught.value) == "file 'a.npy': no events inside. Give a recording with events."


def test_silence_at_the_start_is_read_back_from_events_with_the_option_that_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spikes = np.zeros((1, 4, 6), dtype=np.uint8)
    spikes[0, 2:, [1, 5]] = 1
    recordings = Recordings(spikes, labels=None, step_seconds=0.02, source="late")
    assert write_recordings(Path("a.npy"), recordings, structured=True).options == {"start": 0}
    assert np.array_equal(read_recordings("a.npy", start=0).spikes, spikes)
    assert np.array_equal(read_recordings("a.npy").spikes, spikes[:, 2:])
    write_recordings(Path("late.npz"), recordings)
    assert locsnn(["events", "late.npz", "--to", "b.npy", "--structured"]) == 0
    assert "--start 0" in capsys.readouterr().out


ORDERS = {
    "txyp": "t, x, y and polarity",
    "xypt": "x, y, polarity and t",
    "xytp": "x, y, t and polarity",
    "txp": "t, x and polarity",
    "xpt": "x, polarity and t",
    "xtp": "x, t and polarity",
}
GRID = {"t": [5_000, 30_000, 64_999], "x": [5, 0, 7], "y": [3, 3, 0], "p": [1, 0, 1]}
"""Events of a grid of 8 columns."""


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", ["<i8", "<f8", "<u4"])
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_a_table_of_events_is_recognised(
    tmp_path: Path, order: str, kind: str, suffix: str
) -> None:
    table = np.stack([GRID[name] for name in order], axis=1).astype(kind)
    if suffix == ".npy":
        np.save(tmp_path / "a.npy", table)
    else:
        np.savez(tmp_path / "a.npz", events=table, speaker="Ada")
    recordings = read_recordings(tmp_path / f"a{suffix}")
    rows = GRID["y"] if "y" in order else [0, 0, 0]
    cells = [8 * y + x for x, y in zip(GRID["x"], rows, strict=True)]
    channels = [2 * cell + p for cell, p in zip(cells, GRID["p"], strict=True)]
    assert places(recordings) == list(zip([0, 1, 2], channels, strict=True))
    assumption = (
        f"The columns of file 'a{suffix}' were taken as {ORDERS[order]}, "
        "with t in microseconds (--time-unit)."
    )
    assert assumption in recordings.assumed


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_events_may_be_arrays_called_t_x_y_and_p(tmp_path: Path, suffix: str) -> None:
    columns = {name: np.array(values) for name, values in GRID.items()}
    path = tmp_path / f"a{suffix}"
    if suffix == ".npz":
        np.savez(path, **columns, speaker="Ada")
    else:
        with h5py.File(path, "w") as file:
            for name, column in columns.items():
                file[name] = column
    recordings = read_recordings(path)
    assert places(recordings) == [(0, 2 * (8 * 3 + 5) + 1), (1, 2 * 8 * 3), (2, 2 * 7 + 1)]


def test_arrays_of_events_that_differ_in_size_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=[1, 2], x=[1, 2, 3], p=[0, 0])
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.npz")
    assert str(caught.value) == (
        "file 'a.npz', 'x': its size is another ((3,) against (2,)). Give as many of t, x, y and p."
    )


def test_tables_may_be_the_recordings_of_a_folder(tmp_path: Path) -> None:
    for index in range(2):
        table = np.stack([GRID[name] for name in "txyp"], axis=1)[: 3 - index]
        np.save(tmp_path / f"sample_{index}_label_{index}.npy", table)
    recordings = read_recordings(tmp_path)
    assert recordings.spikes.shape == (2, 3, 60)
    assert recordings.spikes.sum(axis=(1, 2)).tolist() == [3, 2]


def test_an_array_of_bins_is_not_a_table(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0, 1, 1, 0], [1, 0, 0, 0], [0, 0, 1, 1]]))
    assert read_recordings(tmp_path / "a.npy").spikes.shape == (1, 4, 3)


@pytest.mark.parametrize(
    ("unit", "times"),
    [("us", [5_000, 30_000, 64_999]), ("ms", [5.0, 30.0, 64.999]), ("s", [0.005, 0.03, 0.064999])],
)
@pytest.mark.parametrize("made", ["table", "fields"])
def test_the_unit_of_times_can_be_given(
    tmp_path: Path, unit: str, times: list[float], made: str
) -> None:
    if made == "table":
        array = np.array([times, GRID["x"], GRID["p"]], dtype=float).T
    else:
        rows = list(zip(times, GRID["x"], GRID["p"], strict=True))
        array = np.array(rows, dtype=[("t", "f8"), ("x", "i8"), ("p", "i1")])
    np.save(tmp_path / "a.npy", array)
    recordings = read_recordings(tmp_path / "a.npy", time_unit=unit)
    assert places(recordings) == [(0, 11), (1, 0), (2, 15)]


TABLE = np.stack([GRID[name] for name in "txyp"], axis=1)
UNSORTED = TABLE[::-1]
UNCLEAR = np.array([[5, 1, 9, 1], [3, 2, 8, 0]])
REFUSED = [
    pytest.param(
        TABLE[:, [0, 1, 3]] * [1e-6, 1, 1],
        {},
        "file 'a.npy': its times are not in whole microseconds (0.005 of event 0). "
        "Give their unit: --time-unit ms or s.",
        id="fractions of microseconds",
    ),
    pytest.param(
        UNCLEAR,
        {},
        "file 'a.npy': it is neither an array of 0 and 1 nor a table of events (no "
        "column t that rises, in order x y p t, x y t p or t x y p). "
        "Give the fields t, x, y and p, sorted by time.",
        id="no column of times",
    ),
    pytest.param(
        TABLE[:, [0, 1, 2, 1]],
        {},
        "file 'a.npy': it is neither an array of 0 and 1 nor a table of events (5 in the "
        "column of polarities). Give the fields t, x, y and p, sorted by time.",
        id="no column of polarities",
    ),
    pytest.param(
        TABLE,
        {"time_unit": "min"},
        "time_unit: 'min' is not known. Choose one of: ms, ns, s, us.",
        id="an unknown unit",
    ),
    pytest.param(
        TABLE,
        {"start": "last"},
        "start: it is neither a time nor first (got 'last'). "
        "Give the seconds at which step 0 begins, or first.",
        id="a start that is no time",
    ),
    pytest.param(
        TABLE,
        {"start": float("nan")},
        "start: it is neither a time nor first (got nan). "
        "Give the seconds at which step 0 begins, or first.",
        id="a start that is not finite",
    ),
    pytest.param(
        np.zeros((2, 3)),
        {"start": 0},
        "start: 'a.npy' holds bins, not single events to count. Leave it out.",
        id="a start of bins",
    ),
    pytest.param(
        np.zeros((2, 3)),
        {"time_unit": "s"},
        "time_unit: 'a.npy' holds bins, not single events to count. Leave it out.",
        id="a unit of bins",
    ),
]


@pytest.mark.parametrize(("array", "options", "message"), REFUSED)
def test_tables_and_options_that_do_not_fit_are_refused(
    tmp_path: Path, array: np.ndarray, options: dict[str, Any], message: str
) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.npy", **options)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (
            "a.bs1",
            {"time_unit": "ms"},
            "time_unit: times in 'a.bs1' are in microseconds, as its format has them. "
            "Leave it out.",
        ),
        (
            "a.tact",
            {"start": 0},
            "start: 'a.tact' starts where its .startend file or its first event is. Leave it out.",
        ),
    ],
)
def test_formats_with_a_start_or_a_unit_of_their_own_refuse_another(
    tmp_path: Path, name: str, options: dict[str, Any], message: str
) -> None:
    (tmp_path / name).write_bytes(b"1 1 0.5\n" if name == "a.tact" else slayer(0))
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / name, **options)
    assert str(caught.value) == message


def half_a_minute(path: Path) -> Path:
    """Write 30 s of events, one per second."""
    times = np.arange(31) * 1_000_000
    np.save(path, np.array([(t, 0, 0) for t in times], dtype=TXP))
    return path


def test_half_a_minute_in_steps_of_1_ms_is_read_if_more_steps_are_allowed(tmp_path: Path) -> None:
    path = half_a_minute(tmp_path / "a.npy")
    with pytest.raises(InputError) as caught:
        read_recordings(path, step_seconds=0.001)
    assert str(caught.value) == (
        "file 'a.npy': it lasts too long for its bins (30 s in bins of 0.001 s against 20000 bins). "
        "Give wider bins, or allow more with --max-steps."
    )
    for options in ({"max_steps": 30_001}, {"steps": 30_001}):
        recordings = read_recordings(path, step_seconds=0.001, **options)
        assert np.flatnonzero(recordings.spikes[0, :, 0]).tolist() == list(range(0, 30_001, 1000))


def test_times_of_a_format_that_counts_from_0_may_be_read_from_the_first_event(
    tmp_path: Path,
) -> None:
    put_spike_times(tmp_path / "a.h5", 1_000_000_000)
    with pytest.raises(InputError) as caught:
        read_recordings(tmp_path / "a.h5")
    assert str(caught.value) == (
        "file 'a.h5', recording 0: it lasts too long for its bins (1000.06 s in bins of 0.02 s against 20000 bins). "
        "Start it at its first event with --start first."
    )
    assert read_recordings(tmp_path / "a.h5", start="first").spikes.shape == (1, 3, 5)


def test_training_on_long_recordings_is_refused_unless_more_steps_are_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    spikes = np.random.default_rng(0).random((4, 2, 20_050)) < 0.01
    np.savez("a.npz", spikes=spikes, labels=[0, 1, 0, 1], step_seconds=0.001)
    train = ["train", "--data", "a.npz", "--channels", "2", "--model", "window-snn", "--quiet"]
    assert locsnn([*train, "-o", "m.pt"]) == 2
    assert capsys.readouterr().err == (
        "recordings 'a.npz': they are too long (20050 steps against 20000). "
        "Cut them with --steps, use wider bins, or allow more with --max-steps.\n"
    )


def test_commands_take_a_start_a_unit_and_a_longest_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", TABLE[:, [0, 1, 3]] * [1e-6, 1, 1] + [1000, 0, 0])
    given = ["--time-unit", "s", "--step-seconds", "1e-6", "--max-steps", "100000", "--json"]
    assert locsnn(["events", "a.npy", *given]) == 0
    assert json.loads(capsys.readouterr().out)["steps"] == 60_000
    given = ["--time-unit", "s", "--start", "999.98"]
    assert locsnn(["events", "a.npy", *given, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["steps"] == 5
    assert locsnn(["events", "a.npy", "--time-unit", "s"]) == 0
    assert (
        "assumed: Recordings start at their first event, up to 1000 s after time 0 of their files (--start)."
        in capsys.readouterr().out.splitlines()
    )
