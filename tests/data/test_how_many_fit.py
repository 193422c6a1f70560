"""Recordings that are too large for memory are refused; the message says how many fit, and what to do with the parts."""

from __future__ import annotations

import numpy as np
import pytest

from locsnn_compile.data import axes, recordings
from locsnn_compile.data.recordings import Recordings, check_size
from locsnn_compile.errors import InputError


def test_as_many_recordings_as_fit_are_accepted(monkeypatch):
    monkeypatch.setattr(recordings, "MAX_ELEMENTS", 3 * 4 * 5)
    three = np.zeros((3, 4, 5), np.uint8)
    assert len(Recordings(three, labels=None, step_seconds=None, source="three")) == 3


def test_more_recordings_are_refused_with_the_number_that_fits(monkeypatch):
    monkeypatch.setattr(recordings, "MAX_ELEMENTS", 3 * 4 * 5)
    with pytest.raises(InputError) as refused:
        Recordings(np.zeros((4, 4, 5), np.uint8), labels=None, step_seconds=None, source="four")
    assert str(refused.value) == (
        "recordings 'four': its recordings of 4 x 4 x 5 are too large (80 values against 60). Give at "
        "most 3 at a time and average the figures of the parts, or give wider bins."
    )


def test_a_recording_that_does_not_fit_alone_needs_wider_bins():
    with pytest.raises(InputError) as refused:
        check_size(samples=1, steps=300_000, channels=1000, where="file 'long.npy'")
    assert str(refused.value) == (
        "file 'long.npy': its recordings of 1 x 300000 x 1000 are too large (300000000 values against "
        "200000000). Give wider bins, or shorter recordings."
    )


def test_a_large_array_is_refused_before_its_axes_are_reordered(monkeypatch):
    """Reordering would copy it."""
    monkeypatch.setattr(axes, "MAX_ELEMENTS", 1000)
    monkeypatch.setattr(recordings, "MAX_ELEMENTS", 1000)
    with pytest.raises(InputError) as refused:
        axes.order_of(np.zeros((14, 10, 10), np.uint8), "file 'a.npy'", channels=None, order=None)
    assert str(refused.value) == (
        "file 'a.npy': it is too large (1400 values against 1000). Give at most 10 at a time and "
        "average the figures of the parts, or give wider bins."
    )
