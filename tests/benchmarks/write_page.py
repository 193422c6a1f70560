"""Write what the benchmarks measured as pages and a picture: ``write_page.py RESULTS PAGE PICTURE``.

``PAGE`` has the headline; the pages with all rows lie in a folder next to it that has its name.
"""

from __future__ import annotations

import argparse
import json
import os
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from machine import cache_kib
from page_section import section_of
from workloads import WORKLOADS

Found = dict[str, Any]

GOALS: dict[str, dict[str, float]] = {
    "small": {"nengo-loihi": 1000, "sanafe": 200, "lava-dl": 40},
    "large": {"nengo-loihi": 100, "sanafe": 300, "lava-dl": 8},
}
"""How many times faster than a peer's first mode the engine is to be."""
LIMIT_GOAL = 0.5
PLACING = ("build", "place", "arrange", "route")
COMMAND_SPEED = "command-speed"
KEPT = (COMMAND_SPEED, "against", "density", "scale")
"""The sections that the scripts of these names write into the pages; they stay."""
UNBROKEN = {"break_long_words": False, "break_on_hyphens": False}


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table whose columns but the first few are numbers."""
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, rule, *rows])


def read(results: Path) -> dict[str, Found]:
    """Return all records by name; they must be of one machine."""
    records = {path.stem: json.loads(path.read_text()) for path in sorted(results.glob("*.json"))}
    records.pop("pytest-benchmark", None)
    machines = [record.pop("machine") for record in records.values()]
    if any(machine != machines[0] for machine in machines):
        raise SystemExit(f"{results}: not all of one machine and version. Remove the folder and run `make bench`.")
    return {**records, "machine": machines[0]}


def made_by(what: str) -> str:
    """Return the sentence that says how a section's figures are made alone."""
    return f"Made by `pytest tests/benchmarks/{what} -m bench`."


def times(seconds: float) -> str:
    """Return microseconds with about three digits."""
    microseconds = seconds * 1e6
    return f"{microseconds:,.1f}" if microseconds < 1000 else f"{microseconds:,.0f}"


def percent(share: float, digits: int = 0) -> str:
    """Return a share as it is printed everywhere."""
    return f"{share * 100:.{digits}f} %"


def ratio(value: float) -> str:
    """Return a ratio with about two digits."""
    return f"{value:,.1f}" if value < 20 else f"{value:,.0f}"


def own(record: Found) -> Found:
    """Return our engine's row: a batch."""
    row: Found = record["rows"][0]
    return row


def peer(record: Found, tool: str) -> Found | None:
    """Return the row of a peer's first mode, if it was there."""
    return next((row for row in record["rows"] if row["tool"] == tool), None)


def limit_seconds(record: Found) -> float:
    """Return what adding rows takes, by the faster of the two kernels."""
    return float(min(record["limits"]["plain"], record["limits"]["rows"]))


def summary(records: dict[str, Found]) -> str:
    """Return the ratios that there is a goal for."""
    rows = []
    for name, goals in GOALS.items():
        record = records[f"side_by_side_{name}"]
        ours = own(record)["seconds"]
        cells = [name]
        for tool, goal in goals.items():
            found = peer(record, tool)
            cells.append(f"{ratio(found['seconds'] / ours)} ({goal:,.0f})" if found else "not installed")
        share = limit_seconds(record) / ours
        cells.append(f"{percent(share)} ({percent(LIMIT_GOAL)})")
        cells.append(percent(record["limits"]["rows_and_state"] / ours))
        rows.append(cells)
    head = ["network", "nengo-loihi emulator", "SANA-FE, detailed timing", "lava-dl, batch of 32"]
    return table([*head, "of the limit, rows", "of the limit, rows and state"], rows)


def side_by_side(record: Found) -> str:
    """Return the table of one workload, and where the limit is."""
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
                "-" if "example itself" in row["mode"] else ratio(record["synaptic_ops"] / row["seconds"] / 1e6),
                ratio(row["seconds"] / ours),
                "-" if row["peak_mib"] is None else f"{row['peak_mib']:,.0f}",
                "-" if row["spikes_differ"] is None else str(row["spikes_differ"]),
            ]
        )
    limits = record["limits"]
    best = limit_seconds(record)
    head = ["tool", "mode", "µs per recording", "middle half", "million operations a second", "ratio", "peak MiB"]
    return f"""## {record["name"]}: {record["text"]}

A recording has {record["synaptic_ops"]:,.0f} synaptic operations, {record["neuron_updates"]:,.0f} compartment updates and {record["spikes"]:,.0f} spikes.

{table([*head, "other spikes"], rows, left=2)}

The limit: adding the same rows takes {times(best)} µs ({record["synaptic_ops"] / best / 1e9:.1f} billion operations a second; one row at a
time {times(limits["plain"])} µs), and with the state read and written {times(limits["rows_and_state"])} µs. hw_model reaches {percent(best / ours)} and {percent(limits["rows_and_state"] / ours)} of these.
"""


def sizes(records: dict[str, Found]) -> str:
    """Return cost against size."""
    rows = []
    for m in records["sizes"]["sizes"]:
        layer = m["layer_synapse_mib"]
        rows.append(
            [
                f"{m['compartments']:,}", f"{m['synapses']:,}", f"{layer:,.2f}", held_by(layer),
                f"{m['seconds'] * 1e3:,.2f}", f"{m['synaptic_ops'] / 1e6:,.2f}",
                f"{m['seconds'] / m['synaptic_ops'] * 1e9:.2f}", f"{m['seconds'] / m['neuron_updates'] * 1e9:.1f}",
                f"{m['first call']:.2f}", f"{m['peak_mib']:,.0f}",
            ]
        )  # fmt: skip
    head = ["compartments", "synapses", "a layer's MiB", "in", "ms per recording", "million operations"]
    return table([*head, "ns an operation", "ns an update", "first call s", "peak MiB"], rows, left=0)


def held_by(mib: float) -> str:
    """Return the nearest cache that holds so much."""
    return next((name for name, kib in cache_kib().items() if mib * 1024 <= kib), "memory")


def activity(record: Found) -> str:
    """Return cost against activity, beside a straight line through all points (least squares of relative errors)."""
    ops = np.array([m["synaptic_ops"] for m in record["rates"]])
    seconds = np.array([m["seconds"] for m in record["rates"]])
    start, slope = line(ops, seconds)
    rows = []
    for m, fitted in zip(record["rates"], start + slope * ops, strict=True):
        rows.append(
            [
                percent(m['rate'], 1), f"{m['synaptic_ops'] / 1e6:,.2f}", f"{m['seconds'] * 1e3:.2f}",
                f"{fitted * 1e3:.2f}", f"{m['synaptic_ops'] / m['seconds'] / 1e9:.2f}",
            ]
        )  # fmt: skip
    head = ["compartments that fire", "million operations", "ms per recording", "line", "billion operations a second"]
    updates = record["rates"][0]["neuron_updates"]
    return f"""{table(head, rows, left=0)}

The line: {start * 1e3:.2f} ms for {updates:,.0f} compartment updates ({start / updates * 1e9:.2f} ns each), and {slope * 1e9:.3f} ns for each operation.
"""


def line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return start and slope of the line with the least squares of relative errors; the start is at least 0."""
    scaled = np.stack([1 / y, x / y], axis=1)
    (start, slope), *_ = np.linalg.lstsq(scaled, np.ones(len(y)), rcond=None)
    if start < 0:
        return 0.0, float((x / y).sum() / ((x / y) ** 2).sum())
    return float(start), float(slope)


def tables(record: Found) -> str:
    """Return the speed of adding rows out of tables of growing size."""
    rows = [
        [f"{kib:,}", f"{speed / 1e9:.1f}"]
        for kib, speed in zip(record["kib"], record["synaptic_ops_per_second"], strict=True)
    ]
    return table(["KiB of weights a core", "billion operations a second"], rows, left=0)


def test_set(records: dict[str, Found]) -> str:
    """Return the whole test set: time, memory, start-up."""
    found, start = records["test_set"], records["start_up"]
    rows = [
        [f"{m['recordings']:,}", f"{m['seconds']:.3f}", times(m["seconds"] / m["recordings"]), f"{m['peak_mib']:,.0f}"]
        for m in records["stream"]["streams"]
    ]
    return f"""The compiled `objects-hybrid` plays all {found["recordings"]} test recordings of Ev-Objects in {
        found["seconds"] * 1e3:.1f} ms (goal: below 100 ms), in one
call and after start-up: {times(found["seconds"] / found["recordings"])} µs per recording, {
        found["synaptic_ops"] / found["seconds"] / 1e9:.2f} billion synaptic operations and {
        found["neuron_updates"] / found["seconds"] / 1e9:.2f} billion compartment updates a second.

Played again and again as a stream of batches of {found["recordings"]}, in a process of its own:

{table(["recordings", "seconds", "µs per recording", "peak MiB"], rows, left=0)}

Start-up, with the program read from its folder. *Cold* is the first run on a machine, which compiles the engine:

{
        table(
            ["cache of compiled code", "reading s", "first call s", "second call s", "whole process s"],
            [
                [state, *(f"{start[state][part]:.2f}" for part in ("load", "first_call", "second_call", "all"))]
                for state in ("cold", "warm")
            ],
        )
    }
"""


def silence(record: Found) -> str:
    """Return what skipping saves on recordings that begin in silence."""
    rows = [
        [
            f"{name} phase", f"{phase['steps']:,}", f"{phase['skipped_steps']:.1f}",
            percent(phase['skipped_steps'] / phase['steps'], 1),
            percent(phase['neuron_updates_skipped'] / phase['neuron_updates'], 1), percent(phase['at_rest'], 1),
        ]
        for name, phase in record["phases"].items()
    ]  # fmt: skip
    saved = 1 - record["seconds"] / record["seconds_without"]
    return f"""The recordings of Ev-Containers begin with {record["silent_rows"]:.0f} silent rows on average, two seconds. The compiled
`containers-hybrid` takes {times(record["seconds"])} µs per recording, and {times(record["seconds_without"])} µs if told to update everything
(`hw.simulate(..., skip=False)`, the same spikes): skipping saves {percent(saved)} of the time.

{table(["", "steps", "steps skipped", "share", "updates in them", "updates at rest"], rows)}

A silent step has no synaptic operations to skip: what is skipped is compartment updates. *At rest* counts compartments
without charge, current or voltage in any step, whether the engine could leave them out or not.
"""


def streaming(record: Found) -> str:
    """Return predictions after every step, a session beside starting the location branch anew."""
    anew, pushed = (("anew_at_once", "anew_step_by_step"), ("pushed_at_once", "pushed_row_by_row"))
    rows = [
        [label, f"{record[new] * 1e3:.2f}", f"{record[old] * 1e3:.2f}", ratio(record[old] / record[new])]
        for label, new, old in zip(("at once", "as rows arrive"), pushed, anew, strict=True)
    ]
    head = ["a recording", "hw.Session, ms", "location branch anew, ms", "ratio (goal 8, aim 30)"]
    return f"""All {record["steps"]} predictions of a recording of Ev-Objects, one after each step. The location branch is
updated for what the events of a step change (`hw.Session`), or run anew on what is known so far. *At once*: the whole recording
is given, and the {record["steps"]} runs anew are one batch on all cores; *as rows arrive*: a call for every step. All give the
same scores. A session runs {percent(record["again"])} of the steps of blocks again that a run anew takes, since most rows change one
of the first steps. They run in turn and on one core, which limits the ratio at once.

{table(head, rows)}
"""


def placement(records: dict[str, Found]) -> str:
    """Return placing and routing against size, and the hops saved."""
    size_rows = []
    for m in records["sizes"]["sizes"]:
        parts = [m.get(part, 0.0) for part in PLACING]
        size_rows.append(
            [
                f"{m['compartments']:,}", f"{m['synapses']:,}", str(m["cores"]), *(f"{m[part]:.2f}" if part in m else "-" for part in PLACING),
                f"{sum(parts):.2f}", f"{sum(parts) / m['synapses'] * 1e6:.2f}", f"{m['placing_mib'] / 1024:.2f}",
            ]
        )  # fmt: skip
    head = ["compartments", "synapses", "cores", "build s", "place s", "arrange s", "route s", "total s"]
    hop_rows = [
        [
            m["name"], str(m["cores"]), f"{m['before']:,.0f}", f"{m['after']:,.0f}",
            percent(1 - m['after'] / m['before']), f"{m['seconds']:.2f}",
        ]
        for m in records["hops"]["networks"]
    ]  # fmt: skip
    hop_head = ["network", "cores", "hops a step, network order", "arranged", "saved", "seconds to arrange"]
    return f"""{table([*head, "s per million synapses", "peak GiB"], size_rows, left=0)}

*Build* makes the graph through `ProgramBuilder`, checks included; *route* assembles the program too. Time grows with the
number of synapses; arranging grows with the slots of the board instead, cubed, and is left out above 1,024 slots.

## Hops that arranging cores saves

{made_by("test_hops.py")} Expected hops a step if every compartment spikes once, cores in network order against arranged.

{table(hop_head, hop_rows)}
"""


def pages(records: dict[str, Found], picture: str) -> dict[str, str]:
    """Return the text of every page by its name; the headline's is ``""``."""
    machine = records["machine"]
    versions = ", ".join(f"{name} {machine[name]}" for name in ("Python", "numba", "numpy", "scipy"))
    measured = f"""Measured on {machine["processor"]}; caches of a core {machine["caches"]}; memory {machine["memory"]}; {machine["system"]};
{versions}; hw_model {machine["hw_model"]}."""
    head = f"""# Benchmarks

`make bench` measures the figures on these pages and writes them; the public simulators come from `make peers`. {measured}
Seconds differ from machine to machine. Ratios within one run are the result.

How many times faster than each simulator a recording is, the goal in brackets, and the share of the machine's limit:

{summary(records)}

![Time per recording by tool, and cost against size and activity]({picture})

{LINKS}
"""
    return {
        "": head,
        "side-by-side": f"# Side by side with public simulators\n\n{measured}\n\n{tools(records)}",
        "size-and-activity": f"# Cost against size and activity\n\n{measured}\n\n{growth(records)}",
        "recordings": f"# Real recordings\n\n{measured}\n\n{recordings(records)}",
        "placing": f"# Placing and routing\n\n{measured}\n\n{placing(records)}",
    }


LINKS = """- [Side by side](benchmarks/side-by-side.md): every tool on four workloads, and the kernel that is the limit.
- [Size and activity](benchmarks/size-and-activity.md): what a recording costs as networks grow and fire more.
- [Real recordings](benchmarks/recordings.md): the test sets, start-up, what silence saves, a prediction after every step.
- [Placing](benchmarks/placing.md): from a graph to a recording, up to a million compartments.
- [Training](benchmarks/training-speed.md): an epoch next to snnTorch and SpikingJelly."""


def tools(records: dict[str, Found]) -> str:
    """Return every tool on every workload, with what was measured how."""
    workloads = [records[key] for key in (f"side_by_side_{name}" for name in WORKLOADS) if key in records]
    turns = ", ".join(f"{own(record)['turns']} ({record['name']})" for record in workloads)
    return f"""{made_by("test_side_by_side.py")} The same networks and input spikes for every tool, in one run: each waits in a process of its
own, loaded and built, and all take turns, so that noise of the machine hits all alike. Medians of {turns} turns; a turn of
hw_model is a batch, one of lava-dl a batch of 32, one of the others a recording. *Ratio* is to hw_model's batch, which
uses all cores, as lava-dl does. nengo-loihi, brian2-loihi and SANA-FE use one core; *two processes* is what two cores give
when two of them play at the same time. SANA-FE's own threads made it slower in every trial. *Other spikes* are those of
the first recording, over all layers, that differ from the plain numpy loop.

*small* and *large* are feed-forward CUBA-LIF networks of random even 8-bit weights with Bernoulli input, decays 1024 and
128. *objects* and *containers* stand for the example hybrids: no simulator here has joined compartments, so each neuron is
its alpha dendrite alone, with the chip's reset, and the two branches are two networks; layers, decays, steps, recordings
and (rounded) weights are the example's, spikes are not. The example itself is a row of its own; no peer can play it.

What the tools do in that time differs. hw_model returns all spikes and counts operations, wraps, clips and packets; SANA-FE
models energy and time of every message, in mode *detailed* with the network's traffic; lava-dl keeps float tensors ready to
train; nengo-loihi and brian2-loihi only simulate. SANA-FE's LIF soma has a current that decays as the chip's does, but
does not truncate it; its potentials are truncated as v is. Where currents leave nothing to truncate its spikes equal ours
(`tests/peers/test_sanafe.py`). lava-nc, which needs Python 3.10, is left out.

The *limit* is a kernel of the same memory traffic: every delivered spike adds its row of weights, 16 bits each, to a row of
charges, 32 bits each, in the engine's order and on all cores, with the spikes known beforehand (`tests/benchmarks/limits.py`).

{chr(10).join(side_by_side(record) for record in workloads)}
"""


def growth(records: dict[str, Found]) -> str:
    """Return cost against size and against activity."""
    return f"""## Cost against size

{made_by("test_curves.py")} Ten layers in a row; a compartment has 250 synapses from the 400 sources nearest to it, and 2 % of
all compartments fire in a step. 100 steps.

{sizes(records)}

{KNEES}

Rows of 256 weights in random order, out of tables of growing size, one table a core:

{tables(records["tables"])}

## Cost against activity

{made_by("test_curves.py")} Every compartment repeats the input, so that its activity is known. 100 steps.

Fully connected, 4 layers of 1,024:

{activity(records["activity_dense"])}
Local, 10 layers of 1,000, 250 synapses each:

{activity(records["activity_local"])}
"""


def placing(records: dict[str, Found]) -> str:
    """Return placing and routing against size, and the hops that arranging saves."""
    return f"""## Placing and routing against size

{made_by("test_curves.py")} The networks of *cost against size* on a board of eight chips; cores are arranged up to 100,000 compartments.

{placement(records)}"""


KNEES = """*A layer's MiB* are its synapses as the engine holds them, and *in* the nearest cache that holds these. The engine
plays a tile of 64 steps of one layer, then of the next, so a layer is what has to stay near. Cost is linear in events between
the knees, and there are three. Layers that are at least a quarter full are matrices of 2 bytes a synapse, added in vectors; the
others are lists, followed synapse by synapse, 4 bytes each where slot, delay and weight fit, else 12: that is the step from 3,000 compartments on. As a layer outgrows a
cache, each spike fetches its synapses from farther away; the table below has the same for rows alone. In the small networks the
part of a step that does not depend on events, the updates, is the larger one."""


def recordings(records: dict[str, Found]) -> str:
    """Return the sections on published recordings, where they were there."""
    if "test_set" not in records:
        return "The recordings were not there.\n"
    return f"""## The published test recordings

{made_by("test_recordings.py")}

{test_set(records)}
## What silence saves

{made_by("test_recordings.py")}

{silence(records["silence"])}
## A prediction after every step

{made_by("test_streaming.py")}

{streaming(records["streaming"])}
"""


def wrapped(markdown: str) -> str:
    """Return a page with its paragraphs filled to the width of a line; tables, lists, headings and pictures stay."""
    blocks = [block.strip() for block in markdown.split("\n\n")]
    filled = [
        block if block.startswith(("|", "#", "!", "- ")) else textwrap.fill(" ".join(block.split()), 120, **UNBROKEN)
        for block in blocks
    ]
    return "\n\n".join(block for block in filled if block) + "\n"


def main() -> None:
    """Write pages and picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("page", type=Path)
    parser.add_argument("picture", type=Path)
    args = parser.parse_args()
    from picture import draw  # matplotlib: the rest of this file is tested without it

    records = read(args.results)
    draw(records, args.picture)
    picture = os.path.relpath(args.picture, args.page.parent)
    args.page.with_suffix("").mkdir(exist_ok=True)
    for name, text in pages(records, picture).items():
        path = args.page.with_suffix("") / f"{name}.md" if name else args.page
        before = path.read_text() if path.exists() else ""
        kept = [section for part in KEPT if (section := section_of(before, part)) is not None]
        path.write_text("\n".join([wrapped(text), *(f"{section}\n" for section in kept)]))


if __name__ == "__main__":
    main()
