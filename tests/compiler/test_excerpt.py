"""Excerpts: the spikes and a potential of one recording that the report draws, for network and chip.

They are checked against a full evaluation and a full simulation of the recording.
"""

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification import excerpt as module
from locsnn_compile.verification.excerpt import take_excerpt
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import hybrid, recordings

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def network():
    """A small hybrid of spike response neurons."""
    return hybrid(1, steps=40, hidden=6)


@pytest.fixture(scope="module")
def levels(network):
    """The compiled levels of the network with weights of 3 bits, so that spikes differ from the float network's."""
    return lower(network, CHIP, weight_bits=3)


@pytest.fixture(scope="module")
def played(network):
    """Five random recordings."""
    return recordings(network, samples=5)


def test_an_excerpt_has_all_of_a_small_network(network, levels, played):
    first = compare(Observed(levels, played)).first_divergence
    excerpt = take_excerpt(Observed(levels, played), first)
    recording = played[first.recording : first.recording + 1]
    reference = evaluate(network, recording)
    chip = hw.simulate(levels.program, recording)
    assert excerpt.steps == {"time": range(40), "location": range(network.channels)}
    assert excerpt.populations_left_out == 0
    names = [rows.name for rows in excerpt.populations]
    assert names == [population.name for population in network.populations]
    for rows in excerpt.populations:
        assert np.array_equal(rows.numbers, np.arange(rows.size))
        assert np.array_equal(rows.reference, reference.spikes[rows.name][0])
        assert np.array_equal(rows.chip, chip.spikes[rows.name][0])
    assert len(excerpt.inputs) == 2
    for lines in excerpt.inputs:
        assert np.array_equal(lines.reference, reference.spikes[lines.name][0])


def test_the_potential_is_that_of_the_neuron_that_differs_first(levels, played):
    first = compare(Observed(levels, played)).first_divergence
    potential = take_excerpt(Observed(levels, played), first).potential
    row = first.step - potential.first_step
    assert potential.population == first.population
    assert potential.neuron == first.neuron
    assert potential.threshold == first.threshold
    assert potential.reference[row] == first.reference_potential
    assert potential.chip[row] == first.chip_potential
    assert potential.reference_spikes[row] != potential.chip_spikes[row]
    assert np.array_equal(potential.reference_spikes[:row], potential.chip_spikes[:row])


def test_without_a_difference_the_readout_is_shown(network, levels, played):
    excerpt = take_excerpt(Observed(levels, played), first=None)
    read_out = network.readout.populations[0]
    spikes = evaluate(network, played[:1]).spikes[read_out][0]
    assert excerpt.recording == 0
    assert excerpt.potential.population == read_out
    assert excerpt.potential.neuron == spikes.sum(axis=0).argmax()


def test_a_large_excerpt_is_thinned_around_the_first_difference(levels, played, monkeypatch):
    first = compare(Observed(levels, played)).first_divergence
    whole = take_excerpt(Observed(levels, played), first)
    limits = {"STEPS": 8, "MARKS": 20, "NEURONS": 3, "LINES": 10, "POPULATIONS": 2}
    for name, limit in limits.items():
        monkeypatch.setattr(module, name, limit)
    excerpt = take_excerpt(Observed(levels, played), first)
    assert len(excerpt.populations) == 2
    assert excerpt.populations_left_out == len(whole.populations) - 2
    differing = next(rows for rows in excerpt.populations if rows.name == first.population)
    assert first.step in excerpt.steps[differing.axis]
    assert first.neuron in differing.numbers
    assert all(len(steps) <= 8 for steps in excerpt.steps.values())
    for rows in excerpt.populations:
        assert (rows.reference | rows.chip).sum() <= 20
        assert rows.reference.shape == (len(excerpt.steps[rows.axis]), min(rows.size, 3))
    # Neighbouring lines of an input are drawn together: a row has a mark where any of them spikes.
    for lines, all_lines in zip(excerpt.inputs, whole.inputs, strict=True):
        assert lines.together == -(-lines.size // 10)
        steps = excerpt.steps[lines.axis]
        spikes = all_lines.reference[steps.start : steps.stop]
        merged = [
            spikes[:, line : line + lines.together].max(axis=1)
            for line in range(0, lines.size, lines.together)
        ]
        assert np.array_equal(lines.reference, np.stack(merged, axis=1))


def test_the_neuron_that_differs_first_is_always_shown(levels, played, monkeypatch):
    monkeypatch.setattr(module, "NEURONS", 1)
    first = compare(Observed(levels, played)).first_divergence
    excerpt = take_excerpt(Observed(levels, played), first)
    differing = next(rows for rows in excerpt.populations if rows.name == first.population)
    assert differing.numbers.tolist() == [first.neuron]


def test_neurons_that_differ_are_shown_before_those_that_spike_most(levels, monkeypatch):
    monkeypatch.setattr(module, "NEURONS", 2)
    spikes = np.zeros((5, 4), dtype=np.uint8)
    spikes[0, 1] = 1
    spikes[:3, 3] = 1
    population = levels.network.populations[0]
    assert module.rows_shown(population, spikes, spikes, first=None).numbers.tolist() == [1, 3]
    # Neuron 0 spikes on the chip only, and displaces neuron 1, which spikes once on both sides.
    chip_spikes = spikes.copy()
    chip_spikes[4, 0] = 1
    assert module.rows_shown(population, spikes, chip_spikes, first=None).numbers.tolist() == [0, 3]
