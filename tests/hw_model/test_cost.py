"""Energy and latency of tiny programs, computed by hand to the last digit."""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.cost import energy_pj, latency, step_times

CHIP = hw.chip("loihi-sim")


def chain():
    """x -> a -> b on one core: every input event makes a spike of a, and that one of b."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    a = builder.add_compartments("a", 1, decay_u=4096, decay_v=4096, threshold=10)
    b = builder.add_compartments("b", 1, decay_u=4096, decay_v=4096, threshold=10)
    builder.connect(x, a, [[20]])
    builder.connect(a, b, [[20]])
    return builder.build()


def test_counts_of_a_chain():
    counts = hw.simulate(chain(), [[1], [0], [0], [0]]).counts
    assert counts.synaptic_ops == 2  # x -> a and a -> b
    assert counts.neuron_updates == 8  # two compartments, four steps
    assert counts.neuron_updates_active == 4  # a and b in the step of their charge, and with u left in the next
    assert counts.spikes == 2
    assert counts.axon_packets == 1  # b has no target
    assert counts.packets_within_tile == 1
    assert (counts.input_events, counts.input_packets, counts.hops) == (1, 1, 0)


@pytest.mark.parametrize(
    ("profile", "pj"),
    [
        ("davies2018", 2 * 23.6 + 4 * 81 + 4 * 52 + 1 * 1.7),
        ("sanafe", 2 * 35.5 + 8 * 51.2 + 4 * 21.6 + 2 * 69.3 + 1 * 111),
    ],
)
def test_energy_of_a_chain(profile, pj):
    counts = hw.simulate(chain(), [[1], [0], [0], [0]]).counts
    assert sum(energy_pj(counts, CHIP.profile(profile)).values()) == pytest.approx(pj, rel=1e-12)


def test_latency_of_a_chain():
    program = chain()
    result = hw.simulate(program, [[1], [0], [0], [0]], probe=("activity",))
    time = latency(program, {"time": result.activity["time"][0]}, CHIP.profile("davies2018"))
    # step 0: x's synapse; 1: a active, fires to b; 2: a (u left) and b active; 3: b (u left) active.
    steps = (3.5 + 2 * 5.3, 8.4 + 5.3 + 3.5 + 2.1, 2 * 8.4, 8.4 + 5.3)
    assert time.total_ns == pytest.approx(sum(steps) + 4 * 113.0, rel=1e-12)
    assert time.critical_core == 0


def test_hops_are_counted_from_tile_to_tile():
    """One compartment a core: a spike of ``first`` goes to 40 cores. Tiles of four cores, eight tiles a row."""
    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=1))
    builder = hw.ProgramBuilder(small)
    x = builder.add_input("x", 1)
    first = builder.add_compartments("first", 1, decay_u=4096, decay_v=4096, threshold=10)
    rest = builder.add_compartments("rest", 40, decay_u=4096, decay_v=4096, threshold=10)
    builder.connect(x, first, [[20]])
    builder.connect(first, rest, np.full((40, 1), 20))
    program = builder.build()
    counts = hw.simulate(program, [[1], [0], [0]]).counts
    tiles = [(core.slot // 4 % 8, core.slot // 4 // 8) for core in program.cores]
    ways = [(abs(x - tiles[0][0]), abs(y - tiles[0][1])) for x, y in tiles[1:]]
    assert counts.axon_packets == 40
    assert counts.packets_within_tile == ways.count((0, 0)) == 3
    assert (counts.hops_x, counts.hops_y) == (sum(x for x, _ in ways), sum(y for _, y in ways))


@pytest.mark.parametrize(
    ("slots", "hops"),
    [((0, 3), (0, 0)), ((0, 4), (1, 0)), ((0, 31), (7, 0)), ((0, 32), (0, 1)), ((31, 32), (7, 1)), ((0, 128), (8, 0))],
    ids=["same tile", "next tile", "end of row", "next row", "both", "next chip"],
)
def test_hops_table(slots, hops):
    assert CHIP.hops(*slots) == CHIP.hops(*reversed(slots)) == hops


def test_times_of_every_step_and_core_of_a_chain():
    program = chain()
    result = hw.simulate(program, [[1], [0], [0], [0]], probe=("activity",))
    times = step_times(program, "time", result.activity["time"][0], CHIP.profile("davies2018"))
    assert times.work_ns["synaptic_ops"].ravel().tolist() == [3.5, 3.5, 0, 0]
    assert times.work_ns["neuron_updates_active"].ravel().tolist() == [0, 8.4, 2 * 8.4, 8.4]
    assert times.mesh_ns.ravel().tolist() == [0, 0, 0, 0]
    assert times.used.ravel().tolist() == [False, True, False, False]  # a to b, on the same core
    assert times.barrier_ns == 113.0
