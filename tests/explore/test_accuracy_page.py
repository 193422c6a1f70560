"""What docs/research/accuracy/speed-error-energy.md says of the front: its commands give its figures."""

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
    """Give a data set, the options of a row and its cells: first, recommended and last row of every front."""
    for part in SECTION.split("\n## ")[1:]:
        found = [line for line in part.splitlines() if re.match(r"\|.*`--", line)]
        for i in sorted(
            {0, len(found) - 1, next(i for i, line in enumerate(found) if "recommended" in line)}
        ):
            cells = [cell.strip() for cell in found[i].strip("|").split("|")]
            yield pytest.param(
                part.split(",")[0],
                cells[1].strip("`"),
                cells[2:],
                id=f"{part.split(',')[0]} {cells[1]}",
            )


@pytest.mark.parametrize(("dataset", "options", "cells"), list(rows()))
def test_the_command_of_a_row_gives_its_figures(dataset, options, cells, tmp_path):
    model = ROOT / f"examples/models/{dataset.lower()}-hybrid.pt"
    archive = str(REAL / f"Ev-{dataset}.zip")
    given = re.search(rf"    locsnn-compile \S*{dataset.lower()}-hybrid.pt (.*) OPTIONS", SECTION)[
        1
    ]
    arguments = given.replace(f"Ev-{dataset}.zip", archive).split() + options.split()
    assert main([str(model), *arguments, "-o", str(tmp_path / "build"), "--quiet"]) == 0
    figures = figures_of(tmp_path / "build")
    wanted = [share(figures.spike_error), share(figures.prediction_error), share(figures.accuracy)]
    assert cells[2:7] == [*wanted, energy(figures.energy_pj), time(figures.chip_time_ns)]
