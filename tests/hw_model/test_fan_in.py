"""Synapse formats: how many bits they take, which two can be merged, and which are merged first."""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.mapping.fan_in import SynapseFormat, share_formats
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import check_routed, route_axons

CHIP = hw.chip("loihi-sim")
PLAIN = SynapseFormat(weight_bits=4, sign_mode="mixed", exponent=0, delay_bits=2, index_bits=6)


def test_a_synapse_takes_its_weight_delay_and_index_bits():
    assert (
        SynapseFormat(
            weight_bits=5, sign_mode="mixed", exponent=0, delay_bits=3, index_bits=10
        ).bits_per_synapse
        == 18
    )


@pytest.mark.parametrize("field", ["weight_bits", "delay_bits", "index_bits"])
def test_two_formats_are_held_by_the_wider_one(field):
    wider = replace(PLAIN, **{field: 8})
    assert PLAIN.widened(wider) == wider.widened(PLAIN) == wider
    assert PLAIN.joins(wider)


@pytest.mark.parametrize(
    "change", [{"exponent": 1}, {"sign_mode": "excitatory"}], ids=["exponent", "signs"]
)
def test_formats_of_other_exponents_or_signs_cannot_be_merged(change):
    assert not PLAIN.joins(replace(PLAIN, **change))


@pytest.mark.parametrize(("compartments", "bits"), [(64, 6), (1023, 10), (1024, 10)])
def test_an_index_counts_to_the_last_compartment(compartments, bits):
    chip = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=compartments))
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", 3)
    n = builder.add_compartments("n", 3, threshold=1)
    builder.connect(x, n, 2 * np.eye(3))
    (core,) = builder.build().cores
    assert [form.index_bits for form in core.axons.formats] == [bits]


def test_dense_lists_of_one_format_are_lists_of_their_own():
    """Seven synapses of 8 bits and a header take two words; 14 in one list would take no more."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    n = builder.add_compartments("n", 7, threshold=1)
    for _ in range(2):
        builder.connect(x, n, np.full((7, 1), 2))
    (core,) = builder.build().cores
    assert (core.axons.synapse_words, core.axons.formats[0].index_bits) == (4, 0)


def test_formats_that_add_the_fewest_bits_are_merged_first():
    """One synapse of 4 bits in a format of 7 adds 3 bits; a thousand of 7 bits in a format of 8 would add a thousand."""
    wide, middle, narrow = (replace(PLAIN, weight_bits=bits) for bits in (8, 7, 4))
    synapses = {wide: 10, middle: 1000, narrow: 1}
    assert share_formats(synapses, 2) == {wide: wide, middle: middle, narrow: middle}
    assert share_formats(synapses, 3) == {form: form for form in synapses}


@pytest.mark.parametrize("kept", [1, 3], ids=["doubled", "lost"])
def test_routing_that_loses_or_doubles_synapses_is_noticed(kept):
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    n = builder.add_compartments("n", 2, threshold=1)
    for _ in range(2):
        builder.connect(x, n, np.full((2, 2), 2))
    routed = route_axons(place_cores(builder.graph(), CHIP))
    check_routed(routed)
    synapses = (*routed.placed.graph.synapses, routed.placed.graph.synapses[0])[:kept]
    placed = replace(routed.placed, graph=replace(routed.placed.graph, synapses=synapses))
    with pytest.raises(AssertionError, match="routing lost or doubled synapses"):
        check_routed(replace(routed, placed=placed))
