"""The tables of docs/research/accuracy/speed-error-energy.md: the command of a row gives the figures of the row."""

import re
from pathlib import Path

import pytest

from locsnn_compile.cli.compile import main
from locsnn_compile.report.format import energy, share, time
from tests.support.explored_model import figures_of
from tests.support.real_recordings import REAL, on_real_recordings

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/research/accuracy/speed-error-energy.md").read_text()
SECTION = PAGE[PAGE.index("<!-- pareto: begin -->") : PAGE.index("<!-- pareto: end -->")]

pytestmark = [
    pytest.mark.minutes,
    on_real_recordings,
]


def rows():
    """Yield (data set, options of a row, its figures) for the first, recommended and last row of every front."""
    for section in SECTION.split("\n## ")[1:]:
        dataset = section.split(",")[0]
        table_lines = [line for line in section.splitlines() if re.match(r"\|.*`--", line)]
        (recommended,) = (i for i, line in enumerate(table_lines) if "recommended" in line)
        last = len(table_lines) - 1
        for i in sorted({0, recommended, last}):
            _, options, *figures = (cell.strip() for cell in table_lines[i].strip("|").split("|"))
            yield pytest.param(dataset, options.strip("`"), figures, id=f"{dataset} {options}")


@pytest.mark.parametrize(("dataset", "options", "cells"), list(rows()))
def test_the_command_of_a_row_gives_its_figures(dataset, options, cells, tmp_path):
    model = ROOT / f"examples/models/{dataset.lower()}-hybrid.pt"
    archive = str(REAL / f"Ev-{dataset}.zip")
    options_of_page = re.search(
        rf"    locsnn-compile \S*{dataset.lower()}-hybrid.pt (.*) OPTIONS", SECTION
    )[1]
    arguments = options_of_page.replace(f"Ev-{dataset}.zip", archive).split() + options.split()
    assert main([str(model), *arguments, "-o", str(tmp_path / "build"), "--quiet"]) == 0
    figures = figures_of(tmp_path / "build")
    errors_and_accuracy = [
        share(figures.spike_error),
        share(figures.prediction_error),
        share(figures.accuracy),
    ]
    assert cells[2:7] == [
        *errors_and_accuracy,
        energy(figures.energy_pj),
        time(figures.chip_time_ns),
    ]
