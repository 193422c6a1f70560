"""The branches of a hybrid as programs of their own, and what is known of a recording after each step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import hw_model as hw
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.graph import CompartmentGraph
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble


def branch_program(graph: CompartmentGraph, axis: str) -> hw.ChipProgram:
    """Return one branch of a hybrid, ``time`` or ``location``, as a program of its own."""
    groups = tuple(group for group in graph.groups if group.phase == axis)
    names = {group.name for group in groups}
    assert graph.readout is not None
    outputs = [
        (population, weight)
        for population, weight in zip(graph.readout.populations, graph.readout.weights, strict=True)
        if population in names
    ]
    branch = replace(
        graph,
        phases=tuple(phase for phase in graph.phases if phase.name == axis),
        inputs=tuple(item for item in graph.inputs if item.phase == axis),
        groups=groups,
        synapses=tuple(synapses for synapses in graph.synapses if synapses.target in names),
        readout=replace(
            graph.readout,
            populations=tuple(population for population, _ in outputs),
            weights=tuple(weight for _, weight in outputs),
        ),
    )
    chip = hw.chip("loihi-sim")
    return assemble(route_axons(arrange_cores(place_cores(branch, chip))))


def known_after_each_step(recording: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return what was known after each step, (steps, steps, channels): rows that have not come yet are silent."""
    steps = len(recording)
    return recording * np.tri(steps, dtype=np.uint8)[:, :, None]
