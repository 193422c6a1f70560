"""Random programs of one phase with all parameters of compartments and synapses, from a seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import hw_model as hw
from hw_model.arithmetic.fixed_point import weight_grid
from tests.support.hybrids import CHIP

SMALL = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=5))
"""A chip with five compartments per core, on which the same programs take many cores."""


def random_program(seed: int, chip: hw.Chip = CHIP):
    """Draw a program of two populations and a joined dendrite with recurrence, delays and all weight formats.

    In half of the programs biases and weights are so large that registers wrap and clip.

    Returns:
        The program, its graph, its connections (source, target, weights, delay and exponent of each call of ``connect``),
        and a recording (steps, channels).
    """
    r = np.random.default_rng(seed)
    big = bool(r.integers(2))
    builder = hw.ProgramBuilder(chip)
    nodes = {"x": builder.add_input("x", 4)}
    links = []
    limits = {
        "vmin": int(r.choice([1 - 2**23, 1 - 2**15, 0])),
        "vmax": int(r.choice([2**23 - 1, 2**19 - 1])),
    }
    sizes = {"h": 6, "h/dendrite": 6, "y": 3}
    for name, size in sizes.items():
        parameters = {
            "decay_u": r.choice([0, 1, 390, 1024, 4095, 4096], size),
            "decay_v": r.choice([0, 1, 128, 2589, 4095, 4096], size),
            "threshold": r.choice([0, 1, 300, 5000, 131071 if big else 800], size),
            "bias": r.choice([0, 0, -7, 4095, 8190 * 64 if big else 3], size),
            "refractory": r.choice([1, 1, 2, 5, 63], size),
        }
        parent = "h" if name == "h/dendrite" else None
        nodes[name] = builder.add_compartments(
            name, size, **parameters, **limits, joined_to=nodes[parent] if parent else None
        )
    for source, target in (
        ("x", "h"),
        ("x", "h/dendrite"),
        ("h", "y"),
        ("h", "h"),
        ("y", "h/dendrite"),
        ("x", "y"),
        ("h", "y"),
    ):
        bits = int(r.choice([1, 2, 3, 4, 5, 6, 8]))
        mode = str(r.choice(["mixed", "excitatory", "inhibitory"]))
        grid = weight_grid(bits, mode)
        shape = (nodes[target].size, nodes[source].size)
        weights = grid.round(r.uniform(-300, 300, shape))
        weights[r.random(shape) < 0.3] = 0
        exponent = int(r.integers(-8, 8)) if big else int(r.integers(-3, 2))
        delay = r.integers(0, r.choice([1, 3, 63]), shape)
        builder.connect(
            nodes[source],
            nodes[target],
            weights,
            exponent=exponent,
            delay=delay,
            weight_bits=bits,
            sign_mode=mode,
        )
        links.append(
            {
                "source": source,
                "target": target,
                "weights": weights,
                "delay": delay,
                "exponent": exponent,
            }
        )
    steps = 40
    spikes = (r.random((steps, 4)) < r.choice([0.05, 0.3, 1.0])).astype(np.uint8)
    return builder.build(), builder.graph(), links, spikes
