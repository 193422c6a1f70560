"""Recordings that load a program most: events of all channels in every step, in every other step, and in one burst.

Tests of proven bounds (on registers, time and queues) check that no such recording exceeds them.
"""

from __future__ import annotations

import numpy as np

import hw_model as hw


def hostile(
    program: hw.ChipProgram, rows: int, spikes: dict[str, np.ndarray], seed: int
) -> dict[str, np.ndarray]:
    """Return the given recordings followed by hostile ones and by four of random rates, by stream.

    Recordings are (batch, rows, channels).
    """
    r = np.random.default_rng(seed)
    batches = {}
    for name, channels in program.streams.items():
        full = np.ones((1, rows, channels), dtype=np.uint8)
        every_other_row = full.copy()
        every_other_row[:, ::2] = 0
        burst = np.zeros_like(full)
        burst[:, : max(1, rows // 3)] = 1
        random = (r.random((4, rows, channels)) < r.random((4, 1, 1))).astype(np.uint8)
        batches[name] = np.concatenate((spikes[name], full, every_other_row, burst, random))
    return batches
