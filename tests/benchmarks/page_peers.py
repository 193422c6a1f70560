"""The page of every tool on every workload, and the sentences that sum it up."""

from __future__ import annotations

from page_figures import (
    GOALS,
    LIMIT_GOAL,
    Found,
    limit_seconds,
    made_by,
    own,
    peer,
    percent,
    ratio,
    table,
    times,
)
from workloads import WORKLOADS


def headline(records: dict[str, Found]) -> str:
    """Return the sentence on how much faster the engine is than the peers for which there are goals."""
    workloads = [records[f"side_by_side_{name}"] for name in GOALS]
    return f"A recording plays {_faster(workloads, ['nengo-loihi', 'sanafe', 'lava-dl'])}."


def tools_in_short(records: dict[str, Found]) -> str:
    """Return the sentences on how much faster the engine is than every peer, and how near to the limit."""
    workloads = _workloads(records)
    shares = [limit_seconds(record) / own(record)["seconds"] for record in workloads]
    faster = _faster(workloads, ["lava-dl", "sanafe", "nengo-loihi", "brian2-loihi"])
    return (
        f"A batch plays {faster}. It reaches {percent(min(shares))} to {percent(max(shares))} "
        "of what the machine can do at most."
    )


PEER_NAMES = {
    "lava-dl": "lava-dl",
    "sanafe": "SANA-FE",
    "nengo-loihi": "nengo-loihi's emulator",
    "brian2-loihi": "brian2-loihi",
}


def _faster(workloads: list[Found], tools: list[str]) -> str:
    """Return how many times faster the workloads play than in some tools; tools that were not installed are left out."""
    parts = []
    for tool in tools:
        rows = [(peer(record, tool), own(record)["seconds"]) for record in workloads]
        ratios = [found["seconds"] / ours for found, ours in rows if found]
        if ratios:
            least, most = ratio(min(ratios)), ratio(max(ratios))
            parts.append(f"{least} to {most} times faster than in {PEER_NAMES[tool]}")
    if len(parts) < 2:
        return "".join(parts) or "in the time that the tables give"
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def _workloads(records: dict[str, Found]) -> list[Found]:
    """Return the records of the workloads that were played."""
    names = [f"side_by_side_{name}" for name in WORKLOADS]
    return [records[name] for name in names if name in records]


def summary(records: dict[str, Found]) -> str:
    """Return the table of ratios for which there are goals."""
    rows = []
    for name, goals in GOALS.items():
        record = records[f"side_by_side_{name}"]
        ours = own(record)["seconds"]
        cells = [name]
        for tool, goal in goals.items():
            row_of_peer = peer(record, tool)
            cells.append(
                f"{ratio(row_of_peer['seconds'] / ours)} ({goal:,.0f})"
                if row_of_peer
                else "not installed"
            )
        share = limit_seconds(record) / ours
        cells.append(f"{percent(share)} ({percent(LIMIT_GOAL)})")
        cells.append(percent(record["limits"]["rows_and_state"] / ours))
        rows.append(cells)
    head = ["network", "nengo-loihi emulator", "SANA-FE, detailed timing", "lava-dl, batch of 32"]
    return table([*head, "of the limit, rows", "of the limit, rows and state"], rows)


def side_by_side(record: Found) -> str:
    """Return the table of one workload, and how near to the limit the engine comes."""
    ours = own(record)["seconds"]
    rows = []
    for row in record["rows"]:
        low, high = row["quartiles"]
        rows.append(
            [
                " ".join(part for part in (row["tool"], row["version"]) if part),
                row["mode"],
                times(row["seconds"]),
                f"{times(low)} to {times(high)}",
                "-"
                if "example itself" in row["mode"]
                else ratio(record["synaptic_ops"] / row["seconds"] / 1e6),
                ratio(row["seconds"] / ours),
                "-" if row["peak_mib"] is None else f"{row['peak_mib']:,.0f}",
                "-" if row["spikes_differ"] is None else str(row["spikes_differ"]),
            ]
        )
    limits = record["limits"]
    best = limit_seconds(record)
    head = [
        "tool",
        "mode",
        "µs per recording",
        "middle half",
        "million operations per second",
        "ratio",
        "peak MiB",
    ]
    return f"""## {record["name"]}: {record["text"]}

A recording has {record["synaptic_ops"]:,.0f} synaptic operations, {record["neuron_updates"]:,.0f} compartment updates and {record["spikes"]:,.0f} spikes.

{table([*head, "other spikes"], rows, left=2)}

The limit: adding the same rows takes {times(best)} µs ({record["synaptic_ops"] / best / 1e9:.1f} billion operations per second; one row at a
time {times(limits["plain"])} µs), and with the state read and written {times(limits["rows_and_state"])} µs. hw_model reaches {percent(best / ours)} and {percent(limits["rows_and_state"] / ours)} of these.
"""


def tools(records: dict[str, Found]) -> str:
    """Return the tables of all workloads, with the text on how they were measured."""
    workloads = _workloads(records)
    turns = ", ".join(f"{own(record)['turns']} ({record['name']})" for record in workloads)
    return f"""{made_by("test_side_by_side.py")} Every tool plays the same networks and input spikes in one run. Each waits in a process of its
own, with its networks loaded and built, and all take turns, so that other work on the machine disturbs all alike. Medians of {turns} turns; a turn of
hw_model is a batch, one of lava-dl a batch of 32, one of the others a recording. *Ratio* is to hw_model's batch, which
uses all cores, as lava-dl does. nengo-loihi, brian2-loihi and SANA-FE use one core; *two processes* is what two cores give
when two of them play at the same time. SANA-FE's own threads made it slower in every trial. *Other spikes* are those of
the first recording, over all layers, that differ from the plain numpy loop.

*small* and *large* are feed-forward CUBA-LIF networks of random even 8-bit weights with Bernoulli input, decays 1024 and
128. *objects* and *containers* stand for the example hybrids. The hybrids themselves need *joined* compartments, which add their
voltage to another one's in the same step, and no simulator here has these. So each neuron is one compartment with an alpha
kernel and the chip's reset, and the two branches are two networks. Layers, decays, steps, recordings and (rounded) weights are
the example's; the spikes are not. The example itself is a row of its own, which only hw_model plays.

The tools do different things in that time. hw_model returns all spikes and counts operations, wraps, clips and packets; SANA-FE
models energy and time of every message, in mode *detailed* with the network's traffic; lava-dl keeps float tensors ready to
train; nengo-loihi and brian2-loihi only simulate. SANA-FE's LIF soma has a current that decays as the chip's does, but
does not truncate it; its potentials are truncated as v is. Where currents leave nothing to truncate its spikes equal ours
(`tests/peers/test_sanafe.py`). lava-nc, which needs Python 3.10, is left out.

The *limit* is a kernel of the same memory traffic: every delivered spike adds its row of weights, 16 bits each, to a row of
charges, 32 bits each, in the engine's order and on all cores, with the spikes known beforehand (`tests/benchmarks/limits.py`).

{chr(10).join(side_by_side(record) for record in workloads)}
"""
