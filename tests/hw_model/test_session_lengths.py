"""Lengths of sessions: no rows, fewer or more than the program's steps, more than a tile, and any number.

Scores are compared with the reference engine, and memory must not grow with the rows.
"""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings

import hw_model as hw
from hw_model.mapping.graph import Phase, Readout
from hw_model.mapping.routing import InputRoute
from hw_model.rtl.images import CoreProgram
from hw_model.simulation import ENGINES
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs, random_hybrid
from tests.support.register_units import FORGETS_AT_ONCE
from tests.support.session_programs import (
    SEEDS,
    TOGETHER,
    check_session_after_every_step,
    largest_potential_so_far,
    live_program,
)


def test_a_recording_is_as_long_as_the_longest_phase_over_time():
    program, recording = random_hybrid(3)
    short = [Phase(name, "time", 1) for name in ("before", "after")]
    nowhere = np.zeros(0, dtype=np.int64)
    (touch,) = (item for item in program.inputs if item.phase == "time")
    longer = replace(
        program,
        phases=(short[0], *program.phases, short[1]),
        inputs=(
            *program.inputs,
            *(replace(touch, name=phase.name, phase=phase.name) for phase in short),
        ),
        input_routes=(
            *program.input_routes,
            *(InputRoute(phase.name, nowhere, nowhere, nowhere) for phase in short),
        ),
    )
    scores = hw.Session(longer, 10.0).push(recording).scores
    assert np.array_equal(scores, hw.Session(program, 10.0).push(recording).scores)
    assert not np.array_equal(scores, hw.Session(program).push(recording).scores)


@pytest.mark.slow
@pytest.mark.parametrize("psi", [None, 10.0], ids=["plain", "time-weighted"])
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, channels_per_step=TOGETHER)
def test_rows_past_the_end_change_nothing(psi, seed, channels_per_step):
    program, recording = random_hybrid(seed, channels_per_step)
    session = hw.Session(program, psi)
    last = session.push(recording)
    after = session.push(np.ones((5, recording.shape[1]), dtype=np.uint8))
    assert np.array_equal(after.scores, np.repeat(last.scores[-1:], 5, axis=0))
    assert session.steps == len(recording) + 5


def test_pushing_no_rows_changes_nothing():
    program, recording = random_hybrid(1)
    session = hw.Session(program)
    assert session.push(recording[:0]).scores.shape == (0, program.populations["time/y"])
    assert session.push(recording[:0]).prediction.shape == (0,)
    check_session_after_every_step(program, recording, session.push(recording))


@pytest.mark.usefixtures("unchecked")  # the check takes memory of its own
def test_a_live_program_takes_no_more_memory_for_more_rows():
    """Rows are pushed by thousands or one by one, and memory does not grow with them."""
    program = live_program()
    rows = (np.random.default_rng(5).random((10_000, 6)) < 0.2).astype(np.uint8)
    session = hw.Session(program)
    scores = session.push(rows)
    counts = hw.simulate(program, rows).spikes["y"].cumsum(axis=0, dtype=np.int64)
    assert np.array_equal(scores.spikes["y"], counts)
    assert counts[-1].min() > 0

    session.reset()
    one_by_one = [session.push(row).spikes["y"] for row in rows[:10]]
    assert np.array_equal(np.concatenate(one_by_one), counts[:10])
    bytes_after = {}
    tracemalloc.start()
    try:
        for start in range(10, len(rows), 10):
            session.push(rows[start : start + 10])
            if session.steps in (5_000, 10_000):
                bytes_after[session.steps] = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert session.steps == len(rows)
    # Less than a byte per row: nothing is stored for each of them.
    assert bytes_after[10_000] - bytes_after[5_000] < 4_000


@pytest.mark.parametrize(
    ("threshold", "first"), [(300, None), (100_000, 3), (100_000, 66)], ids=["spikes", "3", "66"]
)
@pytest.mark.parametrize("cuts", [[], [70], [3, 5, 140]], ids=["at once", "in two", "in four"])
def test_recordings_longer_than_a_tile_give_the_same_scores(threshold, first, cuts):
    """Tiles have 64 rows. Two inputs pause in between, and potentials are largest in the first tile or in the last."""
    builder = hw.ProgramBuilder(CHIP)
    y = builder.add_compartments(
        "y", 2, decay_u=FORGETS_AT_ONCE, decay_v=[1000, 2000], threshold=threshold, refractory=2
    )
    for name, weights in (("x", [[100], [60]]), ("z", [[-20, 100], [140, -80]])):
        builder.connect(builder.add_input(name, len(weights[0])), y, weights)
    builder.read_out(y)
    program = replace(builder.build(), readout=Readout(("y",), (1.0,), first))
    r = np.random.default_rng(7)
    density = np.repeat([0.9, 0.0, 0.3], [50, 40, 60])[:, None]
    streams = {
        name: (r.random((150, n)) < density).astype(np.uint8) for name, n in (("x", 1), ("z", 2))
    }
    whole = hw.simulate(program, streams, engine="reference", probe=("spikes", "potential"))
    if first is None:
        expected = whole.spikes["y"].cumsum(axis=0, dtype=np.int64)
    else:
        expected = largest_potential_so_far(whole.potential["y"], first)
    session = hw.Session(program)
    for _ in range(2):
        session.reset()
        parts = [
            {name: rows[a:b] for name, rows in streams.items()}
            for a, b in pairwise([0, *cuts, 150])
        ]
        assert np.array_equal(
            np.concatenate([session.push(part).scores for part in parts]), expected[:150]
        )
    assert len(np.unique(expected)) > 5


@pytest.mark.parametrize("engine", ["reference", "fast"])
@pytest.mark.parametrize("rows", [4, 5, 6], ids=["one row short", "as long", "one row long"])
def test_recordings_about_as_long_as_their_program_lose_no_step(rows, engine):
    """An event acts in the step after its row, so the last row of five has no effect."""
    builder = hw.ProgramBuilder(CHIP)
    y = builder.add_compartments(
        "y", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    builder.connect(builder.add_input("x", 1), y, [[20]])
    program = builder.build()
    program = replace(program, phases=(replace(program.phases[0], steps=5),))
    result = hw.simulate(program, np.ones((rows, 1), dtype=np.uint8), engine=engine)
    assert result.spikes["y"].tolist() == [[0], [1], [1], [1], [1]]


@pytest.mark.parametrize("rows", [1, 2, 6], ids=["one row", "fewer rows than visits", "more rows"])
def test_a_transposed_phase_that_does_not_say_its_length_lasts_as_long_as_its_visits(rows):
    """It is so in a session and in both engines, for any number of rows; the last visit would act after the end."""
    builder = hw.ProgramBuilder(CHIP)
    y = builder.add_compartments(
        "y", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    builder.connect(builder.add_input("x", 2), y, [[20, 20]])
    program = program_of_graphs(
        CHIP,
        Readout(("y",), (1.0,)),
        graph_in_phase(builder.graph(), "location", steps=None, positions=np.arange(4)),
    )
    recording = np.ones((rows, 4), dtype=np.uint8)
    session = hw.Session(program)
    assert session.push(recording).spikes["y"].tolist() == [[3]] * rows
    assert session.spikes("y").tolist() == [[0], [1], [1], [1]]
    assert CoreProgram(program, rows).phases[-1].steps == 4
    for engine in ENGINES:
        result = hw.simulate(program, recording, engine=engine)
        assert result.spikes["y"].tolist() == [[0], [1], [1], [1]]
        assert result.counts.events_dropped == max(0, rows - 2) * 4
        longer = hw.simulate(program, recording, steps=6, engine=engine)
        assert longer.spikes["y"].tolist() == [[0], [1], [1], [1], [1], [0]]
