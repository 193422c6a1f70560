"""Networks whose activity is known: every layer repeats the spikes of the layer before it, among many other synapses.

A compartment fires when its counterpart in the layer before did, through one strong synapse; the other synapses are
weak, of both signs, and leave something in every voltage. So the share of compartments that fire is that of the input.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import hw_model as hw
from hw_model.mapping.graph import CompartmentGraph
from hw_model.program.builder import Node

RELAY = {"weight": 254, "exponent": 5}
"""The strong synapse, which makes its target spike: the largest even mantissa, times 32."""
THRESHOLD = 127 << 5
"""Half a relayed spike; ten standard deviations of what the weak synapses leave when half of all compartments fire."""
LAYERS = 10
SYNAPSES = 250
"""Synapses onto a compartment of a local network, the relay included."""
REACH = 400
"""Sources that the weak synapses of a local network are drawn from: those nearest to a compartment."""


def board(chips: int) -> hw.Chip:
    """Return a board of several chips."""
    return replace(hw.chip("loihi-sim"), chips=chips)


def local_graph(size: int, chip: hw.Chip, seed: int = 0) -> CompartmentGraph:
    """Return ten layers, ``size`` compartments together, in which each compartment has a few sources near to it."""
    r = np.random.default_rng(seed)
    width = size // LAYERS
    fan_in, near = min(SYNAPSES, width) - 1, min(REACH, width)
    builder = hw.ProgramBuilder(chip, name="layered")
    before = builder.add_input("x", width)
    for layer in range(LAYERS):
        here = _layer(builder, layer, width, before)
        # For each compartment, fan_in different offsets out of `near`, around its own place in the layer before.
        offsets = np.argsort(r.random((width, near)), axis=1)[:, :fan_in]
        sources = (np.arange(width)[:, None] + offsets - near // 2) % width
        targets = np.repeat(np.arange(width), fan_in)
        weak = sparse.coo_array(
            (_weak(r, sources.size), (targets, sources.ravel())), shape=(width, width)
        )
        builder.connect(before, here, weak)
        before = here
    return builder.graph()


def dense_program(width: int, layers: int, seed: int = 0) -> hw.ChipProgram:
    """Return layers that are fully connected."""
    r = np.random.default_rng(seed)
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), name="dense")
    before = builder.add_input("x", width)
    for layer in range(layers):
        here = _layer(builder, layer, width, before)
        builder.connect(before, here, _weak(r, width * width).reshape(width, width))
        before = here
    return builder.build()


def random_input(shape: tuple[int, int, int], rate: float, seed: int = 0) -> NDArray[np.uint8]:
    """Draw recordings (batch, steps, lines) that spike with a probability."""
    return (np.random.default_rng(seed).random(shape, dtype=np.float32) < rate).astype(np.uint8)


def check_relayed(recordings: NDArray[np.uint8], result: hw.SimulationResult) -> None:
    """Raise an ``AssertionError`` unless every layer repeats the input, each a step later than the one before."""
    for delay, spikes in enumerate(result.spikes.values(), start=1):
        assert np.array_equal(spikes[:, delay:], recordings[:, :-delay])


def _layer(builder: hw.ProgramBuilder, layer: int, width: int, before: Node) -> Node:
    """Add a layer whose currents last one step, and its relays: a strong synapse onto each compartment from its counterpart."""
    here = builder.add_compartments(
        f"layer{layer}", width, decay_u=4096, decay_v=128, threshold=THRESHOLD
    )
    relay = sparse.eye_array(width, dtype=np.int64) * RELAY["weight"]
    builder.connect(before, here, relay, exponent=RELAY["exponent"])
    return here


def _weak(r: np.random.Generator, count: int) -> NDArray[np.int64]:
    """Return small even weights of both signs, 2 to 6."""
    return 2 * r.integers(1, 4, count) * r.choice([-1, 1], count)
