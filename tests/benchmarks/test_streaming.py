"""A prediction after every step: a session against running the location branch anew for every step.

Both must give the same scores, all at once and row by row; their times are recorded.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import pytest
from hybrid_branches import branch_program, known_after_each_step
from machine import machine
from numpy.typing import NDArray
from workloads import RECORDINGS, example_levels, published_test_part

import hw_model as hw

pytestmark = [
    pytest.mark.bench,
    pytest.mark.skipif(
        not RECORDINGS.is_dir(), reason="the published recordings are not beside the repository"
    ),
]

TURNS = 16
QUICK_TURNS = 3


def test_a_session_scores_every_step_as_running_the_location_branch_anew(record, quick):
    levels = example_levels("objects")
    program, time_branch, location_branch = (
        levels.program,
        *(branch_program(levels.compartments, a) for a in ("time", "location")),
    )
    recordings = published_test_part("objects").spikes
    output = next(name for name in time_branch.readout.populations)
    session = hw.Session(program)

    def pushed_at_once(recording, _):
        session.reset()
        return session.push(recording).scores

    def pushed_row_by_row(recording, _):
        session.reset()
        return np.concatenate([session.push(row).scores for row in recording])

    def time_scores(recording):
        spikes = hw.simulate(time_branch, recording).spikes[output]
        return time_branch.readout.weights[0] * spikes.cumsum(axis=0, dtype=np.int64)

    def anew_at_once(recording, known):
        return time_scores(recording) + hw.simulate(location_branch, known).scores

    def anew_step_by_step(recording, known):
        return time_scores(recording) + np.stack(
            [hw.simulate(location_branch, rows).scores for rows in known]
        )

    kinds = (pushed_at_once, pushed_row_by_row, anew_at_once, anew_step_by_step)
    seconds: dict[str, list[float]] = {kind.__name__: [] for kind in kinds}
    for recording in recordings[: 1 + (QUICK_TURNS if quick else TURNS)]:
        known = known_after_each_step(recording)
        scores = [timed(seconds[kind.__name__], kind, recording, known) for kind in kinds]
        assert all(np.array_equal(scores[0], other) for other in scores[1:])
    found = {kind: statistics.median(times[1:]) for kind, times in seconds.items()}
    run, of_all = session.replayed
    record(
        "streaming",
        {"steps": recordings.shape[1], "again": run / of_all, **found, "machine": machine()},
    )


def timed(
    seconds: list[float], run: Callable[..., NDArray[np.float64]], *arguments: object
) -> NDArray[np.float64]:
    """Call a function, append the processor seconds that it took to ``seconds``, and return its result."""
    start = time.process_time()
    result = run(*arguments)
    seconds.append(time.process_time() - start)
    return result
