"""Seconds against size, against activity, and against the working set, recorded for the curves of the speed study.

The tests assert only that every spike is relayed from layer to layer; readers of the page judge the curves.
"""

from __future__ import annotations

import child
import pytest
from limits import median_seconds, working_sets
from machine import machine
from relay_networks import LAYERS, board, check_relayed, dense_program, local_graph, random_input

import hw_model as hw
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble

pytestmark = pytest.mark.bench

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000, 200_000)
RATES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5)
TABLES_KIB = tuple(4**k for k in range(2, 10))
"""From 16 KiB, within the nearest cache, to 256 MiB, beyond all of them."""
DENSE = {"width": 1024, "layers": 4}
LOCAL_SIZE = 10_000
STEPS = 100
BATCH = 4


def test_seconds_and_memory_are_recorded_against_size(record, quick):
    found = [child.run("grow.py", size) for size in (SIZES[:3] if quick else SIZES)]
    record("sizes", {"sizes": found, "machine": machine()})


@pytest.mark.parametrize("kind", ["dense", "local"])
def test_every_spike_is_relayed_at_every_activity(kind, record, quick):
    if kind == "dense":
        program, lines = dense_program(**DENSE), DENSE["width"]
    else:
        chip = board(1)
        program = assemble(route_axons(place_cores(local_graph(LOCAL_SIZE, chip), chip)))
        lines = LOCAL_SIZE // LAYERS
    found = []
    for rate in RATES[::3] if quick else RATES:
        recordings = random_input((BATCH, STEPS, lines), rate)
        result = hw.simulate(program, recordings)
        check_relayed(recordings, result)
        seconds = median_seconds(
            lambda recordings=recordings: hw.simulate(program, recordings), 2 if quick else 7
        )
        found.append(
            {
                "rate": rate,
                "seconds": seconds / BATCH,
                "synaptic_ops": result.counts.synaptic_ops / BATCH,
                "neuron_updates": result.counts.neuron_updates / BATCH,
            }
        )
    record(f"activity_{kind}", {"kind": kind, "rates": found, "machine": machine()})


def test_speed_of_adding_rows_is_recorded_against_the_size_of_their_table(record, quick):
    tables = working_sets(TABLES_KIB[::3] if quick else TABLES_KIB)
    record(
        "tables",
        {
            "kib": list(tables),
            "synaptic_ops_per_second": list(tables.values()),
            "machine": machine(),
        },
    )
