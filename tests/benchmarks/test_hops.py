"""Hops (links of the mesh that spikes cross) that arranging cores saves, recorded for networks of three kinds."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from machine import machine
from relay_networks import board, local_graph
from scipy import sparse
from workloads import example_levels

import hw_model as hw
from hw_model.mapping.arrangement import arrange_cores, core_traffic, slot_distances, total_hops
from hw_model.mapping.graph import CompartmentGraph
from hw_model.mapping.placement import place_cores

pytestmark = pytest.mark.bench


def random_graph(size: int, chip: hw.Chip, *, fan_in: int, seed: int = 0) -> CompartmentGraph:
    """Return a sparse recurrent population: every compartment has synapses from ``fan_in`` others, wherever they are."""
    r = np.random.default_rng(seed)
    builder = hw.ProgramBuilder(chip, name="random sparse")
    x = builder.add_input("x", size)
    n = builder.add_compartments("n", size, decay_u=1024, decay_v=128, threshold=1000)
    builder.connect(x, n, sparse.eye_array(size, dtype=np.int64) * 2)
    targets = np.repeat(np.arange(size), fan_in)
    weights = sparse.coo_array(
        (np.full(size * fan_in, 2), (targets, r.integers(0, size, size * fan_in))), (size, size)
    )
    weights.sum_duplicates()
    weights.data[:] = 2  # a pair that was drawn twice has one synapse
    builder.connect(n, n, weights)
    return builder.graph()


def test_hops_before_and_after_arranging_are_recorded(record):
    chip = board(1)
    # Cores of 16 compartments spread the small example over enough cores to be arranged.
    few = replace(chip, limits=replace(chip.limits, compartments_per_core=16))
    graphs = {
        "objects-hybrid, cores of 16 compartments": (example_levels("objects").compartments, few),
        "random sparse recurrent, 8,000 compartments, 16 synapses each": (
            random_graph(8000, chip, fan_in=16),
            chip,
        ),
        "local layers, 20,000 compartments, 250 synapses each": (local_graph(20_000, chip), chip),
    }
    found = []
    for name, (graph, target) in graphs.items():
        placed = place_cores(graph, target)
        start = time.perf_counter()
        arranged = arrange_cores(placed)
        seconds = time.perf_counter() - start
        traffic, distance = core_traffic(placed), slot_distances(target, target.cores)
        before, after = (total_hops(traffic, distance, p.slots) for p in (placed, arranged))
        found.append(
            {
                "name": name,
                "cores": placed.cores,
                "before": before,
                "after": after,
                "seconds": seconds,
            }
        )
    record("hops", {"networks": found, "machine": machine()})
