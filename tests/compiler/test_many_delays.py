"""Networks that need more synapse formats than a core holds: formats are shared, or fewer are used, or it is an error.

A synapse format has a sign, an exponent, and widths of weights and delays, and serves all synapse lists of a core.
"""

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
from tests.support.networks import NEURON, check_bit_for_bit, single

CHIP = hw.chip("loihi-sim")
DELAYS = (0, 12, 24, 36, 48, 60)
PLAYED = (np.random.default_rng(1).random((2, 90, 6)) < 0.2).astype(np.uint8)


def delayed():
    """Return a population with a projection per delay, whose weights have several sizes and both signs."""
    r = np.random.default_rng(0)
    network = single(NEURON, np.zeros((5, 6)), steps=90)
    weights = r.normal(0, 1, (len(DELAYS), 5, 6)) * r.choice([0.5, 8.0], (len(DELAYS), 5, 6))
    projections = tuple(
        Projection("touch", "n", part, delay) for part, delay in zip(weights, DELAYS, strict=True)
    )
    return replace(network, projections=projections)


def narrowest_formats(levels):
    """Return the formats that a core would hold if every list had the narrowest format for its weights and delays."""
    return {
        (s.exponent, s.sign_mode, s.weight_bits, s.delay_bits) for s in levels.compartments.synapses
    }


@pytest.mark.parametrize(
    ("strategy", "share", "formats_unshared"),
    [
        ("dendrite", 0.0, 17),
        ("dendrite", 1.0, 17),
        ("delay-line", 1.0, 21),
        ("paired-dendrite", 0.0, 17),
    ],
)
def test_shared_formats_keep_the_program_bit_for_bit(strategy, share, formats_unshared):
    levels = lower(
        delayed(),
        CHIP,
        weight_bits=8,
        strategy=strategy,
        rounding=Rounding(graded=True, split=share),
    )
    assert len(narrowest_formats(levels)) == formats_unshared
    assert [len(core.axons.formats) for core in levels.program.cores] == [16]
    expected = check_bit_for_bit(levels, PLAYED)
    assert expected.spikes["n"].sum() > 100


@pytest.mark.parametrize(
    ("strategy", "formats_of_core", "formats_used"),
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
def test_weights_of_one_delay_take_no_more_formats_than_a_core_holds(
    strategy, formats_of_core, formats_used
):
    """Each grade (exponent) takes two formats, one per sign; own spikes take one, or four as a delay line."""
    limits = replace(CHIP.limits, synapse_formats_per_core=formats_of_core)
    chip = replace(CHIP, limits=limits)
    # Powers of two over 24 octaves, far more than one format holds.
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (5, 24))
    weights = signs * 2.0 ** np.arange(24) / 64
    levels = lower(
        single(NEURON, weights / 64),
        chip,
        weight_bits=8,
        strategy=strategy,
        rounding=Rounding(graded=True),
    )
    assert [len(core.axons.formats) for core in levels.program.cores] == [formats_used]


def test_integer_weights_of_too_many_exponents_are_refused():
    neuron = ChipCuba.of(1, decay_u=4096, decay_v=128, threshold=100)
    weights = np.array([[100, -100, 0, 0, 0, 0]])
    network = replace(
        single(NEURON, np.zeros((1, 6)), steps=90),
        populations=(Population("n", "time", size=1, neuron=neuron),),
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
