"""Random networks that stay within what a peer can do.

Values at the ends of registers, formats and decays are drawn far more often than a uniform draw would, because that is where
simulators differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from peer_networks import Network, Population, Projection

from hw_model.arithmetic.fixed_point import WEIGHT_BITS, weight_grid

STEPS = 80
DECAYS = (0, 1, 128, 390, 1024, 2589, 4095, 4096)
"""In 4096ths that a step loses: both ends of the grid, and those of time constants of 10 steps (390) and of 1 (2589)."""
THRESHOLDS = (0, 1, 4095, 131071)
"""Mantissas, 64 units of the voltage register each; the last is the largest."""
THRESHOLDS_IN_WEIGHTS = (0.2, 0.5, 1.0, 3.0, 10.0)
"""Further thresholds, in weights of mantissa 128 at the largest exponent of the network, so that neurons spike."""
BIASES = (0, 0, 0, -7, 3, 4095, -4096, 4095 * 128)
"""In units of the voltage register; the last is the largest, a mantissa of 4095 with the exponent 7."""
REFRACTORY = (1, 1, 1, 2, 3, 7, 63)
"""Steps of which the first is that of the spike; 63 is the most that the chip counts."""
VOLTAGE_MAX = 2**23 - 1
VOLTAGES_MIN = (*[-VOLTAGE_MAX] * 4, 1 - 2**15, 0)
"""Lower limits of the voltage, in its units; values that occur several times are drawn as often."""
VOLTAGES_MAX = (*[VOLTAGE_MAX] * 4, 2**19 - 1, 511)
"""Upper limits."""
EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")
SIGN_MODES = ("mixed", "excitatory", "inhibitory")
SIGN_MODE_SHARES = (0.5, 0.35, 0.15)


@dataclass(frozen=True)
class Abilities:
    """What a peer can do: by default all that the chip can. Each ability that it lacks is a quirk of its table."""

    overflow: bool = True
    """It wraps q, u and u + bias, and clips v; otherwise networks that do so are drawn again."""
    per_compartment: bool = True
    """Compartments of a population may differ in their parameters."""
    bias: bool = True
    limits: bool = True
    """vmin and vmax can be set."""
    refractory: bool = True
    feedback: bool = True
    """A population may project to one before it, not only to itself."""
    delay: Literal["none", "axon", "synapse"] = "synapse"
    """Delays may differ from source to source, or from synapse to synapse."""
    threshold_max: int = 131071
    exponents: range = range(-8, 8)
    floors_negative_exponents: bool = True
    """Otherwise only mantissas that lose no bits are drawn."""
    odd_mantissas: bool = True
    """The sign modes without a sign bit have them, at 8 bits."""
    lowest_mantissa: range = range(-8, 8)
    """Weight exponents at which the mantissa -256 is drawn."""


def random_network(name: str, seed: int, can: Abilities) -> Network:
    """Draw the network of a seed; if the peer does not model overflow, draw again until our engine counts none."""
    for attempt in count():
        network = _draw(name, np.random.default_rng([seed, attempt]), can)
        if can.overflow or not any(network.simulate().counts[event] for event in EVENTS):
            return network
    raise AssertionError("unreachable")


def _draw(name: str, r: Generator, can: Abilities) -> Network:
    size = {"x": int(r.integers(3, 9)), "h": int(r.integers(3, 10)), "y": int(r.integers(2, 6))}
    pairs = [("x", "h"), ("x", "h"), ("x", "y"), ("h", "y"), ("h", "h")]
    if can.feedback:
        pairs.append(("y", "h"))
    top = int(r.choice(can.exponents))  # the largest weight exponent
    return Network(
        name,
        spikes=(r.random((STEPS, size["x"])) < r.choice([0.05, 0.2, 0.5, 1.0])).astype(np.uint8),
        populations=tuple(_population(r, can, key, size[key], top) for key in ("h", "y")),
        projections=tuple(
            _projection(r, can, pair, (size[pair[1]], size[pair[0]]), top) for pair in pairs
        ),
    )


def _population(r: Generator, can: Abilities, name: str, size: int, top: int) -> Population:
    def column(choices: Sequence[int]) -> NDArray[np.int64]:
        return r.choice(choices, size) if can.per_compartment else np.full(size, r.choice(choices))

    thresholds = [
        *THRESHOLDS,
        *(int(share * 128 * 2.0**top) for share in 2 * THRESHOLDS_IN_WEIGHTS),
    ]
    return Population(
        name,
        size,
        decay_u=column(DECAYS),
        decay_v=column(DECAYS),
        threshold=column([t for t in thresholds if t <= can.threshold_max]),
        bias=column(BIASES if can.bias else (0,)),
        refractory=column(REFRACTORY if can.refractory else (1,)),
        vmin=int(r.choice(VOLTAGES_MIN)) if can.limits else -VOLTAGE_MAX,
        vmax=int(r.choice(VOLTAGES_MAX)) if can.limits else VOLTAGE_MAX,
    )


def _projection(
    r: Generator, can: Abilities, pair: tuple[str, str], shape: tuple[int, int], top: int
) -> Projection:
    exponent = int(r.integers(max(can.exponents.start, top - 2), top + 1))
    bits, mode = int(r.choice(WEIGHT_BITS)), str(r.choice(SIGN_MODES, p=SIGN_MODE_SHARES))
    weights = _weights(r, can, shape, exponent, bits, mode)
    return Projection(*pair, weights, _delay(r, can, pair, shape), exponent, bits, mode)


def _weights(
    r: Generator, can: Abilities, shape: tuple[int, int], exponent: int, bits: int, mode: Any
) -> NDArray[np.int64]:
    """Draw mantissas on the grid of the format; about a third of them are zeros."""
    grid = weight_grid(bits, mode)
    step = grid.step if can.odd_mantissas else max(grid.step, 2)
    if not can.floors_negative_exponents:
        step = max(step, 1 << max(-exponent, 0))
    # The ends of the grid, rounded towards 0 to multiples of the step.
    low, high = -(-grid.low // step * step), grid.high // step * step
    if exponent not in can.lowest_mantissa:
        low = max(low, step - 256)
    weights = np.clip(r.integers(-256, 257, shape) // step * step, low, high)
    weights[r.random(shape) < 0.3] = 0
    return weights


def _delay(
    r: Generator, can: Abilities, pair: tuple[str, str], shape: tuple[int, int]
) -> NDArray[np.int64]:
    """Draw delays from three values, so that a peer with one delay per group of synapses needs few groups."""
    values = r.integers(0, r.choice([1, 4, 63]), 3)
    if can.delay == "synapse":
        return r.choice(values, shape)
    if can.delay == "axon" and pair[0] != pair[1]:
        return np.broadcast_to(r.choice(values, shape[1]), shape).copy()
    return np.zeros(shape, dtype=np.int64)
