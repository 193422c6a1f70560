"""Sessions: after every step the same scores as a simulation of the recording so far, however its rows were pushed."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.mapping.graph import Readout, decided
from tests.support.hybrids import (
    CHIP,
    graph_in_phase,
    program_of_graphs,
    random_branch,
    random_hybrid,
)
from tests.support.real_recordings import REAL, on_real_recordings
from tests.support.register_units import FORGETS_AT_ONCE
from tests.support.session_programs import (
    SEEDS,
    TOGETHER,
    check_session_after_every_step,
    joined_scores,
    live_program,
)

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, channels_per_step=TOGETHER, silence=st.integers(0, 2))
def test_every_step_equals_a_run_of_the_recording_so_far(seed, channels_per_step, silence):
    program, recording = random_hybrid(seed, channels_per_step, silence)
    session = hw.Session(program)
    check_session_after_every_step(program, recording, session.push(recording))
    whole = hw.simulate(program, recording)
    for name in program.spiking & program.columns_of("location").keys():
        assert np.array_equal(session.spikes(name), whole.spikes[name]), name


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    seed=SEEDS,
    first=st.one_of(st.integers(0, 9), st.tuples(st.integers(0, 9), st.none() | st.integers(0, 9))),
    rows=st.sampled_from([1, 3, 80]),
)
def test_largest_potentials_so_far_do_not_depend_on_how_rows_are_pushed(seed, first, rows):
    """Rows are pushed one by one, in small parts and at once, and all again after a reset."""
    program, recording = random_hybrid(seed)
    program = replace(program, readout=replace(program.readout, potentials_from=first))
    session = hw.Session(program)
    for _ in range(2):
        parts = [session.push(recording[at : at + rows]) for at in range(0, len(recording), rows)]
        check_session_after_every_step(program, recording, joined_scores(parts))
        session.reset()


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, channels_per_step=TOGETHER, data=st.data())
def test_any_split_of_the_rows_gives_the_same(seed, channels_per_step, data):
    program, recording = random_hybrid(seed, channels_per_step)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(recording)), max_size=6)))
    at_once = hw.Session(program)
    in_parts = hw.Session(program)
    whole = at_once.push(recording)
    parts = [in_parts.push(part) for part in np.split(recording, cuts)]
    assert np.array_equal(np.concatenate([part.scores for part in parts]), whole.scores)
    for name, counts in whole.spikes.items():
        assert np.array_equal(np.concatenate([part.spikes[name] for part in parts]), counts), name
    assert (in_parts.steps, in_parts.replayed) == (at_once.steps, at_once.replayed)


@pytest.mark.parametrize("names", list(permutations("abc")), ids="".join)
@pytest.mark.parametrize(
    "first", [None, 0, (None, 1, None)], ids=lambda first: f"potentials from {first}"
)
def test_scores_are_added_in_the_order_of_the_readout_everywhere(names, first):
    """0.1 + 0.2 + 0.3 is another float than 0.2 + 0.3 + 0.1, so the order could decide between equal classes."""
    graphs = []
    for name in "abc":
        b = hw.ProgramBuilder(CHIP)
        x = b.add_input(f"{name}/x", 1)
        y = b.add_compartments(
            name, 2, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=9
        )
        b.connect(x, y, [[20], [14]])
        graph = graph_in_phase(b.graph(), "time", steps=None)
        phase = replace(graph.phases[0], name=name)
        inputs = tuple(replace(item, phase=name) for item in graph.inputs)
        groups = tuple(replace(group, phase=name) for group in graph.groups)
        graphs.append(replace(graph, phases=(phase,), inputs=inputs, groups=groups))
    weights = {"a": 0.1, "b": 0.2, "c": 0.3}
    readout = Readout(names, tuple(weights[name] for name in names), first)
    program = program_of_graphs(CHIP, readout, *graphs)
    recording = np.array([[1], [0]], dtype=np.uint8)
    result = hw.simulate(program, recording, probe=("spikes", "potential"))
    batch = {
        kind: {n: array[None] for n, array in getattr(result, kind).items()}
        for kind in ("spikes", "potential")
    }
    assert result.scores.tolist() == readout.scores(**batch)[0].tolist()
    assert result.scores.tolist() == hw.Session(program).push(recording).scores[-1].tolist()
    assert (
        result.scores.tolist()
        == hw.simulate(program, recording, engine="reference").scores.tolist()
    )


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_a_session_gives_the_same_row_by_row_and_after_a_reset(seed):
    program, recording = random_hybrid(seed)
    session = hw.Session(program)
    first = [session.push(row).scores for row in recording]
    assert all(scores.shape[0] == 1 for scores in first)
    session.reset()
    assert (session.steps, session.replayed[0]) == (0, 0)
    assert np.array_equal(session.push(recording).scores, np.concatenate(first))


@pytest.mark.parametrize(
    "kind", ["read-only", "by columns", "every other", "booleans", "wide", "lists", "a subclass"]
)
def test_rows_of_any_kind_give_the_same(kind):
    program, recording = random_hybrid(5)
    rows = {
        "read-only": np.frombuffer(recording.tobytes(), np.uint8).reshape(recording.shape),
        "by columns": np.asfortranarray(recording),
        "every other": np.repeat(recording, 2, axis=1)[:, ::2],
        "booleans": recording.astype(np.bool_),
        "wide": recording.astype(np.int64),
        "lists": recording.tolist(),
        "a subclass": recording.view(np.memmap),
    }[kind]
    expected = hw.Session(program).push(recording).scores
    assert np.array_equal(hw.Session(program).push(rows).scores, expected)
    session = hw.Session(program)
    one_by_one = np.concatenate([session.push(row).scores for row in rows])
    assert np.array_equal(one_by_one, expected)
    assert np.array_equal(recording, random_hybrid(5)[1])


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, psi=st.sampled_from([0.0, 2.0, 10.0, 15.0, 5000.0]))
def test_time_weighted_scores_follow_their_formula(seed, psi):
    """With the rate psi, step t of n weighs the location branch by w = 1 / (1 + e^(-psi (t / n - 1))), time by 1 - w."""
    program, recording = random_hybrid(seed)
    plain = hw.Session(program).push(recording)
    weighted = hw.Session(program, psi).push(recording)
    steps = len(recording)
    for t in range(1, steps + 1):
        exponent = psi * (1 - t / steps)
        w = 0.0 if exponent > 700 else 1 / (1 + np.exp(exponent))  # e^710 exceeds a float
        time_weight, location_weight = program.readout.weights
        time_score = (1 - w) * time_weight * plain.spikes["time/y"][t - 1]
        location_score = w * location_weight * plain.spikes["location/y"][t - 1]
        expected = time_score + location_score
        assert np.allclose(weighted.scores[t - 1], expected, rtol=1e-12, atol=1e-300)


def test_silence_replays_no_step():
    program, recording = random_hybrid(2)
    session = hw.Session(program)
    session.push(np.zeros_like(recording))
    assert session.replayed[0] == 0
    assert session.replayed[1] >= len(recording) * recording.shape[1]


def test_an_event_replays_less_than_the_whole_phase():
    program, recording = random_hybrid(4)
    session = hw.Session(program)
    session.push(recording)
    steps_replayed, steps_of_full_replays = session.replayed
    assert 0 < steps_replayed < steps_of_full_replays


@pytest.mark.parametrize(
    ("potentials_from", "first_steps"),
    [
        (None, {}),
        (3, {"a": 3, "b": 3}),
        ((None, 10), {"b": 10}),
        ((2, None), {"a": 2}),
        ((0, 1), {"a": 0, "b": 1}),
    ],
    ids=["spikes", "one for all", "the second", "the first", "one each"],
)
def test_populations_that_give_potentials_have_a_first_step_that_counts(
    potentials_from, first_steps
):
    assert Readout(("a", "b"), (1.0, 1.0), potentials_from).from_step == first_steps


@pytest.mark.parametrize(
    ("scores", "classes"),
    [
        ([1.0, 3.0, 3.0], 1),
        ([2.0, 2.0, 2.0], -1),
        ([2.0], 0),
        ([0.0], -1),
        ([[0.0, 0.0], [0.0, 1.0]], [-1, 1]),
    ],
    ids=[
        "first of equals",
        "all tie",
        "an only class",
        "an only class that is silent",
        "a row each",
    ],
)
def test_the_first_class_of_equals_is_decided_unless_all_tie(scores, classes):
    """-1: all classes tie, so none is predicted."""
    assert decided(np.array(scores)).tolist() == classes


def test_a_session_of_a_readout_of_one_branch():
    program, recording = random_hybrid(6)
    for name in ("time/y", "location/y"):
        alone = replace(program, readout=Readout((name,), (1.0,)))
        check_session_after_every_step(alone, recording, hw.Session(alone).push(recording))


def test_each_phase_reads_its_own_stream():
    program, recording = random_hybrid(7)
    named = replace(
        program, inputs=tuple(replace(item, stream=item.phase) for item in program.inputs)
    )
    reversed_recording = recording[::-1].copy()
    scores = hw.Session(named).push({"time": recording, "location": reversed_recording})
    assert np.array_equal(
        scores.spikes["time/y"], hw.Session(program).push(recording).spikes["time/y"]
    )
    assert np.array_equal(
        scores.spikes["location/y"],
        hw.Session(program).push(reversed_recording).spikes["location/y"],
    )


def _location_only() -> hw.ChipProgram:
    """Return a program without a time phase."""
    branch = random_branch(np.random.default_rng(0), "location", lines=8, classes=2, chip=CHIP)
    return program_of_graphs(
        CHIP, Readout(("location/y",), (1.0,)), graph_in_phase(branch, "location", 8)
    )


def _time_only() -> hw.ChipProgram:
    """Return a program without a location phase."""
    branch = random_branch(np.random.default_rng(0), "time", lines=8, classes=2, chip=CHIP)
    return program_of_graphs(
        CHIP, Readout(("time/y",), (1.0,)), replace(graph_in_phase(branch, "time", 8))
    )


def _mixed() -> hw.ChipProgram:
    """Return a program with a phase that plays one input as it comes and another one transposed."""
    program, _ = random_hybrid(8)
    item = program.inputs_of("location")[0]
    beside = replace(item, name="beside", positions=None)
    route = replace(program.route_of(item.name), input="beside")
    return replace(
        program, inputs=(*program.inputs, beside), input_routes=(*program.input_routes, route)
    )


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda p, _: hw.Session(replace(p, readout=None)), "program 'program': has no readout, so it predicts nothing. Add a readout."),
        (lambda p, _: hw.Session(_mixed()), "phase 'location': mixes transposed inputs with inputs that are played as they come, so it cannot run as they arrive. Use simulate."),
        (lambda p, _: hw.Session(live_program(), 10.0), "psi: the program does not say how long a recording is. Fix the steps of its phase."),
        (lambda p, _: hw.Session(_location_only(), 10.0), "psi: the program has no time phase to weigh against another. Leave it out."),
        (lambda p, _: hw.Session(_time_only(), 10.0), "psi: the program has no location phase to weigh against another. Leave it out."),
        (lambda p, _: hw.Session(p, -1.0), "psi: it is not a valid rate (got -1.0). Give 0 or more, such as 10."),
        (lambda p, _: hw.Session(p, float("nan")), "psi: it is not a valid rate (got nan). Give 0 or more, such as 10."),
        (lambda p, x: hw.Session(p).push(x[None]), "spikes: a session plays one recording. Give rows, (rows, channels)."),
        (lambda p, x: hw.Session(p).push(x[:, 1:]), "spikes of 'touch': the shape does not fit ((22, 7) against (steps, 8) or (batch, steps, 8)). Give one column per channel."),
        (lambda p, x: hw.Session(p).push(2 * x), "spikes of 'touch': values other than 0 and 1. Binarise the events; graded spikes do not exist here."),
        (lambda p, x: hw.Session(p).push({"other": x}), "spikes: its streams are not the program's inputs (touch). Give a mapping with one array for each."),
        (lambda p, x: hw.Session(p).spikes("time/y"), "population 'time/y': is in no transposed phase. Read its counts from push."),
    ],
    ids=["no readout", "mixed phase", "no length", "no time phase", "no location phase", "negative", "not a number", "batch", "channels", "values", "stream", "live population"],
)  # fmt: skip
def test_mistakes_are_refused_with_their_way_out(use, message):
    program, recording = random_hybrid(4)
    assert (recording.shape, recording.all()) == ((22, 8), True)
    with pytest.raises(hw.InputError) as caught:
        use(program, recording)
    assert str(caught.value) == message


@pytest.fixture(scope="module", params=["objects", "containers"])
def example(request):
    """The program of an example model, and its published test recordings."""
    from locsnn_compile.data.read import read_recordings
    from locsnn_compile.frontends import load
    from locsnn_compile.pipeline import lower

    program = lower(load(ROOT / f"examples/models/{request.param}-hybrid.pt"), CHIP, 8).program
    return program, read_recordings(REAL / f"Ev-{request.param.title()}.zip").spikes


@pytest.mark.slow
@on_real_recordings
def test_sessions_of_some_real_recordings(example):
    program, recordings = example
    session = hw.Session(program)
    for recording in recordings[:: len(recordings) // 2]:
        session.reset()
        check_session_after_every_step(program, recording, session.push(recording))


@pytest.mark.minutes
@on_real_recordings
def test_sessions_of_all_real_recordings(example):
    program, recordings = example
    session = hw.Session(program)
    for recording in recordings:
        session.reset()
        check_session_after_every_step(program, recording, session.push(recording))
