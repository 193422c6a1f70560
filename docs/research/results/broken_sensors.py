"""Sensors that are not what they were in training: dead taxels, lost events, clocks that are off.

A *change* takes spikes (samples, steps, channels) and a random generator, and returns what such a sensor would have recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from hw_model.values import ByteArray

DRAWS = 5
"""How often taxels or events are drawn."""
TAXELS, POLARITIES = 39, 2
SHARES = (0.05, 0.1, 0.2)

Change = Callable[[ByteArray, np.random.Generator], ByteArray]


def dead_taxels(share: float) -> Change:
    """Silence a share of the taxels, all polarities of each, the same ones in every recording."""

    def change(spikes: ByteArray, rng: np.random.Generator) -> ByteArray:
        taxels = spikes.shape[2] // POLARITIES
        dead = rng.choice(taxels, round(share * taxels), replace=False)
        alive = ~np.isin(np.arange(spikes.shape[2]) // POLARITIES, dead)
        return np.asarray(spikes * alive, dtype=np.uint8)

    return change


def lost_events(share: float) -> Change:
    """Drop each event with this probability."""
    return lambda spikes, rng: np.asarray(
        spikes * (rng.random(spikes.shape) >= share), dtype=np.uint8
    )


def clock(rate: float) -> Change:
    """Bin events with a clock that runs at ``rate`` of the right one: an event of step t is recorded in step rate * t.

    Events after the last step are lost; events that fall into one bin become one.
    """

    def change(spikes: ByteArray, rng: np.random.Generator) -> ByteArray:
        sample, step, channel = np.nonzero(spikes)
        moved = np.floor((step + 0.5) * rate).astype(np.int64)
        moved_spikes, is_in_time = np.zeros_like(spikes), moved < spikes.shape[1]
        moved_spikes[sample[is_in_time], moved[is_in_time], channel[is_in_time]] = 1
        return moved_spikes

    return change


def changes() -> Iterator[tuple[str, Change, int]]:
    """Yield what is wrong with a sensor, in words, the change, and how often it is drawn."""
    yield "nothing", lambda spikes, rng: spikes, 1
    for share in SHARES:
        yield (
            f"{round(share * TAXELS)} of {TAXELS} taxels dead ({share:.0%})",
            dead_taxels(share),
            DRAWS,
        )
    for share in SHARES:
        yield f"{share:.0%} of events lost", lost_events(share), DRAWS
    yield "clock 10 % fast", clock(1.1), 1
    yield "clock 10 % slow", clock(0.9), 1
