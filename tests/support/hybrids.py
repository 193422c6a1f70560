"""Hybrid programs: a time phase, and a location phase that reads the recording channel by channel.

``ProgramBuilder`` makes graphs of one phase over time. The functions here move such graphs into phases and join them,
and draw random ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import sparse

import hw_model as hw
from hw_model.arithmetic.fixed_point import weight_grid
from hw_model.mapping.graph import Axis, CompartmentGraph, Phase, Readout
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble
from hw_model.program.chip_program import ChipProgram

CHIP = hw.chip("loihi-sim")
SMALL = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=7))
"""Cores of seven compartments: the same programs spread over several cores."""


def graphs_side_by_side(*graphs: CompartmentGraph) -> CompartmentGraph:
    """Return one graph with the phases, inputs, groups and synapses of several graphs."""
    return replace(
        graphs[0],
        phases=tuple(phase for graph in graphs for phase in graph.phases),
        inputs=tuple(item for graph in graphs for item in graph.inputs),
        groups=tuple(group for graph in graphs for group in graph.groups),
        synapses=tuple(synapses for graph in graphs for synapses in graph.synapses),
    )


def program_of_graphs(
    chip: hw.Chip, readout: Readout | None, *graphs: CompartmentGraph
) -> ChipProgram:
    """Return one program of several graphs, a phase each.

    Cores stay in the order of the groups: to optimise their places would take most of the time.
    """
    graph = replace(graphs_side_by_side(*graphs), readout=readout)
    return assemble(route_axons(place_cores(graph, chip)))


def moved(graph: CompartmentGraph, phase: Phase, *feeds: Mapping[str, Any]) -> CompartmentGraph:
    """Move a graph of a builder into a phase.

    ``feeds[i]`` has the fields ``stream``, ``positions`` and ``first_lines`` of input i, see
    :class:`hw_model.mapping.graph.Input`. The stream is "touch" unless it is given.
    """
    feed_of_input = [*feeds, *[{}] * (len(graph.inputs) - len(feeds))]
    inputs = []
    for graph_input, feed in zip(graph.inputs, feed_of_input, strict=True):
        fields = {"phase": phase.name, "stream": "touch", **feed}
        inputs.append(replace(graph_input, **fields))
    groups = [replace(group, phase=phase.name) for group in graph.groups]
    return replace(graph, phases=(phase,), inputs=tuple(inputs), groups=tuple(groups))


def graph_in_phase(
    graph: CompartmentGraph, axis: Axis, steps: int | None, positions=None, first_lines=None
) -> CompartmentGraph:
    """Move a graph of a builder into a phase of its own; with ``positions`` its inputs are transposed."""
    visits = {"positions": positions, "first_lines": first_lines}
    return moved(graph, Phase(axis, axis, steps), *[visits] * len(graph.inputs))


def random_branch(
    r: np.random.Generator, axis: Axis, lines: int, classes: int, chip: hw.Chip
) -> CompartmentGraph:
    """Draw a graph of two populations with joined dendrites, recurrence, delays, biases, refractory periods and formats.

    Population ``y`` has a compartment per class. Constants are extremes (a decay that keeps all or nothing, a threshold
    of 0) and values in between. A fifth of the graphs is ``big``: with decays, exponents and a vmin with which registers
    wrap and clip.
    """
    big = bool(r.random() < 0.2)
    vmin = [None, 0, 1 - 2**15][r.integers(3)] if big else None
    builder = hw.ProgramBuilder(chip)
    sizes = {f"{axis}/h": int(r.integers(1, 20)), f"{axis}/y": classes}
    nodes = {"x": builder.add_input(f"{axis}/x", lines)}

    def add(name: str, size: int, parent: str | None = None) -> None:
        nodes[name] = builder.add_compartments(
            name,
            size,
            decay_u=r.choice([0, 390, 1024, 4096] if big else [390, 1024, 4096], size),
            decay_v=r.choice([0, 128, 2589, 4096] if big else [128, 390, 4096], size),
            threshold=r.choice([0, 1, 300, 3000, 20000], size),
            bias=r.choice([0, 0, -7, 640, -2000], size) * int(r.random() < 0.5),
            refractory=r.choice([1, 1, 2, 5, 20], size),
            joined_to=None if parent is None else nodes[parent],
            vmin=vmin,
        )

    for name, size in sizes.items():
        add(name, size)
        for k in range(int(r.integers(3))):
            add(f"{name}/dendrite{k}", size, name)
    senders = ["x", *sizes]
    pairs = [("x", f"{axis}/h"), (f"{axis}/h", f"{axis}/y")]
    targets = [name for name in nodes if name != "x"]
    pairs += [
        (str(r.choice(senders)), str(r.choice(targets))) for _ in range(int(r.integers(1, 6)))
    ]
    for source, target in pairs:
        bits = int(r.choice([1, 4, 6, 8]))
        shape = (nodes[target].size, nodes[source].size)
        weights = weight_grid(bits, "mixed").round(r.uniform(-150, 250, shape))
        weights[r.random(shape) < r.choice([0.0, 0.9])] = 0
        if r.random() < 0.5:
            delay = r.integers(0, r.choice([1, 3, 63]), shape)
        else:
            delay = int(r.integers(0, 4))
        if r.random() < 0.5:
            weights = sparse.csr_array(weights)  # the builder takes dense and sparse weights
        exponent = int(r.integers(0, 8)) if big else int(r.integers(-2, 2))
        builder.connect(
            nodes[source], nodes[target], weights, exponent=exponent, delay=delay, weight_bits=bits
        )
    return builder.graph()


def random_hybrid(
    seed: int, channels_per_step: int = 1, silence: int = 0
) -> tuple[ChipProgram, np.ndarray]:
    """Return a random hybrid program and a recording (steps, channels) for it.

    Its location phase visits ``channels_per_step`` channels per step, or all if there are fewer, and ends with
    ``silence`` steps without events.
    """
    r = np.random.default_rng(seed)
    steps = int(r.integers(1, 30))
    channels = int(r.integers(1, 9))
    classes = int(r.integers(1, 5))
    channels_per_step = min(channels_per_step, channels)
    chip = CHIP if r.random() < 0.5 else SMALL
    weights = [(1.0, 1.0), (0.5, -2.0)][int(r.random() < 0.3)]
    program = program_of_graphs(
        chip,
        Readout(("time/y", "location/y"), weights),
        graph_in_phase(random_branch(r, "time", channels, classes, chip), "time", steps),
        _location_phase(
            random_branch(r, "location", channels_per_step * steps, classes, chip),
            r.permutation(channels),
            channels_per_step,
            silence,
        ),
    )
    return program, (r.random((steps, channels)) < r.choice([0.05, 0.3, 1.0])).astype(np.uint8)


def _location_phase(
    branch: CompartmentGraph, order: np.ndarray, channels_per_step: int, silence: int
) -> CompartmentGraph:
    """Move a branch into a location phase that visits channel c as number ``order[c]``, then is silent for some steps.

    Channels that are visited in the same step get separate lines, one per row of the recording for each.
    """
    first_lines = None
    if channels_per_step > 1:
        rows = branch.inputs[0].size // channels_per_step
        first_lines = order % channels_per_step * rows
    steps_of_visits = -(-len(order) // channels_per_step)
    return graph_in_phase(
        branch,
        "location",
        steps=steps_of_visits + silence,
        positions=order // channels_per_step,
        first_lines=first_lines,
    )
