"""The error budget: how much of the difference between network and chip each stage of rounding explains.

A twin is a float64 simulation of the program with the deviations of some stages only (weights, decays, states,
thresholds, wraps and clips). Without any it must be the float reference, with all of them the simulator.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.graph import Readout
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, SrmAlpha, alpha_taps
from locsnn_compile.network.projections import ChipProjection, Projection
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.verification.diagnosis import NEURON_STEPS, SAMPLE, diagnose, spread_sample
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
from tests.support.networks import (
    TAU_ON_GRID,
    hybrid,
    recordings,
    single,
    with_weights_of_chip,
)
from tests.support.real_recordings import REAL, on_real_recordings

CHIP = hw.chip("loihi-sim")
ROOT = Path(__file__).parents[2]
SRM = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=2.0, scale_ref=2.0)
ROUNDED = ("weights", "decays", "states", "thresholds", "wraps_clips")


def leaky(seed, *, size=6, channels=5, steps=40, scale=1.0, rule=">", delays=True):
    """Return two populations of leaky integrate-and-fire neurons with biases, delays, and loops within and between them."""
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
    """Return a network of one population that is in the chip's integers from the start."""
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
    """Return the spikes of the float64 twin with the deviations of some stages, by population."""
    spikes = {}
    for phase in phases_of(levels):
        lines = lines_of(levels.network, phase, played)
        spikes |= run_twin(twin_with(phase, stages), lines).spikes
    return spikes


def check_both_ends(network, bits, played, strategy="dendrite"):
    """Check that the twin without stages is the float reference, and with all of them the simulator."""
    levels = lower(network, CHIP, bits, strategy)
    reference = evaluate(network, played, potentials=True)
    chip = hw.simulate(levels.program, played, probe=("spikes", "potential"))
    for phase in phases_of(levels):
        names = tuple(group.exact.name for group in phase.program_neurons.groups)
        lines = lines_of(network, phase, played)
        with_all = run_twin(twin_with(phase, STAGES), lines, potentials=names)
        with_none = run_twin(twin_with(phase, ()), lines, potentials=tuple(with_all.spikes))
        for name in names:
            assert np.array_equal(with_all.potential[name], chip.potential[name]), name
        for name, spikes in with_all.spikes.items():
            scale = levels.quantized.population(name).scale
            assert np.array_equal(spikes, chip.spikes[name]), name
            assert np.array_equal(with_none.spikes[name], reference.spikes[name]), name
            np.testing.assert_allclose(
                with_none.potential[name] / scale, reference.potential[name], rtol=1e-9, atol=1e-9
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
    levels = lower(network, CHIP, weight_bits=8)
    played = recordings(network, samples=2, seed=seed)
    expected = evaluate(network, played).spikes["only"]
    assert expected.any()
    assert np.array_equal(hw.simulate(levels.program, played).spikes["only"], expected)
    for stages in ((), STAGES):
        assert np.array_equal(spikes_with(levels, stages, played)["only"], expected)


@pytest.fixture(scope="module")
def network():
    """A small hybrid of spike response neurons, with 12 channels and 60 steps."""
    return hybrid(1, steps=60, hidden=6, channels=12)


@pytest.fixture(scope="module")
def levels(network):
    """The compiled levels of the network with weights of 3 bits, which lose enough for every stage to show."""
    return lower(network, CHIP, weight_bits=3)


@pytest.fixture(scope="module")
def played(network):
    """Six random recordings."""
    return recordings(network, samples=6)


def budget_of_all(levels, played):
    """Return the error budget over all recordings."""
    observed = Observed(levels, played)
    return error_budget(observed, observed.numbers)


@pytest.fixture(scope="module")
def budget(levels, played):
    """The error budget of the network over all recordings."""
    return budget_of_all(levels, played)


def test_all_stages_together_change_what_matching_counts(budget, levels, played):
    match = compare(Observed(levels, played))
    changed = match.reference_prediction != match.chip_prediction
    assert budget.unexplained == 0
    assert budget.together.by_population == match.by_population
    assert budget.together.predictions_changed == changed.sum()
    assert budget.together.scores == match.scores
    assert budget.together.spikes.mismatches > 0


def test_a_network_that_is_read_by_potentials_has_a_budget_of_scores():
    """The threshold is so high that no neuron spikes: weights of 2 bits change scores only, by more than a tenth."""
    r = np.random.default_rng(3)
    silent_neurons = Cuba.of(3, decay_v=0.1, threshold=1e3)
    network = replace(
        single(silent_neurons, r.uniform(-1, 1, (3, 6))),
        readout=Readout(("n",), (1.0,), potentials_from=0),
    )
    levels = lower(network, CHIP, weight_bits=2)
    played = recordings(network, samples=4)
    match = compare(Observed(levels, played))
    budget = diagnose(Observed(levels, played), first=None).budget
    assert budget.together.spikes.mismatches == budget.alone["weights"].spikes.mismatches == 0
    assert match.scores.relative_error > 0.1
    assert budget.together.scores == match.scores
    assert budget.alone["weights"].scores.relative_error == pytest.approx(
        match.scores.relative_error, rel=0.05
    )
    assert budget.without["weights"].scores.relative_error < 0.01


def test_every_stage_is_counted_alone_and_left_out(budget, levels, network, played):
    reference = evaluate(network, played).spikes

    def check_mismatches(deviation, stages):
        spikes = spikes_with(levels, stages, played)
        for name, match in deviation.by_population.items():
            assert match.mismatches == (spikes[name] != reference[name]).sum()

    assert tuple(budget.alone) == tuple(budget.without) == ROUNDED
    for stage in ROUNDED:
        check_mismatches(budget.alone[stage], stages={stage})
        check_mismatches(budget.without[stage], stages=set(ROUNDED) - {stage})
    assert budget.alone["weights"].spikes.mismatches > 0


def test_weights_and_thresholds_that_the_chip_holds_exactly_change_nothing(played):
    neuron = SrmAlpha(theta=10.0, tau_sr=TAU_ON_GRID, tau_ref=1.0, scale_ref=0.0)
    network = hybrid(1, steps=60, hidden=6, channels=12, neuron=neuron)
    exact_network = with_weights_of_chip(network, CHIP)
    budget = budget_of_all(lower(exact_network, CHIP, weight_bits=8), played)
    assert budget.alone["weights"].spikes.mismatches == 0
    assert budget.alone["thresholds"].spikes.mismatches == 0
    assert budget.unexplained == 0


def test_the_stage_of_clips_keeps_potentials_within_their_register():
    """All inputs spike in every step, so that float potentials exceed the register."""
    network = hybrid(0, steps=60, channels=12, neuron=replace(SRM, scale_ref=0.0))
    network = replace(
        network,
        projections=tuple(replace(p, weights=np.abs(p.weights)) for p in network.projections),
    )
    levels = lower(network, CHIP, weight_bits=8)
    played = np.ones((1, 60, 12), dtype=np.uint8)
    assert hw.simulate(levels.program, played).counts.clips > 0
    phase = phases_of(levels)[0]
    lines = lines_of(network, phase, played)

    def largest_potential(stages):
        name = "time_hidden/dendrite"
        return run_twin(twin_with(phase, stages), lines, potentials=(name,)).potential[name].max()

    assert largest_potential(stages=()) > CHIP.registers.voltage_max
    assert largest_potential(stages=("wraps_clips",)) == CHIP.registers.voltage_max


@pytest.mark.parametrize(
    ("tau", "peak", "taps"),
    [(10.0, 1.0, 77), (1.0, 20.0, 11)],
    ids=["published kernel", "published refractory"],
)
def test_kernels_have_as_many_taps_as_slayer_keeps(tau, peak, taps):
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
    evaluated = evaluate(replace(network, populations=populations), played, potentials=True)

    def tap(tau, peak, lag):
        """Return a tap of an alpha kernel, which slayerPytorch ends beyond tau where it falls below 0.01."""
        value = peak * lag / tau * np.exp(1 - lag / tau)
        return value if lag <= tau or abs(value) >= 0.01 else 0.0

    drive = played.astype(float) @ network.into("time_hidden")[0].weights.T
    spikes = evaluated.spikes["time_hidden"].astype(float)
    for t in range(network.steps):
        expected = 0.0
        for s in range(t):
            response = tap(neuron.tau_sr, 1.0, t - s)
            refractory = tap(neuron.tau_ref, -neuron.scale_ref * neuron.theta, t - s)
            expected = expected + drive[:, s] * response + spikes[:, s] * refractory
        np.testing.assert_allclose(evaluated.potential["time_hidden"][:, t], expected, atol=1e-9)


def test_the_budget_of_a_network_without_kernels_has_no_tail():
    network = leaky(0)
    levels = lower(network, CHIP, weight_bits=8)
    assert budget_of_all(levels, recordings(network)).kernel_tail is None


def test_the_cause_adds_up_to_the_difference(levels, network, played):
    """The cause says how far each stage moves the potential of the first neuron that decides otherwise on the chip."""
    first = compare(Observed(levels, played)).first_divergence
    cause = find_cause(Observed(levels, played), first)
    difference = first.chip_potential - first.reference_potential
    assert cause.together == pytest.approx(difference, abs=1e-9)
    assert sum(cause.moved.values()) + cause.rest == pytest.approx(cause.together)
    assert cause.largest == "weights"
    chip_fires = first.chip_potential >= first.threshold
    enough = []
    for stage, moved in cause.moved.items():
        fires_with_stage = first.reference_potential + moved >= first.threshold
        if fires_with_stage == chip_fires:
            enough.append(stage)
    assert cause.enough == tuple(enough)


@pytest.mark.parametrize("seed", range(4))
def test_the_cause_adds_up_where_neurons_reset_and_recur(seed):
    network = leaky(seed, scale=1.0)
    levels = lower(network, CHIP, weight_bits=2)
    played = recordings(network, samples=4, seed=seed)
    first = compare(Observed(levels, played)).first_divergence
    cause = find_cause(Observed(levels, played), first)
    difference = first.chip_potential - first.reference_potential
    assert cause.together == pytest.approx(difference, abs=1e-9)


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


def test_of_a_large_network_fewer_recordings_are_sampled(network):
    """So large that more than one recording would take more steps of neurons than the diagnosis may take."""
    neuron_steps = sum(p.size * network.steps_of(p.phase) for p in network.populations)
    factor = NEURON_STEPS // neuron_steps
    populations = tuple(replace(p, size=p.size * factor) for p in network.populations)
    large = replace(network, populations=populations)
    assert spread_sample(large, 50, SAMPLE) == (0,)


def test_an_integer_network_has_no_budget():
    network = on_grid()
    levels = lower(network, CHIP, weight_bits=8)
    observed = Observed(levels, recordings(network))
    diagnosis = diagnose(observed, compare(observed).first_divergence)
    assert diagnosis.budget is None
    assert diagnosis.cause is None
    assert diagnosis.margins.populations["only"].error == {0.5: 0.0, 0.95: 0.0, 1.0: 0.0}


def test_the_report_has_the_diagnosis_unless_it_is_turned_off(network, played):
    compiled = lc.compile(network, events=played, strategy="dendrite", weight_bits=3)
    report = compiled.report
    assert report["error_budget"]["recordings"] == list(range(6))
    mismatches = report["error_budget"]["together"]["spike_mismatches"]
    assert mismatches == report["match"]["spike_mismatches"]
    assert report["error_budget"]["unexplained_spikes"] == 0
    assert report["match"]["first_divergence"]["cause"]["largest"] == "weights"
    assert list(report["margins"]["by_population"]) == [p.name for p in network.populations]
    json.dumps(report, allow_nan=False)
    plain = lc.compile(network, events=played, strategy="dendrite", weight_bits=3, diagnosis=False)
    assert not {"error_budget", "margins"} & plain.report.keys()
    assert plain.report["match"]["first_divergence"]["cause"] is None
    assert "Error budget" not in render_markdown(compose(plain.figures))


def test_diagnose_takes_all_recordings_or_a_given_number(network, played):
    """With strategy ``reset`` the chip's reset replaces the refractory kernel, so the kernel is the largest cause."""
    compiled = lc.compile(network, events=played, strategy="reset", weight_bits=8, diagnosis=False)
    diagnosis = lc.diagnose(compiled, played)
    assert diagnosis.recordings == (0, 1, 2, 3, 4, 5)
    assert diagnosis.available == 6
    assert diagnosis.cause.largest == "kernel"
    assert diagnosis.budget.alone["kernel"].spikes.mismatches > 0
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
    """On three real recordings, spread over the test part, the stages of rounding explain every spike that differs."""
    network = lc.load(ROOT / f"examples/models/{name}-hybrid.pt")
    levels = lower(network, CHIP, weight_bits=8, strategy=strategy)
    spikes = lc.read_recordings(REAL / f"Ev-{name.title()}.zip").spikes
    played = spikes[list(spread_sample(network, len(spikes), 3))]
    match = compare(Observed(levels, played))
    diagnosis = diagnose(Observed(levels, played), match.first_divergence)
    assert diagnosis.budget.unexplained == 0
    assert diagnosis.budget.together.by_population == match.by_population
    assert diagnosis.cause.largest == ("kernel" if strategy == "reset" else "weights")
    assert diagnosis.cause.largest in diagnosis.cause.enough
