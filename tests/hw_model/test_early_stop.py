"""Early stops that are proven stand whatever follows, and come as early as the bound proves them."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.description.counts import BY_CORE
from hw_model.mapping.graph import Readout
from tests.support.early_stops import (
    SEEDS,
    by_potentials,
    counts_by_core,
    possible_futures,
    program_and_batch,
    random_layer,
    with_stream_per_phase,
)
from tests.support.hybrids import CHIP, random_hybrid
from tests.support.real_recordings import REAL, on_real_recordings

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, channels_per_step=st.integers(1, 2))
def test_no_future_changes_a_proven_winner(seed, channels_per_step):
    program, recording = random_hybrid(seed, channels_per_step)
    program = by_potentials(
        with_stream_per_phase(program), (None, 0, 3, (None, 2), (4, None), (3, 1))[seed % 6]
    )
    stops = hw.stop_when_proven(program, {"time": recording[None], "location": recording[None]})
    steps_done = int(stops.steps[0])
    assert 0 <= steps_done <= stops.all_steps == sum(phase.steps for phase in program.phases)
    result = hw.simulate(
        program, possible_futures(program, recording, steps_done, np.random.default_rng(seed))
    )
    assert (result.prediction == stops.prediction[0]).all()


@pytest.mark.slow
@settings(max_examples=90, deadline=None)
@given(seed=SEEDS, first=st.sampled_from([None, None, 0, 2, 9]))
def test_every_single_future_keeps_a_proven_winner(seed, first):
    """All of them: small enough to be played."""
    program, recording = random_layer(seed)
    program = by_potentials(program, first)
    stops = hw.stop_when_proven(program, recording[None])
    steps_done = int(stops.steps[0])
    rest = recording[steps_done:]
    if rest.size > 10:
        rest = rest[-10 // recording.shape[1] :]
    many = np.array(list(product((0, 1), repeat=rest.size)), dtype=np.uint8).reshape(
        2**rest.size, *rest.shape
    )
    played = np.repeat(recording[None], len(many), axis=0)
    played[:, len(recording) - len(rest) :] = many
    assert (hw.simulate(program, played).prediction == stops.prediction[0]).all()


def most_to_come(
    program: hw.ChipProgram, result, name: str, at: int, steps: int
) -> list[tuple[int, int]]:
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
        n = 0
        most = int(core.vmin)
        for step in range(at, steps):
            joined = 0
            for c in family:
                u[c] = left(u[c], setting["decay_u"][c]) + int(charge[c])
                arrived = (
                    left(v[c], setting["decay_v"][c])
                    + u[c]
                    + int(core.bias[c])
                    + (joined if c == soma else 0)
                )
                v[c] = min(core.vmax, max(core.vmin, arrived))
                joined += v[c] if c != soma else 0
            if step >= free and (
                v[soma] > core.threshold_voltage[soma] or not all(kept[c] for c in family)
            ):
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
    steps = len(recording)
    first = program.readout.potentials_from
    for at in range(steps):
        more = most_to_come(program, result, name, at, steps)
        if first is None:
            now = [int(n) for n in result.spikes[name][:at].sum(axis=0, dtype=np.int64)]
            ends = [(n, n + spikes) for n, (spikes, _) in zip(now, more, strict=True)]
        else:
            seen = [[int(v) for v in row] for row in result.potential[name][first:at].T]
            now = [max(row, default=0) for row in seen]
            least = program.cores[0].vmin
            ends = [
                (max(*row, least, least), max(*row, top, top))
                for row, (_, top) in zip(seen, more, strict=True)
            ]
            ends = ends if first < steps else [(0, 0)] * len(now)
        score = [weight * n for n in now]
        low = [min(weight * a, weight * b) for a, b in ends]
        high = [max(weight * a, weight * b) for a, b in ends]
        w = score.index(max(score))
        if low == high or all(
            high[c] < low[w] or (exact and c > w and high[c] == low[w])
            for c in range(len(score))
            if c != w
        ):
            return at
    return steps


@pytest.mark.slow
@settings(max_examples=90, deadline=None)
@given(seed=SEEDS, first=st.sampled_from([None, None, 0, 2, 9]))
def test_the_stop_is_the_first_step_that_the_bound_proves(seed, first):
    program, recording = random_layer(seed)
    program = by_potentials(program, first)
    assert int(hw.stop_when_proven(program, recording[None]).steps[0]) == first_proven(
        program, recording
    )


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_counts_of_a_proven_stop_are_those_of_so_many_steps(seed):
    program, recording = random_hybrid(seed)
    stops = hw.stop_when_proven(program, recording[None])
    assert counts_by_core(stops.all_counts) == counts_by_core(
        hw.simulate(program, recording).counts
    )
    left = int(stops.steps[0])
    expected = dict.fromkeys(BY_CORE, 0)
    result = hw.simulate(program, recording, probe=("activity",))
    for phase in program.phases:
        steps = min(left, phase.steps)
        left -= steps
        if phase.name == "time" and steps:
            short = replace(
                program,
                phases=tuple(replace(p, steps=steps) if p is phase else p for p in program.phases),
            )
            counts = counts_by_core(hw.simulate(short, recording).counts_by_phase["time"])
        else:
            activity = result.activity[phase.name][0]
            counts = {name: int(activity.count(name)[:steps].sum()) for name in BY_CORE}
        expected = {name: n + counts[name] for name, n in expected.items()}
    assert counts_by_core(stops.counts) == expected


def test_phases_that_do_not_vote_are_run_nevertheless():
    """The location phase comes after all steps of the time phase, whether they matter or not."""
    program, recording = random_hybrid(4)
    alone = replace(program, readout=Readout(("location/y",), (1.0,)))
    stops = hw.stop_when_proven(alone, recording[None])
    assert stops.all_steps == sum(recording.shape)
    assert len(recording) < stops.steps[0] <= stops.all_steps
    assert stops.counts.spikes >= hw.simulate(program, recording).counts_by_phase["time"].spikes


def test_an_empty_buffer_ends_a_recording():
    """The location phase is not run where no event waits for it."""
    drawn = [random_hybrid(seed) for seed in range(40)]
    unbiased = [x for x in drawn if not any(core.bias.any() for core in x[0].cores_of("location"))]
    stops = [hw.stop_when_proven(program, 0 * recording[None]) for program, recording in unbiased]
    ends = [
        (int(stop.steps[0]), len(recording))
        for stop, (_, recording) in zip(stops, unbiased, strict=True)
    ]
    assert all(step <= rows for step, rows in ends)
    assert any(0 < step for step, _ in ends)


def test_a_shorter_recording_is_followed_by_silence():
    program, recording = random_hybrid(4)
    short = recording[:-5]
    padded = np.concatenate((short, np.zeros_like(recording[:5])))
    scores = hw.timestep_scores(program, short[None])
    assert np.array_equal(scores, hw.timestep_scores(program, padded[None]))
    assert np.array_equal(scores[0, -1], hw.simulate(program, short).scores)
    for stop in (hw.stop_when_proven, lambda p, x: hw.stop_at_margin(p, x, 2.0)):
        a = stop(program, short[None])
        b = stop(program, padded[None])
        assert (a.steps.tolist(), a.all_steps, counts_by_core(a.counts)) == (
            b.steps.tolist(),
            b.all_steps,
            counts_by_core(b.counts),
        )


@pytest.mark.parametrize(
    ("use", "line"),
    [
        (lambda p, x: hw.stop_when_proven(replace(p, readout=None), x), "program 'program': has no readout, so nothing wins. Read the spikes."),
        (lambda p, x: hw.stop_when_proven(p, x[:0]), "spikes: there is no recording, or it has no steps. Give some."),
        (lambda p, x: hw.stop_at_margin(p, x[:, :0], 2.0), "spikes: there is no recording, or it has no steps. Give some."),
        (lambda p, x: hw.stop_at_margin(p, x, 0), "margin: it must be above 0 (got 0). Use that of calibrate_margin."),
        (lambda p, x: hw.stop_at_margin(p, x, float("nan")), "margin: it must be above 0 (got nan). Use that of calibrate_margin."),
        (lambda p, x: hw.stop_in_silence(p, x, 0), "silence: it is not a number of steps (got 0). Give 1 or more."),
        (lambda p, x: hw.calibrate_margin(p, x, 1.5), "agreement: it must be a share (1.5 against 0 to 1). Correct it."),
        (lambda p, x: hw.calibrate_margin(p, x, float("nan")), "agreement: it must be a share (nan against 0 to 1). Correct it."),
        (lambda p, x: hw.timestep_scores(p, x, -2.0), "psi: it is not a valid rate (got -2.0). Give 0 or more, such as 10."),
    ],
    ids=["no readout", "no recordings", "no steps", "no margin", "margin that is no number", "silence", "agreement", "not a number", "psi"],
)  # fmt: skip
def test_messages(use, line):
    program, recordings = program_and_batch(4)
    with pytest.raises(hw.InputError) as caught:
        use(program, recordings)
    assert str(caught.value) == line


@pytest.mark.minutes
@on_real_recordings
@pytest.mark.parametrize("name", ["objects", "containers"])
def test_no_future_changes_the_winner_of_a_real_recording(name):
    from locsnn_compile.data.read import read_recordings
    from locsnn_compile.frontends import load
    from locsnn_compile.pipeline import lower

    program = with_stream_per_phase(
        lower(load(ROOT / f"examples/models/{name}-hybrid.pt"), CHIP, 8).program
    )
    recordings = read_recordings(REAL / f"Ev-{name.title()}.zip").spikes
    stops = hw.stop_when_proven(program, {"time": recordings, "location": recordings})
    assert stops.steps.mean() < stops.all_steps
    r = np.random.default_rng(0)
    for recording, done, prediction in zip(recordings, stops.steps, stops.prediction, strict=True):
        result = hw.simulate(program, possible_futures(program, recording, int(done), r, batch=16))
        assert (result.prediction == prediction).all()
