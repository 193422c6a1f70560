"""Early stops: proven ones stand whatever follows, calibrated ones are what a scan of all leads would find."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hybrids import CHIP, assembled, in_phase, random_hybrid
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.description.counts import BY_CORE
from hw_model.mapping.graph import Readout
from tests.real_recordings import REAL, on_real_recordings

ROOT = Path(__file__).parents[2]

SEEDS = st.integers(0, 2**32 - 1)


def in_streams(program: hw.ChipProgram) -> hw.ChipProgram:
    """The same program with a recording of its own for each phase, so that they can be varied apart."""
    return replace(program, inputs=tuple(replace(item, stream=item.phase) for item in program.inputs))


def futures(program: hw.ChipProgram, recording: np.ndarray, done: int, r: np.random.Generator, batch: int = 64):
    """Recordings of both streams that are as given until ``done`` steps of the phases in order have run.

    When the time phase has ended the recording is over, and the buffer of the location phase holds all of it.
    """
    steps = len(recording)
    density = r.choice([0.0, 0.1, 0.5, 1.0], (2, batch, 1, 1))
    time, location = (r.random((2, batch, *recording.shape)) < density).astype(np.uint8)
    time[:, :done] = recording[:done]
    played = program.inputs_of("location")[0].positions < done - steps
    location[:, :, played] = recording[:, played]
    if done >= steps:
        location[:] = recording
    return {"time": time, "location": location}


def by_potentials(program: hw.ChipProgram, first: int | tuple[int | None, ...] | None) -> hw.ChipProgram:
    """The program with a readout of potentials from that step on, or of spikes."""
    return replace(program, readout=replace(program.readout, potentials_from=first))


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, together=st.integers(1, 2))
def test_no_future_changes_a_proven_winner(seed, together):
    program, recording = random_hybrid(seed, together)
    program = by_potentials(in_streams(program), (None, 0, 3, (None, 2), (4, None), (3, 1))[seed % 6])
    stops = hw.stop_when_proven(program, {"time": recording[None], "location": recording[None]})
    done = int(stops.steps[0])
    assert 0 <= done <= stops.all_steps == sum(phase.steps for phase in program.phases)
    found = hw.simulate(program, futures(program, recording, done, np.random.default_rng(seed)))
    assert (found.prediction == stops.prediction[0]).all()


def one_layer(
    weights, *, decay_u=1024, decay_v=512, threshold=30, bias=0, refractory=1, vmin=None, exponent=0
) -> tuple[hw.ProgramBuilder, hw.ProgramBuilder]:
    """A builder with input ``x`` and its compartments ``y``, one a class."""
    builder = hw.ProgramBuilder(CHIP)
    classes, channels = np.shape(weights)
    x = builder.add_input("x", channels)
    y = builder.add_compartments(
        "y", classes, decay_u=decay_u, decay_v=decay_v, threshold=threshold, bias=bias, refractory=refractory, vmin=vmin
    )
    builder.connect(x, y, weights, exponent=exponent)
    builder.read_out(y)
    return builder, y


def random_layer(seed: int) -> tuple[hw.ChipProgram, np.ndarray]:
    """A program of one or two channels and up to three classes, some with a dendrite, and a short recording."""
    r = np.random.default_rng(seed)
    channels, classes, steps = int(r.integers(1, 3)), int(r.integers(2, 4)), int(r.integers(3, 7))
    weights = 2 * r.integers(-30, 60, (classes, channels))
    builder, y = one_layer(
        weights,
        decay_u=r.choice([1024, 4096], classes),
        decay_v=r.choice([512, 4096], classes),
        threshold=r.choice([0, 30, 60], classes),
        bias=r.choice([0, 0, -640], classes),
        refractory=r.choice([1, 2, 4], classes),
        vmin=r.choice([0, 1 - 2**15]),
    )
    if r.random() < 0.5:
        dendrite = builder.add_compartments(
            "y/dendrite", classes, decay_u=r.choice([1024, 4096]), decay_v=r.choice([512, 4096]), threshold=0,
            bias=r.choice([0, -640, 640], classes), vmin=builder._groups[0].vmin[0], joined_to=y,
        )  # fmt: skip
        builder.connect(y, dendrite, 2 * r.integers(-60, 20, (classes, classes)), delay=int(r.integers(3)))
    program = builder.build()
    program = replace(program, readout=Readout(("y",), (float(r.choice([1.0, 1.0, -1.0, 0.1])),)))
    return program, (r.random((steps, channels)) < 0.5).astype(np.uint8)


@settings(max_examples=90, deadline=None)
@given(seed=SEEDS, first=st.sampled_from([None, None, 0, 2, 9]))
def test_every_single_future_keeps_a_proven_winner(seed, first):
    """All of them: small enough to be played."""
    program, recording = random_layer(seed)
    program = by_potentials(program, first)
    stops = hw.stop_when_proven(program, recording[None])
    done = int(stops.steps[0])
    rest = recording[done:]
    if rest.size > 10:
        rest = rest[-10 // recording.shape[1] :]
    many = np.array(list(product((0, 1), repeat=rest.size)), dtype=np.uint8).reshape(2**rest.size, *rest.shape)
    played = np.repeat(recording[None], len(many), axis=0)
    played[:, len(recording) - len(rest) :] = many
    assert (hw.simulate(program, played).prediction == stops.prediction[0]).all()


def most_to_come(program: hw.ChipProgram, result, name: str, at: int, steps: int) -> list[tuple[int, int]]:
    """Spikes and the largest potential of one population, as the module's words bound them, in Python's integers."""
    core = program.cores[0]
    assert len(program.cores) == 1
    groups = {piece.group: piece for piece in core.slices}
    kept = {g.core: g.cannot_wrap for g in hw.prove_range(program)}[0]
    charge = np.zeros(core.compartments, dtype=np.int64)
    np.add.at(charge, core.axons.target, np.maximum(core.effective_weights, 0))
    setting = {key: core.setting(key) for key in ("decay_u", "decay_v", "refractory")}

    def left(x: int, d: int) -> int:
        return abs(x) * (4096 - d) // 4096 * (1 if x >= 0 else -1)

    found = []
    for i in range(groups[name].size):
        soma = groups[name].offset + i
        family = [c for c in range(core.compartments) if core.parent[c] == soma] + [soma]
        group_of = {piece.offset + i: piece.group for piece in core.slices}
        u = {c: int(result.u[group_of[c]][at - 1, i]) if at else 0 for c in family}
        v = {c: int(result.v[group_of[c]][at - 1, i]) if at else 0 for c in family}
        before = np.flatnonzero(result.spikes[name][:at, i])
        free = int(before[-1]) + int(setting["refractory"][soma]) if len(before) else 0
        n, most = 0, int(core.vmin)
        for step in range(at, steps):
            joined = 0
            for c in family:
                u[c] = left(u[c], setting["decay_u"][c]) + int(charge[c])
                arrived = left(v[c], setting["decay_v"][c]) + u[c] + int(core.bias[c]) + (joined if c == soma else 0)
                v[c] = min(core.vmax, max(core.vmin, arrived))
                joined += v[c] if c != soma else 0
            if step >= free and (v[soma] > core.threshold_voltage[soma] or not all(kept[c] for c in family)):
                n += 1
                free = step + int(setting["refractory"][soma])
            v[soma] = max(v[soma], 0)
            if step >= (program.readout.potentials_from or 0):
                most = max(most, v[soma] if all(kept[c] for c in family) else int(core.vmax))
        found.append((n, most))
    return found


def first_proven(program: hw.ChipProgram, recording: np.ndarray) -> int:
    """Try every step from the first on, with exact scores."""
    result = hw.simulate(program, recording, probe=("spikes", "u", "v", "potential"))
    (name,), (weight,) = program.readout.populations, program.readout.weights
    weight, exact = Fraction(weight), float(weight).is_integer()
    steps, first = len(recording), program.readout.potentials_from
    for at in range(steps):
        more = most_to_come(program, result, name, at, steps)
        if first is None:
            now = [int(n) for n in result.spikes[name][:at].sum(axis=0, dtype=np.int64)]
            ends = [(n, n + spikes) for n, (spikes, _) in zip(now, more, strict=True)]
        else:
            seen = [[int(v) for v in row] for row in result.potential[name][first:at].T]
            now = [max(row, default=0) for row in seen]
            least = program.cores[0].vmin
            ends = [(max(*row, least, least), max(*row, top, top)) for row, (_, top) in zip(seen, more, strict=True)]
            ends = ends if first < steps else [(0, 0)] * len(now)
        score = [weight * n for n in now]
        low = [min(weight * a, weight * b) for a, b in ends]
        high = [max(weight * a, weight * b) for a, b in ends]
        w = score.index(max(score))
        if low == high or all(
            high[c] < low[w] or (exact and c > w and high[c] == low[w]) for c in range(len(score)) if c != w
        ):
            return at
    return steps


@settings(max_examples=90, deadline=None)
@given(seed=SEEDS, first=st.sampled_from([None, None, 0, 2, 9]))
def test_the_stop_is_the_first_step_that_the_bound_proves(seed, first):
    program, recording = random_layer(seed)
    program = by_potentials(program, first)
    assert int(hw.stop_when_proven(program, recording[None]).steps[0]) == first_proven(program, recording)


@pytest.mark.parametrize(
    ("options", "stop"),
    [
        # A charge is enough for a spike: class 0 has 4 after step 4, and class 1 can still have one in each of 3 steps.
        ({}, 5),
        # Class 0 has one spike, in step 1, and class 1 can have no more than one in the last four steps.
        ({"refractory": 4}, 4),
        # With a charge in every step v = 3/4 v + 60 stays below 240.
        ({"threshold": 240}, 0),
        # A charge just reaches the threshold, or is one more.
        ({"threshold": 60, "decay_v": 4096}, 0),
        ({"threshold": 60, "decay_v": 4096, "bias": 1}, 5),
        # Here every charge may wrap, so that nothing is known of v: as if each could spike at any time.
        ({"threshold": 240, "exponent": 7, "decay_u": 1}, 5),
        ({"threshold": 240, "exponent": 7, "decay_u": 1, "refractory": 4}, 4),
    ],
    ids=["at any time", "refractory", "never", "at the threshold", "just above it", "wraps", "wraps and refractory"],
)
def test_stops_by_hand(options, stop):
    """Two classes, a channel each; the first has an event in each of the first four rows of eight."""
    builder, _ = one_layer([[60, 0], [0, 60]], **{"decay_u": 4096, "decay_v": 1024} | options)
    recording = np.zeros((8, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    found = hw.stop_when_proven(builder.build(), recording[None])
    assert (found.steps.tolist(), found.all_steps, found.prediction.tolist()) == ([stop], 8, [0])


def test_what_may_wrap_may_spike():
    """Class 1 has no positive weight at all, but two of its negative ones together wrap to a charge above 0."""
    builder, _ = one_layer([[60, 0, 0], [0, -254, -254]], decay_u=4096, decay_v=4096, exponent=7, threshold=[30, 500])
    program = builder.build()
    recording = np.zeros((8, 3), dtype=np.uint8)
    recording[0, 0] = 1
    found = hw.stop_when_proven(program, recording[None])
    # One spike against six, ... and against one, in the last step: a tie, which goes to class 0.
    assert (found.steps.tolist(), found.prediction.tolist()) == ([7], [0])
    recording[5:, 1:] = 1
    assert hw.simulate(program, recording).prediction == 1


def test_refractory_steps_take_a_voltage_up_to_0():
    """A strong inhibition is forgotten while the neuron is refractory: its charge alone would say that it never spikes."""
    builder, _ = one_layer(
        [[40, 0, 0], [0, 40, -158]], decay_u=[4096, 1024], decay_v=[4096, 0], threshold=10, refractory=[6, 4]
    )
    program = builder.build()
    recording = np.zeros((6, 3), dtype=np.uint8)
    recording[0, :2] = 1
    recording[1, 2] = 1
    found = hw.stop_when_proven(program, recording[None])
    # u of class 1 is 2560, -8192, -6144 ... from step 1 on: a charge in steps 4 and 5 each, and 1024 is above 640.
    assert (found.steps.tolist(), found.prediction.tolist()) == ([5], [0])
    recording[3:, 1] = 1
    played = hw.simulate(program, recording)
    assert (played.spikes["y"].sum(axis=0).tolist(), played.prediction) == ([1, 2], 1)


def test_a_batch_stops_as_its_recordings_alone():
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096)
    program = builder.build()
    recordings = np.zeros((4, 9, 2), dtype=np.uint8)
    recordings[0, :7, 0] = recordings[1, :4, 0] = recordings[2, 2, 1] = 1
    alone = [hw.stop_when_proven(program, one[None]).steps.tolist() for one in recordings]
    assert alone == [[5], [5], [9], [9]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_potentials_of_a_batch_count_to_the_end_of_each_recording_alone():
    """Class 1 can gain 60 in each step that is left: five of 60 in A, two of 254 in B, are ahead of that."""
    builder, _ = one_layer([[60, 0, 254], [0, 60, 0]], decay_u=4096, decay_v=0, threshold=100_000)
    program = by_potentials(builder.build(), 0)
    recordings = np.zeros((2, 9, 3), dtype=np.uint8)
    recordings[0, :8, 0] = recordings[1, :2, 2] = 1
    alone = [hw.stop_when_proven(program, one[None]).steps.tolist() for one in recordings]
    assert alone == [[5], [3]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_spikes_of_a_batch_count_to_the_end_of_each_recording_alone():
    """Class 0 leads with four spikes against four to come in A; in B class 1 is pulled down for good in the first step."""
    builder, _ = one_layer([[60, 0, 0], [0, 32, -254]], decay_u=[4096, 200], decay_v=4096)
    program = builder.build()
    recordings = np.zeros((2, 9, 3), dtype=np.uint8)
    recordings[0, :8, 0] = recordings[1, 0, 2] = 1
    alone = [hw.stop_when_proven(program, one[None]).steps.tolist() for one in recordings]
    assert alone == [[5], [2]]
    assert [[step] for step in hw.stop_when_proven(program, recordings).steps.tolist()] == alone


def test_a_potential_that_may_wrap_may_be_the_largest_voltage():
    """Class 1 has no positive weight at all, but two of its negative ones together wrap to a charge above 0."""
    builder, _ = one_layer([[60, 0, 0], [0, -254, -254]], decay_u=4096, decay_v=4096, exponent=7, threshold=100_000)
    recording = np.zeros((1, 8, 3), dtype=np.uint8)
    recording[0, 0, 0] = 1
    assert hw.stop_when_proven(by_potentials(builder.build(), 0), recording).steps.tolist() == [8]


def test_nothing_is_known_of_a_potential_before_a_step_that_counts():
    """Class 0 can only fall: when row 2 has left it at 0, no other exceeds it, and not before."""
    builder, _ = one_layer([[-60], [0]], decay_u=4096, decay_v=4096, threshold=100_000)
    silence = np.zeros((1, 6, 1), dtype=np.uint8)
    assert hw.stop_when_proven(by_potentials(builder.build(), 2), silence).steps.tolist() == [3]


def test_potentials_stay_0_after_the_end_of_a_recording():
    """The last event acts in step 3: with nothing to come and nothing kept, all is 0 from step 4 on."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096, decay_v=4096, threshold=100_000)
    program = by_potentials(builder.build(), 0)
    program = replace(program, phases=(replace(program.phases[0], steps=40),))
    recording = np.zeros((1, 3, 2), dtype=np.uint8)
    recording[0, :, 1] = 1
    busy = hw.simulate(program, recording, probe=("activity",)).activity["time"][0].by_piece["neuron_updates_active"]
    rests = 1 + int(busy.any(axis=1).nonzero()[0].max())
    found = hw.stop_when_proven(program, recording)
    assert (found.steps.tolist(), found.prediction.tolist(), rests < 8) == ([rests], [1], True)


def test_a_buffer_that_is_empty_needs_no_step():
    """A program of a transposed phase alone: the whole recording is there before it begins."""
    builder = hw.ProgramBuilder(CHIP)
    x, y = builder.add_input("x", 3), builder.add_compartments("y", 2, decay_u=4096, decay_v=4096, threshold=10)
    builder.connect(x, y, [[20, 20, 20], [20, 20, 20]])
    program = assembled(CHIP, Readout(("y",), (1.0,)), in_phase(builder.graph(), "location", 4, np.arange(4)))
    assert hw.stop_when_proven(program, np.zeros((1, 3, 4), dtype=np.uint8)).steps.tolist() == [0]


@pytest.mark.parametrize(("winner", "stop"), [(0, 5), (1, 6)], ids=["the first", "the second"])
def test_a_tie_goes_to_the_first_class(winner, stop):
    """Four spikes against three to come are enough for both; against four, for the first class alone."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096)
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, winner] = 1
    found = hw.stop_when_proven(builder.build(), recording[None])
    assert (found.steps.tolist(), found.prediction.tolist()) == ([stop], [winner])


def test_scores_that_are_rounded_are_no_ties():
    """With weights of a tenth a tie may be decided by rounding, so that it is not taken for proven."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096)
    program = builder.build()
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:4, 0] = 1
    stops = [
        hw.stop_when_proven(replace(program, readout=Readout(("y",), (weight,))), recording[None]).steps.tolist()
        for weight in (1.0, 0.1)
    ]
    assert stops == [[5], [6]]


def test_spikes_against_a_class_count_as_losses():
    """With a negative weight a class can only lose: the silent one wins, and is safe when the other has more."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096, refractory=3)
    program = replace(builder.build(), readout=Readout(("y",), (-2.0,)))
    recording = np.zeros((9, 2), dtype=np.uint8)
    recording[:7, 0] = 1
    found = hw.stop_when_proven(program, recording[None])
    # Class 0 has spiked in steps 1 and 4. In the last four steps class 1 could have two spikes, and lose that tie.
    assert (found.steps.tolist(), found.prediction.tolist()) == ([6], [1])


def test_a_child_is_not_below_its_lower_limit():
    """A joined child is pulled down by its bias, but clipped at 0, so that its parent can spike."""
    builder, y = one_layer([[20, 0], [0, 20]], decay_u=4096, decay_v=4096, threshold=10, vmin=0)
    builder.add_compartments("d", 2, decay_v=4096, threshold=0, bias=[0, -6400], vmin=0, joined_to=y)
    program = builder.build()
    recording = np.zeros((6, 2), dtype=np.uint8)
    recording[0, 0] = 1
    found = hw.stop_when_proven(program, recording[None])
    assert (found.steps.tolist(), found.prediction.tolist()) == ([5], [0])
    recording[2:, 1] = 1
    assert hw.simulate(program, recording).prediction == 1


def counted(counts: hw.Counts) -> dict[str, int]:
    return {name: counts[name] for name in BY_CORE}


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_counts_of_a_proven_stop_are_those_of_so_many_steps(seed):
    program, recording = random_hybrid(seed)
    found = hw.stop_when_proven(program, recording[None])
    assert counted(found.all_counts) == counted(hw.simulate(program, recording).counts)
    left, wanted = int(found.steps[0]), dict.fromkeys(BY_CORE, 0)
    result = hw.simulate(program, recording, probe=("activity",))
    for phase in program.phases:
        steps = min(left, phase.steps)
        left -= steps
        if phase.name == "time" and steps:
            short = replace(program, phases=tuple(replace(p, steps=steps) if p is phase else p for p in program.phases))
            counts = counted(hw.simulate(short, recording).counts_by_phase["time"])
        else:
            activity = result.activity[phase.name][0]
            counts = {name: int(activity.count(name)[:steps].sum()) for name in BY_CORE}
        wanted = {name: n + counts[name] for name, n in wanted.items()}
    assert counted(found.counts) == wanted


def test_phases_that_do_not_vote_are_run_nevertheless():
    """The location phase comes after all steps of the time phase, whether they matter or not."""
    program, recording = random_hybrid(4)
    alone = replace(program, readout=Readout(("location/y",), (1.0,)))
    found = hw.stop_when_proven(alone, recording[None])
    assert found.all_steps == sum(recording.shape)
    assert len(recording) < found.steps[0] <= found.all_steps
    assert found.counts.spikes >= hw.simulate(program, recording).counts_by_phase["time"].spikes


def leads_of(scores: np.ndarray) -> np.ndarray:
    """By how much the best class leads after each step; an only class leads by its score."""
    ordered = np.sort(scores, axis=1)
    return ordered[:, -1] - (ordered[:, -2] if scores.shape[1] > 1 else 0)


def plain_margin(scores: np.ndarray, agreement: float) -> float:
    """Try every lead that occurs, from the smallest on."""
    leads = [leads_of(one) for one in scores]
    for margin in sorted({lead for one in leads for lead in one if lead > 0}):
        agreed = 0
        for one, lead in zip(scores, leads, strict=True):
            at = next((t for t, value in enumerate(lead) if value >= margin), len(one) - 1)
            agreed += one[at].argmax() == one[-1].argmax()
        if agreed / len(scores) >= agreement:
            return float(margin)
    return float("inf")


def batch_for(seed: int, batch: int = 4) -> tuple[hw.ChipProgram, np.ndarray]:
    program, recording = random_hybrid(seed)
    r = np.random.default_rng(seed + 1)
    return program, (r.random((batch, *recording.shape)) < r.choice([0.1, 0.5, 1.0], (batch, 1, 1))).astype(np.uint8)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, agreement=st.sampled_from([0.0, 0.5, 0.8, 1.0]), psi=st.sampled_from([None, 10.0]))
def test_the_smallest_margin(seed, agreement, psi):
    program, recordings = batch_for(seed)
    wanted = plain_margin(hw.timestep_scores(program, recordings, psi), agreement)
    assert hw.calibrate_margin(program, recordings, agreement, psi) == wanted


@pytest.mark.parametrize("psi", [None, 10.0])
def test_margins_are_in_the_integers_of_the_readout(psi):
    program, recordings = batch_for(5)
    readout = program.readout
    tripled = replace(program, readout=replace(readout, weights=tuple(3 * weight for weight in readout.weights)))
    margin = hw.calibrate_margin(program, recordings, 0.5, psi)
    assert 0 < margin < float("inf")
    assert hw.calibrate_margin(tripled, recordings, 0.5, psi) == pytest.approx(3 * margin)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, margin=st.sampled_from([0.5, 1.0, 2.0, 5.0, float("inf")]), psi=st.sampled_from([None, 10.0]))
def test_stops_at_a_margin(seed, margin, psi):
    """The first step with the lead; the counts of a time phase that ends there, and of what follows it."""
    program, recordings = batch_for(seed)
    found = hw.stop_at_margin(program, recordings, margin, psi)
    scores = hw.timestep_scores(program, recordings, psi)
    assert found.all_steps == recordings.shape[1]
    assert np.array_equal(found.final, scores[:, -1].argmax(axis=1))
    wanted = dict.fromkeys(BY_CORE, 0)
    for b, recording in enumerate(recordings):
        step, one = int(found.steps[b]), scores[b]
        leads = leads_of(one)
        assert (leads[: step - 1] < margin).all()
        assert step == len(one) or leads[step - 1] >= margin
        assert found.prediction[b] == one[step - 1].argmax()
        short = replace(program, phases=(replace(program.phases[0], steps=step), program.phases[1]))
        until = recording * (np.arange(len(recording)) < step)[:, None].astype(np.uint8)
        wanted = {name: n + hw.simulate(short, until).counts[name] for name, n in wanted.items()}
    assert counted(found.counts) == wanted
    assert counted(found.all_counts) == counted(hw.simulate(program, recordings).counts)


def at_rest_for(program: hw.ChipProgram, recording: np.ndarray) -> list[int]:
    """For how many rows before each step the phases that play a recording as it comes held nothing at all."""
    found = hw.simulate(program, recording, probe=("u", "v"))
    names = [name for p in program.phases if p.axis == "time" for name in program.columns_of(p.name)]
    zero = [all(not found.u[n][t].any() and not found.v[n][t].any() for n in names) for t in range(len(recording))]
    still = [now and before for now, before in zip(zero, [True, *zero], strict=False)]
    return [next((k for k in range(t) if not still[t - 1 - k]), t) for t in range(1, len(recording) + 1)]


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, silence=st.integers(1, 6), first=st.sampled_from([None, 0, 4]))
def test_stops_in_silence(seed, silence, first):
    """The first step after so many silent rows whose registers are 0, and to which nothing more is under way."""
    program, _ = random_layer(seed)
    program, rows, r = by_potentials(program, first), 90, np.random.default_rng(seed)
    recordings = (r.random((4, rows, program.inputs[0].channels)) < 0.1).astype(np.uint8)
    recordings &= (np.arange(rows) < r.integers(0, rows, (4, 1)))[:, :, None].astype(np.uint8)
    found = hw.stop_in_silence(program, recordings, silence)
    cores = program.cores_of("time")
    under_way = 1 + max(int(core.axons.delay.max(initial=0)) for core in cores)
    biased = any(core.bias.any() for core in cores)
    final = hw.simulate(program, recordings).prediction
    for step, prediction, recording, end in zip(found.steps, found.prediction, recordings, final, strict=True):
        rests = at_rest_for(program, recording)
        events = [t for t in range(rows) if recording[t].any()]
        silent = [t - max((e + 1 for e in events if e < t), default=0) for t in range(1, rows + 1)]
        wanted = (t for t in range(1, rows + 1) if not biased and silent[t - 1] >= max(silence, under_way))
        assert step == next((t for t in wanted if rests[t - 1] >= under_way), rows)
        later = recording[step:].any()
        assert prediction == end or later
    assert (found.all_steps, found.final.tolist()) == (rows, final.tolist())
    assert biased or (found.steps < rows).any()


def test_what_a_silence_saves():
    """Class 0 spikes once, and rests from step 2 on: with three silent steps the end is after step 4."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096, decay_v=4096)
    program = builder.build()
    recording = np.zeros((2, 12, 2), dtype=np.uint8)
    recording[:, 0, 0] = recording[1, 10, 1] = 1
    found = hw.stop_in_silence(program, recording, 3)
    assert (found.steps.tolist(), found.all_steps, found.prediction.tolist()) == ([4, 4], 12, [0, 0])
    assert (found.counts.neuron_updates, found.all_counts.neuron_updates) == (2 * 4 * 2, 2 * 12 * 2)
    assert (found.counts.spikes, found.all_counts.spikes) == (2, 3)
    profile = CHIP.profile(CHIP.default_profile)
    whole = hw.simulate(program, recording, probe=("activity",)).activity["time"]
    ns = [hw.latency(program, {"time": one}, profile).total_ns for one in whole]
    short = hw.simulate(program, recording[:, :4], probe=("activity",)).activity["time"]
    until = [hw.latency(program, {"time": one}, profile).total_ns for one in short]
    assert (found.latency_ns, found.all_latency_ns) == (pytest.approx(sum(until)), pytest.approx(sum(ns)))
    assert hw.stop_in_silence(program, recording[:, :3], 3).steps.tolist() == [3, 3]


def test_silence_waits_for_what_is_under_way():
    """A spike that takes five steps to arrive: nothing is held meanwhile, and it would be too early to stop."""
    builder = hw.ProgramBuilder(CHIP)
    x, y = builder.add_input("x", 1), builder.add_compartments("y", 1, decay_u=4096, decay_v=4096, threshold=30)
    builder.connect(x, y, [[60]], delay=5)
    builder.read_out(y)
    recording = np.zeros((1, 20, 1), dtype=np.uint8)
    recording[0, 2] = 1
    # Sent in row 2 it acts in row 8, and row 9 forgets it. Rows 10 to 15 are the first six at rest.
    assert hw.stop_in_silence(builder.build(), recording, 2).steps.tolist() == [16]


def test_nothing_comes_after_the_end_of_a_recording():
    """Three events, and 37 silent steps that the program adds: what is proven there knows that no event is left."""
    builder, _ = one_layer([[60, 0], [0, 60]], decay_u=4096, decay_v=2048, refractory=2)
    program = builder.build()
    program = replace(program, phases=(replace(program.phases[0], steps=40),))
    recording = np.zeros((1, 3, 2), dtype=np.uint8)
    recording[0, :, 1] = 1
    stop = hw.stop_when_proven(program, recording)
    rests = 1 + int(hw.simulate(program, recording, probe=("activity",)).activity["time"][0]
                    .by_piece["neuron_updates_active"].any(axis=1).nonzero()[0].max())  # fmt: skip
    assert (stop.steps.tolist(), stop.prediction.tolist(), stop.all_steps) == ([rests], [1], 40)
    assert 4 < rests < 20
    silent = hw.stop_when_proven(program, 0 * recording)
    assert (silent.steps.tolist(), silent.counts.neuron_updates) == ([3], 6)
    for short in (recording, 0 * recording):
        longer = np.concatenate((short, np.zeros((1, 37, 2), dtype=np.uint8)), axis=1)
        assert hw.stop_when_proven(program, longer).steps.tolist() > [30]


def test_an_empty_buffer_ends_a_recording():
    """The location phase is not run where no event waits for it."""
    drawn = [random_hybrid(seed) for seed in range(40)]
    unbiased = [x for x in drawn if not any(core.bias.any() for core in x[0].cores_of("location"))]
    stops = [hw.stop_when_proven(program, 0 * recording[None]) for program, recording in unbiased]
    ends = [(int(stop.steps[0]), len(recording)) for stop, (_, recording) in zip(stops, unbiased, strict=True)]
    assert all(step <= rows for step, rows in ends)
    assert any(0 < step for step, _ in ends)


def test_agreement_on_the_recordings_it_was_calibrated_on():
    program, recordings = batch_for(4, batch=40)
    margin = hw.calibrate_margin(program, recordings, 0.9)
    found = hw.stop_at_margin(program, recordings, margin)
    assert (found.prediction == found.final).mean() >= 0.9


def test_a_shorter_recording_is_followed_by_silence():
    program, recording = random_hybrid(4)
    short = recording[:-5]
    padded = np.concatenate((short, np.zeros_like(recording[:5])))
    scores = hw.timestep_scores(program, short[None])
    assert np.array_equal(scores, hw.timestep_scores(program, padded[None]))
    assert np.array_equal(scores[0, -1], hw.simulate(program, short).scores)
    for stop in (hw.stop_when_proven, lambda p, x: hw.stop_at_margin(p, x, 2.0)):
        a, b = stop(program, short[None]), stop(program, padded[None])
        assert (a.steps.tolist(), a.all_steps, counted(a.counts)) == (b.steps.tolist(), b.all_steps, counted(b.counts))


@pytest.mark.parametrize(
    ("use", "line"),
    [
        (lambda p, x: hw.stop_when_proven(replace(p, readout=None), x), "program 'program': has no readout, so nothing wins. Read the spikes."),
        (lambda p, x: hw.stop_when_proven(p, x[:0]), "spikes: there is no recording, or it has no steps. Give some."),
        (lambda p, x: hw.stop_at_margin(p, x[:, :0], 2.0), "spikes: there is no recording, or it has no steps. Give some."),
        (lambda p, x: hw.stop_in_silence(p, x, 0), "silence: it is not a number of steps (got 0). Give 1 or more."),
        (lambda p, x: hw.calibrate_margin(p, x, 1.5), "agreement: it is a share (1.5 against 0 to 1). Correct it."),
        (lambda p, x: hw.calibrate_margin(p, x, float("nan")), "agreement: it is a share (nan against 0 to 1). Correct it."),
        (lambda p, x: hw.timestep_scores(p, x, -2.0), "psi: it is not a valid rate (got -2.0). Give 0 or more, such as 10."),
    ],
    ids=["no readout", "no recordings", "no steps", "silence", "agreement", "not a number", "psi"],
)  # fmt: skip
def test_messages(use, line):
    program, recordings = batch_for(4)
    with pytest.raises(hw.InputError) as caught:
        use(program, recordings)
    assert str(caught.value) == line


@pytest.mark.slow
@on_real_recordings
@pytest.mark.parametrize("name", ["objects", "containers"])
def test_no_future_changes_the_winner_of_a_real_recording(name):
    from locsnn_compile.data.read import read_recordings
    from locsnn_compile.frontends import load
    from locsnn_compile.pipeline import lower

    program = in_streams(lower(load(ROOT / f"examples/models/{name}-hybrid.pt"), CHIP, 8).program)
    recordings = read_recordings(REAL / f"Ev-{name.title()}.zip").spikes
    stops = hw.stop_when_proven(program, {"time": recordings, "location": recordings})
    assert stops.steps.mean() < stops.all_steps
    r = np.random.default_rng(0)
    for recording, done, prediction in zip(recordings, stops.steps, stops.prediction, strict=True):
        found = hw.simulate(program, futures(program, recording, int(done), r, batch=16))
        assert (found.prediction == prediction).all()
