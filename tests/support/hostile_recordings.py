"""Recordings that ask the most of a program: every channel always, in turns, and in one burst."""

from __future__ import annotations

import numpy as np

import hw_model as hw


def hostile(
    program: hw.ChipProgram, rows: int, spikes: dict[str, np.ndarray], seed: int
) -> dict[str, np.ndarray]:
    """The recordings of a case, and others: every channel always, in turns, in one burst, at random rates."""
    r = np.random.default_rng(seed)
    batches = {}
    for name, channels in program.streams.items():
        full = np.ones((1, rows, channels), dtype=np.uint8)
        turns = full.copy()
        turns[:, ::2] = 0
        burst = np.zeros_like(full)
        burst[:, : max(1, rows // 3)] = 1
        random = (r.random((4, rows, channels)) < r.random((4, 1, 1))).astype(np.uint8)
        batches[name] = np.concatenate((spikes[name], full, turns, burst, random))
    return batches
