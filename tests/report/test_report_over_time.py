"""The section of the report on predictions over time: its curves, what a stop saves, and what it says if data is missing.

Curves are compared with the predictions of the small report, which has ten steps of 0.7 s.
"""

from __future__ import annotations

from typing import Any

import pytest

from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Bar, Plot, Section, Table
from locsnn_compile.report.renderers.html import render_html
from tests.support.small_report import figures


def _section(document: dict[str, Any]) -> Section:
    """Return the section of a report on predictions over time."""
    return next(
        section for section in compose(figures(document)).sections if section.key == "over-time"
    )


def _plot(document: dict[str, Any]) -> Plot:
    """Return the plot of right predictions."""
    return next(block for block in _section(document).unfolded if isinstance(block, Plot))


def test_curves_are_drawn_at_their_steps(document: dict[str, Any]) -> None:
    plot = _plot(document)
    assert (plot.title, plot.x_label) == ("Accuracy after each step", "seconds")
    assert plot.x.places == [
        (0.0, "0"),
        (0.2, "1.4"),
        (0.4, "2.8"),
        (0.6, "4.2"),
        (0.8, "5.6"),
        (1.0, "7.0"),
    ]
    assert [curve.label for curve in plot.curves] == [
        "all branches together",
        "time branch",
        "location branch",
        "time-weighted",
    ]
    assert plot.placed(plot.curves[1]) == [
        (0.2, 0.25),
        (0.4, 0.5),
        (0.6, 0.5),
        (0.8, 0.75),
        (1.0, 0.75),
    ]


def test_every_curve_has_a_look_of_its_own(document: dict[str, Any]) -> None:
    page = render_html(compose(figures(document)))
    for index in range(4):
        assert f".c{index}{{stroke:" in page
        assert f'class="curve c{index}"' in page


def test_savings_are_shares_of_the_whole_recording(document: dict[str, Any]) -> None:
    table = next(
        block
        for block in _section(document).unfolded
        if isinstance(block, Table) and "proven" in block.caption
    )
    costs = [
        "steps",
        "synaptic operations",
        "energy, profile davies2018",
        "latency, profile davies2018",
    ]
    assert [row[0] for row in table.rows] == costs
    assert table.rows[2] == (
        "energy, profile davies2018",
        Bar(pytest.approx(0.2), "20.0 % saved"),
        "100 nJ",
        "80.0 nJ",
        "20.0 %",
    )


def test_without_labels_the_curve_is_not_called_accuracy(document: dict[str, Any]) -> None:
    document["over_time"]["right_is"] = "the prediction after the last step"
    assert _plot(document).title == "Recordings with the same prediction as after the last step"


def test_without_the_length_of_a_step_the_axis_counts_steps(document: dict[str, Any]) -> None:
    document["over_time"]["step_seconds"] = None
    plot = _plot(document)
    assert plot.x_label == "steps"
    assert [text for _, text in plot.x.places] == ["0", "2", "4", "6", "8", "10"]


def test_a_network_of_one_branch_has_no_weights_of_branches(document: dict[str, Any]) -> None:
    right = document["over_time"]["right"]
    document["over_time"]["right"] = {"together": right["together"]}
    assert len(_plot(document).curves) == 1
    page = render_html(compose(figures(document)))
    section = page.split('id="over-time"')[1].split("<section")[0]
    assert "psi" not in section


def test_predictions_that_were_not_followed_have_a_reason(document: dict[str, Any]) -> None:
    document["over_time"] = {
        "left_out": "phase 'location' mixes transposed inputs with inputs that are played as they come"
    }
    section = _section(document)
    assert section.lead == (
        "Predictions were not followed step by step: phase 'location' mixes transposed inputs with inputs that are played as they come."
    )
    assert [block.title for block in section.unfolded if isinstance(block, Plot)] == [
        "Energy of a step, mean over the recordings, profile davies2018",
        "Time of a step, mean over the recordings, profile davies2018",
    ]
    del document["over_time"]
    assert _section(document).lead == "What the steps of a recording cost."


@pytest.mark.parametrize(
    ("course", "points"),
    [
        ({"bin_steps": 1, "bins": [6.0, 12.0, 3.0]}, ((1 / 6, 0.5), (0.5, 1.0), (5 / 6, 0.25))),
        ({"bin_steps": 2, "bins": [6.0, 12.0, 3.0]}, ((1 / 6, 0.5), (0.5, 1.0))),
        ({"bin_steps": 2, "bins": [6.0]}, ((0.5, 1.0),)),
    ],
    ids=["every step", "a last bin that may be short", "one bin"],
)
def test_only_a_bin_that_may_be_short_is_left_out(
    document: dict[str, Any], course: Any, points: Any
) -> None:
    document["energy"]["by_step_pj"] = {"time": course}
    plot = next(
        block
        for block in _section(document).unfolded
        if isinstance(block, Plot) and block.title.startswith("Energy of a step")
    )
    assert plot.placed(plot.curves[0]) == [(pytest.approx(x), y) for x, y in points]
