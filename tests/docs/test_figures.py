"""Accuracies, energies and resources in README and pages equal those of the tables that they were copied from.

``make results`` writes the tables of accuracy and energy (`docs/research/results/*.csv`); the pages of
the benchmarks and of the placed hardware hold the others.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from tests.support.fences import ROOT

TABLES = ROOT / "docs/research/results"
BEST = TABLES / "best-networks.md"
LABELS = {
    "Hybrid, lambda 1, loop (the paper's)": "Hybrid, lambda 1, loop",
    "Window-SNN and hybrid, joined (dendrite)": "Window-SNN and hybrid, joined",
    "Three Window-SNNs and hybrid, joined (reset)": "Three Window-SNNs and hybrid, joined",
    "the same, hybrid trained on the chip's integers": "Three Window-SNNs and hybrid, trained for the chip",
    "Window-SNN, trained on the chip's integers with 2 bits": "Window-SNN, trained with 2 bits",
    "the same, trained on the chip's integers with 2 bits": "Window-SNN, neighbouring levels, trained with 2 bits",
}
"""Networks of the page of the best networks that have another name in the tables."""
HEADLINES = {  # for each shipped model: its network in the tables, and its data set
    "objects-best": ("Three Window-SNNs and hybrid, trained for the chip", "Objects"),
    "containers-best": ("Window-SNN, neighbouring levels", "Containers"),
}


def table(page: Path, heading: str) -> list[list[str]]:
    """Return the rows of the table on a page whose first column or columns have this heading.

    Marks of emphasis and code are removed from the cells.
    """
    lines = iter(page.read_text("utf-8").splitlines())
    next(line for line in lines if line.startswith(f"| {heading} |"))
    next(lines)  # the line of dashes
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        cells = re.sub(r"[*`]", "", line).strip("|").split("|")
        rows.append([cell.strip() for cell in cells])
    return rows


def row_of(page: Path, heading: str, first_cell: str) -> list[str]:
    """Return the first row of a table whose first cell ends with these words."""
    return next(row for row in table(page, heading) if row[0].endswith(first_cell))


def rows(name: str) -> list[list[str]]:
    """Return the rows of a table that ``make results`` wrote, the heading first."""
    return list(csv.reader((TABLES / f"{name}.csv").read_text("utf-8").splitlines()))


def chip(network: str, data: str) -> tuple[str, str, str]:
    """Return the accuracy as trained, the accuracy on the chip, and microjoules per recording, as measured."""
    _, trained, on_chip, _, _, energy = next(
        row for row in rows("chip") if row[0] == f"{network}, {data}"
    )
    return trained, on_chip, f"{float(energy):.1f}"


@pytest.mark.parametrize("row", table(BEST, "set"), ids=lambda row: " ".join(row[:2]))
def test_the_best_networks_are_those_that_were_measured(row):
    data, label, trained, on_chip, energy, cores = row
    network = LABELS.get(label, label)
    assert (trained, on_chip, energy) == chip(network, data)
    # Columns of the table of the Pareto front: data set, network, accuracy (4) and cores (6).
    # A network that is not on the front, or has no number there, is not compared.
    cores_of_front = {(entry[0], entry[1], entry[4]): entry[6] for entry in rows("front")}
    assert (cores_of_front.get((data, network, on_chip)) or cores) == cores


@pytest.mark.parametrize(
    ("heading", "name", "columns"),
    [
        ("what is wrong", "robustness", 4),
        ("network", "time-seen", 4),
        ("network | validation recordings", "margins", 8),
    ],
)
def test_a_table_of_the_page_repeats_the_file_next_to_it(heading, name, columns):
    # The first column holds names, which are longer on the page; the page may leave out the last ones.
    measured = [row[1 : columns + 1] for row in rows(name)[1:]]
    assert sorted(row[1:] for row in table(BEST, heading)) == sorted(measured)


@pytest.mark.parametrize("model", HEADLINES)
def test_headlines_and_cards_have_the_figures_of_the_tables(model):
    network, data = HEADLINES[model]
    _, on_chip, energy = chip(network, data)
    mean, deviation = on_chip.split(" ± ")
    readme = " ".join((ROOT / "README.md").read_text("utf-8").split())
    assert re.search(rf"\b{mean} (on the chip )?\({data}, {energy} µJ", readme)
    card = " ".join((ROOT / f"examples/models/{model}.md").read_text("utf-8").split())
    assert re.search(rf"\b{mean} on the chip over five seeds, at {energy} µJ", card)
    assert f"mean {mean}, sample standard deviation {deviation}" in card
    assert f"**{on_chip} on {data}** (*{network}*)" in (
        ROOT / "docs/research/results.md"
    ).read_text("utf-8")


def test_the_readme_has_the_speed_of_the_benchmark():
    readme = " ".join((ROOT / "README.md").read_text("utf-8").split())
    benchmark = table(ROOT / "docs/research/benchmarks.md", "network")
    (speed_of_large,) = (row[1] for row in benchmark if row[0] == "large")
    times_faster = int(speed_of_large.split()[0].replace(",", ""))
    assert f"about {round(times_faster, -1)} times faster than nengo-loihi" in readme


def test_the_readme_has_the_published_figures():
    readme = " ".join((ROOT / "README.md").read_text("utf-8").split())
    page = (ROOT / "docs/research/results.md").read_text("utf-8")
    objects, containers = re.search(
        r"The best published figures on these recordings are ([\d.]+) and ([\d.]+);", page
    ).groups()
    assert f"figures on these recordings are at most {objects} and {containers};" in readme
    published = table(ROOT / "docs/research/results.md", "network")
    # The fifth column holds the published accuracy on Containers, where there is one.
    published_on_containers = [
        row[4] for row in published if row[0].startswith("Hybrid, lambda") and row[4]
    ]
    interval = f"{min(published_on_containers)} to {max(published_on_containers)}"
    assert f"two fingertips, on other recordings of Containers, are {interval}." in readme


@pytest.mark.parametrize("board", ["ulx3s-25f", "icebreaker"])
def test_the_page_on_public_work_has_the_resources_that_were_placed(board):
    _, _, luts, _, rams, _, clock = placed_on(board)[:7]
    fastest = re.search(r"([\d.]+) MHz of", clock)[1]
    compared = row_of(ROOT / "docs/research/hardware/public-work.md", "work", board)
    # Its columns from the third on: logic cells, block RAMs and clock, each followed by its unit.
    assert [cell.split(" ")[0] for cell in compared[2:5]] == [luts, rams, fastest]


def placed_on(board: str) -> list[str]:
    """Return the row of a board in the table of placed programs.

    Its cells: board, program, LUTs, flip-flops, block RAMs, multipliers, clock.
    """
    page = ROOT / "docs/research/hardware/resources-and-clock.md"
    return next(row for row in table(page, "board | program") if row[0] == board)


def test_the_page_on_boards_has_the_resources_that_were_placed():
    placed = placed_on("ulx3s-25f")
    luts, flip_flops, rams, multipliers = (cell.replace(",", "") for cell in placed[2:6])
    page = (ROOT / "docs/how-to/put-a-model-on-a-board.md").read_text("utf-8")
    assert (
        f"takes {luts} LUTs, {flip_flops} flip-flops, {rams} block RAMs and {multipliers} multipliers"
        in page
    )
    slowest, fastest, placements = re.fullmatch(
        r"([\d.]+) to ([\d.]+) MHz of (\d+)", placed[6]
    ).groups()
    assert (
        f"clock: {fastest} MHz, the fastest of {placements} placements ({slowest} to {fastest} MHz)\n"
        in page
    )
