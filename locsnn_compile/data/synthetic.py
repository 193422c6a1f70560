"""Synthetic touches with a sensor's layout, for tests and demonstrations without recordings.

They do not model any real object.

A contact with the round pressure profile p = exp(-d^2 / (2 r^2)) strokes over the fingertip: it comes down, moves to
and fro along a line through the taxels, and lifts. A taxel fires rising events while its pressure grows and falling
events while it shrinks, with a probability proportional to the change. Noise events come anywhere and at any time. A
sensor of another size is touched as if it were as large as a NeuTouch fingertip. Taxels without positions are placed in
a row. A taxel with a single polarity fires at changes in either direction.
"""

import math

import numpy as np

from hw_model.values import BoolArray, FloatArray
from locsnn_compile.data.recordings import MAX_ELEMENTS, Recordings
from locsnn_compile.data.sensor import TAXEL_COORDINATES_MM, SensorLayout, neutouch
from locsnn_compile.errors import check_most, check_range

EVENT_SHARE = 2490 / (250 * 78)
"""Share of bins with an event: 2490 events in 250 steps of 78 channels, as in the published Ev-Objects.

All other numbers of this file are made up: they make motions that differ by class and vary within one.
"""
NOISE_SHARE = 0.1
"""Share of the events that are noise."""
RADIUS_MM = 2.5
"""The radius r of the contact."""
REACH_MM = 7.0
"""How far a stroke reaches from the middle of its line."""


def synthetic_touches(  # noqa: PLR0913 - public: each is an option of its own
    samples: int,
    *,
    steps: int,
    fingertips: int = 1,
    classes: int = 6,
    seed: int = 0,
    step_seconds: float | None = 0.02,
    sensor: SensorLayout | None = None,
) -> Recordings:
    """Return ``samples`` recordings (samples, steps, channels) with labels 0, 1, ... in turn.

    Channels are those of ``sensor``, by default of NeuTouch ``fingertips``. A class is a motion: the direction
    of its strokes, their number, and the step at which the contact comes down. Where and how hard it touches varies
    between recordings. Equal arguments give equal recordings. Raises ``InputError`` for numbers out of range.
    """
    # Name -> (value, least, most).
    limits = {
        "samples": (samples, 1, 100_000),
        "steps": (steps, 1, 20_000),
        "classes": (classes, 1, 4_096),
        "fingertips": (fingertips, 1, 16),
        "seed": (seed, 0, 2**32 - 1),
    }
    for name, limit in limits.items():
        check_range(*limit, f"synthetic touches, {name!r}")
    labels = np.arange(samples, dtype=np.int64) % classes
    sensor = sensor or neutouch(fingertips)
    size = samples * steps * sensor.channels
    check_most(
        size,
        MAX_ELEMENTS,
        "synthetic touches",
        "they are too large",
        unit="values",
        fix="Ask for fewer.",
    )
    spikes = np.empty((samples, steps, sensor.channels), dtype=np.uint8)
    for sample, label in enumerate(labels):
        # A generator per recording, so that the first n are the same however many are made. PCG64 is
        # named because numpy may change its default generator.
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, sample])))
        spikes[sample] = _touch(int(label), classes, steps, sensor, rng)
    return Recordings(spikes, labels, step_seconds, source="synthetic touches", origin="made up")


def _places_mm(sensor: SensorLayout) -> FloatArray:
    """Return where taxels are touched, (taxels, 2): around (0, 0), as far out as the taxels of NeuTouch."""
    places = sensor.places
    if places is None:
        places = np.stack([np.arange(sensor.taxels), np.zeros(sensor.taxels)], axis=1)
    from_middle = places - (places.min(axis=0) + places.max(axis=0)) / 2
    largest = float(np.abs(from_middle).max())
    scale = float(np.abs(TAXEL_COORDINATES_MM).max()) / largest if largest else 1.0
    places_mm: FloatArray = from_middle * scale
    return places_mm


def _touch(
    label: int, classes: int, steps: int, sensor: SensorLayout, rng: np.random.Generator
) -> BoolArray:
    """Return the events (steps, channels) of one recording."""
    # The class decides direction, number of strokes and beginning, each with some scatter.
    angle = 2 * math.pi * label / classes + rng.normal(0, 0.1)
    strokes = 1.0 + label % 3
    begin = (0.05 + 0.1 * (label % 2) + rng.uniform(0, 0.03)) * steps
    length = (0.75 + rng.uniform(-0.03, 0.03)) * steps
    time = (np.arange(steps) - begin) / length
    # From here on, time runs from 0 to 1 during the touch. The contact is pressed down within its
    # first twentieth and lifted within its last.
    force = np.clip(20 * time, 0, 1) * np.clip(20 * (1 - time), 0, 1)
    along = REACH_MM * np.cos(2 * math.pi * strokes * time)
    aside = rng.normal(0, 1.0)  # millimetres between the line of the strokes and the middle
    centre_x = math.cos(angle) * along - math.sin(angle) * aside
    centre_y = math.sin(angle) * along + math.cos(angle) * aside
    taxels = _places_mm(sensor)
    activity = np.empty((steps, sensor.surfaces, sensor.taxels, sensor.polarities))
    for fingertip in range(sensor.surfaces):
        # Fingertips face each other, so the second one sees the motion mirrored.
        x = centre_x if fingertip % 2 == 0 else -centre_x
        square = (taxels[:, 0] - x[:, np.newaxis]) ** 2 + (
            taxels[:, 1] - centre_y[:, np.newaxis]
        ) ** 2
        pressure = force[:, np.newaxis] * np.exp(-square / (2 * RADIUS_MM**2))
        change = np.diff(pressure, axis=0, prepend=np.zeros((1, sensor.taxels)))
        both = np.stack([np.maximum(change, 0), np.maximum(-change, 0)], axis=-1)
        activity[:, fingertip] = (
            both if sensor.polarities == 2 else both.sum(axis=-1, keepdims=True)
        )
    share = _scaled(activity.reshape(steps, -1), EVENT_SHARE * (1 - NOISE_SHARE))
    noise = EVENT_SHARE * NOISE_SHARE
    # The probability that at least one of two independent causes makes an event.
    return rng.random(share.shape) < share + noise - share * noise


def _scaled(activity: FloatArray, mean: float) -> FloatArray:
    """Return probabilities of at most 0.9, proportional to ``activity`` below that, with this ``mean`` if possible."""
    share = activity
    # Clipping lowers the mean, and rescaling raises the values that are not clipped to restore it. Eight
    # rounds come close enough; the number was chosen by hand, as was 0.9.
    for _ in range(8):
        total = float(share.mean())
        if total == 0:
            break
        share = np.minimum(share * (mean / total), 0.9)
    return share
