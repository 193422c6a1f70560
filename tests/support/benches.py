"""Small programs with recordings that together use everything the open core has.

The tests of the open core play them: a SystemVerilog source with a planted fault (a mutant) must give another result
than the simulator on at least one of them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import hw_model as hw
from hw_model.mapping.graph import CompartmentGraph, Phase, Readout
from hw_model.rtl.comparison import compare
from hw_model.rtl.images import Sizes
from tests.support import hybrids
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL, LARGEST_BIAS, LARGEST_THRESHOLD

CHIP = hw.chip("loihi-sim")
FAULT = ("update.sv", "6'b0}) < sum7;", "6'b0}) >= sum7;")
"""A planted fault: a file, a text in it, and its replacement. Compartments fire at or below their threshold."""
SIZES = Sizes(
    axons=256,
    synapses=4096,
    compartments=64,
    slots=64,
    charge=26,
    join=36,
    bitmap=256,
    visits=32,
    entries=32,
    word=8,
)

# `later` is 2 bits: compartments are a quarter and slots of charges four times as many where the second phase takes
# events as they arrive. `groups` lets rows share sources.
LATER = replace(SIZES, compartments=128, later=2, groups=1)
"""Sizes as on the largest device: a second phase takes its events as they arrive, and rows share sources."""


def with_fault(texts: dict[str, str]) -> dict[str, str]:
    """Return the SystemVerilog by file with :data:`FAULT` in it."""
    name, old, new = FAULT
    assert texts[name].count(old) == 1
    return {**texts, name: texts[name].replace(old, new)}


def ends_of_ranges() -> tuple[hw.ChipProgram, np.ndarray]:
    """Charges and currents wrap, voltages clip at limits of their own, and the same target is charged in successive cycles.

    Synapses repeat a target at once and after one other, the two distances at which a pipeline can read an old value.
    """
    r = np.random.default_rng(4)
    b = hw.ProgramBuilder(CHIP, name="ends")
    x = b.add_input("x", 4)
    voltage_limits = {"vmin": 1 - (1 << 15), "vmax": (1 << 17) - 1}
    one = b.add_compartments(
        "one", 1, decay_u=KEEPS_ALL, decay_v=1, threshold=900, bias=-4096 * 128, refractory=2
    )
    two = b.add_compartments(
        "two",
        2,
        decay_u=[1, 2048],
        decay_v=[0, 4095],
        threshold=40,
        bias=[0, LARGEST_BIAS],
        refractory=3,
        **voltage_limits,
    )
    y = b.add_compartments(
        "y", 3, decay_u=390, decay_v=128, threshold=[0, 100, 131071], refractory=[1, 63, 5]
    )
    # After four spikes its current is -2^23, the only value whose magnitude needs all 24 bits.
    edge = b.add_compartments(
        "edge", 1, decay_u=KEEPS_ALL, decay_v=FORGETS_AT_ONCE, threshold=LARGEST_THRESHOLD
    )
    b.connect(x, edge, [[-256, 0, 0, 0]], exponent=7)
    for target in (one, two, one, two, y):
        for exponent, delay in ((7, 0), (7, 0), (-2, 3)):
            weights = 2 * r.integers(-128, 128, (target.size, 4))
            weights[0, 0] = (
                2  # with exponent -2 it adds nothing, but still counts as a synaptic operation
            )
            b.connect(x, target, weights, exponent=exponent, delay=delay)
    b.connect(x, y, 255 * np.ones((3, 4), dtype=int), sign_mode="excitatory", delay=62)
    for source in (one, two):
        b.connect(
            source,
            y,
            2 * r.integers(20, 128, (3, source.size)),
            delay=r.integers(0, 4, (3, source.size)),
        )
    b.read_out(y)
    return b.build(), (r.random((2, 66, 4)) < 0.5).astype(np.uint8)


def families() -> tuple[hw.ChipProgram, np.ndarray]:
    """A fan with a chain below one child: with so few compartments the pipeline must wait for children before a parent."""
    r = np.random.default_rng(5)
    b = hw.ProgramBuilder(CHIP, name="families")
    x = b.add_input("x", 3)
    parameters = {"decay_u": 390, "decay_v": 300, "threshold": 60}
    y = b.add_compartments("y", 1, **parameters)
    fan = [b.add_compartments(f"y/{i}", 1, **parameters, joined_to=y, bias=-64) for i in range(3)]
    leaf = b.add_compartments("y/1/leaf", 1, **parameters, joined_to=fan[1])
    for target in (y, *fan, leaf):
        b.connect(x, target, 2 * r.integers(-30, 60, (1, 3)))
    b.connect(y, leaf, [[-200]], delay=1)
    b.read_out(y)
    return b.build(), (r.random((1, 40, 3)) < 0.4).astype(np.uint8)


def blocked() -> tuple[hw.ChipProgram, np.ndarray]:
    """Compartments that wait out their refractory time without current or voltage, and then receive more input."""
    b = hw.ProgramBuilder(CHIP, name="blocked")
    x = b.add_input("x", 2)
    h = b.add_compartments(
        "h", 2, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=1, refractory=[4, 9]
    )
    b.connect(x, h, [[200, 0], [0, 200]])
    # Its bias makes it fire at once, and wraps what drives it after four spikes, while it is blocked.
    full = b.add_compartments(
        "full",
        1,
        decay_u=KEEPS_ALL,
        decay_v=FORGETS_AT_ONCE,
        threshold=1,
        bias=LARGEST_BIAS,
        refractory=63,
    )
    b.connect(x, full, [[254, 0]], exponent=7)
    b.read_out(h)
    spikes = np.zeros((1, 30, 2), dtype=np.uint8)
    spikes[0, [0, 3, 5, 6, 12, 20, 21, 29]] = 1
    return b.build(), spikes


def hybrid(seed: int) -> tuple[hw.ChipProgram, np.ndarray]:
    """A random program of a time phase and a location phase, with one recording (1, steps, channels)."""
    program, spikes = hybrids.random_hybrid(seed, channels_per_step=2, silence=1)
    return program, spikes[None]


def _hybrid_of(
    seed: int, *, rows: int, rows_heard: int, recordings: int, channels: int, density: float
) -> tuple[hw.ChipProgram, np.ndarray]:
    """Phases over time and over channels, of which the second hears only the first ``rows_heard`` rows."""
    r = np.random.default_rng(seed)
    program = hybrids.program_of_graphs(
        CHIP,
        Readout(("time/y", "location/y"), (1.0, 1.0)),
        hybrids.graph_in_phase(hybrids.random_branch(r, "time", channels, 2, CHIP), "time", rows),
        hybrids.graph_in_phase(
            hybrids.random_branch(r, "location", rows_heard, 2, CHIP),
            "location",
            4,  # steps: one per channel, and a silent one
            r.permutation(channels),
        ),
    )
    return program, (r.random((recordings, rows, channels)) < density).astype(np.uint8)


def long() -> tuple[hw.ChipProgram, np.ndarray]:
    """A recording of 70 steps, more than two words of the transpose buffer hold."""
    return _hybrid_of(8, rows=70, rows_heard=70, recordings=1, channels=3, density=0.2)


def early_rows() -> tuple[hw.ChipProgram, np.ndarray]:
    """A first phase that hears all rows of a recording, and a second that hears only the first ten."""
    return _hybrid_of(14, rows=24, rows_heard=10, recordings=2, channels=3, density=0.4)


def by_potentials() -> tuple[hw.ChipProgram, np.ndarray]:
    """Four classes predicted by potentials from the sixth step on; two have equal weights, so that scores tie."""
    r = np.random.default_rng(6)
    b = hw.ProgramBuilder(CHIP, name="potentials")
    x = b.add_input("x", 2)
    y = b.add_compartments(
        "y",
        4,
        decay_u=FORGETS_AT_ONCE,
        decay_v=[0, 100, 100, 2000],
        threshold=LARGEST_THRESHOLD,
        bias=-99,
    )
    weights = 2 * r.integers(-60, 60, (4, 2))
    weights[2] = weights[1]
    b.connect(x, y, weights)
    readout = Readout(("y",), (-1.5,), potentials_from=5)
    program = hybrids.program_of_graphs(CHIP, readout, b.graph())
    return program, (r.random((3, 30, 2)) < 0.4).astype(np.uint8)


def together(*branches: CompartmentGraph) -> hw.ChipProgram:
    """One program of the phases of all branches, which reads out their last groups with weights of both signs."""
    groups = tuple(f"{branch.phases[0].name}/y" for branch in branches)
    weights = (1.0, -2.0, 0.5, 3.0, 1.5)[: len(groups)]
    return hybrids.program_of_graphs(CHIP, Readout(groups, weights), *branches)


def several_phases() -> tuple[hw.ChipProgram, np.ndarray]:
    """Two phases over time and two over channels; the first hears less than the buffer keeps."""
    r = np.random.default_rng(9)
    channels = 4
    rows = 20

    def branch(name, lines):
        return hybrids.random_branch(r, name, lines, 3, CHIP)

    # The last phase hears twelve rows, of two channels in each of its first two steps.
    program = together(
        hybrids.moved(
            branch("a", rows),
            Phase("a", "location", steps=5),
            {"positions": r.permutation(channels)},
        ),
        hybrids.moved(branch("b", channels), Phase("b", "time", steps=9)),
        hybrids.moved(branch("c", channels), Phase("c", "time", steps=14)),
        hybrids.moved(
            branch("d", 2 * 12),
            Phase("d", "location", steps=3),
            {"positions": [1, 0, 0, 1], "first_lines": [0, 0, 12, 12]},
        ),
    )
    spikes = (r.random((2, rows, channels)) < 0.3).astype(np.uint8)
    spikes[:, 9] = 1  # one row in which every channel spikes
    return program, spikes


def both_ways() -> tuple[hw.ChipProgram, np.ndarray]:
    """A phase with two inputs: one reads the buffer row by row, the other channel by channel."""
    r = np.random.default_rng(11)
    channels = 3
    rows = 36
    b = hw.ProgramBuilder(CHIP, name="both ways")
    x = b.add_input("x", channels)
    turned = b.add_input("turned", rows)
    y = b.add_compartments("both/y", 4, decay_u=390, decay_v=300, threshold=60)
    b.connect(x, y, 2 * r.integers(-30, 60, (4, channels)), delay=2)
    b.connect(turned, y, 2 * r.integers(-30, 60, (4, rows)))
    program = together(
        hybrids.moved(
            b.graph(), Phase("both", "time", steps=9), {}, {"positions": [2, 2 + 5, 2 + 3]}
        )
    )
    return program, (r.random((1, rows, channels)) < 0.3).astype(np.uint8)


def late_starts() -> tuple[hw.ChipProgram, np.ndarray]:
    """Phases that begin with the first row of two events: late, at once, never, and in the last row of a recording."""
    r = np.random.default_rng(12)
    channels = 3
    rows = 40
    visits = {"positions": r.permutation(channels)}
    short = 30  # steps of the phases that begin late, fewer than the recording has

    def branch(name, lines):
        return hybrids.random_branch(r, name, lines, 2, CHIP)

    program = together(
        hybrids.moved(branch("a", channels), Phase("a", "time", short, align_events=2)),
        hybrids.moved(branch("b", short), Phase("b", "location", steps=4, align_events=2), visits),
        hybrids.moved(branch("c", rows), Phase("c", "location", steps=3), visits),
    )
    late, at_once, never, at_the_end = range(4)
    spikes = (r.random((4, rows, channels)) < 0.3).astype(np.uint8)
    spikes[:, :, 1:] &= spikes[:, :, :1] ^ 1  # where channel 0 spikes, no other does
    spikes[at_once, 0] = 1
    spikes[late, 7, :2] = 1
    spikes[at_the_end, rows - 1] = 1
    spikes[never] = np.eye(3, dtype=np.uint8)[r.integers(0, 3, rows)]  # one event in each row
    # Channel 0 alone has at most one event in a row, so the phases do not begin before the row given above.
    spikes[late, :7, 1:] = 0
    spikes[at_the_end, :-1, 1:] = 0
    return program, spikes


def never_starts() -> tuple[hw.ChipProgram, np.ndarray]:
    """A phase that never begins, since no row has two events, next to one with lines for more rows than there are."""
    r = np.random.default_rng(14)
    channels = 3
    rows = 6
    lines = 17
    program = together(
        hybrids.moved(
            hybrids.random_branch(r, "a", channels, 2, CHIP),
            Phase("a", "time", rows, align_events=2),
        ),
        hybrids.moved(
            hybrids.random_branch(r, "b", lines, 2, CHIP),
            Phase("b", "location", steps=4),
            {"positions": r.permutation(channels)},
        ),
    )
    return program, np.eye(channels, dtype=np.uint8)[r.integers(0, channels, (2, rows))]


def windows(changed: slice = slice(0)) -> tuple[hw.ChipProgram, np.ndarray]:
    """Two phases whose weights are equal within windows of 4 and of 8 rows; the second begins at the first touch.

    The core stores such weights once per window. Lines of ``changed`` get a weight of their own in one compartment,
    which breaks up their windows.
    """
    r = np.random.default_rng(15)
    channels = 3
    rows = 22

    def branch(name: str, window: int) -> CompartmentGraph:
        b = hw.ProgramBuilder(CHIP, name=name)
        x = b.add_input(f"{name}/x", channels * rows)
        y = b.add_compartments(f"{name}/y", 4, decay_u=390, decay_v=300, threshold=60)
        windows_in_all = -(-rows // window)  # rounded up: the last window is cut short
        weights_of_windows = 2 * r.integers(-30, 60, (4, channels, windows_in_all))
        weights = weights_of_windows.repeat(window, axis=2)[:, :, :rows].reshape(4, -1)
        weights[1, changed] += 2
        b.connect(x, y, weights)
        return b.graph()

    def visits() -> dict:
        return {"positions": np.array([0, 2, 0]), "first_lines": rows * r.permutation(channels)}

    program = together(
        hybrids.moved(branch("a", 4), Phase("a", "location", steps=4), visits()),
        hybrids.moved(branch("b", 8), Phase("b", "location", steps=5, align_events=2), visits()),
    )
    return program, (r.random((2, rows, channels)) < 0.3).astype(np.uint8)


def all_benches() -> list[tuple[hw.ChipProgram, np.ndarray]]:
    """Return all programs with their recordings, the quickest first.

    Most faults show in several of them, and a test ends with the first in which its fault shows.
    """
    program, spikes = hybrid(22)
    potentials, recordings = by_potentials()
    return [
        (potentials, recordings[:, :3]),
        blocked(),
        both_ways(),
        (program, spikes[:, :-2]),
        (program, spikes),
        hybrid(43),
        families(),
        (potentials, recordings),
        hybrid(0),
        long(),
        early_rows(),
        late_starts(),
        never_starts(),
        windows(),
        ends_of_ranges(),
        several_phases(),
    ]


benches = cache(all_benches)


STOPPING_CLOCK_GATE = """module clock_gate (input logic clk, input logic enable, output logic gated);
    logic open;
    always_latch if (!clk) open = enable;
    assign gated = clk && open;
endmodule
"""
"""A latch and an AND gate, as a chip has in place of `clock_gate.sv`, which keeps the clock running."""


def differ(texts, sizes=SIZES) -> bool:
    """Return whether these SystemVerilog files give another result than the simulator on any program."""
    patience_cycles = (
        20_000  # a faulty core may hang; every program takes fewer cycles per recording
    )
    for program, spikes in benches():
        comparison = compare(
            program, spikes, texts, "icarus", sizes=sizes, patience=patience_cycles
        )
        if comparison["mismatches"] or comparison["cycle_mismatches"]:
            return True
    return False
