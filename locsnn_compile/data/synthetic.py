"""Synthetic touches with the sensor's layout, for checks without recordings; no claim about any real object.

A contact with a round pressure profile p = exp(-d^2 / (2 r^2)) strokes over the fingertip: it comes down,
moves to and fro along a line through the taxels, and lifts. Taxels fire rising events while their pressure
grows, falling events while it shrinks, with a probability proportional to the change; noise events come
anywhere, any time.
"""

import math

import numpy as np

from hw_model.arithmetic.arrays import BoolArray, FloatArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXEL_COORDINATES_MM, TAXELS
from locsnn_compile.errors import check_range

#: Share of bins with an event: 2490 events in 250 steps of 78 channels, as in the published Ev-Objects.
EVENT_SHARE = 2490 / (250 * 78)
#: Share of the events that are noise, and the radius r of the contact in millimetres.
NOISE_SHARE, RADIUS_MM = 0.1, 2.5
#: A stroke reaches this far from the middle of its line, in millimetres.
REACH_MM = 7.0


def synthetic_touches(
    samples: int, *, steps: int, fingertips: int = 1, classes: int = 6, seed: int = 0, step_seconds: float = 0.02
) -> Recordings:
    """Return ``samples`` recordings (samples, steps, 78 * fingertips) with labels 0, 1, ... in turn.

    A class is a motion: the direction of its strokes, their number and the step at which the contact comes
    down. Where and how hard it touches varies from recording to recording. Equal arguments give equal
    recordings. Raises ``InputError`` for numbers out of range.
    """
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
    spikes = np.empty((samples, steps, fingertips * TAXELS * POLARITIES), dtype=np.uint8)
    for sample, label in enumerate(labels):
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, sample])))
        spikes[sample] = _touch(int(label), classes, steps, fingertips, rng)
    return Recordings(spikes, labels, step_seconds, "synthetic touches", "made up")


def _touch(label: int, classes: int, steps: int, fingertips: int, rng: np.random.Generator) -> BoolArray:
    """Return the events (steps, channels) of one recording."""
    angle = 2 * math.pi * label / classes + rng.normal(0, 0.1)
    strokes = 1.0 + label % 3
    begin = (0.05 + 0.1 * (label % 2) + rng.uniform(0, 0.03)) * steps
    length = (0.75 + rng.uniform(-0.03, 0.03)) * steps
    time = (np.arange(steps) - begin) / length
    # Pressed down and lifted within a twentieth of the touch each.
    force = np.clip(20 * time, 0, 1) * np.clip(20 * (1 - time), 0, 1)
    along = REACH_MM * np.cos(2 * math.pi * strokes * time)
    aside = rng.normal(0, 1.0)
    centre_x = math.cos(angle) * along - math.sin(angle) * aside
    centre_y = math.sin(angle) * along + math.cos(angle) * aside
    taxels = np.array(TAXEL_COORDINATES_MM)
    activity = np.empty((steps, fingertips, TAXELS, POLARITIES))
    for fingertip in range(fingertips):
        # Fingertips face each other, so the second sees the motion mirrored.
        x = centre_x if fingertip % 2 == 0 else -centre_x
        square = (taxels[:, 0] - x[:, np.newaxis]) ** 2 + (taxels[:, 1] - centre_y[:, np.newaxis]) ** 2
        pressure = force[:, np.newaxis] * np.exp(-square / (2 * RADIUS_MM**2))
        change = np.diff(pressure, axis=0, prepend=np.zeros((1, TAXELS)))
        activity[:, fingertip, :, 0] = np.maximum(change, 0)
        activity[:, fingertip, :, 1] = np.maximum(-change, 0)
    share = _scaled(activity.reshape(steps, -1), EVENT_SHARE * (1 - NOISE_SHARE))
    noise = EVENT_SHARE * NOISE_SHARE
    return rng.random(share.shape) < share + noise - share * noise


def _scaled(activity: FloatArray, mean: float) -> FloatArray:
    """Return ``activity`` as probabilities of at most 0.9 with this ``mean``, or as near to it as there is
    activity.
    """
    share = activity
    # Clipping takes from the mean; a few rounds of rescaling give it back to what is not clipped.
    for _ in range(8):
        total = float(share.mean())
        if total == 0:
            break
        share = np.minimum(share * (mean / total), 0.9)
    return share
