"""The measuring itself: the limit's kernels do the work they stand for, and figures are printed as they are."""

from __future__ import annotations

import numpy as np
import pytest
from limits import TILE, _add_plain, _add_together, deliveries
from page_figures import line, percent, times
from write_page import wrapped


@pytest.mark.parametrize(
    "add", [_add_plain, _add_together], ids=["one row at a time", "rows together"]
)
@pytest.mark.parametrize("rate", [0.01, 0.6])
def test_kernels_add_every_row_where_it_is_due(add, rate):
    r = np.random.default_rng(0)
    spikes = (r.random((2, 100, 30)) < rate).astype(np.uint8)
    weights = r.integers(-127, 128, (30, 20)).astype(np.int16)
    begin, source, due = deliveries([spikes])
    tiles = [tile for recording in spikes for tile in (recording[:TILE], recording[TILE:])]
    assert len(begin) == len(tiles) + 1
    for part, tile in enumerate(tiles):
        charge = np.zeros((TILE + 1, 20), dtype=np.int32)
        add(source, due, begin[part], begin[part + 1], weights, charge)
        assert np.array_equal(charge[1 : len(tile) + 1], tile.astype(np.int64) @ weights)


@pytest.mark.parametrize(
    ("start", "slope", "found"),
    [(2.0, 3.0, (2.0, 3.0)), (-0.5, 1.0, None)],
    ids=["a line", "a start below 0 is held at 0"],
)
def test_line_through_points(start, slope, found):
    x = np.array([1.0, 10.0, 100.0])
    fitted = line(x, start + slope * x)
    assert fitted == pytest.approx(found) if found else fitted[0] == 0.0


def test_figures_as_text():
    assert (times(70.43e-6), times(0.0123456), percent(0.305), percent(0.3091, 1)) == (
        "70.4",
        "12,346",
        "30 %",
        "30.9 %",
    )


def test_paragraphs_are_filled_and_tables_stay():
    table = "| a | b |\n| --- | --- |\n| " + "x" * 130 + " | 1 |"
    assert (
        wrapped(f"# Head\n\n{'word ' * 30}\n\n{table}\n")
        == f"# Head\n\n{('word ' * 24).strip()}\n{('word ' * 6).strip()}\n\n{table}\n"
    )
