"""The example networks on the published test recordings: time, memory, start-up, and what skipping silent steps saves.

Figures are recorded for the page. Asserted is that memory does not grow and that skipping changes no spike.
"""

from __future__ import annotations

import statistics
import time

import child
import numpy as np
import pytest
from machine import machine
from workloads import RECORDINGS, example_levels, published_test_part

import hw_model as hw

pytestmark = [
    pytest.mark.bench,
    pytest.mark.skipif(
        not RECORDINGS.is_dir(), reason="the published recordings are not beside the repository"
    ),
]

BATCHES = (1, 10, 100)
"""How often all test recordings are played in a row, to see whether memory grows."""
ROUNDS = 25
QUICK_ROUNDS = 3


@pytest.fixture
def example(request):
    """Return the program of an example and its test recordings."""
    return example_levels(request.param).program, published_test_part(request.param).spikes


@pytest.fixture
def files(example, tmp_path):
    """Return the paths of a saved program and of its recordings."""
    program, recordings = example
    program.save(tmp_path / "program")
    np.save(tmp_path / "recordings.npy", recordings)
    return tmp_path / "program", tmp_path / "recordings.npy"


@pytest.mark.parametrize("example", ["objects"], indirect=True)
def test_time_of_the_whole_test_set_is_recorded(example, benchmark, record, quick):
    program, recordings = example
    result = hw.simulate(program, recordings)
    benchmark.pedantic(
        hw.simulate,
        (program, recordings),
        rounds=QUICK_ROUNDS if quick else ROUNDS,
        warmup_rounds=1,
    )
    found = {
        "recordings": len(recordings),
        "seconds": benchmark.stats.stats.median,
        "synaptic_ops": result.counts.synaptic_ops,
        "neuron_updates": result.counts.neuron_updates,
        "machine": machine(),
    }
    benchmark.extra_info.update(found)
    record("test_set", found)


@pytest.mark.parametrize("example", ["objects"], indirect=True)
def test_memory_does_not_grow_with_recordings(files, record, quick):
    found = [
        child.run("stream.py", *files, batches) for batches in (BATCHES[:2] if quick else BATCHES)
    ]
    record("stream", {"streams": found, "machine": machine()})
    assert found[-1]["peak_mib"] < 1.1 * found[0]["peak_mib"]  # a tenth for the allocator


@pytest.mark.parametrize("example", ["objects"], indirect=True)
def test_seconds_of_start_up_are_recorded_without_and_with_compiled_code(files, tmp_path, record):
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    found = {
        state: child.run("start_up.py", *files, environment=cache) for state in ("cold", "warm")
    }
    record("start_up", {**found, "machine": machine()})


@pytest.mark.parametrize("example", ["containers"], indirect=True)
def test_skipping_silent_steps_changes_no_spike(example, record, quick):
    program, recordings = example
    seconds: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(QUICK_ROUNDS if quick else ROUNDS):
        for skip, found in seconds.items():
            start = time.perf_counter()
            hw.simulate(program, recordings, skip=skip)
            found.append(time.perf_counter() - start)
    kept, all_updated = (hw.simulate(program, recordings, skip=skip) for skip in (True, False))
    assert all(
        np.array_equal(kept.spikes[name], spikes) for name, spikes in all_updated.spikes.items()
    )
    batch = len(recordings)
    phases = {}
    for phase in program.phases:
        counts = kept.counts_by_phase[phase.name]
        steps = phase.steps or recordings.shape[1]
        phases[phase.name] = {
            "steps": steps,
            "skipped_steps": counts.skipped_steps / batch,
            "neuron_updates": counts.neuron_updates / batch,
            "neuron_updates_skipped": counts.skipped_steps
            * (counts.neuron_updates / batch / steps)
            / batch,
            "at_rest": counts.neuron_updates_inactive / counts.neuron_updates,
        }
    record(
        "silence",
        {
            "recordings": batch,
            "silent_rows": float(np.mean([int(r.any(axis=1).argmax()) for r in recordings])),
            "seconds": statistics.median(seconds[True]) / batch,
            "seconds_without": statistics.median(seconds[False]) / batch,
            "phases": phases,
            "machine": machine(),
        },
    )
