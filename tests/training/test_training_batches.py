"""The batches of an epoch: the division into training and validation, the order of recordings, and augmentation.

Augmentations are random; their shares are compared with the distributions that they are drawn from.
"""

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

TAXELS = 39
CHANNELS = 2 * TAXELS
"""Channels of a fingertip, two polarities for each taxel."""


@pytest.mark.parametrize(
    ("per_class", "fraction", "held_out"),
    [
        pytest.param(16, 0.125, 2, id="two of sixteen"),
        pytest.param(12, 0.1667, 2, id="two of twelve"),
        pytest.param(4, 0.1, 1, id="at least one"),
        pytest.param(1, 0.5, 0, id="never the only one"),
        pytest.param(2, 0.9, 1, id="never all"),
        pytest.param(8, 0.0, 0, id="no validation"),
    ],
)
def test_the_share_of_every_class_is_held_out(
    per_class: int, fraction: float, held_out: int
) -> None:
    labels = np.repeat(np.arange(5), per_class)
    training, validation = stratified_split(labels, fraction, seed=3)
    assert np.bincount(labels[validation], minlength=5).tolist() == [held_out] * 5
    assert sorted([*training, *validation]) == list(range(len(labels)))


def test_equal_seeds_give_equal_splits_and_different_seeds_do_not() -> None:
    labels = np.repeat(np.arange(3), 8)
    first, again, other = (stratified_split(labels, 0.25, seed)[1].tolist() for seed in (1, 1, 2))
    assert first == again
    assert first != other


@given(samples=st.integers(1, 20), size=st.integers(1, 8), seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_every_recording_is_in_one_batch_of_an_epoch(samples: int, size: int, seed: int) -> None:
    spikes = np.zeros((samples, 2, 3), dtype=np.uint8)
    labels = np.arange(samples)
    config = TrainingConfig(batch_size=size, event_dropout=0.0, channel_dropout=0.0)
    epoch = list(batches(spikes, labels, config, epoch_generator(seed, 1, 1)))
    assert sorted(np.concatenate([y for _, y in epoch])) == list(range(samples))
    assert {len(y) for _, y in epoch[:-1]} <= {size}  # the last one may be smaller


@given(largest=st.floats(0, 1), seed=st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_dropping_never_adds_events(largest: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    spikes = (rng.random((4, 10, 6)) < 0.5).astype(np.float32)
    kept = drop(spikes, largest, rng)
    assert kept.dtype == np.float32
    assert ((kept == spikes) | (kept == 0)).all()


def test_channels_are_dropped_in_all_steps() -> None:
    spikes = np.ones((300, 5, CHANNELS), dtype=np.float32)
    kept = drop(spikes, 0.4, epoch_generator(0, 1, 1), CHANNELS)
    assert (kept == kept[:, :1]).all()
    # The probability is uniform on 0..0.4.
    assert 1 - kept.mean() == pytest.approx(0.2, abs=0.02)
    assert drop(spikes, 0.0, epoch_generator(0, 1, 1), CHANNELS) is spikes


def test_every_recording_draws_its_own_probability_of_dropping() -> None:
    spikes = np.ones((400, 50, 40), dtype=np.float32)
    share = 1 - drop(spikes, 0.6, epoch_generator(0, 1, 1)).mean(axis=(1, 2))
    # Uniform on 0..0.6: mean 0.3, standard deviation 0.6 / sqrt(12).
    assert share.mean() == pytest.approx(0.3, abs=0.03)
    assert share.std() == pytest.approx(0.6 / np.sqrt(12), abs=0.02)
    assert share.max() < 0.63


def test_dropped_taxels_lose_both_polarities() -> None:
    spikes = np.ones((40, 3, CHANNELS), dtype=np.float32)
    kept = drop(spikes, 0.5, epoch_generator(0, 1, 1), TAXELS)
    by_taxel = kept[:, 0].reshape(40, TAXELS, 2)
    assert (by_taxel[:, :, 0] == by_taxel[:, :, 1]).all()
    assert (kept == kept[:, :1]).all()
    assert 0.7 < kept.mean() < 0.8  # the probability is uniform on 0..0.5, so 0.75 is expected
    assert drop(spikes, 0.0, epoch_generator(0, 1, 1), TAXELS) is spikes


@given(steps=st.integers(1, 9), largest=st.integers(1, 12), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_a_shift_moves_all_events_alike_and_loses_those_that_leave(
    steps: int, largest: int, seed: int
) -> None:
    spikes = (np.random.default_rng(seed).random((4, steps, 3)) < 0.5).astype(np.float32)
    moved = shift_in_time(spikes, largest, epoch_generator(seed, 1, 1))
    for before, after in zip(spikes, moved, strict=True):
        # After must be one of all possible shifts of before.
        silence = np.zeros((largest, 3))
        padded = np.concatenate([silence, before, silence])
        possible = [
            padded[largest - by : largest - by + steps] for by in range(-largest, largest + 1)
        ]
        assert any(np.array_equal(after, shifted) for shifted in possible)


def test_shifts_go_both_ways() -> None:
    spikes = np.zeros((60, 9, 1), dtype=np.float32)
    spikes[:, 4] = 1
    moved = shift_in_time(spikes, 2, epoch_generator(0, 1, 1))
    assert set(moved.argmax(axis=1).ravel()) == {2, 3, 4, 5, 6}
    assert shift_in_time(spikes, 0, epoch_generator(0, 1, 1)) is spikes


def test_augmentations_that_are_off_draw_nothing() -> None:
    spikes = np.ones((4, 5, CHANNELS), dtype=np.float32)
    rng = epoch_generator(1, 1, 1)
    by_hand = drop(drop(spikes, 0.5, rng), 0.3, rng, CHANNELS)
    config = TrainingConfig(event_dropout=0.5, channel_dropout=0.3)
    assert np.array_equal(augmented(spikes, config, epoch_generator(1, 1, 1)), by_hand)


def test_noise_adds_events_and_never_drops_any() -> None:
    spikes = (np.random.default_rng(0).random((200, 20, CHANNELS)) < 0.1).astype(np.float32)
    noisy = add_events(spikes, 0.2, epoch_generator(0, 1, 1))
    assert noisy.dtype == np.float32
    assert (noisy[spikes == 1] == 1).all()
    assert noisy[spikes == 0].mean() == pytest.approx(0.1, abs=0.01)
    assert add_events(spikes, 0.0, epoch_generator(0, 1, 1)) is spikes


def test_mixing_takes_taxels_with_both_polarities_in_all_steps() -> None:
    ours = np.zeros((100, 3, CHANNELS), dtype=np.float32)
    theirs = np.ones((100, 3, CHANNELS), dtype=np.float32)
    mixed = mix_taxels(ours, theirs, 0.5, epoch_generator(0, 1, 1))
    by_taxel = mixed.reshape(100, 3, TAXELS, 2)
    assert mixed.dtype == np.float32
    assert (by_taxel == by_taxel[:, :1, :, :1]).all()
    assert mixed.mean() == pytest.approx(0.25, abs=0.03)


def test_mixing_stays_within_a_class() -> None:
    labels = np.repeat(np.arange(2), 6)
    spikes = np.zeros((12, 12, CHANNELS), dtype=np.uint8)
    # Recording i has its events in step i, so the step of an event shows which recording it comes from.
    spikes[np.arange(12), np.arange(12)] = 1
    config = TrainingConfig(batch_size=5, event_dropout=0.0, channel_dropout=0.0, mixing=1.0)
    epoch = list(batches(spikes, labels, config, epoch_generator(0, 1, 1)))
    x = np.concatenate([batch for batch, _ in epoch])
    y = np.concatenate([batch_labels for _, batch_labels in epoch])
    assert (x.sum(axis=1) == 1).all()
    origin = x.argmax(axis=1)  # (samples, channels)
    assert (origin // 6 == y[:, None]).all()
    assert len({tuple(row) for row in origin[y == 0].tolist()}) == 6
    assert (origin != origin[:, :1]).any()


def test_every_taxel_moves_by_itself_with_both_polarities() -> None:
    samples = 60
    spikes = np.zeros((samples, 9, CHANNELS), dtype=np.float32)
    spikes[:, 4] = 1
    moved = shift_in_time(spikes, 2, epoch_generator(0, 1, 1), parts=TAXELS)
    new_step = moved.argmax(axis=1).reshape(samples, TAXELS, 2)
    assert (new_step[:, :, 0] == new_step[:, :, 1]).all()
    assert set(new_step.ravel()) == {2, 3, 4, 5, 6}
    assert all(len(set(recording)) > 1 for recording in new_step[:, :, 0].tolist())


def test_recordings_are_cut_at_their_end() -> None:
    spikes = np.ones((300, 40, 4), dtype=np.float32)
    cut = cut_end(spikes, 0.5, epoch_generator(0, 1, 1))
    assert cut.dtype == np.float32
    assert (np.diff(cut, axis=1) <= 0).all()  # after the end there is silence
    assert (cut == cut[:, :, :1]).all()
    ends = cut[:, :, 0].sum(axis=1)
    # Rounded up from a uniform length of 20..40 steps.
    assert (ends.min(), ends.max()) == (21, 40)
    assert ends.mean() == pytest.approx(30.5, abs=0.8)
    assert cut_end(spikes, 0.0, epoch_generator(0, 1, 1)) is spikes


def test_all_times_of_a_recording_are_stretched_by_one_rate() -> None:
    spikes = np.zeros((400, 100, 2), dtype=np.float32)
    spikes[:, [20, 80], 1] = 1
    moved = stretch_time(spikes, 0.1, epoch_generator(0, 1, 1))
    assert moved.dtype == np.float32
    assert not moved[:, :, 0].any()
    early, late = (moved[:, half, 1] for half in (slice(0, 50), slice(50, 100)))
    assert (early.sum(axis=1) == 1).all()
    assert (late.sum(axis=1) == 1).all()
    first = early.argmax(axis=1)
    second = 50 + late.argmax(axis=1)
    # 20 and 80, by 10 % to either side.
    assert (first.min(), first.max()) == (18, 22)
    assert (second.min(), second.max()) == (72, 88)
    # The later event of a recording moves four times as far as the earlier one.
    assert np.corrcoef(first, second)[0, 1] > 0.9
    assert stretch_time(spikes, 0.0, epoch_generator(0, 1, 1)) is spikes


def test_stretched_events_that_leave_are_lost_and_events_in_one_step_become_one() -> None:
    spikes = np.ones((200, 50, 3), dtype=np.float32)
    moved = stretch_time(spikes, 0.5, epoch_generator(0, 1, 1))
    assert set(np.unique(moved)) == {0, 1}
    ends = 50 - moved[:, ::-1, 0].argmax(axis=1)  # a recording that is sped up ends early
    assert (ends.min(), ends.max()) == (25, 50)


def test_the_option_time_stretch_stretches_time() -> None:
    spikes = np.zeros((60, 40, 4), dtype=np.float32)
    spikes[:, 30] = 1
    config = TrainingConfig(event_dropout=0.0, channel_dropout=0.0, time_stretch=0.2)
    stretched = augmented(spikes, config, epoch_generator(0, 1, 1))
    steps = stretched[:, :, 0].argmax(axis=1)
    assert len(set(steps.tolist())) > 5
