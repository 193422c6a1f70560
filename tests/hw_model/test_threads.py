"""Several threads that play one program at the same time: each has rooms of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from sessions import live_program

import hw_model as hw

THREADS, ROWS = 4, 20_000


def test_threads_do_not_disturb_each_other():
    """All begin together, a program that nobody has played and then the same again; runs are long enough to overlap."""
    density = np.linspace(0.1, 0.7, THREADS)[:, None, None]
    recordings = (np.random.default_rng(0).random((THREADS, ROWS, 6)) < density).astype(np.uint8)
    alone, program, begin = live_program(), live_program(), Barrier(THREADS)
    wanted = [hw.simulate(alone, one) for one in recordings]

    def play(recording: np.ndarray) -> list[hw.SimulationResult]:
        found = []
        for _ in range(3):
            begin.wait()
            found.append(hw.simulate(program, recording))
        return found

    with ThreadPoolExecutor(THREADS) as threads:
        each = list(threads.map(play, recordings))
    for found, one in zip(each, wanted, strict=True):
        for result in found:
            assert np.array_equal(result.spikes["y"], one.spikes["y"])
            assert result.counts == one.counts


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be taken away here")
def test_cores_are_those_that_the_process_may_use():
    asks = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); from hw_model.engine import threads; print(threads.cores())"
    done = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
