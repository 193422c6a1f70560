"""Small programs that use everything the core has; together they tell every mutant from the core."""

from __future__ import annotations

import hybrids
import numpy as np

import hw_model as hw
from hw_model.mapping.graph import Readout
from hw_model.rtl.images import Sizes

CHIP = hw.chip("loihi-sim")
SIZES = Sizes(axons=256, synapses=4096, compartments=64, slots=64, charge=26, join=36, bitmap=64, visits=32, entries=32)


def ends_of_ranges() -> tuple[hw.ChipProgram, np.ndarray]:
    """Charges and currents wrap, voltages clip at limits of their own, targets repeat in a row and every other time."""
    r = np.random.default_rng(4)
    b = hw.ProgramBuilder(CHIP, name="ends")
    x = b.add_input("x", 4)
    kept = {"vmin": 1 - (1 << 15), "vmax": (1 << 17) - 1}
    one = b.add_compartments("one", 1, decay_u=0, decay_v=1, threshold=900, bias=-4096 * 128, refractory=2)
    two = b.add_compartments(
        "two", 2, decay_u=[1, 2048], decay_v=[0, 4095], threshold=40, bias=[0, 4095 * 128], refractory=3, **kept
    )
    y = b.add_compartments("y", 3, decay_u=390, decay_v=128, threshold=[0, 100, 131071], refractory=[1, 63, 5])
    # After four spikes its current is -2^23, the only value whose magnitude needs all 24 bits.
    edge = b.add_compartments("edge", 1, decay_u=0, decay_v=4096, threshold=131071)
    b.connect(x, edge, [[-256, 0, 0, 0]], exponent=7)
    for target in (one, two, one, two, y):
        for exponent, delay in ((7, 0), (7, 0), (-2, 3)):
            weights = 2 * r.integers(-128, 128, (target.size, 4))
            b.connect(x, target, weights, exponent=exponent, delay=delay)
    b.connect(x, y, 255 * np.ones((3, 4), dtype=int), sign_mode="excitatory", delay=62)
    for source in (one, two):
        b.connect(source, y, 2 * r.integers(20, 128, (3, source.size)), delay=r.integers(0, 4, (3, source.size)))
    b.read_out(y)
    return b.build(), (r.random((2, 66, 4)) < 0.5).astype(np.uint8)


def families() -> tuple[hw.ChipProgram, np.ndarray]:
    """A chain, a fan and single compartments, so few that parents have to wait for their children."""
    r = np.random.default_rng(5)
    b = hw.ProgramBuilder(CHIP, name="families")
    x = b.add_input("x", 3)
    given = {"decay_u": 390, "decay_v": 300, "threshold": 60}
    y = b.add_compartments("y", 1, **given)
    fan = [b.add_compartments(f"y/{i}", 1, **given, joined_to=y, bias=-64) for i in range(3)]
    leaf = b.add_compartments("y/1/leaf", 1, **given, joined_to=fan[1])
    for target in (y, *fan, leaf):
        b.connect(x, target, 2 * r.integers(-30, 60, (1, 3)))
    b.connect(y, leaf, [[-200]], delay=1)
    b.read_out(y)
    return b.build(), (r.random((1, 40, 3)) < 0.4).astype(np.uint8)


def hybrid(seed: int) -> tuple[hw.ChipProgram, np.ndarray]:
    program, spikes = hybrids.random_hybrid(seed, together=2, silence=1)
    return program, spikes[None]


def long() -> tuple[hw.ChipProgram, np.ndarray]:
    """A recording of more steps than two words of the transpose buffer hold."""
    r = np.random.default_rng(8)
    steps, channels = 70, 3
    program = hybrids.assembled(
        CHIP,
        Readout(("time/y", "location/y"), (1.0, 1.0)),
        hybrids.in_phase(hybrids.random_branch(r, "time", channels, 2, CHIP), "time", steps),
        hybrids.in_phase(hybrids.random_branch(r, "location", steps, 2, CHIP), "location", 4, r.permutation(channels)),
    )
    return program, (r.random((1, steps, channels)) < 0.2).astype(np.uint8)


def by_potentials() -> tuple[hw.ChipProgram, np.ndarray]:
    """Two classes, the second as good as the first in the end; potentials count from the sixth step on."""
    r = np.random.default_rng(6)
    b = hw.ProgramBuilder(CHIP, name="potentials")
    x = b.add_input("x", 2)
    y = b.add_compartments("y", 4, decay_u=4096, decay_v=[0, 100, 100, 2000], threshold=131071, bias=-99)
    weights = 2 * r.integers(-60, 60, (4, 2))
    weights[2] = weights[1]
    b.connect(x, y, weights)
    program = hybrids.assembled(CHIP, Readout(("y",), (-1.5,), 5), b.graph())
    return program, (r.random((3, 30, 2)) < 0.4).astype(np.uint8)


def all_benches() -> list[tuple[hw.ChipProgram, np.ndarray]]:
    program, spikes = hybrid(22)
    potentials, few = by_potentials()
    shorter = [(program, spikes[:, :-2]), (potentials, few[:, :3])]
    return [ends_of_ranges(), families(), (potentials, few), *map(hybrid, (43, 0, 22)), *shorter, long()]
