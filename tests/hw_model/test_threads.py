"""Several threads simulate one program at the same time: each has its own memory, and gets the results of one alone."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest

import hw_model as hw
from tests.support.session_programs import live_program

THREADS = 4
ROWS = 20_000
"""Rows of a recording: runs are long enough to overlap."""


def test_threads_do_not_disturb_each_other():
    """All begin together: first with a program that nobody has played yet, then twice with the same one again."""
    density = np.linspace(0.1, 0.7, THREADS)[:, None, None]
    recordings = (np.random.default_rng(0).random((THREADS, ROWS, 6)) < density).astype(np.uint8)
    program_of_one_thread = live_program()
    expected = [hw.simulate(program_of_one_thread, recording) for recording in recordings]
    program = live_program()
    begin = Barrier(THREADS)

    def play(recording: np.ndarray) -> list[hw.SimulationResult]:
        results = []
        for _ in range(3):
            begin.wait()
            results.append(hw.simulate(program, recording))
        return results

    with ThreadPoolExecutor(THREADS) as threads:
        results_by_thread = list(threads.map(play, recordings))
    for results, expected_result in zip(results_by_thread, expected, strict=True):
        for result in results:
            assert np.array_equal(result.spikes["y"], expected_result.spikes["y"])
            assert result.counts == expected_result.counts


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be taken away here")
def test_only_the_cores_that_a_process_may_use_are_counted():
    program = """\
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from hw_model.engine import threads
print(threads.cores())
"""
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert process.stdout == "1\n"
