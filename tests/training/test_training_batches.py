"""What an epoch is fed: stratified parts, every recording once, events dropped and never added."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.data.read import stratified_split
from locsnn_compile.training.batches import (
    add_events,
    augmented,
    batches,
    cut_end,
    drop,
    epoch_generator,
    mix_taxels,
    shift_in_time,
    stretch_time,
)
from locsnn_compile.training.config import TrainingConfig


@pytest.mark.parametrize(
    ("per_class", "fraction", "held"),
    [
        pytest.param(16, 0.125, 2, id="two of sixteen"),
        pytest.param(12, 0.1667, 2, id="two of twelve"),
        pytest.param(4, 0.1, 1, id="at least one"),
        pytest.param(1, 0.5, 0, id="never the only one"),
        pytest.param(2, 0.9, 1, id="never all"),
        pytest.param(8, 0.0, 0, id="none asked for"),
    ],
)
def test_every_class_gives_its_share(per_class: int, fraction: float, held: int) -> None:
    labels = np.repeat(np.arange(5), per_class)
    training, validation = stratified_split(labels, fraction, seed=3)
    assert np.bincount(labels[validation], minlength=5).tolist() == [held] * 5
    assert sorted([*training, *validation]) == list(range(len(labels)))


def test_a_seed_gives_its_own_split() -> None:
    labels = np.repeat(np.arange(3), 8)
    first, again, other = (stratified_split(labels, 0.25, seed)[1].tolist() for seed in (1, 1, 2))
    assert first == again
    assert first != other


@given(samples=st.integers(1, 20), size=st.integers(1, 8), seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_every_recording_once(samples: int, size: int, seed: int) -> None:
    spikes = np.zeros((samples, 2, 3), dtype=np.uint8)
    labels = np.arange(samples)
    config = TrainingConfig(batch_size=size, event_dropout=0.0, channel_dropout=0.0)
    fed = list(batches(spikes, labels, config, epoch_generator(seed, 1, 1)))
    assert sorted(np.concatenate([y for _, y in fed])) == list(range(samples))
    assert {len(y) for _, y in fed[:-1]} <= {size}


@given(largest=st.floats(0, 1), seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_dropping_never_adds(largest: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    spikes = (rng.random((4, 10, 6)) < 0.5).astype(np.float32)
    kept = drop(spikes, largest, rng)
    assert kept.dtype == np.float32
    assert ((kept == spikes) | (kept == 0)).all()


def test_whole_channels_are_dropped() -> None:
    spikes = np.ones((300, 5, 78), dtype=np.float32)
    kept = drop(spikes, 0.4, epoch_generator(0, 1, 1), 78)
    assert (kept == kept[:, :1]).all()
    assert 1 - kept.mean() == pytest.approx(0.2, abs=0.02)
    assert drop(spikes, 0.0, epoch_generator(0, 1, 1), 78) is spikes


def test_dropping_takes_another_share_of_every_recording() -> None:
    spikes = np.ones((400, 50, 40), dtype=np.float32)
    share = 1 - drop(spikes, 0.6, epoch_generator(0, 1, 1)).mean(axis=(1, 2))
    # Uniform on 0..0.6: mean 0.3, standard deviation 0.6 / sqrt(12).
    assert share.mean() == pytest.approx(0.3, abs=0.03)
    assert share.std() == pytest.approx(0.6 / np.sqrt(12), abs=0.02)
    assert share.max() < 0.63


def test_dropped_taxels_lose_both_polarities() -> None:
    spikes = np.ones((40, 3, 78), dtype=np.float32)
    kept = drop(spikes, 0.5, epoch_generator(0, 1, 1), 39)
    by_taxel = kept[:, 0].reshape(40, 39, 2)
    assert (by_taxel[:, :, 0] == by_taxel[:, :, 1]).all()
    assert (kept == kept[:, :1]).all()
    assert 0.7 < kept.mean() < 0.8
    assert drop(spikes, 0.0, epoch_generator(0, 1, 1), 39) is spikes


@given(steps=st.integers(1, 9), largest=st.integers(1, 12), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_a_shift_moves_every_event_alike_and_loses_what_leaves(
    steps: int, largest: int, seed: int
) -> None:
    spikes = (np.random.default_rng(seed).random((4, steps, 3)) < 0.5).astype(np.float32)
    moved = shift_in_time(spikes, largest, epoch_generator(seed, 1, 1))
    for before, after in zip(spikes, moved, strict=True):
        padded = np.concatenate([np.zeros((largest, 3)), before, np.zeros((largest, 3))])
        shifts = [
            padded[largest - by : largest - by + steps] for by in range(-largest, largest + 1)
        ]
        assert any(np.array_equal(after, shifted) for shifted in shifts)


def test_shifts_go_both_ways() -> None:
    spikes = np.zeros((60, 9, 1), dtype=np.float32)
    spikes[:, 4] = 1
    moved = shift_in_time(spikes, 2, epoch_generator(0, 1, 1))
    assert set(moved.argmax(axis=1).ravel()) == {2, 3, 4, 5, 6}
    assert shift_in_time(spikes, 0, epoch_generator(0, 1, 1)) is spikes


def test_what_is_off_does_not_change_what_is_drawn() -> None:
    spikes = np.ones((4, 5, 78), dtype=np.float32)
    alone = drop(drop(spikes, 0.5, rng := epoch_generator(1, 1, 1)), 0.3, rng, 78)
    both = augmented(
        spikes, TrainingConfig(event_dropout=0.5, channel_dropout=0.3), epoch_generator(1, 1, 1)
    )
    assert np.array_equal(both, alone)


def test_noise_adds_and_never_drops() -> None:
    spikes = (np.random.default_rng(0).random((200, 20, 78)) < 0.1).astype(np.float32)
    noisy = add_events(spikes, 0.2, epoch_generator(0, 1, 1))
    assert noisy.dtype == np.float32
    assert (noisy[spikes == 1] == 1).all()
    assert noisy[spikes == 0].mean() == pytest.approx(0.1, abs=0.01)
    assert add_events(spikes, 0.0, epoch_generator(0, 1, 1)) is spikes


def test_whole_taxels_are_mixed() -> None:
    ours, theirs = np.zeros((100, 3, 78), dtype=np.float32), np.ones((100, 3, 78), dtype=np.float32)
    mixed = mix_taxels(ours, theirs, 0.5, epoch_generator(0, 1, 1))
    by_taxel = mixed.reshape(100, 3, 39, 2)
    assert mixed.dtype == np.float32
    assert (by_taxel == by_taxel[:, :1, :, :1]).all()
    assert mixed.mean() == pytest.approx(0.25, abs=0.03)


def test_mixing_stays_within_a_class() -> None:
    labels = np.repeat(np.arange(2), 6)
    spikes = np.zeros((12, 12, 78), dtype=np.uint8)
    spikes[np.arange(12), np.arange(12)] = 1  # step i is set in recording i alone
    config = TrainingConfig(batch_size=5, event_dropout=0.0, channel_dropout=0.0, mixing=1.0)
    fed = list(batches(spikes, labels, config, epoch_generator(0, 1, 1)))
    x, y = np.concatenate([x for x, _ in fed]), np.concatenate([y for _, y in fed])
    assert (x.sum(axis=1) == 1).all()  # each channel is that of one recording
    assert (x.argmax(axis=1) // 6 == y[:, None]).all()
    assert len({tuple(steps) for steps in x.argmax(axis=1)[y == 0].tolist()}) == 6
    assert (x.argmax(axis=1) != x.argmax(axis=1)[:, :1]).any()


def test_taxels_are_moved_by_themselves_with_both_polarities() -> None:
    spikes = np.zeros((60, 9, 78), dtype=np.float32)
    spikes[:, 4] = 1
    moved = (
        shift_in_time(spikes, 2, epoch_generator(0, 1, 1), parts=39)
        .argmax(axis=1)
        .reshape(60, 39, 2)
    )
    assert (moved[:, :, 0] == moved[:, :, 1]).all()
    assert set(moved.ravel()) == {2, 3, 4, 5, 6}
    assert all(len(set(recording)) > 1 for recording in moved[:, :, 0].tolist())


def test_recordings_end_early() -> None:
    spikes = np.ones((300, 40, 4), dtype=np.float32)
    cut = cut_end(spikes, 0.5, epoch_generator(0, 1, 1))
    assert cut.dtype == np.float32
    assert (np.diff(cut, axis=1) <= 0).all()  # after the end there is silence
    assert (cut == cut[:, :, :1]).all()
    ends = cut[:, :, 0].sum(axis=1)
    assert (ends.min(), ends.max()) == (21, 40)
    assert ends.mean() == pytest.approx(30.5, abs=0.8)
    assert cut_end(spikes, 0.0, epoch_generator(0, 1, 1)) is spikes


def test_times_are_stretched_recording_by_recording() -> None:
    spikes = np.zeros((400, 100, 2), dtype=np.float32)
    spikes[:, [20, 80], 1] = 1
    moved = stretch_time(spikes, 0.1, epoch_generator(0, 1, 1))
    assert moved.dtype == np.float32
    assert not moved[:, :, 0].any()
    early, late = (moved[:, half, 1] for half in (slice(0, 50), slice(50, 100)))
    assert (early.sum(axis=1) == 1).all()
    assert (late.sum(axis=1) == 1).all()
    first, second = early.argmax(axis=1), 50 + late.argmax(axis=1)
    assert (first.min(), first.max(), second.min(), second.max()) == (18, 22, 72, 88)
    # One rate for a recording: its later event moves four times as far.
    assert np.corrcoef(first, second)[0, 1] > 0.9
    assert stretch_time(spikes, 0.0, epoch_generator(0, 1, 1)) is spikes


def test_stretched_events_that_leave_are_lost_and_those_that_meet_are_one() -> None:
    spikes = np.ones((200, 50, 3), dtype=np.float32)
    moved = stretch_time(spikes, 0.5, epoch_generator(0, 1, 1))
    assert set(np.unique(moved)) == {0, 1}
    ends = 50 - moved[:, ::-1, 0].argmax(axis=1)  # played faster, a recording ends early
    assert (ends.min(), ends.max()) == (25, 50)


def test_a_configuration_stretches_time() -> None:
    spikes = np.zeros((60, 40, 4), dtype=np.float32)
    spikes[:, 30] = 1
    config = TrainingConfig(event_dropout=0.0, channel_dropout=0.0, time_stretch=0.2)
    assert (
        len(
            {
                int(step)
                for step in augmented(spikes, config, epoch_generator(0, 1, 1))[:, :, 0].argmax(
                    axis=1
                )
            }
        )
        > 5
    )
