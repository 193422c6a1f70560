"""Listing and transposing events: the compiled functions equal those of numpy, and both equal the recording."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numba.core import config

import hw_model as hw
from hw_model.engine import events as event_scan
from hw_model.engine import lanes, playing, threads
from hw_model.engine.trace import PhaseInput
from hw_model.mapping.graph import Input, read_only

RECORDINGS = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 40)).flatmap(
    lambda shape: hnp.arrays(np.uint8, shape, elements=st.integers(0, 1))
)


@settings(max_examples=60, deadline=None)
@given(recordings=RECORDINGS, lines=st.integers(1, 12), seed=st.integers(0, 99))
def test_compiled_lists_equal_those_of_numpy(recordings, lines, seed):
    expected = playing.list_events("x", recordings)
    lists = event_scan.list_events("x", recordings)
    assert np.array_equal(lists.first, expected.first)
    assert np.array_equal(lists.channel, expected.channel)

    item, steps = _visits(seed, recordings.shape[2], lines)
    expected = playing.transpose(expected, item, steps)
    lists = event_scan.transpose(lists, item, steps)
    assert np.array_equal(lists.first, expected.first)
    assert np.array_equal(lists.channel, expected.channel)
    assert lists.channel.dtype == expected.channel.dtype == np.int32
    played = np.zeros((len(recordings), steps, item.size), dtype=np.uint8)
    for b, t, c in np.argwhere(recordings).tolist():
        if t < lines and item.positions[c] < steps:
            played[
                b, item.positions[c], t + (0 if item.first_lines is None else item.first_lines[c])
            ] += 1
    turned = PhaseInput(
        steps, (item.size,), (lists,), *np.zeros((3, len(recordings)), dtype=np.int64)
    )
    assert all(np.array_equal(turned.lines(b), played[b]) for b in range(len(recordings)))
    for b, row in np.ndindex(len(recordings), steps):  # ascending within a row, as every list
        assert (np.diff(lists.channel[lists.first[b, row] : lists.first[b, row + 1]]) > 0).all()


def _visits(seed: int, channels: int, lines: int) -> tuple[Input, int]:
    """Return a random transposed input, and a number of steps that may end before its last visit.

    Channels are visited in any order, several of them in the same step.
    """
    r = np.random.default_rng(seed)
    channels_per_step = int(r.integers(1, channels + 1))
    at = r.permutation(channels)
    first_lines = (
        None
        if channels_per_step == 1 and r.random() < 0.5
        else read_only(at % channels_per_step * lines)
    )
    steps = max(1, -(-channels // channels_per_step) + int(r.integers(-1, 3)))
    return Input(
        name="x",
        size=channels_per_step * lines,
        phase="location",
        stream="touch",
        positions=read_only(at // channels_per_step),
        first_lines=first_lines,
    ), steps


@pytest.mark.parametrize("module", [event_scan, playing], ids=["compiled", "numpy"])
@settings(max_examples=30, deadline=None)
@given(recordings=RECORDINGS)
def test_lists_hold_the_recording_and_transpose_it(module, recordings):
    events = module.list_events("x", recordings)
    steps, channels = recordings.shape[1:]
    played = PhaseInput(
        steps, (channels,), (events,), *np.zeros((3, len(recordings)), dtype=np.int64)
    )
    item = Input(
        name="x",
        size=steps,
        phase="location",
        stream="touch",
        positions=np.arange(channels)[::-1].copy(),
    )
    turned = module.transpose(events, item, channels)
    transposed = PhaseInput(
        channels, (steps,), (turned,), *np.zeros((3, len(recordings)), dtype=np.int64)
    )
    for b, recording in enumerate(recordings):
        assert np.array_equal(played.lines(b), recording)
        assert np.array_equal(transposed.lines(b), recording.T[::-1])
    assert np.array_equal(events.events, recordings.sum(axis=(1, 2)))


@pytest.mark.parametrize("module", [event_scan, playing], ids=["compiled", "numpy"])
def test_recordings_without_rows_or_events_have_empty_lists(module):
    assert module.list_events("x", np.zeros((2, 0, 3), dtype=np.uint8)).first.tolist() == [[0], [0]]
    assert module.list_events("x", np.zeros((2, 1, 3), dtype=np.uint8)).first.tolist() == [
        [0, 0],
        [0, 0],
    ]


class Visits(NamedTuple):
    """A transposed input of three channels, and the lines that :data:`EVENTS_OF_VISITS` spike on in each step."""

    positions: list[int]
    first_lines: list[int] | None
    lines: int
    steps: int
    lines_by_step: list[list[int]]


EVENTS_OF_VISITS = [(0, 0), (0, 2), (1, 0), (1, 1), (2, 2)]
"""Row and channel of each event."""
# The columns: positions, first_lines, lines, steps, lines_by_step.
VISITS = {
    "one at a time": Visits([2, 0, 1], None, 3, 3, [[1], [0, 2], [0, 1]]),
    "fewer lines than rows": Visits([2, 0, 1], None, 2, 3, [[1], [0], [0, 1]]),
    "two together": Visits([0, 1, 0], [0, 0, 3], 6, 2, [[0, 1, 3, 5], [1]]),
    "lines in the order of no walk": Visits([0, 1, 0], [3, 0, 0], 6, 2, [[0, 2, 3, 4], [1]]),
    "all together": Visits([0, 0, 0], [0, 3, 6], 9, 1, [[0, 1, 4, 6, 8]]),
    "all together, fewer lines than rows": Visits([0, 0, 0], [0, 1, 2], 3, 1, [[0, 2]]),
    "silence after the walk": Visits([0, 1, 0], [0, 0, 3], 6, 4, [[0, 1, 3, 5], [1], [], []]),
    "steps before its end": Visits([2, 0, 1], None, 3, 2, [[1], [0, 2]]),
    "two steps before its end": Visits([2, 0, 1], None, 3, 1, [[1]]),
}


@pytest.mark.parametrize("module", [event_scan, playing], ids=["compiled", "numpy"])
@pytest.mark.parametrize("visits", VISITS.values(), ids=VISITS)
def test_events_become_lines(module, visits):
    """The second recording of a batch has the events, and the first one none."""
    recordings = np.zeros((2, 3, 3), dtype=np.uint8)
    for row, channel in EVENTS_OF_VISITS:
        recordings[1, row, channel] = 1
    first_lines = None if visits.first_lines is None else read_only(visits.first_lines)
    item = Input(
        name="x",
        size=visits.lines,
        phase="location",
        stream="touch",
        positions=read_only(visits.positions),
        first_lines=first_lines,
    )
    lists = module.transpose(module.list_events("x", recordings), item, visits.steps)
    assert lists.rows == visits.steps
    assert not lists.first[0].any()
    spikes_by_step = np.split(lists.channel, lists.first[1, 1:-1])
    assert [spikes.tolist() for spikes in spikes_by_step] == visits.lines_by_step


@pytest.mark.parametrize("module", [event_scan, playing], ids=["compiled", "numpy"])
@pytest.mark.parametrize("channels", [1, 63, 64, 65, 156])
@pytest.mark.parametrize("value", [2, 128, 255])
def test_a_byte_above_1_is_refused_wherever_it_is(module, channels, value):
    message = "spikes of 'x': values other than 0 and 1. Binarise the events; graded spikes do not exist here."
    for b, row, channel in np.ndindex(2, 3, channels):
        recordings = np.ones((2, 3, channels), dtype=np.uint8)
        recordings[b, row, channel] = value
        with pytest.raises(hw.InputError) as caught:
            module.list_events("x", recordings)
        assert str(caught.value) == message


@pytest.mark.parametrize("dtype", ["c8", "O", "U1", "m8[s]"])
def test_ones_that_are_no_real_numbers_are_refused(dtype):
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    builder.add_input("x", 2)
    builder.add_compartments("n", 1, threshold=90)
    with pytest.raises(hw.InputError, match=r"^spikes of 'x': values other than 0 and 1"):
        hw.simulate(builder.build(), np.ones((3, 2), dtype=np.int64).astype(dtype))


@pytest.mark.parametrize("channels", [1, 15, 16, 63, 64, 65, 156])
@pytest.mark.parametrize("density", [0.0, 0.03, 0.5, 1.0])
def test_rows_of_every_length_are_listed(channels, density):
    recordings = (np.random.default_rng(channels).random((3, 7, channels)) < density).astype(
        np.uint8
    )
    expected = playing.list_events("x", recordings)
    lists = event_scan.list_events("x", recordings)
    assert np.array_equal(lists.first, expected.first)
    assert np.array_equal(lists.channel, expected.channel)


@pytest.mark.parametrize(
    "shape",
    [(5, 300, 500), (2, 1100, 500), (40, 3, 500)],
    ids=["some", "one at a time", "all together"],  # recordings that a thread lists at a time
)
def test_a_batch_is_listed_in_threads_as_one(shape, monkeypatch):
    """The lists of a part begin where those of earlier parts end, and a byte above 1 in the last part is refused."""
    monkeypatch.setattr(threads, "cores", lambda: 2)
    recordings = (np.random.default_rng(0).random(shape) < 0.02).astype(np.uint8)
    expected = playing.list_events("x", recordings)
    lists = event_scan.list_events("x", recordings)
    assert np.array_equal(lists.first, expected.first)
    assert np.array_equal(lists.channel, expected.channel)
    program = hw.ProgramBuilder(hw.chip("loihi-sim"))
    n = program.add_compartments("n", 1, threshold=90)
    program.connect(program.add_input("x", 500), n, np.full((1, 500), 2))
    recordings[-1, -1, -1] = 2
    with pytest.raises(hw.InputError, match="values other than 0 and 1"):
        hw.simulate(program.build(), recordings)


OF_EVERY_WIDTH = """\
import numpy as np
from hw_model.engine import lanes
lanes.can = lambda feature: {moves}
import hw_model as hw
from hw_model.engine.events import list_events
r = np.random.default_rng(1)
for channels in (*range(1, 70), 127, 128, 129, 200):
    for density in (0.03, 0.5, 1.0):
        recordings = (r.random((2, 5, channels)) < density).astype(np.uint8)
        lists = list_events("x", recordings)
        rows, channel = np.nonzero(recordings.reshape(10, -1))
        assert lists.channel.tolist() == channel.tolist(), channels
        ends = np.searchsorted(rows, np.arange(11))
        assert np.array_equal(lists.first, [ends[:6], ends[5:]]), channels
from tests.support.hybrids import random_hybrid
for seed in range(12):
    program, recording = random_hybrid(seed, channels_per_step=1 + seed % 3)
    pushed = hw.Session(program).push(recording)
    expected = hw.simulate(program, recording, engine="reference")
    assert np.array_equal(pushed.scores[-1], expected.scores), seed
"""


@pytest.mark.minutes
@pytest.mark.parametrize("moves", [False, True], ids=["one by one", "at once"])
def test_lists_are_the_same_on_every_processor(moves, tmp_path):
    paths = os.pathsep.join(map(str, (Path(__file__).parents[2], Path(__file__).parent)))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": paths}
    script = OF_EVERY_WIDTH.format(moves=moves)
    process = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, env=environment
    )
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "features", "moves"),
    [
        ("generic", None, False),
        (None, "+sse4.2,+avx2", False),
        (None, "+avx2,-avx512f,+avx512fp16", False),
        (None, "+avx2,+avx512f", True),
        ("generic", "+avx512f", True),
    ],
)
def test_features_are_those_of_the_processor_compiled_for(monkeypatch, name, features, moves):
    monkeypatch.setattr(config, "CPU_NAME", name)
    monkeypatch.setattr(config, "CPU_FEATURES", features)
    assert lanes.can.__wrapped__("avx512f") is moves
