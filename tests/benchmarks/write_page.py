"""Write the pages and the picture of the benchmarks: ``write_page.py RESULTS PAGE PICTURE``.

``RESULTS`` is the folder of records. ``PAGE`` gets the headline; the pages with all rows lie in a folder of its name next to it.
"""

from __future__ import annotations

import argparse
import json
import os
import textwrap
from pathlib import Path

from page_figures import Found
from page_growth import growth, growth_in_short
from page_peers import headline, summary, tools, tools_in_short
from page_placing import placing, placing_in_short
from page_recordings import recordings, recordings_in_short
from page_section import section_of

COMMAND_SPEED = "command-speed"
KEPT = (COMMAND_SPEED, "against", "processors", "density", "scale", "chips")
"""Sections that other scripts write into these pages (``scale``: scale.py, ...); they are kept when pages are written anew."""

UNBROKEN = {"break_long_words": False, "break_on_hyphens": False}


def read(results: Path) -> dict[str, Found]:
    """Return all records by name. They must come from one machine, or their ratios would mean nothing."""
    records = {path.stem: json.loads(path.read_text()) for path in sorted(results.glob("*.json"))}
    records.pop("pytest-benchmark", None)
    machines = [record.pop("machine") for record in records.values()]
    if any(machine != machines[0] for machine in machines):
        raise SystemExit(
            f"{results}: not all of one machine and version. Remove the folder and run `make bench`."
        )
    return {**records, "machine": machines[0]}


def pages(records: dict[str, Found], picture: str) -> dict[str, str]:
    """Return the text of every page by its name; the name of the headline's page is ``""``."""
    machine = records["machine"]
    versions = ", ".join(
        f"{name} {machine[name]}" for name in ("Python", "numba", "numpy", "scipy")
    )
    measured = f"""Measured on {machine["processor"]}; caches of a core {machine["caches"]}; memory {machine["memory"]}; {machine["system"]};
{versions}; hw_model {machine["hw_model"]}."""
    head = f"""# Benchmarks

{headline(records)} `make bench` measures the figures on these pages and writes them; the public simulators come from
`make peers`. {measured} Seconds differ from machine to machine. Ratios within one run are the result.

The table says how many times faster a recording plays than in each simulator, with our goal in brackets. The last two
columns compare with the *limit*: a kernel that moves the same memory and computes next to nothing, first for the rows of
weights alone, then also for the state of all compartments ([side by side](benchmarks/side-by-side.md)).

{summary(records)}

![Time per recording by tool, and cost against size and activity]({picture})

{LINKS}
"""
    return {
        "": head,
        "side-by-side": _page(
            "Side by side with public simulators", tools_in_short(records), tools(records)
        ),
        "size-and-activity": _page(
            "Cost against size and activity", growth_in_short(records), growth(records)
        ),
        "recordings": _page("Real recordings", recordings_in_short(records), recordings(records)),
        "placing": _page("Placing and routing", placing_in_short(records), placing(records)),
    }


def _page(title: str, conclusion: str, sections: str) -> str:
    """Return a page with its conclusion first; the headline's page describes the machine."""
    machine = "Measured on the machine that [Benchmarks](../benchmarks.md) names."
    return f"# {title}\n\n{conclusion} {machine}\n\n{sections}"


LINKS = """- [Side by side](benchmarks/side-by-side.md): every tool on four workloads, and the kernel that is the limit.
- [Size and activity](benchmarks/size-and-activity.md): what a recording costs as networks grow and fire more.
- [Real recordings](benchmarks/recordings.md): the test sets, start-up, what silence saves, a prediction after every step.
- [Placing](benchmarks/placing.md): from a graph to a recording, up to a million compartments.
- [Training](benchmarks/training-speed.md): an epoch next to snnTorch and SpikingJelly."""


def wrapped(markdown: str) -> str:
    """Return a page with its paragraphs filled to the width of a line; tables, lists, headings and pictures stay."""
    blocks = [block.strip() for block in markdown.split("\n\n")]
    filled = [
        block
        if block.startswith(("|", "#", "!", "- "))
        else textwrap.fill(" ".join(block.split()), 120, **UNBROKEN)
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
        old_text = path.read_text() if path.exists() else ""
        kept_sections = [
            section for part in KEPT if (section := section_of(old_text, part)) is not None
        ]
        path.write_text("\n".join([wrapped(text), *(f"{section}\n" for section in kept_sections)]))


if __name__ == "__main__":
    main()
