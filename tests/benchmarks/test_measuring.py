"""The measuring itself: the kernels of the limit add every row of weights, and pages print the figures that were measured."""

from __future__ import annotations

import numpy as np
import pytest
from limits import TILE, _add_plain, _add_together, deliveries
from page_figures import Found, line, percent, times
from page_growth import growth_in_short
from page_peers import headline, tools_in_short
from page_placing import placing_in_short
from page_recordings import recordings_in_short
from write_page import wrapped


@pytest.mark.parametrize(
    "add", [_add_plain, _add_together], ids=["one row at a time", "rows together"]
)
@pytest.mark.parametrize("rate", [0.01, 0.6])
def test_kernels_add_every_row_where_it_is_due(add, rate):
    r = np.random.default_rng(0)
    spikes = (r.random((2, 100, 30)) < rate).astype(np.uint8)
    weights = r.integers(-127, 128, (30, 20)).astype(np.int16)
    first_of_tile, source, due = deliveries([spikes])
    tiles = []
    for recording in spikes:
        tiles += [recording[:TILE], recording[TILE:]]
    assert len(first_of_tile) == len(tiles) + 1
    for number, tile in enumerate(tiles):
        charge = np.zeros((TILE + 1, 20), dtype=np.int32)
        add(source, due, first_of_tile[number], first_of_tile[number + 1], weights, charge)
        assert np.array_equal(charge[1 : len(tile) + 1], tile.astype(np.int64) @ weights)


@pytest.mark.parametrize(
    ("start", "slope", "found"),
    [(2.0, 3.0, (2.0, 3.0)), (-0.5, 1.0, None)],
    ids=["a line", "a start below 0 is held at 0"],
)
def test_a_line_is_fitted_and_does_not_start_below_0(start, slope, found):
    x = np.array([1.0, 10.0, 100.0])
    fitted = line(x, start + slope * x)
    assert fitted == pytest.approx(found) if found else fitted[0] == 0.0


def test_times_and_shares_are_printed_with_about_three_digits():
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


def workload(nengo: float, sanafe: float, limit: float) -> Found:
    """Return the record of a workload whose recordings take our engine a second; ``nengo`` and ``sanafe``: seconds of peers."""
    peers = {"nengo-loihi": nengo, "sanafe": sanafe}
    rows = [{"tool": tool, "seconds": seconds} for tool, seconds in peers.items()]
    return {
        "rows": [{"tool": "hw_model", "seconds": 1.0}, *rows],
        "limits": {"plain": 1.0, "rows": limit},
    }


def test_a_page_begins_with_its_least_and_largest_figures() -> None:
    # 1 ms without any operation, and 2 ns for each.
    rates = [{"synaptic_ops": ops, "seconds": 1e-3 + ops * 2e-9} for ops in (1e5, 1e6)]
    sizes = [
        {"compartments": 1000, "synapses": 2e6, "synaptic_ops": 1e6, "seconds": 3e-4, "build": 1.0},
        {"compartments": 4000, "synapses": 4e6, "synaptic_ops": 1e6, "seconds": 9e-4, "build": 3.0},
    ]
    records = {
        "side_by_side_small": workload(nengo=300.0, sanafe=40.0, limit=0.25),
        "side_by_side_large": workload(nengo=200.0, sanafe=50.0, limit=0.5),
        "sizes": {"sizes": sizes},
        "activity_dense": {"rates": rates},
        "activity_local": {"rates": rates},
        "hops": {"networks": [{"before": 4, "after": 3}, {"before": 4, "after": 1}]},
        "test_set": {"recordings": 144, "seconds": 0.02},
        "streaming": {
            "anew_at_once": 6.0,
            "pushed_at_once": 2.0,
            "anew_step_by_step": 8.0,
            "pushed_row_by_row": 2.0,
        },
    }
    faster = "200 to 300 times faster than in nengo-loihi's emulator"
    assert headline(records) == (
        f"A recording plays {faster} and 40 to 50 times faster than in SANA-FE."
    )
    assert tools_in_short(records) == (
        f"A batch plays 40 to 50 times faster than in SANA-FE and {faster}. "
        "It reaches 25 % to 50 % of what the machine can do at most."
    )
    assert growth_in_short(records) == (
        "From 1,000 to 4,000 compartments, a synaptic operation takes 0.30 to 0.90 ns. Time grows "
        "with spikes along a straight line: 2.000 ns for each operation more where layers are "
        "fully connected, 2.000 ns where they are sparse."
    )
    assert placing_in_short(records) == (
        "To build, place and route a million synapses takes 0.50 to 0.75 seconds, up to 4,000 "
        "compartments. Arranging the cores saves 25 % to 75 % of the hops."
    )
    assert recordings_in_short(records) == (
        "The 144 test recordings of Ev-Objects play in 20.0 ms. A prediction after every step "
        "takes a session 3.0 times less time than playing anew, and 4.0 times less as rows arrive."
    )
