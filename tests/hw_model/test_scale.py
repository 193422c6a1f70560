"""Memory grows with the number of synapses and sources, not with pairs of them, such as cores times sources.

Peak memory is measured for a network whose pairs would take many times as much.
"""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

import hw_model as hw
from hw_model.mapping.graph import compact
from hw_model.mapping.placement import place_cores
from hw_model.program import sealed
from tests.support.register_units import FORGETS_AT_ONCE

CHIP = hw.chip("loihi-sim")
SIZE = 20_000
MANY_CORES = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=50), chips=4)
"""A chip on which 20,000 compartments take 400 cores."""


def relays(chip, delay=0):
    """Return a builder of 20,000 lines and compartments, connected one to one."""
    builder = hw.ProgramBuilder(chip)
    lines = builder.add_input("x", SIZE)
    out = builder.add_compartments(
        "n", SIZE, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=1
    )
    builder.connect(lines, out, sparse.eye_array(SIZE, dtype=np.int64) * 20, delay=delay)
    return builder


def peak_mib(do):
    """Return the result of a function, and the peak memory of Python and numpy while it ran, in MiB."""
    tracemalloc.start()
    try:
        result = do()
        return result, tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "delay", [3, sparse.eye_array(SIZE, dtype=np.int64) * 3], ids=["one for all", "one for each"]
)
def test_delays_take_memory_for_synapses_and_not_for_pairs(delay):
    graph, mib = peak_mib(relays(MANY_CORES, delay).graph)
    assert graph.synapses[0].delay.tolist() == [3] * SIZE
    _, mib = peak_mib(lambda: relays(MANY_CORES, delay))
    assert mib < 20, "pairs take 3,000"


def test_delays_of_another_shape_are_refused():
    with pytest.raises(hw.InputError) as caught:
        relays(CHIP, sparse.eye_array(3, dtype=np.int64))
    assert str(caught.value) == (
        "synapses 'x' -> 'n': delay has the wrong shape ((3, 3) against (20000, 20000)). "
        "Give n_target rows and n_source columns."
    )


@pytest.mark.slow
def test_a_core_takes_no_memory_for_the_sources_of_others():
    graph = relays(MANY_CORES).graph()
    placed, mib = peak_mib(lambda: place_cores(graph, MANY_CORES))
    assert placed.cores == 400
    assert all(
        np.array_equal(axons, np.arange(50 * i, 50 * i + 50))
        for i, axons in enumerate(placed.axons)
    )
    assert mib < 15, "a byte and a number for each core and source take 140"


@pytest.mark.slow
def test_counts_take_no_memory_for_cores_times_sources():
    program = relays(MANY_CORES).build()
    spikes = (np.random.default_rng(0).random((5, SIZE)) < 0.1).astype(np.uint8)
    hw.simulate(relays(MANY_CORES).build(), spikes)  # compiles loops, which takes memory of its own
    result, mib = peak_mib(lambda: hw.simulate(program, spikes))
    assert np.array_equal(result.spikes["n"][1:], spikes[:-1])
    assert result.counts.synaptic_ops == result.counts.input_packets == spikes.sum()
    assert mib < 20, "a number for each core and source takes 61"


def test_numbers_of_synapses_take_as_few_bytes_as_they_need():
    rows = np.arange(1000)
    for values, bytes_of_one in (
        (rows, 4),
        (rows + 2**31, 8),
        (-rows - 2**31, 8),
        (rows - 2**31, 4),
        (rows * 0 + 7, 0),
    ):
        stored = compact(values)
        assert (stored.tolist(), stored.strides, stored.flags.writeable) == (
            values.tolist(),
            (bytes_of_one,),
            False,
        )
    assert compact([]).tolist() == []


def test_a_file_may_unpack_to_more_the_larger_it_is(tmp_path, monkeypatch):
    relays(CHIP).build().save(tmp_path)
    monkeypatch.setattr(sealed, "MAX_ARRAY_BYTES", 1000)
    assert len(hw.load_program(tmp_path).cores) == 20
    monkeypatch.setattr(sealed, "MAX_PACKING", 1)
    with pytest.raises(hw.InputError) as caught:
        hw.load_program(tmp_path)
    assert str(caught.value) == "program.npz: its arrays are absurdly large. Compile again."
