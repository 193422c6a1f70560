"""Random programs of everything that ``--emit lava`` accepts, and programs that reach the ends of registers.

Lava's neurons differ from the chip where a register wraps, so the emitter refuses a program that wraps in the recording.
"""

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
"""Thresholds as multiples of a middle weight (mantissa 128), so that populations neither stay silent nor always spike."""
THRESHOLD_MAX = 2**17 - 1
CURRENT_LIMIT = 2**23
"""The first magnitude that a current of 23 bits and a sign does not reach."""
DELAY_MAX = 62
SIGN_MODES: tuple[SignMode, ...] = ("mixed", "excitatory", "inhibitory")
SIGN_MODE_SHARES = (0.5, 0.35, 0.15)

Case = tuple[hw.ChipProgram, NDArray[np.uint8]]
"""A program, and a recording (steps, lines) of its one stream ``x``."""


def random_case(seed: int) -> Case:
    """Draw programs until the emitter accepts one, since it refuses those whose registers wrap in the recording."""
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
    """Draw two populations, up to six connections, and a recording."""
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
    """Add a population of two to eight compartments, whose thresholds suit weights of an exponent."""
    size = int(generator.integers(2, 9))
    multiples = np.array(THRESHOLDS_IN_WEIGHTS) * 128 * 2.0**exponent
    thresholds = [0, 1, THRESHOLD_MAX, *np.minimum(multiples, THRESHOLD_MAX).astype(int)]

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
    builder: hw.ProgramBuilder, generator: Generator, ends: tuple[Node, Node], largest_exponent: int
) -> None:
    """Connect source and target with random weights and delays in a random format; about 30 % of the pairs have none."""
    source, target = ends
    shape = target.size, source.size
    exponent = int(generator.integers(max(largest_exponent - 2, 0), largest_exponent + 1))
    bits = int(generator.choice(WEIGHT_BITS))
    mode = SIGN_MODES[int(generator.choice(3, p=SIGN_MODE_SHARES))]
    grid = weight_grid(bits, mode)
    drawn = generator.integers(grid.low, grid.high + 1, shape)
    # Rounding down to the grid may leave it at its lower end.
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
    """Return programs with situations that random programs would hardly have, by their descriptions."""
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

    Line i brings a charge of 2^i units of 64, for i from 0 to 14, so the spikes of a row are the binary digits of any
    charge. Weights have 8 bits, so lines above 7 have the weight 2^(i - 7) at exponent 7.
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
    """Return the charge of every step, in units of 64, that leads u from 0 to a target with decay 1."""
    largest_charge = 2**20  # the register of the charge has 21 bits and a sign
    u = 0
    charges: list[int] = []
    while True:
        kept = u * 4095 >> 12
        gap = target - kept
        if gap % 64 == 0 and gap <= largest_charge:
            return [*charges, gap // 64]
        # The decay leaves arbitrary last bits of u. Charges that differ from step to step change those bits, until the
        # remaining gap is a multiple of 64.
        charge = min(gap // 2, largest_charge) // 64 - len(charges)
        charges.append(charge)
        u = kept + 64 * charge


def _at_the_threshold() -> hw.ChipProgram:
    """Three neurons of weights 2, 4 and -2: the first has v equal to its threshold of 6 in its third step."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "edge")
    line = builder.add_input("x", 1)
    neurons = builder.add_compartments("h", 3, decay_u=4096, decay_v=0, threshold=6)
    builder.connect(line, neurons, [[2], [4], [-2]])
    return builder.build()


def _doubled() -> hw.ChipProgram:
    """One line and one neuron with two synapses of different delays."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "doubled")
    line = builder.add_input("x", 1)
    neuron = builder.add_compartments("h", 1, decay_u=100, decay_v=50, threshold=900)
    builder.connect(line, neuron, [[200]], delay=2)
    builder.connect(line, neuron, [[200]], delay=5)
    return builder.build()


def _apart() -> hw.ChipProgram:
    """A population that nothing is connected to, whose bias makes it spike."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), "apart")
    lines = builder.add_input("x", 2)
    first = builder.add_compartments("first", 1, decay_u=100, decay_v=50, threshold=900)
    builder.add_compartments("alone", 2, decay_u=1, decay_v=0, threshold=100, bias=640)
    builder.connect(lines, first, [[200, 100]])
    return builder.build()
