"""Phases that start at the first touch: both engines, sessions and stops against recordings that are cut by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from early_stops import futures, in_streams
from hybrids import CHIP, assembled, in_phase, random_hybrid
from hypothesis import given, settings
from hypothesis import strategies as st
from sessions import check_every_step, largest_so_far

import hw_model as hw
from hw_model.accounting.cost import step_times
from hw_model.mapping.graph import Readout

SEEDS = st.integers(0, 2**32 - 1)
EVENTS = st.sampled_from([None, 1, 1, 2, 3])
KINDS = ["as drawn", "late", "at the last step", "empty", "longer"]
PROBE = ("spikes", "u", "v", "potential", "activity")


def aligned(program: hw.ChipProgram, time: int | None, location: int | None) -> hw.ChipProgram:
    """The program with phases that start at so many events."""
    events = {"time": time, "location": location}
    return replace(
        program, phases=tuple(replace(p, align_events=events[p.name]) for p in program.phases)
    )


def of_kind(kind: str, recording: np.ndarray, r: np.random.Generator) -> np.ndarray:
    """A recording that starts late, with its last step or never, or goes on for longer than its program."""
    if kind == "longer":
        silent = np.zeros((int(r.integers(0, 60)), recording.shape[1]), dtype=np.uint8)
        return np.concatenate((silent, recording, recording))
    first = {"as drawn": 0, "late": int(r.integers(len(recording))), "empty": len(recording)}
    return recording * (np.arange(len(recording)) >= first.get(kind, len(recording) - 1))[
        :, None
    ].astype(np.uint8)


def start_of(recording: np.ndarray, events: int | None) -> int:
    """The first step with so many events; the number of steps where there is none."""
    return (
        0
        if events is None
        else next((t for t, row in enumerate(recording) if row.sum() >= events), len(recording))
    )


def check_phase(
    program: hw.ChipProgram, found: hw.SimulationResult, recording: np.ndarray, name: str
) -> None:
    """A phase against the phase that starts at once, played the recording from its start on."""
    (phase,) = (p for p in program.phases if p.name == name)
    start = start_of(recording, phase.align_events)
    cut = recording[start:]
    counts = found.counts_by_phase[name]
    rows = slice(None)
    assert counts.aligned_steps == (start if phase.align_events else 0)
    if phase.align_events and name == "time":
        cut = cut[: phase.steps]
        whole = max(phase.steps, len(recording))
        ran = 0 if start == len(recording) else min(phase.steps, whole - start)
        rows = slice(start, start + ran)
        assert counts.neuron_updates == ran * sum(
            core.compartments for core in program.cores_of(name)
        )
        for kind in PROBE[:-1]:
            for group in getattr(found, kind).keys() & program.columns_of(name).keys():
                array = getattr(found, kind)[group]
                assert len(array) == whole
                assert not array[:start].any()
                assert not array[start + ran :].any()
        if ran == 0:
            assert hw.latency(program, {name: found.activity[name][0]}, DAVIES).total_ns == 0
            assert counts == hw.Counts(aligned_steps=start, events_dropped=int(recording.sum()))
            return
        phase = replace(phase, steps=ran)
    at_once = replace(program, phases=(replace(phase, align_events=None),), readout=None)
    padded = cut if len(cut) else np.zeros_like(recording[:1])
    wanted = hw.simulate(at_once, padded, engine="reference", probe=PROBE)
    for kind in PROBE[:-1]:
        for group, array in getattr(wanted, kind).items():
            assert np.array_equal(getattr(found, kind)[group][rows], array), (kind, group)
    given = wanted.counts_by_phase[name]
    dropped = int(recording.sum()) - given.input_events - given.transpose_events
    skipped = {
        "aligned_steps": counts.aligned_steps,
        "events_dropped": dropped,
        "skipped_steps": counts.skipped_steps,
    }
    assert counts == replace(given, **skipped)
    if phase.align_events:
        price = {phase.name: wanted.activity[name][0]}
        ours = hw.latency(program, {phase.name: found.activity[name][0]}, DAVIES).by_phase_ns
        assert ours == pytest.approx(hw.latency(at_once, price, DAVIES).by_phase_ns)


DAVIES = hw.chip("loihi-sim").profile("davies2018")


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=SEEDS,
    time=EVENTS,
    location=EVENTS,
    kind=st.sampled_from(KINDS),
    together=st.sampled_from([1, 2]),
)
def test_both_engines_play_a_recording_from_its_start_on(seed, time, location, kind, together):
    program, recording = random_hybrid(seed, together)
    program = aligned(program, time, location)
    recording = of_kind(kind, recording, np.random.default_rng(seed))
    slow = hw.simulate(program, recording, engine="reference", probe=PROBE)
    for skip in (True, False):
        fast = hw.simulate(program, recording, probe=PROBE, skip=skip)
        for which in PROBE[:-1]:
            for name, array in getattr(slow, which).items():
                assert np.array_equal(getattr(fast, which)[name], array), (which, name)
        assert replace(fast.counts, skipped_steps=0) == slow.counts
        assert fast.events == slow.events
        assert np.array_equal(fast.scores, slow.scores)
        for phase, items in slow.activity.items():
            for name, by_piece in items[0].by_piece.items():
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
def test_sessions_know_the_same_after_every_step(seed, time, location, kind, rows):
    """The first events decide the start, whatever parts they come in; and once more after a reset."""
    program, recording = random_hybrid(seed)
    first = [None, 0, 3, (None, 1), (2, None)][seed % 5]
    program = replace(
        aligned(program, time, location), readout=replace(program.readout, potentials_from=first)
    )
    recording = of_kind(kind, recording, np.random.default_rng(seed))
    session = hw.Session(program)
    for _ in range(2):
        parts = [session.push(recording[at : at + rows]) for at in range(0, len(recording), rows)]
        spikes, potential = (
            {
                name: np.concatenate([getattr(p, kept)[name] for p in parts])
                for name in getattr(parts[0], kept)
            }
            for kept in ("spikes", "potential")
        )
        scores = np.concatenate([part.scores for part in parts])
        check_every_step(program, recording, hw.StepScores(spikes, potential, scores))
        session.reset()


@pytest.mark.parametrize("first", [0, 1, 2, 3, 4, 9], ids=lambda first: f"from step {first}")
@pytest.mark.parametrize("steps", [None, 1, 2, 9], ids=lambda steps: f"{steps} steps")
def test_a_session_of_a_late_phase_that_ends_before_its_recording_or_with_it(steps, first):
    """Potentials are below 0 while it runs, and 0 before and after."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 1)
    y = b.add_compartments("y", 2, threshold=9, bias=[-640, -64], decay_u=4096, decay_v=4096)
    b.connect(x, y, [[2], [-2]])
    graph = b.graph()
    late = replace(graph, phases=(replace(graph.phases[0], steps=steps, align_events=1),))
    program = assembled(CHIP, Readout(("y",), (1.0,), first), late)
    recording = np.array([[0], [0], [1], [0], [1], [0], [0]], dtype=np.uint8)
    for rows in (1, 3, 7):
        session = hw.Session(program)
        pushed = [session.push(recording[at : at + rows]).scores for at in range(0, 7, rows)]
        whole = hw.simulate(program, recording, engine="reference", probe=("potential",)).potential[
            "y"
        ][:7]
        assert np.concatenate(pushed).tolist() == largest_so_far(whole, first).tolist()


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, time=EVENTS, location=EVENTS)
def test_a_session_waits_for_the_touch_as_long_as_it_takes(seed, time, location):
    program, recording = random_hybrid(seed)
    program = aligned(program, time, location)
    longer = of_kind("longer", recording, np.random.default_rng(seed))
    assert np.array_equal(
        hw.Session(program).push(longer).scores[-1], hw.simulate(program, longer).scores
    )


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, time=EVENTS, location=EVENTS, kind=st.sampled_from(KINDS[:4]))
def test_no_future_changes_a_proven_winner(seed, time, location, kind):
    program, recording = random_hybrid(seed)
    program = in_streams(aligned(program, time, location))
    program = replace(
        program, readout=replace(program.readout, potentials_from=(None, 0, 3)[seed % 3])
    )
    recording = of_kind(kind, recording, np.random.default_rng(seed))
    stops = hw.stop_when_proven(program, {"time": recording[None], "location": recording[None]})
    found = hw.simulate(
        program, futures(program, recording, int(stops.steps[0]), np.random.default_rng(seed))
    )
    assert (found.prediction == stops.prediction[0]).all()


def test_a_batch_equals_its_recordings_one_by_one():
    program, recording = random_hybrid(4)
    program = aligned(program, 1, 2)
    r = np.random.default_rng(0)
    batch = np.stack([of_kind(kind, recording, r) for kind in KINDS[:4]])
    together = hw.simulate(program, batch)
    for i, one in enumerate(batch):
        alone = hw.simulate(program, one)
        assert together.per_recording[i] == alone.counts
        assert np.array_equal(together.scores[i], alone.scores)


def test_files_keep_the_start_and_say_nothing_without_one(tmp_path):
    program, recording = random_hybrid(4)
    for name, its in (("at once", program), ("late", aligned(program, 1, 3))):
        its.save(tmp_path / name)
        phases = yaml.safe_load((tmp_path / name / "program.yaml").read_text())["phases"]
        assert ["align_events" in phase for phase in phases] == [name == "late"] * 2
        loaded = hw.load_program(tmp_path / name)
        assert loaded.phases == its.phases
        assert hw.simulate(loaded, recording).counts == hw.simulate(its, recording).counts


@pytest.mark.parametrize("wrong", [0, -1, 1.5, True, "first", [1]])
def test_files_with_another_start_are_refused(tmp_path, wrong):
    aligned(random_hybrid(4)[0], 1, 1).save(tmp_path)
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
    program = aligned(program, 1, None)
    late = recording * (np.arange(len(recording)) >= 7)[:, None].astype(np.uint8)
    activity = hw.simulate(program, late, probe=("activity",)).activity["time"][0]
    step_ns = step_times(program, "time", activity, DAVIES).step_ns
    assert step_ns[:7].tolist() == [0] * 7
    assert (step_ns[7 : len(recording)] > 0).all()


def spikes_and_late_potentials(builder: hw.ProgramBuilder) -> hw.ChipProgram:
    """Class 0 spikes in each of eight steps but the first; potentials of ``b`` in hundredths, from step 10 on, come on top.

    Their phase starts with the first event of its own.
    """
    spiking = hw.ProgramBuilder(CHIP)
    a = spiking.add_compartments("a", 2, decay_u=4096, decay_v=4096, threshold=10)
    spiking.connect(spiking.add_input("x", 1), a, [[20], [0]])
    late = in_phase(builder.graph(), "time", 16)
    late = replace(
        late,
        phases=(replace(late.phases[0], name="late", align_events=1),),
        inputs=tuple(replace(item, phase="late", stream="late") for item in late.inputs),
        groups=tuple(replace(group, phase="late") for group in late.groups),
    )
    readout = Readout(("a", "b"), (1.0, 0.01), (None, 10))
    return assembled(CHIP, readout, in_phase(spiking.graph(), "time", 8), late)


def stop_before_a_touch(builder: hw.ProgramBuilder) -> list[int]:
    silence = np.zeros((1, 8, 1), dtype=np.uint8)
    return hw.stop_when_proven(
        spikes_and_late_potentials(builder), {"touch": silence + 1, "late": silence}
    ).steps.tolist()


def test_a_dendrite_that_has_not_started_has_not_fallen():
    """It falls from the touch on: until then class 1 may still reach 6 * 64 in hundredths, which seven spikes exceed not."""
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments("b", 2, decay_u=4096, decay_v=4096, threshold=100_000, vmin=-511)
    builder.add_compartments("d", 2, decay_v=0, threshold=0, bias=[0, -64], vmin=-511, joined_to=b)
    builder.connect(builder.add_input("z", 1), b, [[0], [6]])
    assert stop_before_a_touch(builder) == [8]


def test_a_potential_is_0_until_the_touch():
    """Class 1 falls to -511 once it has started. The sixth spike exceeds what class 0 may still lose, 5.11."""
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments(
        "b", 2, decay_u=4096, decay_v=0, threshold=100_000, bias=[0, -64], vmin=-511
    )
    builder.connect(builder.add_input("z", 1), b, [[-2], [-2]])
    assert stop_before_a_touch(builder) == [7]


def test_a_session_plays_two_phases_in_time():
    """Seven spikes of class 0; the potential of class 1 rises by 6 * 64 with each of the last two events, after step 10."""
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments("b", 2, decay_u=4096, decay_v=0, threshold=100_000)
    builder.connect(builder.add_input("z", 1), b, [[0], [6]])
    program = spikes_and_late_potentials(builder)
    rows = {"touch": np.ones((16, 1), dtype=np.uint8), "late": np.eye(16, 1, -11, dtype=np.uint8)}
    rows["late"][13] = 1
    found = hw.Session(program).push(rows)
    whole = hw.simulate(program, rows)
    assert found.spikes["a"][[0, 1, 7, 15]].tolist() == [[0, 0], [1, 0], [7, 0], [7, 0]]
    assert found.potential["b"][[0, 11, 12, 13, 14, 15]].tolist() == [
        [0, 0],
        [0, 0],
        [0, 384],
        [0, 384],
        [0, 768],
        [0, 768],
    ]
    assert found.scores[-1].tolist() == whole.scores.tolist() == [7, 7.68]


def test_a_reset_forgets_the_largest_potential():
    """Before the touch of the second recording the potential is 0, more than what follows, and not that of the first."""
    builder = hw.ProgramBuilder(CHIP)
    b = builder.add_compartments("b", 1, decay_u=4096, decay_v=4096, threshold=100_000, vmin=-511)
    builder.connect(builder.add_input("z", 2), b, [[6, -6]])
    phase = in_phase(builder.graph(), "time", 8)
    phase = replace(phase, phases=(replace(phase.phases[0], align_events=1),))
    session = hw.Session(assembled(CHIP, Readout(("b",), (1.0,), 0), phase))
    played = []
    for row, channel in ((0, 0), (2, 1)):
        rows = np.zeros((4, 2), dtype=np.uint8)
        rows[row, channel] = 1
        played.append(
            (
                session.push(rows).potential["b"][:, 0].tolist(),
                int(hw.simulate(session.program, rows).scores[0]),
            )
        )
        session.reset()
    assert played == [([0, 384, 384, 384], 384), ([0, 0, 0, 0], 0)]


def test_events_before_the_touch_are_not_played():
    """One event, in a channel of its own, comes before the row with two that starts the recording."""
    builder = hw.ProgramBuilder(CHIP)
    y = builder.add_compartments("y", 1, decay_u=4096, decay_v=4096, threshold=10)
    builder.connect(builder.add_input("x", 2), y, [[20, 20]])
    phase = in_phase(builder.graph(), "location", 4, np.arange(4))
    phase = replace(phase, phases=(replace(phase.phases[0], align_events=2),))
    program = assembled(CHIP, Readout(("y",), (1.0,)), phase)
    rows = np.array([[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0]], dtype=np.uint8)
    session = hw.Session(program)
    assert session.push(rows).spikes["y"].tolist() == [[0], [2], [2]]
    assert (
        session.spikes("y").tolist()
        == hw.simulate(program, rows).spikes["y"].tolist()
        == [[0], [0], [1], [1]]
    )
