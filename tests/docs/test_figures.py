"""Figures that pages repeat are those of the tables which ``make results`` writes and of the benchmark page."""

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
"""Names of networks in the table of the best ones that are not those of the other tables."""
HEADLINES = {
    "objects-best": ("Three Window-SNNs and hybrid, trained for the chip", "Objects"),
    "containers-best": ("Window-SNN, neighbouring levels", "Containers"),
}


def table(page: Path, heading: str) -> list[list[str]]:
    """Return the rows of a page's table whose head begins so, without emphasis and code."""
    lines = iter(page.read_text("utf-8").splitlines())
    next(line for line in lines if line.startswith(f"| {heading} |"))
    next(lines)
    found = []
    for line in lines:
        if not line.startswith("|"):
            break
        found.append([cell.strip() for cell in re.sub(r"[*`]", "", line).strip("|").split("|")])
    return found


def rows(name: str) -> list[list[str]]:
    return list(csv.reader((TABLES / f"{name}.csv").read_text("utf-8").splitlines()))


def chip(network: str, data: str) -> tuple[str, str, str]:
    """Return the accuracy as trained, the accuracy on the chip, and microjoules per recording."""
    _, trained, on_chip, _, _, energy = next(
        row for row in rows("chip") if row[0] == f"{network}, {data}"
    )
    return trained, on_chip, f"{float(energy):.1f}"


@pytest.mark.parametrize("row", table(BEST, "set"), ids=lambda row: " ".join(row[:2]))
def test_the_best_networks_are_those_that_were_measured(row):
    data, label, trained, on_chip, energy, cores = row
    network = LABELS.get(label, label)
    assert (trained, on_chip, energy) == chip(network, data)
    front = {(found[0], found[1], found[4]): found[6] for found in rows("front")}
    assert (front.get((data, network, on_chip)) or cores) == cores


@pytest.mark.parametrize(
    ("heading", "name", "columns"),
    [
        ("what is wrong", "robustness", 4),
        ("network", "time-seen", 4),
        ("network | validation recordings", "margins", 8),
    ],
)
def test_a_table_of_the_page_is_the_one_next_to_it(heading, name, columns):
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
    (large,) = (
        row[1]
        for row in table(ROOT / "docs/research/benchmarks.md", "network")
        if row[0] == "large"
    )
    times = int(large.split()[0].replace(",", ""))
    assert f"about {round(times, -1)} times faster than nengo-loihi" in readme


def test_the_readme_has_the_published_figures():
    readme = " ".join((ROOT / "README.md").read_text("utf-8").split())
    page = (ROOT / "docs/research/results.md").read_text("utf-8")
    objects, containers = re.search(
        r"The best published figures on these recordings are ([\d.]+) and ([\d.]+);", page
    ).groups()
    assert f"figures on these recordings are at most {objects} and {containers};" in readme
    hybrids = [
        row[4]
        for row in table(ROOT / "docs/research/results.md", "network")
        if row[0].startswith("Hybrid, lambda") and row[4]
    ]
    of_two = f"{min(hybrids)} to {max(hybrids)}"
    assert f"two fingertips, on other recordings of Containers, are {of_two}." in readme


@pytest.mark.parametrize("board", ["ulx3s-25f", "icebreaker"])
def test_the_page_on_public_work_has_the_resources_that_were_placed(board):
    placed = next(
        row
        for row in table(ROOT / "docs/research/hardware/resources-and-clock.md", "board | program")
        if row[0] == board
    )
    beside = next(
        row
        for row in table(ROOT / "docs/research/hardware/public-work.md", "work")
        if row[0].endswith(board)
    )
    fastest = re.search(r"([\d.]+) MHz of", placed[6])[1]
    assert [cell.split(" ")[0] for cell in beside[2:5]] == [placed[2], placed[4], fastest]


def test_the_page_on_boards_has_the_resources_that_were_placed():
    placed = next(
        row
        for row in table(ROOT / "docs/research/hardware/resources-and-clock.md", "board | program")
        if row[0] == "ulx3s-25f"
    )
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
