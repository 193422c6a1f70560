"""Projections of so many delays that their formats do not fit a core apart: they share, and no spike changes."""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import Population
from locsnn_compile.network.projections import ChipProjection, Projection
from locsnn_compile.passes.rounding.task import Rounding
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from tests.support.networks import NEURON, single

CHIP = hw.chip("loihi-sim")
DELAYS = (0, 12, 24, 36, 48, 60)
PLAYED = (np.random.default_rng(1).random((2, 90, 6)) < 0.2).astype(np.uint8)


def delayed():
    """Return a population behind one view, a projection a delay, whose weights are of several sizes and both signs."""
    r = np.random.default_rng(0)
    network = single(NEURON, np.zeros((5, 6)), steps=90)
    weights = r.normal(0, 1, (len(DELAYS), 5, 6)) * r.choice([0.5, 8.0], (len(DELAYS), 5, 6))
    projections = tuple(
        Projection("touch", "n", part, delay) for part, delay in zip(weights, DELAYS, strict=True)
    )
    return replace(network, projections=projections)


def narrowest_formats(levels):
    """Return the formats that a core would hold if every list kept to its own."""
    return {
        (s.exponent, s.sign_mode, s.weight_bits, s.delay_bits) for s in levels.compartments.synapses
    }


@pytest.mark.parametrize(
    ("strategy", "share", "apart"),
    [
        ("dendrite", 0.0, 17),
        ("dendrite", 1.0, 17),
        ("delay-line", 1.0, 21),
        ("paired-dendrite", 0.0, 17),
    ],
)
def test_the_program_is_the_rounded_network_bit_for_bit(strategy, share, apart):
    levels = lower(
        delayed(),
        CHIP,
        weight_bits=8,
        strategy=strategy,
        rounding=Rounding(graded=True, split=share),
    )
    assert len(narrowest_formats(levels)) == apart
    assert [len(core.axons.formats) for core in levels.program.cores] == [16]
    wanted = evaluate(levels.quantized.on_grid(), PLAYED, potentials=True)
    found = hw.simulate(levels.program, PLAYED, probe=("spikes", "potential"))
    assert wanted.spikes["n"].sum() > 100
    assert np.array_equal(found.spikes["n"], wanted.spikes["n"])
    assert np.array_equal(found.potential["n"], wanted.potential["n"])


@pytest.mark.parametrize(
    ("strategy", "held", "taken"),
    [
        ("dendrite", 16, 9),
        ("dendrite", 8, 7),
        ("dendrite", 5, 5),
        ("dendrite", 4, 3),
        ("dendrite", 3, 3),
        ("reset", 8, 8),
        ("reset", 2, 2),
        ("delay-line", 8, 6),
    ],
)
def test_weights_of_one_delay_take_no_more_formats_than_a_core_holds(strategy, held, taken):
    """Each grade takes two, one a sign; own spikes take one, or four in a line of delays."""
    chip = replace(CHIP, limits=replace(CHIP.limits, synapse_formats_per_core=held))
    weights = (
        np.random.default_rng(0).choice([-1.0, 1.0], (5, 24))
        * 2.0 ** np.arange(24).repeat(5).reshape(24, 5).T
        / 64
    )
    levels = lower(
        single(NEURON, weights / 64),
        chip,
        weight_bits=8,
        strategy=strategy,
        rounding=Rounding(graded=True),
    )
    assert [len(core.axons.formats) for core in levels.program.cores] == [taken]


def test_exponents_of_integer_weights_that_are_too_many():
    neuron = ChipCuba.of(1, decay_u=4096, decay_v=128, threshold=100)
    weights = np.array([[100, -100, 0, 0, 0, 0]])
    network = replace(
        single(NEURON, np.zeros((1, 6)), steps=90),
        populations=(Population("n", "time", 1, neuron),),
        projections=tuple(
            ChipProjection("touch", "n", weights, exponent, weight_bits=8)
            for exponent in range(-8, 1)
        ),
    )
    with pytest.raises(TargetError) as caught:
        lower(network, CHIP, weight_bits=8)
    assert str(caught.value) == (
        "population 'n': 18 synapse formats of neuron 0 do not fit one core (loihi-sim holds 16). "
        "Use fewer weight exponents for this population: formats of one exponent and sign share one already."
    )
