"""Placement and routing: no limit of a core is exceeded, every synapse is delivered once, and cores are filled.

Synapses are compared with the weights that were connected, words of memory with a formula of the test.
"""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from tests.support.delivered import delivered
from tests.support.random_programs import random_program
from tests.support.register_units import FORGETS_AT_ONCE

CHIP = hw.chip("loihi-sim")

# Sizes of the synapse memory of loihi-sim, from the description of the chip.
RUN = 64
HEADER_BITS = 10
WORD_BITS = 64
# Limits so small that programs take several cores, and just large enough for the largest neuron.
chips = st.builds(
    lambda **limits: replace(CHIP, limits=replace(CHIP.limits, **limits)),
    compartments_per_core=st.integers(2, 20),
    input_axons_per_core=st.integers(13, 40),
    synapse_words_per_core=st.integers(60, 200),
    synapse_formats_per_core=st.integers(7, 16),
    compartment_profiles_per_core=st.integers(4, 32),
    threshold_profiles_per_core=st.integers(2, 16),
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(chip=chips, seed=st.integers(0, 2**32 - 1))
def test_every_synapse_is_delivered_once_within_every_limit(chip, seed):
    program, _, links, _ = random_program(seed, chip)
    limits = chip.limits
    for core in program.cores:
        axons = core.axons
        assert core.compartments <= limits.compartments_per_core
        assert axons.input_axons <= limits.input_axons_per_core
        assert axons.output_axons <= limits.output_axons_per_core
        assert len(axons.formats) <= limits.synapse_formats_per_core
        assert len(core.profiles) <= limits.compartment_profiles_per_core
        assert len(core.thresholds) <= limits.threshold_profiles_per_core
        assert words(core, chip) == axons.synapse_words <= limits.synapse_words_per_core
        for piece in core.slices:
            joined = core.parent[piece.offset : piece.offset + piece.size]
            assert (joined == -1).all() or (
                joined > np.arange(piece.offset, piece.offset + piece.size)
            ).all()
    assert delivered(program) == connected(links)


def words(core, chip):
    """Return the words of synapse memory of a core.

    An axon's list is divided into runs of at most :data:`RUN` synapses of one format. A run has a header, and is rounded
    up to whole words.
    """
    total = 0
    axons = core.axons
    for j in range(axons.input_axons):
        row = slice(axons.list_start[j], axons.list_start[j + 1])
        for form, count in zip(
            *np.unique(axons.format_index[row], return_counts=True), strict=True
        ):
            for first in range(0, count, RUN):
                synapses = min(RUN, count - first)
                bits = HEADER_BITS + synapses * axons.formats[form].bits_per_synapse
                total += -(-bits // WORD_BITS)  # rounded up
    return total


def connected(links):
    """Return source, target, weight and delay of every synapse that was connected, sorted."""
    return sorted(
        (
            (link["source"], int(j)),
            (link["target"], int(i)),
            (int(link["weights"][i, j]), link["exponent"]),
            int(link["delay"][i, j]),
        )
        for link in links
        for i, j in zip(*np.nonzero(link["weights"]), strict=True)
    )


@pytest.mark.parametrize(
    ("end", "values"),
    [("vmin", [0, 0, -1, -1]), ("vmax", [511, 511, 2047, 2047])],
    ids=["lower", "upper"],
)
def test_compartments_with_other_voltage_limits_go_to_another_core(end, values):
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    n = builder.add_compartments("n", 4, threshold=1, **{end: values})
    builder.connect(x, n, np.full((4, 1), 2))
    cores = builder.build().cores
    assert [(getattr(core, end), core.compartments) for core in cores] == [
        (values[0], 2),
        (values[2], 2),
    ]


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(chip=chips, seed=st.integers(0, 2**32 - 1))
def test_no_core_has_room_for_the_next_neuron(chip, seed):
    """A neuron and its joined compartments start a new core only if the core before would exceed a limit."""
    program = random_program(seed, chip)[0]
    limits = chip.limits
    for core, after in pairwise(program.cores):
        moved = _first_neuron(program, after)
        both = [(core, np.arange(core.compartments)), (after, moved)]
        sources = set()
        lists = Counter()
        profiles = set()
        thresholds = set()
        ends = set()
        for core_of_both, compartments in both:
            axons = core_of_both.axons
            source = program.senders[core_of_both.number][axons.axon_of_synapse]
            ends_on_core = np.isin(axons.target, compartments)
            sources |= set(source[ends_on_core].tolist())
            lists.update(
                (int(s), axons.formats[f])
                for s, f in zip(source[ends_on_core], axons.format_index[ends_on_core], strict=True)
            )
            profiles |= {core_of_both.profiles[i] for i in core_of_both.profile[compartments]}
            thresholds |= {core_of_both.thresholds[i] for i in core_of_both.threshold[compartments]}
            ends.add((core_of_both.vmin, core_of_both.vmax))
        words = sum(
            int(chip.synapse_memory.words(n, form.bits_per_synapse))
            for (_, form), n in lists.items()
        )
        formats = {*core.axons.formats, *after.axons.formats}
        broken = [
            core.compartments + len(moved) > limits.compartments_per_core,
            len(sources) > limits.input_axons_per_core,
            words > limits.synapse_words_per_core,
            len(profiles) > limits.compartment_profiles_per_core,
            len(thresholds) > limits.threshold_profiles_per_core,
            len(formats) > limits.synapse_formats_per_core,
            len(ends) > 1,
        ]
        assert any(broken)


def _first_neuron(program, core):
    """Return the compartments of the first neuron of a core: the first of each group that is joined to it."""
    root = program.joined_to.get(core.slices[0].group, core.slices[0].group)
    start = core.slices[0].start
    groups = [
        p
        for p in core.slices
        if p.start == start and program.joined_to.get(p.group, p.group) == root
    ]
    return np.array([piece.offset for piece in groups])


@pytest.mark.parametrize(
    ("synapses", "bits", "words"),
    [(1, 8, 1), (6, 9, 1), (7, 8, 2), (64, 8, 9), (65, 8, 10), (128, 8, 18)],
)
def test_words_of_a_list_follow_the_formula_of_the_chip(synapses, bits, words):
    assert CHIP.synapse_memory.words(synapses, bits) == words


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.1, 1.0), limit=st.integers(300, 4000))
def test_placement_counts_the_words_that_routing_stores(seed, share, limit):
    """Populations exceed the window of neurons that the placer looks at, so lists grow over several windows.

    Every core but the last must be full, and none overfull.
    """
    chip = replace(CHIP, limits=replace(CHIP.limits, synapse_words_per_core=limit))
    r = np.random.default_rng(seed)
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", 5)
    n = builder.add_compartments("n", 400, threshold=1)
    builder.connect(x, n, 2 * (r.random((400, 5)) < share))
    builder.connect(x, n, 2 * (r.random((400, 5)) < share), delay=3)
    program = builder.build()
    used = [core.axons.synapse_words for core in program.cores]
    assert max(used) <= limit
    assert [words(core, chip) for core in program.cores] == used
    # One more neuron has at most ten synapses, each of which takes a word at worst.
    for words_used, core in zip(used[:-1], program.cores, strict=False):
        assert words_used > limit - 10 or core.compartments == 1024


def test_only_populations_with_too_many_output_axons_are_spread():
    limits = replace(
        CHIP.limits, compartments_per_core=40, output_axons_per_core=80, synapse_words_per_core=90
    )
    b = hw.ProgramBuilder(replace(CHIP, limits=limits))
    x = b.add_input("touch", 1)
    wide, narrow = (
        b.add_compartments(
            name, size, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=1
        )
        for name, size in (("wide", 70), ("narrow", 24))
    )
    b.connect(x, wide, np.full((70, 1), 4))
    b.connect(wide, narrow, np.full((24, 70), 4))
    cores = [[(piece.group, piece.size) for piece in core.slices] for core in b.build().cores]
    wide_alone = [("wide", 20)]
    narrow_alone = [("narrow", 6)]
    assert cores == [*[wide_alone] * 3, [("wide", 10), ("narrow", 6)], *[narrow_alone] * 3]


def test_input_axons_of_two_populations_add_up():
    """Each population has five lines. With 8 axons, three neurons of the second fit next to the first population."""
    builder = hw.ProgramBuilder(replace(CHIP, limits=replace(CHIP.limits, input_axons_per_core=8)))
    for name in ("first", "second"):
        x = builder.add_input(f"{name}_lines", 5)
        builder.connect(x, builder.add_compartments(name, 5, threshold=1), 2 * np.eye(5))
    cores = [[(piece.group, piece.size) for piece in core.slices] for core in builder.build().cores]
    assert cores == [[("first", 5), ("second", 3)], [("second", 2)]]


def test_formats_of_two_populations_add_up():
    """Two populations share their two formats; the third needs a format more than a core has."""
    builder = hw.ProgramBuilder(
        replace(CHIP, limits=replace(CHIP.limits, synapse_formats_per_core=2))
    )
    x = builder.add_input("x", 1)
    for name, exponents in (("first", (0, 1)), ("second", (1, 0)), ("third", (0, 2))):
        n = builder.add_compartments(name, 3, threshold=1)
        for exponent in exponents:
            builder.connect(x, n, np.full((3, 1), 2), exponent=exponent)
    cores = [[(piece.group, piece.size) for piece in core.slices] for core in builder.build().cores]
    assert cores == [[("first", 3), ("second", 3)], [("third", 3)]]


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [([2, 0], [0, 2], 1), ([2, 2], [2, 2], 2)],
    ids=["one each", "both"],
)
def test_synapses_of_one_format_share_a_list(first, second, words):
    """Two projections from one line in one list take 10 + 2 * 19 bits, one word; as dense lists, they take two words."""

    def cores(synapse_words):
        limits = replace(CHIP.limits, synapse_words_per_core=synapse_words)
        builder = hw.ProgramBuilder(replace(CHIP, limits=limits))
        x = builder.add_input("x", 1)
        n = builder.add_compartments("n", 2, threshold=1)
        for weights in (first, second):
            builder.connect(x, n, np.array(weights)[:, None])
        return builder.build().cores

    assert [core.axons.synapse_words for core in cores(1000)] == [words]
    # Placement counts in the same way: as many words are enough, and one less is not.
    assert len(cores(words)) == 1
    if words > 1:
        with pytest.raises(hw.TargetError, match="synapse memory words"):
            cores(words - 1)


@pytest.mark.parametrize(
    ("output_axons", "cores"),
    [
        (12, [[("a", 4), ("b", 2)]]),
        (9, [[("a", 2)], [("a", 2)], [("b", 2), ("out", 4)]]),
        (5, [[("a", 2)], [("a", 2)], [("b", 2)], [("out", 6)]]),
        (2, [[("a", 1)]] * 4 + [[("b", 1)]] * 2),
    ],
    ids=["just enough", "the largest gives way", "each by itself", "one a core"],
)
def test_populations_with_too_many_output_axons_give_way(output_axons, cores):
    program = six_senders(output_axons_per_core=output_axons)
    assert [[(piece.group, piece.size) for piece in core.slices] for core in program.cores][
        : len(cores)
    ] == cores


def test_narrower_weights_are_no_way_out_of_too_many_output_axons():
    with pytest.raises(hw.TargetError) as caught:
        six_senders(output_axons_per_core=9, cores_per_chip=3)
    assert str(caught.value) == (
        "network 'program': 5 cores are needed (loihi-sim has 3 on 1 chip). "
        "Give a chip file with chips: 2, if the board has as many."
    )


def six_senders(**limits):
    """Build six neurons that reach two cores each: eight output axons of one population, and four of another."""
    limits = replace(CHIP.limits, compartments_per_core=6, **limits)
    builder = hw.ProgramBuilder(replace(CHIP, limits=limits))
    x = builder.add_input("x", 1)
    a, b, out = (
        builder.add_compartments(name, size, threshold=1)
        for name, size in (("a", 4), ("b", 2), ("out", 12))
    )
    for group, size in ((a, 4), (b, 2)):
        builder.connect(x, group, np.full((size, 1), 2))
        builder.connect(group, out, np.full((12, size), 2))
    return builder.build()
