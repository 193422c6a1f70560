"""Phases that begin at the first touch: engines, sessions and early stops, against recordings that are cut by the test.

A phase that waits for the touch must do what the same phase does when it starts at once with the recording from the
touch on (:func:`check_phase`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.accounting.cost import step_times
from hw_model.mapping.graph import Readout
from tests.support.early_stops import possible_futures, with_stream_per_phase
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs, random_hybrid
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL, UNIT
from tests.support.session_programs import (
    check_session_after_every_step,
    joined_scores,
    largest_potential_so_far,
)

SEEDS = st.integers(0, 2**32 - 1)
EVENTS = st.sampled_from([None, 1, 1, 2, 3])
"""The events of a row with which a phase starts; None: it starts at once. Networks use 1, so it is drawn more often."""
KINDS = ["as drawn", "late", "at the last step", "empty", "longer"]
"""Kinds of recordings, which :func:`recording_of_kind` makes."""
REGISTERS = ("spikes", "u", "v", "potential")
"""The arrays of every compartment and step in which both engines must agree."""
PROBE = (*REGISTERS, "activity")
DAVIES = hw.chip("loihi-sim").profile("davies2018")
"""Any profile that has times: the test compares two latencies of one profile, and so takes no number from it."""


def starting_at_touch(
    program: hw.ChipProgram, time: int | None, location: int | None
) -> hw.ChipProgram:
    """Return a program whose phases start with the first row of that many events, or at once for None."""
    events = {"time": time, "location": location}
    phases = [replace(phase, align_events=events[phase.name]) for phase in program.phases]
    return replace(program, phases=tuple(phases))


def recording_of_kind(kind: str, recording: np.ndarray, r: np.random.Generator) -> np.ndarray:
    """Return a recording without its events before some step, or one that is longer than its program.

    ``as drawn``: none are gone; ``late``: those before a random step; ``at the last step``: all but
    those of the last step; ``empty``: all. ``longer``: silence, and then the recording twice.
    """
    steps, channels = recording.shape
    if kind == "longer":
        silent = np.zeros((int(r.integers(0, 60)), channels), dtype=np.uint8)
        return np.concatenate((silent, recording, recording))
    first_steps = {
        "as drawn": 0,
        "late": int(r.integers(steps)),
        "at the last step": steps - 1,
        "empty": steps,
    }
    is_left = np.arange(steps) >= first_steps[kind]
    return recording * is_left[:, None].astype(np.uint8)


def first_step_of(recording: np.ndarray, events: int | None) -> int:
    """Return the first step whose row has at least ``events`` events, or the number of steps if there is none."""
    if events is None:
        return 0
    touches = np.flatnonzero(recording.sum(axis=1, dtype=np.int64) >= events)
    return int(touches[0]) if len(touches) else len(recording)


def check_phase(
    program: hw.ChipProgram, result: hw.SimulationResult, recording: np.ndarray, name: str
) -> None:
    """Compare a phase with the same phase that starts at once and plays the recording from the touch on."""
    (phase,) = (phase for phase in program.phases if phase.name == name)
    start = first_step_of(recording, phase.align_events)
    waits = phase.align_events is not None
    counts = result.counts_by_phase[name]
    assert counts.aligned_steps == (start if waits else 0)

    from_touch = recording[start:]
    compared_steps = slice(None)
    if waits and name == "time":
        # A time phase runs in the steps of the recording; it is silent before the touch and after its own steps.
        from_touch = from_touch[: phase.steps]
        steps_of_result = max(phase.steps, len(recording))
        never_starts = start == len(recording)
        steps_run = 0 if never_starts else min(phase.steps, steps_of_result - start)
        compared_steps = slice(start, start + steps_run)
        check_steps_run(program, result, name, compared_steps, steps_of_result)
        if steps_run == 0:
            activity = {name: result.activity[name][0]}
            assert hw.latency(program, activity, DAVIES).total_ns == 0
            dropped = int(recording.sum())
            assert counts == hw.Counts(aligned_steps=start, events_dropped=dropped)
            return
        phase = replace(phase, steps=steps_run)

    starts_at_once = replace(phase, align_events=None)
    program_at_once = replace(program, phases=(starts_at_once,), readout=None)
    played = from_touch if len(from_touch) else np.zeros_like(recording[:1])
    expected = hw.simulate(program_at_once, played, engine="reference", probe=PROBE)
    for register in REGISTERS:
        for group, array in getattr(expected, register).items():
            compared = getattr(result, register)[group][compared_steps]
            assert np.array_equal(compared, array), (register, group)

    # All counts are equal, except those of steps and events before the touch, and of skipped steps.
    expected_counts = expected.counts_by_phase[name]
    events_played = expected_counts.input_events + expected_counts.transpose_events
    assert counts == replace(
        expected_counts,
        aligned_steps=counts.aligned_steps,
        events_dropped=int(recording.sum()) - events_played,
        skipped_steps=counts.skipped_steps,
    )
    if waits:
        activity = {name: result.activity[name][0]}
        activity_at_once = {name: expected.activity[name][0]}
        latency = hw.latency(program, activity, DAVIES)
        latency_at_once = hw.latency(program_at_once, activity_at_once, DAVIES)
        assert latency.by_phase_ns == pytest.approx(latency_at_once.by_phase_ns)


def check_steps_run(
    program: hw.ChipProgram,
    result: hw.SimulationResult,
    name: str,
    steps_run: slice,
    steps_of_result: int,
) -> None:
    """Check that a phase updates its compartments in ``steps_run``, and that its registers are 0 in all other steps."""
    compartments = sum(core.compartments for core in program.cores_of(name))
    updates = (steps_run.stop - steps_run.start) * compartments
    assert result.counts_by_phase[name].neuron_updates == updates
    for register in REGISTERS:
        by_group = getattr(result, register)
        for group in by_group.keys() & program.columns_of(name).keys():
            array = by_group[group]
            assert len(array) == steps_of_result
            assert not array[: steps_run.start].any()
            assert not array[steps_run.stop :].any()


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=SEEDS,
    time=EVENTS,
    location=EVENTS,
    kind=st.sampled_from(KINDS),
    channels_per_step=st.sampled_from([1, 2]),
)
def test_both_engines_play_a_recording_from_its_start_on(
    seed, time, location, kind, channels_per_step
):
    program, recording = random_hybrid(seed, channels_per_step)
    program = starting_at_touch(program, time, location)
    recording = recording_of_kind(kind, recording, np.random.default_rng(seed))
    slow = hw.simulate(program, recording, engine="reference", probe=PROBE)
    for skip in (True, False):
        fast = hw.simulate(program, recording, probe=PROBE, skip=skip)
        for register in REGISTERS:
            for name, array in getattr(slow, register).items():
                assert np.array_equal(getattr(fast, register)[name], array), (register, name)
        assert replace(fast.counts, skipped_steps=0) == slow.counts
        assert fast.events == slow.events
        assert np.array_equal(fast.scores, slow.scores)
        for phase, of_recordings in slow.activity.items():
            for name, by_piece in of_recordings[0].by_piece.items():
                assert np.array_equal(fast.activity[phase][0].by_piece[name], by_piece), name
    for phase in program.phases:
        check_phase(program, slow, recording, phase.name)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    seed=SEEDS,
    time=EVENTS,
    location=EVENTS,
    kind=st.sampled_from(KINDS[:4]),
    rows=st.sampled_from([1, 3, 80]),
)
def test_sessions_have_the_scores_of_whole_runs_after_every_step(seed, time, location, kind, rows):
    """The start does not depend on how many rows are pushed at a time, and a reset forgets it."""
    program, recording = random_hybrid(seed)
    # The readout counts spikes, or weighs potentials from some step on, of both populations or of one.
    potentials_from = [None, 0, 3, (None, 1), (2, None)][seed % 5]
    readout = replace(program.readout, potentials_from=potentials_from)
    program = replace(starting_at_touch(program, time, location), readout=readout)
    recording = recording_of_kind(kind, recording, np.random.default_rng(seed))
    session = hw.Session(program)
    for _ in range(2):
        pushed = [session.push(recording[at : at + rows]) for at in range(0, len(recording), rows)]
        check_session_after_every_step(program, recording, joined_scores(pushed))
        session.reset()


@pytest.mark.parametrize("first", [0, 1, 2, 3, 4, 9], ids=lambda first: f"from step {first}")
@pytest.mark.parametrize("steps", [None, 1, 2, 9], ids=lambda steps: f"{steps} steps")
def test_a_session_runs_a_late_phase_to_its_end_or_that_of_the_recording(steps, first):
    """Its potentials are negative while it runs, and 0 before and after."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 1)
    y = b.add_compartments(
        "y", 2, threshold=9, bias=[-640, -64], decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE
    )
    b.connect(x, y, [[2], [-2]])
    graph = b.graph()
    late = replace(graph, phases=(replace(graph.phases[0], steps=steps, align_events=1),))
    program = program_of_graphs(CHIP, Readout(("y",), (1.0,), first), late)
    recording = np.array([[0], [0], [1], [0], [1], [0], [0]], dtype=np.uint8)
    for rows in (1, 3, 7):
        session = hw.Session(program)
        starts = range(0, len(recording), rows)
        pushed = [session.push(recording[at : at + rows]).scores for at in starts]
        whole = hw.simulate(program, recording, engine="reference", probe=("potential",))
        potential = whole.potential["y"][: len(recording)]
        expected = largest_potential_so_far(potential, first)
        assert np.concatenate(pushed).tolist() == expected.tolist()


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, time=EVENTS, location=EVENTS)
def test_a_session_waits_for_the_touch_as_long_as_it_takes(seed, time, location):
    program, recording = random_hybrid(seed)
    program = starting_at_touch(program, time, location)
    longer = recording_of_kind("longer", recording, np.random.default_rng(seed))
    assert np.array_equal(
        hw.Session(program).push(longer).scores[-1], hw.simulate(program, longer).scores
    )


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, time=EVENTS, location=EVENTS, kind=st.sampled_from(KINDS[:4]))
def test_no_future_changes_a_proven_winner(seed, time, location, kind):
    program, recording = random_hybrid(seed)
    program = with_stream_per_phase(starting_at_touch(program, time, location))
    program = replace(
        program, readout=replace(program.readout, potentials_from=(None, 0, 3)[seed % 3])
    )
    recording = recording_of_kind(kind, recording, np.random.default_rng(seed))
    stops = hw.stop_when_proven(program, {"time": recording[None], "location": recording[None]})
    result = hw.simulate(
        program,
        possible_futures(program, recording, int(stops.steps[0]), np.random.default_rng(seed)),
    )
    assert (result.prediction == stops.prediction[0]).all()


def test_a_batch_equals_its_recordings_one_by_one():
    program, recording = random_hybrid(4)
    program = starting_at_touch(program, time=1, location=2)
    r = np.random.default_rng(0)
    batch = np.stack([recording_of_kind(kind, recording, r) for kind in KINDS[:4]])
    together = hw.simulate(program, batch)
    for i, one_recording in enumerate(batch):
        alone = hw.simulate(program, one_recording)
        assert together.per_recording[i] == alone.counts
        assert np.array_equal(together.scores[i], alone.scores)


def test_files_keep_the_start_and_say_nothing_without_one(tmp_path):
    program, recording = random_hybrid(4)
    for name, saved in (
        ("at once", program),
        ("late", starting_at_touch(program, time=1, location=3)),
    ):
        saved.save(tmp_path / name)
        phases = yaml.safe_load((tmp_path / name / "program.yaml").read_text())["phases"]
        assert ["align_events" in phase for phase in phases] == [name == "late"] * 2
        loaded = hw.load_program(tmp_path / name)
        assert loaded.phases == saved.phases
        assert hw.simulate(loaded, recording).counts == hw.simulate(saved, recording).counts


@pytest.mark.parametrize("wrong", [0, -1, 1.5, True, "first", [1]])
def test_files_with_another_start_are_refused(tmp_path, wrong):
    starting_at_touch(random_hybrid(4)[0], time=1, location=1).save(tmp_path)
    path = tmp_path / "program.yaml"
    document = yaml.safe_load(path.read_text())
    document["phases"][0]["align_events"] = wrong
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(tmp_path)
    assert str(caught.value) == "phases: its starts do not make a program. Compile it again."


def test_a_late_phase_is_transposed_as_a_whole_or_not_at_all(tmp_path):
    program, _ = random_hybrid(4)
    turned = replace(program.phases[0], axis="location", align_events=1)
    replace(program, phases=(turned, program.phases[1])).save(tmp_path)
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(tmp_path)
    assert str(caught.value) == "phases: its starts do not make a program. Compile it again."


def test_steps_before_the_touch_take_no_time():
    program, recording = random_hybrid(4)
    program = starting_at_touch(program, time=1, location=None)
    late = recording * (np.arange(len(recording)) >= 7)[:, None].astype(np.uint8)
    activity = hw.simulate(program, late, probe=("activity",)).activity["time"][0]
    step_ns = step_times(program, "time", activity, DAVIES).step_ns
    assert step_ns[:7].tolist() == [0] * 7
    assert (step_ns[7 : len(recording)] > 0).all()


def spikes_and_late_potentials(builder: hw.ProgramBuilder) -> hw.ChipProgram:
    """Return a program of two classes that adds the spikes of ``a`` and a hundredth of the largest potential of ``b``.

    ``a`` is in a phase of 8 steps, which starts at once: its class 0 spikes in each step after an event of channel
    ``x``. ``b`` is what ``builder`` has, in a phase of 16 steps that starts with the first event of its own stream
    ``late``; its potentials count from step 10 on.
    """
    spiking = hw.ProgramBuilder(CHIP)
    a = spiking.add_compartments(
        "a", 2, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    spiking.connect(spiking.add_input("x", 1), a, [[20], [0]])
    late = graph_in_phase(builder.graph(), "time", 16)
    late = replace(
        late,
        phases=(replace(late.phases[0], name="late", align_events=1),),
        inputs=tuple(replace(item, phase="late", stream="late") for item in late.inputs),
        groups=tuple(replace(group, phase="late") for group in late.groups),
    )
    readout = Readout(("a", "b"), (1.0, 0.01), (None, 10))
    return program_of_graphs(CHIP, readout, graph_in_phase(spiking.graph(), "time", 8), late)


def steps_until_class_0_is_proven(builder: hw.ProgramBuilder) -> list[int]:
    """Return after how many steps class 0 of :func:`spikes_and_late_potentials` is proven, with events in all steps of ``x``.

    The stream ``late`` is silent for these eight steps, so the phase of ``b`` has not started, and may still do anything.
    Class 0 has t - 1 spikes after t steps.
    """
    silence = np.zeros((1, 8, 1), dtype=np.uint8)
    recordings = {"touch": silence + 1, "late": silence}
    return hw.stop_when_proven(spikes_and_late_potentials(builder), recordings).steps.tolist()


def test_a_dendrite_that_has_not_started_has_not_fallen():
    """The dendrite of class 1 falls by 64 in each step, but only from the touch on.

    Until the touch it does not lower what class 1 may still reach with one event: 6 * 64, a score of 3.84. Class 0 may
    fall to vmin, -511, and so lose 5.11 of its score: of seven spikes 1.89 are left, less than 3.84. So nothing is
    proven before the last step.
    """
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments(
        "b", 2, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100_000, vmin=-511
    )
    builder.add_compartments(
        "d", 2, decay_v=KEEPS_ALL, threshold=0, bias=[0, -64], vmin=-511, joined_to=b
    )
    builder.connect(builder.add_input("z", 1), b, [[0], [6]])
    assert steps_until_class_0_is_proven(builder) == [8]


def test_a_potential_is_0_until_the_touch():
    """Once it has started, class 1 only falls, so it never exceeds the 0 from before.

    Class 0 may fall to vmin, -511, and so lose 5.11 of its score. Its sixth spike, in the seventh step, exceeds that.
    """
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments(
        "b",
        2,
        decay_u=FORGETS_AT_ONCE,
        decay_v=KEEPS_ALL,
        threshold=100_000,
        bias=[0, -64],
        vmin=-511,
    )
    builder.connect(builder.add_input("z", 1), b, [[-2], [-2]])
    assert steps_until_class_0_is_proven(builder) == [7]


def test_a_session_plays_two_phases_in_time():
    """Class 0 has seven spikes; class 1 gains 6 * 64 with each of two events, which come in steps 11 and 13 of ``late``.

    The first of them starts the phase. The potential takes part in the next step, and from step 10 of the program on.
    """
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments(
        "b", 2, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=100_000
    )
    builder.connect(builder.add_input("z", 1), b, [[0], [6]])
    program = spikes_and_late_potentials(builder)
    rows = {"touch": np.ones((16, 1), dtype=np.uint8), "late": np.eye(16, 1, -11, dtype=np.uint8)}
    rows["late"][13] = 1
    scores = hw.Session(program).push(rows)
    whole = hw.simulate(program, rows)
    assert scores.spikes["a"][[0, 1, 7, 15]].tolist() == [[0, 0], [1, 0], [7, 0], [7, 0]]
    assert scores.potential["b"][[0, 11, 12, 13, 14, 15]].tolist() == [
        [0, 0],
        [0, 0],
        [0, 6 * UNIT],
        [0, 6 * UNIT],
        [0, 2 * 6 * UNIT],
        [0, 2 * 6 * UNIT],
    ]
    after_two_events = 2 * 6 * UNIT
    assert scores.scores[-1].tolist() == whole.scores.tolist() == [7, 0.01 * after_two_events]


def test_a_reset_forgets_the_largest_potential():
    """Before the touch of the second recording the potential is 0: more than what follows, and less than the first's."""
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments(
        "b", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=100_000, vmin=-511
    )
    builder.connect(builder.add_input("z", 2), b, [[6, -6]])
    phase = graph_in_phase(builder.graph(), "time", 8)
    phase = replace(phase, phases=(replace(phase.phases[0], align_events=1),))
    session = hw.Session(program_of_graphs(CHIP, Readout(("b",), (1.0,), 0), phase))
    played = []
    for row, channel in ((0, 0), (2, 1)):
        rows = np.zeros((4, 2), dtype=np.uint8)
        rows[row, channel] = 1
        largest_potentials = session.push(rows).potential["b"][:, 0].tolist()
        score = int(hw.simulate(session.program, rows).scores[0])
        played.append((largest_potentials, score))
        session.reset()
    largest = 6 * UNIT
    assert played == [([0, largest, largest, largest], largest), ([0, 0, 0, 0], 0)]


def test_events_before_the_touch_are_not_played():
    """A row with one event comes before the row with two events that starts the recording."""
    builder = hw.ProgramBuilder(CHIP)
    y = builder.add_compartments(
        "y", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    builder.connect(builder.add_input("x", 2), y, [[20, 20]])
    phase = graph_in_phase(builder.graph(), "location", 4, np.arange(4))
    phase = replace(phase, phases=(replace(phase.phases[0], align_events=2),))
    program = program_of_graphs(CHIP, Readout(("y",), (1.0,)), phase)
    rows = np.array([[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0]], dtype=np.uint8)
    session = hw.Session(program)
    assert session.push(rows).spikes["y"].tolist() == [[0], [2], [2]]
    assert (
        session.spikes("y").tolist()
        == hw.simulate(program, rows).spikes["y"].tolist()
        == [[0], [0], [1], [1]]
    )
