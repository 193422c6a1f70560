"""Build, place, route and play a network of a size, and print seconds and memory as JSON: ``grow.py COMPARTMENTS``.

It runs in a process of its own, so that the peak of memory belongs to this size.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from limits import median_seconds
from peak_memory import peak_mib
from relay_networks import LAYERS, board, check_relayed, local_graph, random_input

import hw_model as hw
from hw_model.engine.lay_out import fast_layout
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble

T = TypeVar("T")

CHIPS = 8
ARRANGED_UP_TO = 100_000
"""Larger networks, in compartments, keep their cores in network order: arranging takes a minute there, and changes no result."""
STEPS = 100
ACTIVITY = 0.02


def placed_program(
    size: int, chip: hw.Chip, timed: Callable[[str, Callable[[], Any]], Any]
) -> hw.ChipProgram:
    """Build, place, arrange and route the network of a size.

    Graph and placement are local, so their memory is free again when the program plays.
    """
    graph = timed("build", lambda: local_graph(size, chip))
    placed = timed("place", lambda: place_cores(graph, chip))
    if size <= ARRANGED_UP_TO:
        placed = timed("arrange", partial(arrange_cores, placed))
    program: hw.ChipProgram = timed("route", lambda: assemble(route_axons(placed)))
    return program


def measure(size: int) -> dict[str, float]:
    """Return seconds of every part, sizes, counts of a recording, and peak memory."""
    chip = board(CHIPS)
    seconds: dict[str, float] = {}

    def timed(part: str, run: Callable[[], T]) -> T:
        start = time.perf_counter()
        result = run()
        seconds[part] = time.perf_counter() - start
        return result

    program = placed_program(size, chip, timed)
    placing_mib = peak_mib()
    # Enough recordings for small networks to be measured.
    batch = 2 * max(1, min(32, 100_000 // size))
    recordings = random_input((batch, STEPS, size // LAYERS), ACTIVITY)
    result = timed("first call", lambda: hw.simulate(program, recordings))
    check_relayed(recordings, result)
    playing = median_seconds(
        lambda: hw.simulate(program, recordings), 3 if size > ARRANGED_UP_TO else 5
    )
    return {
        "compartments": size,
        "synapses": sum(len(core.axons.target) for core in program.cores),
        "cores": len(program.cores),
        **seconds,
        "placing_mib": placing_mib,
        "layer_synapse_mib": synapse_bytes(program) / LAYERS / 2**20,
        "batch": batch,
        "seconds": playing / batch,
        "synaptic_ops": result.counts.synaptic_ops / batch,
        "neuron_updates": result.counts.neuron_updates / batch,
        "peak_mib": peak_mib(),
    }


def synapse_bytes(program: hw.ChipProgram) -> int:
    """Return how large the engine's synapses are: matrices, and lists where these are smaller."""
    links = fast_layout(program, program.phases[0].name).tables.links
    return sum(array.nbytes for array in links)


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]))))
