"""Energy and latency of tiny programs, computed by hand to the last digit."""

import numpy as np
import pytest

import hw_model as hw
from hw_model.cost import energy_pj, latency

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
    result = hw.simulate(program, [[1], [0], [0], [0]])
    time = latency(program, {"time": result.activity["time"][0]}, CHIP.profile("davies2018"))
    # step 0: x's synapse; 1: a active, fires to b; 2: a (u left) and b active; 3: b (u left) active.
    steps = (3.5 + 2 * 5.3, 8.4 + 5.3 + 3.5 + 2.1, 2 * 8.4, 8.4 + 5.3)
    assert time.total_ns == pytest.approx(sum(steps) + 4 * 113.0, rel=1e-12)
    assert time.critical_core == 0


def test_hops_between_tiles():
    """Sixty compartments a core on a chip of small cores: a spike from core 0 to core 4 goes one tile east."""
    from dataclasses import replace

    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=1))
    builder = hw.ProgramBuilder(small)
    x = builder.add_input("x", 1)
    first = builder.add_compartments("first", 1, decay_u=4096, decay_v=4096, threshold=10)
    rest = builder.add_compartments("rest", 40, decay_u=4096, decay_v=4096, threshold=10)
    builder.connect(x, first, [[20]])
    builder.connect(first, rest, np.full((40, 1), 20))
    counts = hw.simulate(builder.build(), [[1], [0], [0]]).counts
    # rest is on cores 1..40: 3 in tile 0, then tiles 1..9 of four cores, and one core in tile 10. Columns 8, so tile
    # 8 is column 0 of row 1, tile 9 column 1, tile 10 column 2.
    assert counts.axon_packets == 40
    assert counts.packets_within_tile == 3
    assert counts.hops_x == 4 * (1 + 2 + 3 + 4 + 5 + 6 + 7) + 4 * (0 + 1) + 1 * 2
    assert counts.hops_y == 4 * 2 + 1
