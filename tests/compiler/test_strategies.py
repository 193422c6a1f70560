"""Strategies, the ways to lay out spike response (SRM) neurons as compartments: their kernels, fits and programs.

An SRM neuron has a kernel for its inputs and a refractory kernel (nu) for its own spikes. ``dendrite`` has a compartment
for each, ``delay-line`` makes nu of delayed self-synapses (taps), ``reset`` replaces it by the chip's own reset, and
``paired-dendrite`` has each dendrite twice.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from locsnn_compile.errors import TargetError
from locsnn_compile.models.chip_entry import MOST_OWN_SYNAPSES
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.srm.quantize import LAYOUTS, refractory_count
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.integer_neurons import input_response, own_spike_response
from locsnn_compile.settings import STRATEGIES, TRAINABLE
from tests.support.networks import (
    DECAY_OF_1,
    DECAY_OF_10,
    NEURON,
    UNIT,
    check_bit_for_bit,
    hybrid,
    recordings,
    single,
)

CHIP = hw.chip("loihi-sim")


def quantized(strategy, neuron=NEURON, weight=2.0):
    """Return the quantised population of one neuron behind one weight."""
    network = single(neuron, [[weight]])
    return quantize(network, CHIP, weight_bits=8, strategy=strategy).population("n")


def nu(neuron, steps):
    """Return the refractory kernel at lags 1 to ``steps``, from its equation."""
    k = np.arange(1, steps + 1)
    alpha = k / neuron.tau_ref * np.exp(1 - k / neuron.tau_ref)
    return -neuron.scale_ref * neuron.theta * alpha


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    strategy=st.sampled_from(sorted(STRATEGIES)),
    bits=st.sampled_from([1, 3, 8]),
    tau_ref=st.sampled_from([0.7, 1.0, 4.0, 10.0]),
)
def test_the_program_is_the_rounded_network_bit_for_bit(seed, strategy, bits, tau_ref):
    network = hybrid(
        seed,
        steps=40,
        hidden=5,
        neuron=SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=tau_ref, scale_ref=2.0),
    )
    levels = lower(network, CHIP, bits, strategy)
    check_bit_for_bit(levels, recordings(network, samples=2, seed=seed))


@pytest.mark.parametrize(
    ("strategy", "groups"),
    [
        ("dendrite", ["n/dendrite", "n/refractory", "n"]),
        ("delay-line", ["n/dendrite", "n"]),
        ("reset", ["n"]),
        ("paired-dendrite", ["n/dendrite", "n/refractory", "n/dendrite_2", "n/refractory_2", "n"]),
    ],
)
def test_each_strategy_has_its_compartments(strategy, groups):
    levels = lower(single(NEURON, [[2.0]]), CHIP, weight_bits=8, strategy=strategy)
    assert list(levels.program.populations) == groups
    assert levels.program.provenance["strategy"] == strategy
    assert levels.quantized.population("n").strategy == strategy


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    tau_sr=st.floats(1, 40),
    tau_ref=st.floats(0.5, 6),
    scale_ref=st.floats(0.5, 4),
    weight=st.floats(0.5, 8),
)
def test_delayed_self_synapses_answer_as_the_refractory_kernel(tau_sr, tau_ref, scale_ref, weight):
    """The response to an own spike is the kernel to within rounding, also long after the last tap."""
    neuron = SrmAlpha(theta=10.0, tau_sr=tau_sr, tau_ref=tau_ref, scale_ref=scale_ref)
    population = quantized("delay-line", neuron, weight)
    steps = 400
    response = own_spike_response(population.neuron, CHIP.registers, steps)[:, 0]
    kernel = nu(neuron, steps)
    assert np.abs(response / population.scale[0] - kernel).max() <= 0.03 * np.abs(kernel).max()
    assert population.fit.refractory_rms < 0.05


def test_the_published_neuron_takes_about_thirteen_taps():
    population = quantized("delay-line")
    taps = population.neuron.refractory
    assert 13 <= len(taps.delay) <= 16
    assert taps.delay.max() <= 14
    assert population.fit.refractory_max < 1e-3
    assert population.fit.refractory_rms < 1e-3
    formats = set(zip(taps.exponent.tolist(), (taps.mantissa[:, 0] > 0).tolist(), strict=True))
    assert len(formats) <= 6


def test_the_first_taps_are_the_filtered_kernel():
    """charge(k) = nu(k) - 2 b nu(k - 1) + b^2 nu(k - 2), apart from corrections of the rounding of earlier taps."""
    population = quantized("delay-line")
    b = 1 - int(population.neuron.decay_u[0]) / 4096  # what a step keeps
    kernel = np.array([0.0, 0.0, *nu(NEURON, 6)]) * population.scale[0]
    charge = kernel[2:] - 2 * b * kernel[1:-1] + b * b * kernel[:-2]
    taps = population.neuron.refractory
    charge_of_taps = np.zeros(6)
    charges = UNIT * taps.mantissa[:, 0] * 2.0**taps.exponent
    for delay, tap_charge in zip(taps.delay, charges, strict=True):
        if delay < 6:
            charge_of_taps[delay] += tap_charge
    assert np.abs(charge_of_taps - charge).max() < 2e-3 * np.abs(kernel).max()


def test_equal_time_constants_take_few_taps():
    """The dendrite's response then has the shape of nu, apart from its rounded decay."""
    neuron = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=10.0, scale_ref=2.0)
    taps = quantized("delay-line", neuron).neuron.refractory
    assert taps.delay[0] == 0
    assert len(taps.delay) <= 8


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
def test_without_a_refractory_kernel_there_are_no_self_synapses(strategy):
    neuron = replace(NEURON, scale_ref=0.0)
    population = quantized(strategy, neuron)
    # Only the reset, which every neuron has then, differs from a kernel of 0.
    assert (population.fit.refractory_max is None) == (strategy != "reset")
    graph = lower(single(neuron, [[2.0]]), CHIP, weight_bits=8, strategy=strategy).compartments
    assert [synapses for synapses in graph.synapses if synapses.source == "n"] == []


def test_a_kernel_that_outlasts_the_delays_is_refused():
    with pytest.raises(TargetError) as caught:
        quantized("delay-line", SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=40.0, scale_ref=2.0))
    assert str(caught.value) == (
        "population 'n': 63 delayed synapses cannot hold a kernel of tau_ref 40 "
        "(an error of 0.51 against 0.1; loihi-sim has delay_max 62). Use strategy dendrite."
    )


@pytest.mark.parametrize("strategy", sorted(STRATEGIES))
@pytest.mark.parametrize("tau_sr", [2.0, 10.0, 33.0])
def test_the_stated_fit_of_the_input_kernel_is_that_of_a_simulated_spike(strategy, tau_sr):
    """Measured on the chip with one input spike, whose response peaks just below the threshold of 10."""
    neuron = SrmAlpha(theta=10.0, tau_sr=tau_sr, tau_ref=1.0, scale_ref=2.0)
    network = single(neuron, [[9.9]], steps=200)
    levels = lower(network, CHIP, weight_bits=8, strategy=strategy)
    population = levels.quantized.population("n")
    played = np.zeros((200, 1), dtype=np.uint8)
    played[0] = 1
    potential = hw.simulate(levels.program, played, probe=("potential",)).potential["n"][1:, 0]
    # With paired dendrites, each of two projections brings a part of the charge to a dendrite of its own.
    charges = [int(UNIT * p.mantissa[0, 0] * 2.0**p.exponent) for p in levels.quantized.projections]
    chip_neuron = population.neuron
    if isinstance(chip_neuron, ChipSrm):
        chip_neuron = replace(chip_neuron, dendrites=1)
    responses = [
        input_response(chip_neuron, np.array([charge]), CHIP.registers, len(potential))[:, 0]
        for charge in charges
    ]
    assert np.array_equal(potential, sum(responses))
    k = np.arange(1, 200)
    kernel = k / tau_sr * np.exp(1 - k / tau_sr)
    weight = sum(charges) / quantized_gain(levels)
    error = np.abs(potential - weight * kernel).max() / weight
    assert error == pytest.approx(population.fit.input_max, abs=2e-4 * len(responses))


def quantized_gain(levels):
    """Return the charge with which the rounded decay fits a kernel of height 1 best, by least squares."""
    keep = (4096 - int(levels.quantized.population("n").neuron.decay_u[0])) / 4096
    tau = levels.network.populations[0].neuron.tau_sr
    k = np.arange(1, 5000.0)
    response = k * keep ** (k - 1)
    kernel = k / tau * np.exp(1 - k / tau)
    return (kernel @ response) / (response @ response)


def test_fits_of_the_published_neuron():
    fits = {strategy: quantized(strategy).fit for strategy in STRATEGIES}
    assert all(fit.input_max < 1e-3 for fit in fits.values())
    assert fits["dendrite"].refractory_rms < 3e-4
    assert fits["delay-line"].refractory_rms < 1e-3
    # The reset subtracts a threshold, which decays with tau_sr, where nu subtracts two that decay fast.
    kernel = nu(NEURON, 200)
    by_reset = -NEURON.theta * np.exp(-np.arange(1, 201) / NEURON.tau_sr)
    error = math.sqrt(((by_reset - kernel) ** 2).sum() / (kernel**2).sum())
    assert fits["reset"].refractory_rms == pytest.approx(error, rel=0.01)


@pytest.mark.parametrize(
    ("neuron", "decay", "count"),
    [
        (NEURON, DECAY_OF_10, 1),
        (replace(NEURON, scale_ref=0.0), DECAY_OF_10, 1),
        (replace(NEURON, scale_ref=20.0), DECAY_OF_10, 41),
        (SrmAlpha(theta=10.0, tau_sr=1.0, tau_ref=4.0, scale_ref=2.0), DECAY_OF_1, 22),
        (SrmAlpha(theta=10.0, tau_sr=1.0, tau_ref=40.0, scale_ref=2.0), DECAY_OF_1, 217),
    ],
    ids=["published", "none", "strong", "slow", "longest"],
)
def test_the_refractory_count_takes_as_much_as_the_kernel(neuron, decay, count):
    """With strategy ``reset`` a neuron stays blocked for so many steps that it loses what the kernel would take."""
    assert refractory_count(neuron, decay) == count


def test_every_strategy_has_its_kind_of_neuron():
    kinds = {strategy: type(quantized(strategy).neuron) for strategy in STRATEGIES}
    assert kinds == {
        "dendrite": ChipSrm,
        "delay-line": ChipSrm,
        "reset": ChipCuba,
        "paired-dendrite": ChipSrm,
    }


def test_every_table_of_strategies_has_all_of_them():
    assert list(LAYOUTS) == list(STRATEGIES)
    assert list(MOST_OWN_SYNAPSES) == list(TRAINABLE)
    assert [quantized(strategy).strategy for strategy in STRATEGIES] == list(STRATEGIES)


def test_a_fit_is_measured_once_and_only_when_it_is_read(monkeypatch):
    calls = []
    monkeypatch.setattr(
        "locsnn_compile.passes.quantize.kernel_fit", lambda *arguments: calls.append(arguments)
    )
    population = quantized("dendrite")
    assert calls == []
    assert population.fit is None
    assert population.fit is None
    assert len(calls) == 1
