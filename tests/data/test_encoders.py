"""Encoders turn plain numbers into spikes: as rates, as latencies, or where a signal crosses levels.

Each states how far the numbers that can be decoded from the spikes are from the original ones.
"""

import numpy as np
import pytest

from locsnn_compile.data import (
    latency_spikes,
    level_spikes,
    rate_spikes,
    read_recordings,
    write_recordings,
)
from locsnn_compile.errors import InputError


def test_rates_are_the_share_of_steps_with_a_spike():
    values = np.array([[0.0, 0.25, 1.0]])
    steps = 10_000
    encoded = rate_spikes(values, steps, seed=3)
    rates = encoded.spikes.sum(axis=1) / steps
    assert rates[0, [0, 2]].tolist() == [0.0, 1.0]
    # A spike in each step with probability p has a rate with a standard deviation of sqrt(p (1 - p) / steps).
    assert abs(rates[0, 1] - 0.25) < 5 * np.sqrt(0.25 * 0.75 / steps)
    assert encoded.decoded.tolist() == rates.tolist()
    assert encoded.largest_error == abs(rates[0, 1] - 0.25)


def test_the_loss_of_rates_is_the_stated_one():
    values = np.full((100, 100), 0.3)
    encoded = rate_spikes(values, 40, seed=0)
    assert encoded.rms_error == pytest.approx(np.sqrt(0.3 * 0.7 / 40), rel=0.03)


def test_a_seed_gives_the_same_spikes_again():
    values = np.full((2, 5), 0.5)
    first = rate_spikes(values, 20, seed=1).spikes
    assert np.array_equal(rate_spikes(values, 20, seed=1).spikes, first)
    assert not np.array_equal(rate_spikes(values, 20, seed=2).spikes, first)


def test_larger_values_spike_earlier():
    encoded = latency_spikes(np.array([[1.0, 0.5, 0.0, 0.74]]), 5)
    assert np.argwhere(encoded.spikes[0].T).tolist() == [[0, 0], [1, 2], [2, 4], [3, 1]]
    assert encoded.decoded.tolist() == [[1.0, 0.5, 0.0, 0.75]]


def test_latencies_lose_half_a_step_at_most():
    values = np.linspace(0, 1, 1001)[None]
    encoded = latency_spikes(values, 11)
    assert encoded.largest_error == pytest.approx(0.05)
    assert encoded.spikes.sum(axis=1).tolist() == [[1] * 1001]


def test_a_signal_spikes_where_it_has_moved_by_the_threshold():
    signal = np.array([2.0, 2.5, 3.0, 4.5, 4.5, 4.4, 2.0])
    encoded = level_spikes(signal[None, :, None], 1.0)
    falling = encoded.spikes[0, :, 0]
    rising = encoded.spikes[0, :, 1]
    assert rising.tolist() == [0, 0, 1, 1, 0, 0, 0]
    assert falling.tolist() == [0, 0, 0, 0, 0, 0, 1]
    assert encoded.decoded[0, :, 0].tolist() == [2, 2, 3, 4, 4, 4, 3]
    assert encoded.largest_error == 1.0


def test_slow_signals_are_off_by_less_than_the_threshold():
    rng = np.random.default_rng(0)
    signals = np.cumsum(rng.uniform(-0.1, 0.1, (3, 500, 4)), axis=1)
    assert level_spikes(signals, 0.1).largest_error < 0.1


def test_encoded_values_are_written_and_read_as_recordings(tmp_path):
    encoded = level_spikes(np.array([[[0.0], [1.0], [-1.0]]]), 1.0)
    recordings = encoded.recordings(labels=np.array([4]), step_seconds=0.01)
    write_recordings(tmp_path / "a.npz", recordings)
    back = read_recordings(tmp_path / "a.npz")
    assert np.array_equal(back.spikes, encoded.spikes)
    assert back.labels.tolist() == [4]
    assert back.step_seconds == 0.01


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: rate_spikes(np.zeros(3), 5, seed=0),
            "values: they are not numbers of axes (samples, channels) "
            "(float64 of shape (3,)). Give such an array.",
        ),
        (
            lambda: level_spikes(np.zeros((1, 0, 2)), 1.0),
            "values: they are not numbers of axes (samples, steps, signals) "
            "(float64 of shape (1, 0, 2)). Give such an array.",
        ),
        (
            lambda: latency_spikes(np.array([[0.5, 1.5]]), 5),
            "values: one is out of range (1.5). Scale them to 0..1.",
        ),
        (
            lambda: rate_spikes(np.array([[np.nan]]), 5, seed=0),
            "values: one is out of range (nan). Scale them to 0..1.",
        ),
        (
            lambda: level_spikes(np.array([[[np.inf]]]), 1.0),
            "values: one is out of range (inf). Give finite numbers.",
        ),
        (
            lambda: level_spikes(np.zeros((1, 2, 1)), 0.0),
            "threshold: it is not above 0 (0.0). Give a positive number.",
        ),
        (
            lambda: latency_spikes(np.zeros((1, 1)), 1),
            "steps: their number is out of range (1 against 2 to 20000). Give another number.",
        ),
        (
            lambda: rate_spikes(np.zeros((300, 100)), 20_000, seed=0),
            "values: their spikes are too many (600000000 against 200000000). "
            "Give fewer samples or steps.",
        ),
    ],
    ids=["axes", "empty", "above 1", "nan", "infinite", "threshold", "steps", "too large"],
)
def test_values_that_cannot_be_encoded_are_refused(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value) == message
