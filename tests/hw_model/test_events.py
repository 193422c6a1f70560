"""Lists of events: the compiled ones equal those of numpy, and both equal the recording."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hw_model import event_scan, playing
from hw_model.trace import PhaseInput

RECORDINGS = hnp.array_shapes(min_dims=3, max_dims=3, min_side=1, max_side=9).flatmap(
    lambda shape: hnp.arrays(np.uint8, shape, elements=st.integers(0, 1))
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(recordings=RECORDINGS, lines=st.integers(1, 12), seed=st.integers(0, 99))
def test_compiled_lists_equal_those_of_numpy(recordings, lines, seed):
    wanted = playing.list_events(recordings)
    found = event_scan.list_events(recordings)
    assert np.array_equal(found.first, wanted.first)
    assert np.array_equal(found.channel, wanted.channel)

    positions = np.random.default_rng(seed).permutation(recordings.shape[2])
    wanted = playing.transpose(wanted, positions, lines)
    found = event_scan.transpose(found, positions, lines)
    assert np.array_equal(found.first, wanted.first)
    assert np.array_equal(found.channel, wanted.channel)


@pytest.mark.parametrize("module", [event_scan, playing], ids=["compiled", "numpy"])
@settings(max_examples=30, deadline=None, derandomize=True)
@given(recordings=RECORDINGS)
def test_lists_hold_the_recording_and_transpose_it(module, recordings):
    events = module.list_events(recordings)
    none = np.zeros(len(recordings), dtype=np.int64)
    steps, channels = recordings.shape[1:]
    played = PhaseInput(steps, (channels,), (events,), none, none, none)
    turned = module.transpose(events, np.arange(channels)[::-1].copy(), steps)
    transposed = PhaseInput(channels, (steps,), (turned,), none, none, none)
    for b, recording in enumerate(recordings):
        assert np.array_equal(played.lines(b), recording)
        assert np.array_equal(played.lines(b, steps - 1), recording[-1:])
        assert np.array_equal(transposed.lines(b), recording.T[::-1])
    recording, channel = events.at(steps - 1)
    assert np.array_equal(np.stack((recording, channel)), np.nonzero(recordings[:, -1]))
    assert np.array_equal(events.until(steps), recordings.sum(axis=(1, 2)))


@pytest.mark.parametrize("module", [event_scan, playing], ids=["compiled", "numpy"])
def test_no_rows_and_no_events(module):
    assert module.list_events(np.zeros((2, 0, 3), dtype=np.uint8)).first.tolist() == [[0], [0]]
    assert module.list_events(np.zeros((2, 1, 3), dtype=np.uint8)).first.tolist() == [[0, 0], [0, 0]]
