"""The page of cost against size and activity."""

from __future__ import annotations

import numpy as np
from machine import cache_kib
from page_figures import Found, line, made_by, percent, table


def sizes(records: dict[str, Found]) -> str:
    """Return cost against size."""
    rows = []
    for measured in records["sizes"]["sizes"]:
        layer = measured["layer_synapse_mib"]
        rows.append(
            [
                f"{measured['compartments']:,}", f"{measured['synapses']:,}", f"{layer:,.2f}", held_by(layer),
                f"{measured['seconds'] * 1e3:,.2f}", f"{measured['synaptic_ops'] / 1e6:,.2f}",
                f"{measured['seconds'] / measured['synaptic_ops'] * 1e9:.2f}", f"{measured['seconds'] / measured['neuron_updates'] * 1e9:.1f}",
                f"{measured['first call']:.2f}", f"{measured['peak_mib']:,.0f}",
            ]
        )  # fmt: skip
    head = [
        "compartments",
        "synapses",
        "a layer's MiB",
        "in",
        "ms per recording",
        "million operations",
    ]
    return table(
        [*head, "ns an operation", "ns an update", "first call s", "peak MiB"], rows, left=0
    )


def held_by(mib: float) -> str:
    """Return the name of the nearest cache that holds so many MiB."""
    return next((name for name, kib in cache_kib().items() if mib * 1024 <= kib), "memory")


def activity(record: Found) -> str:
    """Return the table of cost against activity, next to a straight line through all points."""
    start, slope = _line_through(record)
    rows = []
    for measured in record["rates"]:
        fitted = start + slope * measured["synaptic_ops"]
        rows.append(
            [
                percent(measured['rate'], 1), f"{measured['synaptic_ops'] / 1e6:,.2f}", f"{measured['seconds'] * 1e3:.2f}",
                f"{fitted * 1e3:.2f}", f"{measured['synaptic_ops'] / measured['seconds'] / 1e9:.2f}",
            ]
        )  # fmt: skip
    head = [
        "compartments that fire",
        "million operations",
        "ms per recording",
        "line",
        "billion operations per second",
    ]
    updates = record["rates"][0]["neuron_updates"]
    return f"""{table(head, rows, left=0)}

The line: {start * 1e3:.2f} ms for {updates:,.0f} compartment updates ({start / updates * 1e9:.2f} ns each), and {slope * 1e9:.3f} ns for each operation.
"""


def tables(record: Found) -> str:
    """Return the speed of adding rows out of tables of growing size."""
    rows = [
        [f"{kib:,}", f"{speed / 1e9:.1f}"]
        for kib, speed in zip(record["kib"], record["synaptic_ops_per_second"], strict=True)
    ]
    return table(["KiB of weights per core", "billion operations per second"], rows, left=0)


def growth_in_short(records: dict[str, Found]) -> str:
    """Say what an operation costs as networks grow and fire more."""
    sizes = records["sizes"]["sizes"]
    costs = [m["seconds"] / m["synaptic_ops"] * 1e9 for m in sizes]
    _, dense = _line_through(records["activity_dense"])
    _, local = _line_through(records["activity_local"])
    return (
        f"From {sizes[0]['compartments']:,} to {sizes[-1]['compartments']:,} compartments, a "
        f"synaptic operation takes {min(costs):.2f} to {max(costs):.2f} ns. Time grows with "
        f"spikes along a straight line: {dense * 1e9:.3f} ns for each operation more where layers are "
        f"fully connected, {local * 1e9:.3f} ns where they are sparse."
    )


def _line_through(record: Found) -> tuple[float, float]:
    """Return the seconds without an operation and those of each operation, by the line through all rates."""
    ops = np.array([m["synaptic_ops"] for m in record["rates"]])
    seconds = np.array([m["seconds"] for m in record["rates"]])
    return line(ops, seconds)


def growth(records: dict[str, Found]) -> str:
    """Return cost against size and against activity."""
    return f"""## Cost against size

{made_by("test_curves.py")} Ten layers in a row; a compartment has 250 synapses from the 400 sources nearest to it, or 100 where
a layer has only 100 compartments. In each of 100 steps, 2 % of all compartments fire.

{sizes(records)}

{KNEES}

Rows of 256 weights in random order, out of tables of growing size, one table per core:

{tables(records["tables"])}

## Cost against activity

{made_by("test_curves.py")} Every layer repeats the spikes of the input, so the activity is known beforehand. 100 steps. *Line* is a straight line
through all rows, fitted to their relative errors.

Fully connected, 4 layers of 1,024:

{activity(records["activity_dense"])}
Local, 10 layers of 1,000, 250 synapses each:

{activity(records["activity_local"])}
"""


KNEES = """*A layer's MiB* is the size of its synapses in the engine, and *in* is the nearest cache that holds them. The engine
plays 64 steps of one layer (a *tile*), then the same steps of the next layer, so the synapses of one layer are what has
to stay in a cache. Cost is linear in events, with three knees. In small networks, the updates, which do not depend on
events, are the larger part of a step. Layers with at least a quarter of all possible synapses are matrices of 2 bytes per
synapse, added in vectors. All others are lists, followed synapse by synapse, with 4 bytes for each synapse if its target,
delay and weight fit them, else 12: this is the jump after 3,000 compartments. As a layer outgrows a cache, each spike
fetches its synapses from farther away; the table below shows the same for rows of weights alone."""
