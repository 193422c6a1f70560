"""The budget of every stage: its twin against the float reference on one side and the simulator on the other."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
import locsnn_compile as lc
from hw_model.arithmetic.fixed_point import effective_weight
from hw_model.mapping.graph import Readout
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, SrmAlpha, alpha_taps
from locsnn_compile.network.projections import ChipProjection, Projection
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.verification.diagnosis import SAMPLE, diagnose, spread_sample
from locsnn_compile.verification.error_budget.budget import (
    STAGES,
    error_budget,
    find_cause,
    lines_of,
    phases_of,
    twin_with,
)
from locsnn_compile.verification.error_budget.twin import run_twin
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import DECAY_OF_10, hybrid, recordings, single
from tests.support.real_recordings import REAL, on_real_recordings

CHIP = hw.chip("loihi-sim")
ROOT = Path(__file__).parents[2]
SRM = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=2.0, scale_ref=2.0)
ROUNDED = ("weights", "decays", "states", "thresholds", "wraps_clips")


def leaky(seed, *, size=6, channels=5, steps=40, scale=1.0, rule=">", delays=True):
    """Two populations of leaky integrate-and-fire neurons, the second recurrent, with delays and biases."""
    r = np.random.default_rng(seed)

    def population(name):
        neuron = Cuba.of(
            size,
            decay_u=r.uniform(0.05, 1.0, size),
            decay_v=r.uniform(0.02, 0.5, size),
            threshold=r.uniform(0.5, 2.0, size),
            bias=r.normal(0, 0.02, size),
            refractory=r.integers(1, 4, size),
            rule=rule,
        )
        return Population(name, "time", size, neuron)

    def projection(source, target, sources):
        delay = r.integers(0, 4, (size, sources)) if delays else 0
        return Projection(source, target, r.normal(0, scale, (size, sources)), delay)

    return Network(
        name="leaky",
        channels=channels,
        steps=steps,
        step_seconds=None,
        sensor=None,
        views=(InputView("events", "time", channels),),
        populations=(population("first"), population("second")),
        projections=(
            projection("events", "first", channels),
            projection("first", "second", size),
            projection("second", "second", size),
            projection("second", "first", size),
        ),
        readout=Readout(("second",), (1.0,)),
        sha256="0" * 64,
    )


def on_grid(seed=0, *, size=4, channels=3, steps=30):
    """One population in the chip's integers from the start."""
    r = np.random.default_rng(seed)
    neuron = ChipCuba.of(size, decay_u=1024, decay_v=128, threshold=100)
    mantissa = 2 * r.integers(-100, 100, (size, channels))
    return Network(
        name="integers",
        channels=channels,
        steps=steps,
        step_seconds=None,
        sensor=None,
        views=(InputView("events", "time", channels),),
        populations=(Population("only", "time", size, neuron),),
        projections=(
            ChipProjection("events", "only", mantissa, exponent=0, weight_bits=8, signs="mixed"),
        ),
        readout=Readout(("only",), (1.0,)),
        sha256="0" * 64,
    )


def spikes_with(levels, stages, played):
    """The spikes of the float64 twin with the deviations of some stages, by population."""
    spikes = {}
    for phase in phases_of(levels):
        lines = lines_of(levels.network, phase, played)
        spikes |= run_twin(twin_with(phase, stages), lines).spikes
    return spikes


def check_both_ends(network, bits, played, strategy="dendrite"):
    """Without stages the float reference, with all of them the simulator, register for register."""
    levels = lower(network, CHIP, bits, strategy)
    wanted = evaluate(network, played, potentials=True)
    chip = hw.simulate(levels.program, played, probe=("spikes", "potential"))
    for phase in phases_of(levels):
        names = tuple(group.exact.name for group in phase.program_neurons.groups)
        lines = lines_of(network, phase, played)
        whole = run_twin(twin_with(phase, STAGES), lines, potentials=names)
        exact = run_twin(twin_with(phase, ()), lines, potentials=tuple(whole.spikes))
        for name in names:
            assert np.array_equal(whole.potential[name], chip.potential[name]), name
        for name, spikes in whole.spikes.items():
            scale = levels.quantized.population(name).scale
            assert np.array_equal(spikes, chip.spikes[name]), name
            assert np.array_equal(exact.spikes[name], wanted.spikes[name]), name
            np.testing.assert_allclose(
                exact.potential[name] / scale, wanted.potential[name], rtol=1e-9, atol=1e-9
            )


@pytest.mark.slow
@settings(max_examples=16, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.sampled_from([1, 3, 8]),
    tau_sr=st.sampled_from([1.0, 10.0, 80.0]),
    scale=st.sampled_from([0.5, 8.0, 300.0]),
    strategy=st.sampled_from(["dendrite", "delay-line", "reset", "paired-dendrite"]),
)
def test_srm_twins_meet_reference_and_chip(seed, bits, tau_sr, scale, strategy):
    network = hybrid(seed, steps=40, hidden=5, neuron=replace(SRM, tau_sr=tau_sr), scale=scale)
    check_both_ends(network, bits, recordings(network, samples=2, seed=seed), strategy)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.sampled_from([1, 3, 8]),
    scale=st.sampled_from([0.1, 1.0, 100.0]),
    rule=st.sampled_from([">", ">="]),
)
def test_leaky_twins_meet_reference_and_chip(seed, bits, scale, rule):
    network = leaky(seed, scale=scale, rule=rule)
    check_both_ends(network, bits, recordings(network, samples=2, seed=seed))


@pytest.mark.parametrize("seed", range(3))
def test_integer_twins_are_the_chip_with_and_without_stages(seed):
    network = on_grid(seed)
    levels, played = lower(network, CHIP, weight_bits=8), recordings(network, samples=2, seed=seed)
    wanted = evaluate(network, played).spikes["only"]
    assert wanted.any()
    assert np.array_equal(hw.simulate(levels.program, played).spikes["only"], wanted)
    for stages in ((), STAGES):
        assert np.array_equal(spikes_with(levels, stages, played)["only"], wanted)


@pytest.fixture(scope="module")
def network():
    """A small hybrid of spike response neurons, with 12 channels and 60 steps."""
    return hybrid(1, steps=60, hidden=6, channels=12)


@pytest.fixture(scope="module")
def levels(network):
    """It at every level, with weights of 3 bits, which lose enough for every stage to show."""
    return lower(network, CHIP, weight_bits=3)


@pytest.fixture(scope="module")
def played(network):
    """Six random recordings."""
    return recordings(network, samples=6)


def budget_of_all(levels, played):
    observed = Observed(levels, played)
    return error_budget(observed, observed.numbers)


@pytest.fixture(scope="module")
def budget(levels, played):
    """What every stage of rounding changes on the recordings."""
    return budget_of_all(levels, played)


def test_together_is_what_matching_counts(budget, levels, played):
    match = compare(Observed(levels, played))
    assert budget.unexplained == 0
    assert budget.together.by_population == match.by_population
    assert (
        budget.together.predictions_changed
        == (match.reference_prediction != match.chip_prediction).sum()
    )
    assert budget.together.scores == match.scores
    assert budget.together.spikes.mismatches > 0


def test_a_network_that_is_read_by_potentials_has_a_budget_of_scores():
    """No spike and no class differs with weights of 2 bits, and the budget said that nothing is lost."""
    r = np.random.default_rng(3)
    cells = Cuba.of(3, decay_v=0.1, threshold=1e3)
    network = replace(
        single(cells, r.uniform(-1, 1, (3, 6))), readout=Readout(("n",), (1.0,), potentials_from=0)
    )
    levels = lower(network, CHIP, weight_bits=2)
    played = recordings(network, samples=4)
    match = compare(Observed(levels, played))
    budget = diagnose(Observed(levels, played), None).budget
    assert budget.together.spikes.mismatches == budget.alone["weights"].spikes.mismatches == 0
    assert match.scores.relative_error > 0.1
    assert budget.together.scores == match.scores
    assert budget.alone["weights"].scores.relative_error == pytest.approx(
        match.scores.relative_error, rel=0.05
    )
    assert budget.without["weights"].scores.relative_error < 0.01


def test_every_stage_is_counted_alone_and_left_out(budget, levels, network, played):
    wanted = evaluate(network, played).spikes
    assert tuple(budget.alone) == tuple(budget.without) == ROUNDED
    for stage in ROUNDED:
        for found, stages in (
            (budget.alone[stage], {stage}),
            (budget.without[stage], set(ROUNDED) - {stage}),
        ):
            spikes = spikes_with(levels, stages, played)
            for name, counted in found.by_population.items():
                assert counted.mismatches == (spikes[name] != wanted[name]).sum()
    assert budget.alone["weights"].spikes.mismatches > 0


def test_what_is_exact_changes_nothing(played):
    """Weights and decays that the chip holds exactly leave the rounding of states alone."""
    tau = -1 / np.log(1 - DECAY_OF_10 / 4096)
    neuron = SrmAlpha(theta=10.0, tau_sr=float(tau), tau_ref=1.0, scale_ref=0.0)
    network = hybrid(1, steps=60, hidden=6, channels=12, neuron=neuron)
    once = lower(network, CHIP, weight_bits=8).quantized
    gain = np.e * np.exp(-1 / tau) / tau
    on_grid_weights = tuple(
        replace(
            p,
            weights=effective_weight(q.mantissa, q.exponent)
            / (once.population(p.target).scale[:, None] * gain),
        )
        for p, q in zip(network.projections, once.projections, strict=True)
    )
    found = budget_of_all(
        lower(replace(network, projections=on_grid_weights), CHIP, weight_bits=8), played
    )
    assert [found.alone[stage].spikes.mismatches for stage in ("weights", "thresholds")] == [0, 0]
    assert found.unexplained == 0


def test_clips_alone_are_found():
    """Every input at every step: float potentials leave the register, and the stage keeps them within."""
    network = hybrid(0, steps=60, channels=12, neuron=replace(SRM, scale_ref=0.0))
    network = replace(
        network,
        projections=tuple(replace(p, weights=np.abs(p.weights)) for p in network.projections),
    )
    levels, played = lower(network, CHIP, weight_bits=8), np.ones((1, 60, 12), dtype=np.uint8)
    assert hw.simulate(levels.program, played).counts.clips > 0
    phase, name = phases_of(levels)[0], "time_hidden/dendrite"
    lines = lines_of(network, phase, played)
    free, held = (
        run_twin(twin_with(phase, stages), lines, potentials=(name,)).potential[name].max()
        for stages in ((), ("wraps_clips",))
    )
    assert held == CHIP.registers.voltage_max < free


@pytest.mark.parametrize(
    ("tau", "peak", "taps"),
    [(10.0, 1.0, 77), (1.0, 20.0, 11)],
    ids=["published kernel", "published refractory"],
)
def test_taps_are_those_of_slayer(tau, peak, taps):
    assert len(alpha_taps(tau, peak)) == taps


@pytest.mark.parametrize(
    "neuron",
    [SRM, SrmAlpha(theta=10.0, tau_sr=3.0, tau_ref=1.0, scale_ref=2.0)],
    ids=["tau 10", "tau 3"],
)
def test_cut_kernels_are_the_sums_over_their_taps(neuron):
    network = hybrid(3, steps=120, channels=12, neuron=neuron)
    played = recordings(network, samples=2, seed=5)
    populations = tuple(replace(p, neuron=p.neuron.cut()) for p in network.populations)
    found = evaluate(replace(network, populations=populations), played, potentials=True)

    def cut(tau, peak, lag):
        value = peak * lag / tau * np.exp(1 - lag / tau)
        return value if lag <= tau or abs(value) >= 0.01 else 0.0

    drive = played.astype(float) @ network.into("time_hidden")[0].weights.T
    spikes = found.spikes["time_hidden"].astype(float)
    for t in range(network.steps):
        wanted = sum(
            drive[:, s] * cut(neuron.tau_sr, 1.0, t - s)
            + spikes[:, s] * cut(neuron.tau_ref, -neuron.scale_ref * neuron.theta, t - s)
            for s in range(t)
        )
        np.testing.assert_allclose(found.potential["time_hidden"][:, t], wanted, atol=1e-9)


def test_a_network_without_kernels_has_no_tail():
    network = leaky(0)
    assert (
        budget_of_all(lower(network, CHIP, weight_bits=8), recordings(network)).kernel_tail is None
    )


def test_the_cause_adds_up_to_the_difference(levels, network, played):
    first = compare(Observed(levels, played)).first_divergence
    cause = find_cause(Observed(levels, played), first)
    assert cause.together == pytest.approx(
        first.chip_potential - first.reference_potential, abs=1e-9
    )
    assert sum(cause.moved.values()) + cause.rest == pytest.approx(cause.together)
    assert cause.largest == "weights"
    fires = first.chip_potential >= first.threshold
    reproduced = tuple(
        stage
        for stage, moved in cause.moved.items()
        if (first.reference_potential + moved >= first.threshold) == fires
    )
    assert cause.enough == reproduced


@pytest.mark.parametrize("seed", range(4))
def test_the_cause_holds_where_neurons_reset_and_recur(seed):
    network = leaky(seed, scale=1.0)
    levels, played = lower(network, CHIP, weight_bits=2), recordings(network, samples=4, seed=seed)
    first = compare(Observed(levels, played)).first_divergence
    cause = find_cause(Observed(levels, played), first)
    assert cause.together == pytest.approx(
        first.chip_potential - first.reference_potential, abs=1e-9
    )


@pytest.mark.parametrize(
    ("available", "samples", "numbers"),
    [
        (3, SAMPLE, (0, 1, 2)),
        (31, SAMPLE, tuple(range(0, 31, 2))),
        (9, 3, (0, 4, 8)),
        (1, 5, (0,)),
        (20, None, tuple(range(20))),
    ],
    ids=["few", "many", "asked for", "one", "all"],
)
def test_a_sample_is_spread_evenly(network, available, samples, numbers):
    assert spread_sample(network, available, samples) == numbers


def test_a_large_network_takes_fewer_recordings(network):
    steps = sum(p.size * network.steps_of(p.phase) for p in network.populations)
    large = replace(
        network,
        populations=tuple(
            replace(p, size=p.size * ((1 << 22) // steps)) for p in network.populations
        ),
    )
    assert spread_sample(large, 50, SAMPLE) == (0,)


def test_an_integer_network_has_no_budget():
    network = on_grid()
    levels, played = lower(network, CHIP, weight_bits=8), recordings(network)
    found = diagnose(Observed(levels, played), compare(Observed(levels, played)).first_divergence)
    assert (found.budget, found.cause) == (None, None)
    assert found.margins.populations["only"].error == {0.5: 0.0, 0.95: 0.0, 1.0: 0.0}


def test_compile_reports_the_diagnosis_unless_told_not_to(network, played):
    compiled = lc.compile(network, events=played, strategy="dendrite", weight_bits=3)
    report = compiled.report
    assert report["error_budget"]["recordings"] == list(range(6))
    assert (
        report["error_budget"]["together"]["spike_mismatches"]
        == report["match"]["spike_mismatches"]
    )
    assert report["error_budget"]["unexplained_spikes"] == 0
    assert report["match"]["first_divergence"]["cause"]["largest"] == "weights"
    assert list(report["margins"]["by_population"]) == [p.name for p in network.populations]
    json.dumps(report, allow_nan=False)
    bare = lc.compile(network, events=played, strategy="dendrite", weight_bits=3, diagnosis=False)
    assert not {"error_budget", "margins"} & bare.report.keys()
    assert bare.report["match"]["first_divergence"]["cause"] is None
    assert "Error budget" not in render_markdown(compose(bare.figures))


def test_diagnose_takes_all_recordings_or_as_many_as_asked(network, played):
    compiled = lc.compile(network, events=played, strategy="reset", weight_bits=8, diagnosis=False)
    found = lc.diagnose(compiled, played)
    assert (found.recordings, found.available) == ((0, 1, 2, 3, 4, 5), 6)
    assert found.cause.largest == "kernel"
    assert found.budget.alone["kernel"].spikes.mismatches > 0
    assert lc.diagnose(compiled, played, samples=2).recordings == (0, 5)


@on_real_recordings
@pytest.mark.parametrize(
    ("name", "strategy"),
    [
        ("objects", "dendrite"),
        ("objects", "delay-line"),
        ("containers", "dendrite"),
        ("containers", "reset"),
    ],
)
def test_the_shipped_networks_leave_nothing_unexplained(name, strategy):
    """Real recordings, spread over the test part: with all stages every spike is the chip's, with none the network's."""
    network = lc.load(ROOT / f"examples/models/{name}-hybrid.pt")
    levels = lower(network, CHIP, weight_bits=8, strategy=strategy)
    spikes = lc.read_recordings(REAL / f"Ev-{name.title()}.zip").spikes
    played = spikes[list(spread_sample(network, len(spikes), 3))]
    match = compare(Observed(levels, played))
    found = diagnose(Observed(levels, played), match.first_divergence)
    assert found.budget.unexplained == 0
    assert found.budget.together.by_population == match.by_population
    assert found.cause.largest == ("kernel" if strategy == "reset" else "weights")
    assert found.cause.largest in found.cause.enough
