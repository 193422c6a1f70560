"""Early stops in silence: no event for some rows, all registers 0, and no charge on its way.

The expected step is computed from the registers and rows of a whole simulation.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from tests.support.early_stops import SEEDS, by_potentials, one_layer, random_layer
from tests.support.hybrids import CHIP
from tests.support.register_units import FORGETS_AT_ONCE


def at_rest_for(program: hw.ChipProgram, recording: np.ndarray) -> list[int]:
    """Return for how many rows, up to each step, all registers of phases over time have been 0."""
    result = hw.simulate(program, recording, probe=("u", "v"))
    steps = len(recording)
    is_zero = np.ones(steps, dtype=np.bool_)
    for phase in program.phases:
        if phase.axis == "time":
            for name in program.columns_of(phase.name):
                is_zero &= ~result.u[name][:steps].any(axis=1)
                is_zero &= ~result.v[name][:steps].any(axis=1)
    # A step at rest begins and ends with registers of 0.
    was_zero = np.concatenate(([True], is_zero[:-1]))
    at_rest = is_zero & was_zero
    rows_at_rest = 0
    rows_before_each_step = []
    for step_rests in at_rest.tolist():
        rows_at_rest = rows_at_rest + 1 if step_rests else 0
        rows_before_each_step.append(rows_at_rest)
    return rows_before_each_step


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, silence=st.integers(1, 6), first=st.sampled_from([None, 0, 4]))
def test_stops_in_silence_are_at_the_first_step_at_rest(seed, silence, first):
    """They are at the first step with enough silent rows, all registers 0, and no charge on its way."""
    program, _ = random_layer(seed)
    program = by_potentials(program, first)
    rows = 90
    r = np.random.default_rng(seed)
    recordings = (r.random((4, rows, program.inputs[0].channels)) < 0.1).astype(np.uint8)
    recordings &= (np.arange(rows) < r.integers(0, rows, (4, 1)))[:, :, None].astype(np.uint8)
    stops = hw.stop_in_silence(program, recordings, silence)
    cores = program.cores_of("time")
    under_way = 1 + max(int(core.axons.delay.max(initial=0)) for core in cores)
    biased = any(core.bias.any() for core in cores)
    final = hw.simulate(program, recordings).prediction
    for step, prediction, recording, end in zip(
        stops.steps, stops.prediction, recordings, final, strict=True
    ):
        rests = at_rest_for(program, recording)
        expected_step = rows
        silent_rows = 0
        for t in range(1, rows + 1):
            silent_rows = 0 if recording[t - 1].any() else silent_rows + 1
            is_silent = silent_rows >= max(silence, under_way)
            if is_silent and rests[t - 1] >= under_way and not biased:
                expected_step = t
                break
        assert step == expected_step
        events_after_stop = recording[step:].any()
        assert prediction == end or events_after_stop
    assert (stops.all_steps, stops.final.tolist()) == (rows, final.tolist())
    assert biased or (stops.steps < rows).any()


def test_a_stop_in_silence_saves_the_steps_after_it():
    """Class 0 spikes once, and rests from step 2 on: after three silent rows, a recording stops after step 4."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE)
    program = builder.build()
    recording = np.zeros((2, 12, 2), dtype=np.uint8)
    recording[:, 0, 0] = recording[1, 10, 1] = 1
    stops = hw.stop_in_silence(program, recording, 3)
    assert stops.steps.tolist() == [4, 4]
    assert stops.all_steps == 12
    assert stops.prediction.tolist() == [0, 0]
    # Two recordings, the steps, two compartments.
    assert (stops.counts.neuron_updates, stops.all_counts.neuron_updates) == (2 * 4 * 2, 2 * 12 * 2)
    assert (stops.counts.spikes, stops.all_counts.spikes) == (2, 3)
    profile = CHIP.profile(CHIP.default_profile)

    def total_ns(recordings):
        activities = hw.simulate(program, recordings, probe=("activity",)).activity["time"]
        return sum(
            hw.latency(program, {"time": activity}, profile).total_ns for activity in activities
        )

    assert stops.latency_ns == pytest.approx(total_ns(recording[:, :4]))
    assert stops.all_latency_ns == pytest.approx(total_ns(recording))
    assert hw.stop_in_silence(program, recording[:, :3], 3).steps.tolist() == [3, 3]


def test_silence_waits_for_what_is_under_way():
    """An event takes five steps to arrive. Meanwhile all registers are 0, but it is too early to stop."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    y = builder.add_compartments(
        "y", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=30
    )
    builder.connect(x, y, [[60]], delay=5)
    builder.read_out(y)
    recording = np.zeros((1, 20, 1), dtype=np.uint8)
    recording[0, 2] = 1
    # Sent in row 2 it acts in row 8, and row 9 forgets it. Rows 10 to 15 are the first six at rest.
    assert hw.stop_in_silence(builder.build(), recording, 2).steps.tolist() == [16]
