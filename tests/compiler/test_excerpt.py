"""What is kept of a recording to be looked at, against a full evaluation and a full simulation."""

import numpy as np
import pytest
from networks import hybrid, recordings

import hw_model as hw
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification import excerpt as module
from locsnn_compile.verification.excerpt import take_excerpt
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def network():
    return hybrid(1, steps=40, hidden=6)


@pytest.fixture(scope="module")
def levels(network):
    return lower(network, CHIP, 3)


@pytest.fixture(scope="module")
def played(network):
    return recordings(network, samples=5)


def test_all_of_a_small_network_is_kept(network, levels, played):
    first = compare(Observed(levels, played)).first_divergence
    found = take_excerpt(Observed(levels, played), first)
    one = played[first.recording : first.recording + 1]
    wanted, chip = evaluate(network, one), hw.simulate(levels.program, one)
    assert found.steps == {"time": range(40), "location": range(network.channels)}
    assert found.populations_left_out == 0
    assert [item.name for item in found.populations] == [p.name for p in network.populations]
    for item in found.populations:
        assert np.array_equal(item.numbers, np.arange(item.size))
        assert np.array_equal(item.reference, wanted.spikes[item.name][0])
        assert np.array_equal(item.chip, chip.spikes[item.name][0])
    assert [
        np.array_equal(item.reference, wanted.spikes[item.name][0]) for item in found.inputs
    ] == [True, True]


def test_the_potential_is_the_one_that_differs_first(levels, played):
    first = compare(Observed(levels, played)).first_divergence
    shown = take_excerpt(Observed(levels, played), first).potential
    at = first.step - shown.first_step
    assert (shown.population, shown.neuron, shown.threshold) == (
        first.population,
        first.neuron,
        first.threshold,
    )
    assert (shown.reference[at], shown.chip[at]) == (
        first.reference_potential,
        first.chip_potential,
    )
    assert shown.reference_spikes[at] != shown.chip_spikes[at]
    assert np.array_equal(shown.reference_spikes[:at], shown.chip_spikes[:at])


def test_without_a_difference_the_readout_is_shown(network, levels, played):
    found = take_excerpt(Observed(levels, played), None)
    spikes = evaluate(network, played[:1]).spikes[network.readout.populations[0]][0]
    assert (found.recording, found.potential.population) == (0, network.readout.populations[0])
    assert found.potential.neuron == spikes.sum(axis=0).argmax()


def test_much_is_thinned_around_the_first_difference(levels, played, monkeypatch):
    first = compare(Observed(levels, played)).first_divergence
    whole = take_excerpt(Observed(levels, played), first)
    for name, value in {
        "STEPS": 8,
        "MARKS": 20,
        "NEURONS": 3,
        "LINES": 10,
        "POPULATIONS": 2,
    }.items():
        monkeypatch.setattr(module, name, value)
    found = take_excerpt(Observed(levels, played), first)
    assert (len(found.populations), found.populations_left_out) == (2, len(whole.populations) - 2)
    shown = next(item for item in found.populations if item.name == first.population)
    assert first.step in found.steps[shown.axis]
    assert first.neuron in shown.numbers
    assert all(len(steps) <= 8 for steps in found.steps.values())
    for item in found.populations:
        assert (item.reference | item.chip).sum() <= 20
        assert item.reference.shape == (len(found.steps[item.axis]), min(item.size, 3))
    for item, every in zip(found.inputs, whole.inputs, strict=True):
        assert item.together == -(-item.size // 10)
        here = every.reference[found.steps[item.axis].start : found.steps[item.axis].stop]
        rows = [
            here[:, i : i + item.together].max(axis=1) for i in range(0, item.size, item.together)
        ]
        assert np.array_equal(item.reference, np.stack(rows, axis=1))


def test_the_neuron_that_differs_first_is_always_shown(levels, played, monkeypatch):
    monkeypatch.setattr(module, "NEURONS", 1)
    first = compare(Observed(levels, played)).first_divergence
    shown = next(
        i
        for i in take_excerpt(Observed(levels, played), first).populations
        if i.name == first.population
    )
    assert shown.numbers.tolist() == [first.neuron]


def test_neurons_without_differences_are_those_that_spike_most(levels, played, monkeypatch):
    monkeypatch.setattr(module, "NEURONS", 2)
    whole = np.zeros((5, 4), dtype=np.uint8)
    whole[0, 1] = whole[:2, 3] = whole[2, 3] = 1
    population = levels.network.populations[0]
    assert module.rows_shown(population, whole, whole, None).numbers.tolist() == [1, 3]
    differs = whole.copy()
    differs[4, 0] = 1
    assert module.rows_shown(population, whole, differs, None).numbers.tolist() == [0, 3]
