"""Random programs over all that ``--emit lava`` allows, and programs that meet the edges of registers."""

from __future__ import annotations

from itertools import count

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

import hw_model as hw
from hw_model.arithmetic.fixed_point import WEIGHT_BITS, SignMode, weight_grid
from hw_model.program.builder import Node
from locsnn_compile.emitters import bench_files
from locsnn_compile.errors import InputError

STEPS = 60
DECAYS_U = (1, 2, 390, 1024, 2589, 4095, 4096)
DECAYS_V = (0, 1, 128, 390, 1024, 4095)
BIASES = (0, 0, 0, -7, 3, 4095, -4096, 4095 * 128)
THRESHOLDS_IN_WEIGHTS = (0.2, 0.5, 1.0, 3.0, 10.0)
THRESHOLD_MAX = 2**17 - 1
CURRENT_LIMIT = 2**23
DELAY_MAX = 62
SIGN_MODES: tuple[SignMode, ...] = ("mixed", "excitatory", "inhibitory")
SIGN_MODE_SHARES = (0.5, 0.35, 0.15)

Case = tuple[hw.ChipProgram, NDArray[np.uint8]]
"""A program, and a recording (steps, lines) of its one stream ``x``."""


def random_case(seed: int) -> Case:
    """Draw programs until one is allowed: registers of the others wrap in their recording."""
    for attempt in count():
        generator = np.random.default_rng([seed, attempt])
        program, spikes = _draw(generator)
        try:
            bench_files(program, ["lava"], spikes)
        except InputError as error:
            if "in this recording" not in str(error):
                raise
        else:
            return program, spikes
    raise AssertionError("unreachable")


def _draw(generator: Generator) -> Case:
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "random")
    exponent = int(generator.integers(0, 8))
    lines = int(generator.integers(3, 9))
    nodes = {
        "x": builder.add_input("x", lines),
        "h": _population(builder, generator, "h", exponent),
        "y": _population(builder, generator, "y", exponent),
    }
    pairs = [("x", "h"), ("h", "y")]
    optional = [("x", "h"), ("h", "h"), ("y", "h"), ("x", "y")]
    pairs += [pair for pair in optional if generator.random() < 0.4]
    for source, target in pairs:
        _connect(builder, generator, (nodes[source], nodes[target]), exponent)
    rate = generator.choice([0.05, 0.2, 0.5, 1.0])
    spikes = (generator.random((STEPS, lines)) < rate).astype(np.uint8)
    return builder.build(), spikes


def _population(builder: hw.ProgramBuilder, generator: Generator, name: str, exponent: int) -> Node:
    size = int(generator.integers(2, 9))
    weights = np.array(THRESHOLDS_IN_WEIGHTS) * 128 * 2.0**exponent
    thresholds = [0, 1, THRESHOLD_MAX, *np.minimum(weights, THRESHOLD_MAX).astype(int)]

    def column(choices: object) -> NDArray[np.int64]:
        """Draw one value for all compartments, or two, which split the population."""
        drawn = generator.choice(np.asarray(choices), int(generator.integers(1, 3)))
        values: NDArray[np.int64] = generator.choice(drawn, size)
        return values

    return builder.add_compartments(
        name,
        size,
        decay_u=column(DECAYS_U),
        decay_v=column(DECAYS_V),
        threshold=column(thresholds),
        bias=generator.choice(BIASES, size),
    )


def _connect(
    builder: hw.ProgramBuilder, generator: Generator, ends: tuple[Node, Node], top: int
) -> None:
    source, target = ends
    shape = target.size, source.size
    exponent = int(generator.integers(max(top - 2, 0), top + 1))
    bits = int(generator.choice(WEIGHT_BITS))
    mode = SIGN_MODES[int(generator.choice(3, p=SIGN_MODE_SHARES))]
    grid = weight_grid(bits, mode)
    drawn = generator.integers(grid.low, grid.high + 1, shape)
    weights = np.clip(drawn // grid.step * grid.step, grid.low, grid.high)
    weights[generator.random(shape) < 0.3] = 0
    latest = int(generator.choice([0, 1, 4, DELAY_MAX]))
    builder.connect(
        source,
        target,
        weights,
        exponent=exponent,
        delay=generator.integers(0, latest + 1, shape),
        weight_bits=bits,
        sign_mode=mode,
    )


def edge_cases() -> dict[str, Case]:
    """Return programs that meet what chance would not hit, by what they meet."""
    every_step = np.ones((20, 1), dtype=np.uint8)
    return {
        "v at the threshold": (_at_the_threshold(), every_step),
        "the highest u, and v clipped": steered_case(CURRENT_LIMIT - 64),
        "the lowest u, and v clipped": steered_case(64 - CURRENT_LIMIT),
        "a pair connected twice": (_doubled(), every_step),
        "parts that are not connected": (_apart(), np.ones((20, 2), dtype=np.uint8)),
    }


def steered_case(target: int) -> Case:
    """Return a program whose u becomes ``target``, a multiple of 64, in its last step.

    Fifteen lines bring charges of 1, 2, 4, ... 2^14 units, so a row holds the charge of its step.
    """
    sign = 1 if target > 0 else -1
    mode: SignMode = "excitatory" if target > 0 else "inhibitory"
    bits = np.arange(15)
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "steered")
    lines = builder.add_input("x", len(bits))
    neuron = builder.add_compartments("h", 1, decay_u=1, decay_v=0, threshold=THRESHOLD_MAX)
    low = np.where(bits <= 7, sign << bits.clip(max=7), 0)
    high = np.where(bits > 7, sign << (bits - 7).clip(min=0), 0)
    builder.connect(lines, neuron, [low.tolist()], sign_mode=mode)
    builder.connect(lines, neuron, [high.tolist()], exponent=7, sign_mode=mode)
    charges = _steps_to(abs(target))
    # The charge of a row acts in the next step, which is the last one.
    rows = [*((charge >> bits) & 1 for charge in charges), np.zeros_like(bits)]
    return builder.build(), np.array(rows, dtype=np.uint8)


def _steps_to(target: int) -> list[int]:
    """Return the charge of every step, in units of 64, that leads u from 0 to a target at decay 1."""
    u = 0
    charges: list[int] = []
    while True:
        kept = u * 4095 >> 12
        gap = target - kept
        if gap % 64 == 0 and gap <= 2**20:
            return [*charges, gap // 64]
        # Each step differs from the others, until the rest of the way is a whole number of units.
        charge = min(gap // 2, 2**20) // 64 - len(charges)
        charges.append(charge)
        u = kept + 64 * charge


def _at_the_threshold() -> hw.ChipProgram:
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "edge")
    line = builder.add_input("x", 1)
    neurons = builder.add_compartments("h", 3, decay_u=4096, decay_v=0, threshold=6)
    builder.connect(line, neurons, [[2], [4], [-2]])
    return builder.build()


def _doubled() -> hw.ChipProgram:
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "doubled")
    line = builder.add_input("x", 1)
    neuron = builder.add_compartments("h", 1, decay_u=100, decay_v=50, threshold=900)
    builder.connect(line, neuron, [[200]], delay=2)
    builder.connect(line, neuron, [[200]], delay=5)
    return builder.build()


def _apart() -> hw.ChipProgram:
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "apart")
    lines = builder.add_input("x", 2)
    first = builder.add_compartments("first", 1, decay_u=100, decay_v=50, threshold=900)
    builder.add_compartments("alone", 2, decay_u=1, decay_v=0, threshold=100, bias=640)
    builder.connect(lines, first, [[200, 100]])
    return builder.build()
