"""Proven early stops: no continuation changes the winner, and none comes later than its bound allows.

Continuations are played: random ones, all of a small layer, and those of real recordings. :class:`PlainBound` computes
the bound a second time, in Python's integers.
"""

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
from tests.support.register_units import FORGETS_AT_ONCE

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
    """All continuations of a small layer are played, or all of its last rows: up to 2^10."""
    program, recording = random_layer(seed)
    program = by_potentials(program, first)
    stops = hw.stop_when_proven(program, recording[None])
    steps_done = int(stops.steps[0])
    later_rows = recording[steps_done:]
    if later_rows.size > 10:
        later_rows = later_rows[-10 // recording.shape[1] :]
    futures = np.array(list(product((0, 1), repeat=later_rows.size)), dtype=np.uint8)
    futures = futures.reshape(2**later_rows.size, *later_rows.shape)
    played = np.repeat(recording[None], len(futures), axis=0)
    played[:, len(recording) - len(later_rows) :] = futures
    assert (hw.simulate(program, played).prediction == stops.prediction[0]).all()


class PlainBound:
    """What a population can still do after ``at`` steps, by the rules of the proof's module, in Python's integers.

    In every step each compartment gets its largest charge, the sum of its positive weights. A compartment that may wrap
    may have any value, so its soma may spike in any step in which it is not refractory. A negative voltage counts as 0
    in the next step, as a refractory period could have set it to 0.
    """

    def __init__(self, program: hw.ChipProgram, result: hw.SimulationResult, at: int) -> None:
        assert len(program.cores) == 1
        self.program = program
        self.core = program.cores[0]
        self.result = result
        self.at = at
        (proven,) = hw.prove_range(program)
        self.cannot_wrap = proven.cannot_wrap
        self.most_charge = np.zeros(self.core.compartments, dtype=np.int64)
        positive_weights = np.maximum(self.core.effective_weights, 0)
        np.add.at(self.most_charge, self.core.axons.target, positive_weights)
        self.slices = {piece.group: piece for piece in self.core.slices}

    def after(self, name: str, steps: int) -> list[tuple[int, int]]:
        """Return the most spikes and the largest potential of each neuron from step ``at`` to step ``steps``."""
        return [self.of_neuron(name, neuron, steps) for neuron in range(self.slices[name].size)]

    def of_neuron(self, name: str, neuron: int, steps: int) -> tuple[int, int]:
        """Return the most spikes and the largest potential of one neuron: its soma and dendrites, the family."""
        core = self.core
        soma = self.slices[name].offset + neuron
        family = [c for c in range(core.compartments) if core.parent[c] == soma] + [soma]
        never_wraps = all(self.cannot_wrap[c] for c in family)
        u = {c: self.last_value(self.result.u, c, neuron) for c in family}
        v = {c: self.last_value(self.result.v, c, neuron) for c in family}
        refractory = int(core.setting("refractory")[soma])
        spikes_before = np.flatnonzero(self.result.spikes[name][: self.at, neuron])
        free_from = int(spikes_before[-1]) + refractory if len(spikes_before) else 0
        counts_from = self.program.readout.potentials_from or 0

        spikes = 0
        largest = int(core.vmin)
        for step in range(self.at, steps):
            self.advance(family, soma, u, v)
            may_spike = v[soma] > core.threshold_voltage[soma] or not never_wraps
            if step >= free_from and may_spike:
                spikes += 1
                free_from = step + refractory
            v[soma] = max(v[soma], 0)
            if step >= counts_from:
                largest = max(largest, v[soma] if never_wraps else int(core.vmax))
        return spikes, largest

    def last_value(self, registers: dict[str, np.ndarray], compartment: int, neuron: int) -> int:
        """Return a register of a neuron's compartment after ``at`` steps."""
        if self.at == 0:
            return 0
        for piece in self.core.slices:
            if piece.offset + neuron == compartment:
                return int(registers[piece.group][self.at - 1, neuron])
        raise AssertionError(compartment)

    def advance(self, family: list[int], soma: int, u: dict[int, int], v: dict[int, int]) -> None:
        """Advance the registers of the dendrites and then of their soma by a step."""
        core = self.core
        joined = 0
        for c in family:
            u[c] = kept(u[c], core.setting("decay_u")[c]) + int(self.most_charge[c])
            v_sum = kept(v[c], core.setting("decay_v")[c]) + u[c] + int(core.bias[c])
            if c == soma:
                v_sum += joined
            v[c] = min(core.vmax, max(core.vmin, v_sum))
            joined += v[c]


def kept(x: int, decay: int) -> int:
    """Return x (4096 - decay) / 4096, truncated toward zero."""
    magnitude = abs(x) * (FORGETS_AT_ONCE - int(decay)) // FORGETS_AT_ONCE
    return magnitude if x >= 0 else -magnitude


def first_proven(program: hw.ChipProgram, recording: np.ndarray) -> int:
    """Return the first step after which the plain bound proves the winner, with exact scores."""
    result = hw.simulate(program, recording, probe=("spikes", "u", "v", "potential"))
    steps = len(recording)
    return next((at for at in range(steps) if is_proven(program, result, at, steps)), steps)


def is_proven(program: hw.ChipProgram, result: hw.SimulationResult, at: int, steps: int) -> bool:
    """Return whether no other class can win any more than the one that leads after ``at`` steps."""
    (name,) = program.readout.populations
    (float_weight,) = program.readout.weights
    weight = Fraction(float_weight)
    # With other weights scores are rounded, so a tie proves nothing.
    is_exact = float(float_weight).is_integer()
    to_come = PlainBound(program, result, at).after(name, steps)
    first = program.readout.potentials_from
    if first is None:
        so_far = result.spikes[name][:at].sum(axis=0, dtype=np.int64).tolist()
        ends = [(n, n + spikes) for n, (spikes, _) in zip(so_far, to_come, strict=True)]
    else:
        potentials = result.potential[name][first:at].T.tolist()
        so_far = [max(of_class, default=0) for of_class in potentials]
        lowest = int(program.cores[0].vmin)
        ends = [
            (max([*of_class, lowest]), max([*of_class, highest]))
            for of_class, (_, highest) in zip(potentials, to_come, strict=True)
        ]
        if first >= steps:
            ends = [(0, 0)] * len(so_far)
    # A negative weight makes the lowest number the highest score.
    least = [min(weight * low, weight * high) for low, high in ends]
    most = [max(weight * low, weight * high) for low, high in ends]
    scores = [weight * n for n in so_far]
    winner = scores.index(max(scores))

    def stays_behind(rival: int) -> bool:
        ties_and_loses = is_exact and rival > winner and most[rival] == least[winner]
        return most[rival] < least[winner] or ties_and_loses

    rivals = [rival for rival in range(len(scores)) if rival != winner]
    return least == most or all(map(stays_behind, rivals))


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
def test_a_proven_stop_counts_the_steps_before_it(seed):
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
    ("use", "message"),
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
def test_mistakes_are_refused_with_their_way_out(use, message):
    program, recordings = program_and_batch(4)
    with pytest.raises(hw.InputError) as caught:
        use(program, recordings)
    assert str(caught.value) == message


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
    for recording, steps_done, prediction in zip(
        recordings, stops.steps, stops.prediction, strict=True
    ):
        result = hw.simulate(
            program, possible_futures(program, recording, int(steps_done), r, batch=16)
        )
        assert (result.prediction == prediction).all()
