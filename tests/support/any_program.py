"""Strategies of hypothesis that draw programs from everything that a chip file and the builder allow.

Drawn are register widths, biases, thresholds, voltage limits, weight formats, delays, refractory periods, compartments
joined as fans, chains and trees, recurrence, several synapses between the same two compartments, and cores that hold
only one family (a compartment with all that are joined to it). Each program comes with counts of what was drawn, by
which tests check that nothing rare is missing.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.arithmetic.fixed_point import SIGN_MODES, weight_grid
from hw_model.arithmetic.loihi import voltage_maxima, voltage_minima
from hw_model.description.chip import check_chip
from hw_model.mapping.graph import CompartmentGraph, Readout
from hw_model.program.builder import Node
from tests.support import hybrids
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL

LOIHI = hw.chip("loihi-sim")
MANY_CHILDREN = 260
"""Children of one compartment: 260 voltages of 23 bits and a sign have a sum that 32 bits do not hold."""


@dataclass(frozen=True, eq=False, repr=False)
class Drawn:
    """A program, its graph, its recordings (batch, steps, channels), and counts of what was drawn, by name."""

    program: hw.ChipProgram
    graph: CompartmentGraph
    spikes: np.ndarray
    drawn: Counter[str]

    def __repr__(self) -> str:
        return f"Drawn({self.program.chip.registers}, {dict(self.drawn)})"


def _usual_or(usual: int, others: st.SearchStrategy[int]) -> st.SearchStrategy[int]:
    """Draw the value of the chips that ship, or one of ``others``."""
    return st.one_of(st.just(usual), others)


@st.composite
def chips(draw: st.DrawFn, widths: bool = True) -> hw.Chip:
    """Draw a chip; without ``widths`` its charge, current and voltage registers are those of the chips that ship."""
    any_width = st.sampled_from([9, 10, 15, 16, 20, 21, 22, 23, 24, 28, 29, 30, 31, 32, 33, 39, 40])
    register_widths = {
        "charge_bits": _usual_or(21, any_width),
        "current_bits": _usual_or(23, any_width),
        "voltage_bits": _usual_or(23, any_width),
    }
    ranges = {
        "threshold_mantissa_bits": _usual_or(17, st.integers(1, 34)),
        "bias_mantissa_bits": _usual_or(12, st.integers(1, 24)),
        "bias_exponent_max": _usual_or(7, st.integers(0, 24)),
        "refractory_max": st.sampled_from([1, 2, 7, 63, 65_535]),
        "delay_max": st.sampled_from([0, 1, 10, 62, 300]),
    }
    if widths:
        ranges |= register_widths
    drawn = {name: draw(strategy, label=name) for name, strategy in ranges.items()}
    # Every compartment has drawn parameters, so it needs profiles and formats of its own.
    profiles = {"compartment_profiles_per_core": 1024, "threshold_profiles_per_core": 1024}
    limits = replace(LOIHI.limits, **profiles, synapse_formats_per_core=256)
    chip = replace(LOIHI, registers=replace(LOIHI.registers, **drawn), limits=limits)
    check_chip(chip, "drawn")
    return chip


def parameters(r: np.random.Generator, size: int, chip: hw.Chip) -> dict[str, np.ndarray]:
    """Draw every parameter at its ends or in between, with more weight on values at which compartments spike."""
    limits = chip.registers
    span = 1 << limits.bias_mantissa_bits  # mantissas go from -span to span - 1
    mantissa = r.choice([0, 0, 0, 1, -2, span - 1, -span, r.integers(-span, span)], size)
    exponent = r.choice(
        [0, 0, limits.bias_exponent_max, r.integers(0, limits.bias_exponent_max + 1)], size
    )
    # The highest threshold that a voltage can exceed: thresholds are stored in units of 64.
    reachable = min(limits.threshold_mantissa_max, limits.voltage_max >> 6)
    return {
        "decay_u": r.choice([0, 1, 390, 2048, 4095, 4096, r.integers(0, 4097)], size),
        "decay_v": r.choice([0, 1, 128, 2589, 4095, 4096, r.integers(0, 4097)], size),
        "threshold": r.choice(
            [0, 1, min(300, reachable), reachable // 2, reachable, limits.threshold_mantissa_max],
            size,
        ),
        "bias": mantissa << exponent,
        "refractory": r.choice(
            [
                1,
                1,
                1,
                min(2, limits.refractory_max),
                min(5, limits.refractory_max),
                limits.refractory_max,
            ],
            size,
        ),
    }


POTENTIALS_FROM = st.sampled_from([None, None, 0, 2, 7])
"""The step from which the readout predicts by potentials; None: it predicts by spikes."""
OF_EACH = st.one_of(POTENTIALS_FROM, st.tuples(POTENTIALS_FROM, POTENTIALS_FROM))
"""One such step for all populations of a readout, or one for each of two."""

SHAPES = {
    "none": (0, 0),
    "fan": (2, 4),
    "chain": (2, 5),
    "tree": (3, 6),
    "many": (MANY_CHILDREN,) * 2,
}
"""Ways to join compartments to a population, each with the least and the most joined compartments."""


def add_children(
    builder: hw.ProgramBuilder,
    soma: Node,
    shape: str,
    chip: hw.Chip,
    r: np.random.Generator,
    voltage_limits: dict[str, int],
) -> list[Node]:
    """Join compartments to a population in a way of :data:`SHAPES`; they often have equal parameters.

    The many of the widest fan mostly sit at the end of their range, so that the sum of their voltages is largest.
    """
    alike = bool(r.random() < (0.9 if shape == "many" else 0.7))
    first = parameters(r, soma.size, chip)
    if shape == "many" and alike:
        end = (1 << chip.registers.bias_mantissa_bits) - 1 << chip.registers.bias_exponent_max
        first |= {"decay_u": FORGETS_AT_ONCE, "decay_v": KEEPS_ALL, "bias": end}
    nodes = [soma]
    least, most = SHAPES[shape]
    for i in range(int(r.integers(least, most + 1))):
        any_node = nodes[int(r.integers(len(nodes)))]  # drawn for each shape, so that seeds agree
        parent = {"chain": nodes[-1], "tree": any_node}.get(shape, soma)
        child = builder.add_compartments(
            f"{soma.name}/{i}",
            soma.size,
            **(first if alike else parameters(r, soma.size, chip)),
            **voltage_limits,
            joined_to=parent,
        )
        nodes.append(child)
    return nodes[1:]


def connect(
    r: np.random.Generator, builder: hw.ProgramBuilder, source: Node, target: Node, chip: hw.Chip
) -> None:
    """Add synapses with a drawn format, weights, exponent and delays; a weight of 0 makes no synapse."""
    bits = int(r.choice(chip.registers.weight_bits))
    mode = str(r.choice(SIGN_MODES))
    grid = weight_grid(bits, mode)
    shape = (target.size, source.size)
    weights = grid.round(r.choice([20, 300]) * r.uniform(-1, 1, shape))
    weights[r.random(shape) < r.choice([0.0, 0.3, 0.9])] = 0
    last = min(chip.registers.delay_max, int(r.choice([0, 2, 30, 300])))
    delay = r.integers(0, last + 1, shape) if r.random() < 0.5 else last
    builder.connect(
        source,
        target,
        weights,
        exponent=int(r.choice([-8, -2, 0, 0, 2, 7])),
        delay=delay,
        weight_bits=bits,
        sign_mode=mode,
    )


@st.composite
def graphs(
    draw: st.DrawFn, chip: hw.Chip, lines: int, classes: int, prefix: str = ""
) -> tuple[CompartmentGraph, Counter]:
    """Draw one to three populations with joined compartments and synapses, and count what was drawn.

    Population ``y`` has a compartment per class.
    """
    r = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="seed"))
    builder = hw.ProgramBuilder(chip)
    senders = [builder.add_input(f"{prefix}x", lines)]
    voltage_limits = {
        "vmin": int(r.choice(voltage_minima(chip.registers))),
        "vmax": int(r.choice(voltage_maxima(chip.registers))),
    }
    if r.random() < 0.7:
        voltage_limits = {}
    names = ["y", *(f"h{i}" for i in range(draw(st.integers(0, 2), label="hidden")))]
    counts: Counter[str] = Counter()
    joined: list[Node] = []
    for name in names:
        # At most one wide fan per graph, since it takes long to play.
        has_wide_fan = bool(counts["fans of more than 255"])
        shapes = [shape for shape in SHAPES if shape != "many" or not has_wide_fan]
        shape = draw(st.sampled_from(shapes), label="joins")
        if name == "y":
            size = classes
        elif shape == "many":
            size = 1
        else:
            size = int(r.integers(1, 6))
        soma = builder.add_compartments(
            f"{prefix}{name}", size, **parameters(r, size, chip), **voltage_limits
        )
        senders.append(soma)
        children = add_children(builder, soma, shape, chip, r, voltage_limits)
        joined += children
        counts["joined compartments"] += len(children) * size
        counts["fans of more than 255"] += len(children) > 255
    # Of a wide fan only some, or populations would seldom be drawn.
    targets = senders[1:] + joined[:12]
    for _ in range(draw(st.integers(1, 8), label="links")):
        source = senders[int(r.integers(len(senders)))]
        target = targets[int(r.integers(len(targets)))]
        for _ in range(int(r.choice([1, 1, 2, 4]))):
            connect(r, builder, source, target, chip)
        counts["links"] += 1
        counts["recurrent links"] += source.name == target.name
    biases = np.concatenate(
        [group.bias_mantissa << group.bias_exponent for group in builder.graph().groups]
    )
    counts["biases of more than 31 bits"] += int((np.abs(biases) >= 1 << 31).sum())
    return builder.graph(), counts


def small_cores(draw: st.DrawFn, chip: hw.Chip, *parts: CompartmentGraph) -> hw.Chip:
    """Return the chip, or one whose cores hold little more than the largest family.

    A family is a compartment with all that are joined to it; a core holds whole families only.
    """
    if draw(st.booleans(), label="usual cores"):
        return chip
    families: Counter[str] = Counter()
    for part in parts:
        parent = {group.name: group.joined_to for group in part.groups}
        for group in part.groups:
            root = group.name
            while parent[root] is not None:
                root = parent[root]
            families[root] += 1
    room = max(families.values()) + draw(st.integers(0, 3), label="room")
    return replace(chip, limits=replace(chip.limits, compartments_per_core=room))


@st.composite
def programs(
    draw: st.DrawFn, widths: bool = True, given: st.SearchStrategy[hw.Chip] | None = None
) -> Drawn:
    """Draw a program of one phase and two recordings for it; ``given`` draws the chip."""
    chip = draw(chips(widths) if given is None else given)
    lines = draw(st.integers(1, 5), label="lines")
    classes = draw(st.integers(1, 4), label="classes")
    graph, counts = draw(graphs(chip, lines, classes))
    chip = small_cores(draw, chip, graph)
    graph = replace(graph, readout=Readout(("y",), (1.0,), draw(POTENTIALS_FROM)))
    program = hybrids.program_of_graphs(chip, graph.readout, graph)
    r = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="recording"))
    shape = (2, draw(st.sampled_from([40, 20, 20, 5, 1]), label="steps"), lines)
    spikes = (r.random(shape) < r.choice([0.0, 0.05, 0.3, 1.0], (2, 1, 1))).astype(np.uint8)
    return Drawn(program, graph, spikes, counts + _counts_of_chip(program))


@st.composite
def hybrid_programs(draw: st.DrawFn, given: st.SearchStrategy[hw.Chip] | None = None) -> Drawn:
    """Draw a program of a time phase and a transposed location phase, and one recording (1, steps, channels)."""
    chip = draw(chips() if given is None else given)
    steps = draw(st.integers(1, 16), label="steps")
    channels = draw(st.integers(1, 5), label="channels")
    classes = draw(st.integers(1, 3), label="classes")
    time, time_counts = draw(graphs(chip, channels, classes, "time/"))
    location, location_counts = draw(graphs(chip, steps, classes, "location/"))
    chip = small_cores(draw, chip, time, location)
    r = np.random.default_rng(draw(st.integers(0, 2**32 - 1), label="recording"))
    silence = int(r.integers(0, 3))
    readout = Readout(("time/y", "location/y"), (1.0, float(r.choice([1.0, -2.0]))), draw(OF_EACH))
    branches = (
        hybrids.graph_in_phase(time, "time", steps),
        hybrids.graph_in_phase(location, "location", channels + silence, r.permutation(channels)),
    )
    graph = replace(hybrids.graphs_side_by_side(*branches), readout=readout)
    program = hybrids.program_of_graphs(chip, readout, *branches)
    spikes = (r.random((1, steps, channels)) < r.choice([0.05, 0.3, 1.0])).astype(np.uint8)
    counts = time_counts + location_counts + _counts_of_chip(program)
    return Drawn(program, graph, spikes, counts)


def _counts_of_chip(program: hw.ChipProgram) -> Counter[str]:
    """Count a program, and whether its chip has other widths than those that ship or its phases several cores."""
    limits = program.chip.registers
    widths = (limits.charge_bits, limits.current_bits, limits.voltage_bits)
    return Counter(
        {
            "programs": 1,
            "programs of other widths": int(widths != (21, 23, 23)),
            "programs of several cores": int(len(program.cores) > len(program.phases)),
        }
    )


# A program takes long to draw, and its first example is large: hypothesis would call either an error.
SETTINGS = settings(
    deadline=None,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
    ],
)
