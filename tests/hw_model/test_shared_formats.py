"""Merging synapse formats where a core would need too many: no synapse and no spike changes, only memory."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.fixed_point import SIGN_MODES, WEIGHT_BITS
from hw_model.mapping.fan_in import SynapseFormat, share_formats
from tests.support.delivered import delivered

CHIP = hw.chip("loihi-sim")

formats = st.builds(
    SynapseFormat,
    weight_bits=st.sampled_from(WEIGHT_BITS),
    sign_mode=st.sampled_from(SIGN_MODES),
    exponent=st.integers(-1, 1),
    delay_bits=st.integers(0, 6),
    index_bits=st.sampled_from([0, 10]),
)


@settings(max_examples=100, deadline=None)
@given(
    synapses=st.dictionaries(formats, st.integers(1, 500), min_size=1, max_size=24),
    limit=st.integers(1, 20),
)
def test_formats_are_merged_only_as_far_as_the_limit_requires(synapses, limit):
    stored = share_formats(synapses, limit)
    kinds = {(form.sign_mode, form.exponent) for form in synapses}
    formats_left = set(stored.values())
    assert len(formats_left) <= max(limit, len(kinds))
    if len(synapses) <= limit:
        assert all(form == wide for form, wide in stored.items())
    for form, wide in stored.items():
        assert (form.sign_mode, form.exponent) == (wide.sign_mode, wide.exponent)
        assert form.weight_bits <= wide.weight_bits
        assert form.delay_bits <= wide.delay_bits
        assert form.index_bits <= wide.index_bits


def test_the_two_formats_whose_merging_costs_least_are_merged():
    def form(delay_bits, exponent=0):
        return SynapseFormat(
            weight_bits=8,
            sign_mode="excitatory",
            exponent=exponent,
            delay_bits=delay_bits,
            index_bits=10,
        )

    # In bits: 100 synapses from 0 to 4, 300 from 4 to 5, or 100 from 0 to 5; exponent 1 shares with none.
    synapses = Counter({form(0): 100, form(4): 300, form(5): 10, form(4, exponent=1): 1})
    assert share_formats(synapses, 4) == {f: f for f in synapses}
    assert share_formats(synapses, 3) == {f: f for f in synapses} | {form(4): form(5)}
    assert share_formats(synapses, 2) == {f: form(5) for f in synapses if f.exponent == 0} | {
        form(delay_bits=4, exponent=1): form(delay_bits=4, exponent=1)
    }


def many_formats(limit, exponents=(0,)):
    """Return a program of neurons with a dendrite, whose lists differ in delays, bits, signs and density."""
    r = np.random.default_rng(3)
    builder = hw.ProgramBuilder(
        replace(CHIP, limits=replace(CHIP.limits, synapse_formats_per_core=limit))
    )
    x = builder.add_input("x", 9)
    n = builder.add_compartments("n", 12, decay_u=1024, decay_v=128, threshold=60)
    dendrite = builder.add_compartments(
        "n/dendrite", 12, decay_u=500, decay_v=500, threshold=0, joined_to=n
    )
    for target in (n, dendrite):
        for exponent in exponents:
            for delay, bits, share in ((0, 8, 1.0), (3, 4, 0.5), (12, 8, 0.3), (62, 5, 0.8)):
                step = 1 << 8 - bits
                weights = r.integers(1, 1 << bits, (12, 9)) * step * (r.random((12, 9)) < share)
                for sign, mode in ((1, "excitatory"), (-1, "inhibitory")):
                    builder.connect(
                        x,
                        target,
                        sign * weights,
                        exponent=exponent,
                        delay=delay,
                        weight_bits=bits,
                        sign_mode=mode,
                    )
    builder.connect(x, n, np.full((12, 9), 254), delay=7)
    return builder.build()


def synapse_bits(program):
    """Return the bits of all synapses, without headers and rounding, which merged lists save."""
    axons = program.cores[0].axons
    return sum(
        form.bits_per_synapse for form in np.array(axons.formats, dtype=object)[axons.format_index]
    )


@pytest.mark.parametrize("limit", [8, 3])
def test_merged_formats_change_no_spike(limit):
    apart = many_formats(16)
    shared = many_formats(limit)
    assert len(apart.cores[0].axons.formats) == 9
    assert [len(core.axons.formats) for core in shared.cores] == [limit]
    assert synapse_bits(shared) > synapse_bits(apart)
    assert delivered(shared) == delivered(apart)
    spikes = (np.random.default_rng(0).random((3, 60, 9)) < 0.3).astype(np.uint8)
    expected = hw.simulate(apart, spikes, probe=("spikes", "potential"))
    result = hw.simulate(shared, spikes, probe=("spikes", "potential"))
    assert 0 < expected.spikes["n"].mean() < 1
    assert np.array_equal(result.spikes["n"], expected.spikes["n"])
    assert np.array_equal(result.potential["n"], expected.potential["n"])


def test_too_many_exponents_and_signs_are_refused():
    with pytest.raises(hw.TargetError) as caught:
        many_formats(16, exponents=range(-4, 4))
    assert str(caught.value) == (
        "population 'n': 17 synapse formats of neuron 0 do not fit one core (loihi-sim holds 16). "
        "Use fewer weight exponents for this population: formats of one exponent and sign share one already."
    )
