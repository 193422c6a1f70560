"""The pictures of the report: rasters, potentials, margins, meshes and curves, with places that can be followed by hand.

Most tests look at the content (a raster's strokes, a plot's points) before it becomes SVG; ``test_blocks.py`` has the
markup.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import sparse

import locsnn_compile as lc
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Mesh, Plot, Raster, Section, Table
from locsnn_compile.report.pictures.axis import round_numbers, step_axis
from locsnn_compile.report.pictures.drawings import mesh, raster
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.verification.excerpt import (
    LINES,
    MARKS,
    NEURONS,
    POPULATIONS,
    STEPS,
    Excerpt,
    SpikeRows,
)
from tests.support.networks import single
from tests.support.small_report import figures


def _section(key: str, document: dict[str, Any], excerpt: Excerpt | None = None) -> Section:
    """Return the section of a report with this key."""
    return next(
        section for section in compose(figures(document), excerpt).sections if section.key == key
    )


def _rasters(document: dict[str, Any], excerpt: Excerpt) -> list[Raster]:
    """Return the rasters of the section on spikes: the population, then the input."""
    return [
        block
        for block in _section("spikes", document, excerpt).unfolded
        if isinstance(block, Raster)
    ]


def test_spikes_are_sorted_by_side(document: dict[str, Any], excerpt: Excerpt) -> None:
    population, _ = _rasters(document, excerpt)
    assert population.title == "time_output: 2 of 36 neurons"
    assert (population.columns, population.rows) == (4, 2)
    # Step 41 is the third column, and neuron 3 the second row.
    assert population.flag == (2, 1)
    assert population.flag_label == "neuron 3, step 41"
    assert [(strokes.kind, strokes.label, strokes.points) for strokes in population.strokes] == [
        ("equal", "3 on both sides", ((0, 0), (3, 0), (1, 1))),
        ("reference", "1 only in the float network", ((2, 1),)),
        ("chip", "1 only on the chip", ((3, 1),)),
    ]
    assert population.x.places == [(0.125, "39"), (0.375, "40"), (0.625, "41"), (0.875, "42")]


def test_a_network_in_its_own_integers_is_called_the_network(
    document: dict[str, Any], excerpt: Excerpt
) -> None:
    document["match"]["reference"] = "integers"
    population, _ = _rasters(document, excerpt)
    assert [strokes.label for strokes in population.strokes] == [
        "3 on both sides",
        "1 only in the network",
        "1 only on the chip",
    ]
    assert population.description.endswith(
        " spikes on both sides, 1 only in the network, 1 only on the chip."
    )


def test_limits_that_a_core_does_not_have_are_left_out(document: dict[str, Any]) -> None:
    """A limit of 0 has no row unless the program exceeds it."""
    document["resources"]["limits"] |= {
        "step": {"used": 0, "limit": 0},
        "places": {"used": 1, "limit": 0},
    }
    table = next(
        block for block in _section("resources", document).unfolded if isinstance(block, Table)
    )
    names = {str(row[0]) for row in table.rows}
    assert "places for compartments of a phase of a core" in names
    assert not any("steps between targets" in name for name in names)


def test_sides_are_told_apart_without_colour(document: dict[str, Any], excerpt: Excerpt) -> None:
    markup = raster(_rasters(document, excerpt)[0])
    paths = dict(re.findall(r'<path class="stroke (\w+)"[^>]* d="([^"]*)"/>', markup))
    # Rows are 8 units high: a shared spike is 6 long, one of the float network 4 from the top, one of the chip 4 below.
    assert paths == {"equal": "M0 1v6M3 1v6M1 9v6", "reference": "M2 8v4", "chip": "M3 12v4"}


def test_lines_share_rows(document: dict[str, Any], excerpt: Excerpt) -> None:
    _, lines = _rasters(document, excerpt)
    assert lines.title == "Input of the time branch: 5 lines, 2 per row"
    assert [strokes.label for strokes in lines.strokes] == ["4 strokes, each one event or more"]


def test_populations_read_by_potential_are_drawn_only_where_they_spike(
    document: dict[str, Any], excerpt: Excerpt
) -> None:
    document["match"]["readout"] |= {"by": "potentials", "populations": ["time_output"]}
    assert _rasters(document, excerpt)[0].title == "time_output: 2 of 36 neurons"
    (population,) = excerpt.populations
    silent = replace(
        population,
        reference=np.zeros_like(population.reference),
        chip=np.zeros_like(population.chip),
    )
    silent_excerpt = replace(excerpt, populations=(silent,))
    # Only the input is drawn.
    assert len(_rasters(document, silent_excerpt)) == 1
    assert str(_section("spikes", document, silent_excerpt).blocks[0]).endswith(
        "2 further populations are not drawn."
    )
    # A population that is not read by potential is drawn even if it is silent.
    document["match"]["readout"]["populations"] = []
    assert len(_rasters(document, silent_excerpt)) == 2


def test_the_section_says_what_is_not_drawn(document: dict[str, Any], excerpt: Excerpt) -> None:
    first_paragraph = _section("spikes", document, excerpt).blocks[0]
    assert first_paragraph == (
        "Recording 0, the first in which a spike differs. Of 100 time steps, 39 to 42 are drawn. Large populations "
        "are drawn in part: the neurons with the most differences, then the busiest ones. 1 further population is not drawn."
    )


def test_populations_read_by_potential_have_no_margins_drawn_and_no_row_in_the_error_budget(
    document: dict[str, Any],
) -> None:
    def blocks_of(key: str, kind: type) -> list[Any]:
        """Return the blocks of a kind in a section."""
        return [block for block in _section(key, document).unfolded if isinstance(block, kind)]

    document["match"]["readout"] |= {"by": "potentials", "populations": ["time_output"]}
    assert [plot.title.split(":")[0] for plot in blocks_of("margins", Plot)] == [
        "time_output",
        "location_output",
    ]
    document["match"]["by_population"]["time_output"]["spike_agreement"] = None
    assert [plot.title.split(":")[0] for plot in blocks_of("margins", Plot)] == ["location_output"]
    _, by_population = blocks_of("error-budget", Table)
    assert [row[0] for row in by_population.rows] == ["location_output"]


def test_without_an_excerpt_no_recording_is_shown(document: dict[str, Any]) -> None:
    keys = {section.key for section in compose(figures(document)).sections}
    assert not {"spikes", "potential"} & keys


def test_the_error_of_the_potential_is_drawn_until_spikes_differ(
    document: dict[str, Any], excerpt: Excerpt
) -> None:
    section = _section("potential", document, excerpt)
    potentials, error = (block for block in section.unfolded if isinstance(block, Plot))
    assert [curve.label for curve in potentials.curves] == [
        "float potential",
        "chip potential",
        "threshold, 10",
    ]
    # Step 41 of 39 to 42.
    assert potentials.x.place(potentials.marked) == pytest.approx(2 / 3)
    float_curve, chip_curve, threshold_curve = potentials.curves
    threshold = threshold_curve.points[0][1]
    assert [y > threshold for _, y in float_curve.points] == [False, True, True, False]
    assert [y > threshold for _, y in chip_curve.points] == [False, True, False, True]
    # The error in percent of the threshold is 0, 0 and -5; later errors have another cause. The axis has 0.3 of room at
    # each end.
    assert [y for _, y in error.placed(error.curves[0])] == pytest.approx(
        [5.3 / 5.6, 5.3 / 5.6, 0.3 / 5.6]
    )
    table = next(block for block in section.unfolded if isinstance(block, Table))
    assert table.rows[1:3] == (
        ("40", "10.5", "10.5", "float and chip"),
        ("41", "10.25", "9.75", "float"),
    )


def test_without_a_difference_a_neuron_is_an_example(
    document: dict[str, Any], excerpt: Excerpt
) -> None:
    document["match"]["first_divergence"] = None
    excerpt = replace(excerpt, first=None)
    assert _section("potential", document, excerpt).title == "Potential of a neuron"
    assert [raster.flag for raster in _rasters(document, excerpt)] == [None, None]
    assert "the first one, as no spike of any recording differs." in render_html(
        compose(figures(document), excerpt)
    )


def test_cores_sit_where_they_are_and_are_as_full_as_their_fullest_limit(
    document: dict[str, Any],
) -> None:
    fullness, energy = (
        block for block in _section("cores", document).unfolded if isinstance(block, Mesh)
    )
    # Slot 39 is core 3 of tile (1, 1): of 2 by 2 cores there the last. Three of 16 synapse formats are in use.
    assert [(core.column, core.row, core.share, core.text) for core in fullness.cores] == [
        (0, 0, 0.1875, "19"),
        (3, 3, 0.1875, "19"),
    ]
    assert (
        fullness.title
        == "Fullest limit of each core of loihi-sim, in percent: 2 of 128 cores in use"
    )
    assert fullness.description == (
        "core 0, time branch: 18.8 % of its synapse formats; core 1, location branch: 18.8 % of its synapse formats"
    )
    tiles = 8 * 4
    assert mesh(fullness).count('class="tile"') == tiles
    # 75 and 25 nJ: the first is full, the second as full as it is to the first.
    assert [(core.column, core.row, core.share, core.text) for core in energy.cores] == [
        (0, 0, 1.0, "75"),
        (3, 3, pytest.approx(1 / 3), "25"),
    ]


def test_chips_are_drawn_one_by_one(document: dict[str, Any]) -> None:
    """Of six chips with a core each, four are drawn. A chip has 128 cores on 8 columns of tiles."""
    resources = document["resources"]
    resources["mesh"]["chips"] = 6
    core = resources["by_core"][0]
    resources["by_core"] = [
        {**core, "core": i, "slot": 128 * i, "tile": [8 * i, 0]} for i in range(6)
    ]
    blocks = _section("cores", document).blocks
    meshes = [block for block in blocks if isinstance(block, Mesh)]
    assert [mesh.title for mesh in meshes[::2]] == [
        f"Fullest limit of each core of chip {i} of loihi-sim, in percent: 1 of 128 cores in use"
        for i in range(4)
    ]
    assert blocks[-1] == "2 chips are not drawn; see core by core."
    assert all(core.column == 0 for mesh in meshes for core in mesh.cores)


def test_the_largest_excerpt_is_a_small_page(document: dict[str, Any], excerpt: Excerpt) -> None:
    """As many populations, neurons, lines and spikes as an excerpt may have: every neuron spikes in every step."""
    size = 100_000
    steps = MARKS // NEURONS
    all_spikes = np.ones((steps, NEURONS), dtype=np.uint8)
    populations = tuple(
        SpikeRows(
            f"layer{i}",
            "time",
            "time",
            size=size,
            numbers=np.arange(NEURONS),
            reference=all_spikes,
            chip=1 - all_spikes,
        )
        for i in range(POPULATIONS)
    )
    events = np.ones((MARKS // LINES, LINES), dtype=np.uint8)
    events = np.pad(events, ((0, steps - len(events)), (0, 0)))
    lines_per_row = math.ceil(size / LINES)
    inputs = (
        SpikeRows(
            "input",
            "time",
            "time",
            size=size,
            numbers=np.arange(0, size, lines_per_row),
            reference=events,
            chip=events,
            together=lines_per_row,
        ),
    )
    excerpt = replace(
        excerpt, first=None, steps={"time": range(steps)}, populations=populations, inputs=inputs
    )
    assert len(render_html(compose(figures(document), excerpt)).encode()) < 1_000_000
    assert steps < STEPS


def test_the_energy_of_a_step_is_drawn_over_the_steps(document: dict[str, Any]) -> None:
    blocks = _section("over-time", document).unfolded
    (plot,) = (
        block
        for block in blocks
        if isinstance(block, Plot) and block.title.startswith("Energy of a step")
    )
    # 15 and 45 nJ over 4 steps each, 5 nJ over 2; the last bin may be shorter and is left out. The largest energy is
    # 11.25 nJ per step.
    assert [plot.placed(curve) for curve in plot.curves] == [
        [(pytest.approx(1 / 6), pytest.approx(1 / 3)), (pytest.approx(1 / 2), 1.0)],
        [(pytest.approx(1 / 4), pytest.approx(2.5 / 11.25))],
    ]
    assert [text for _, text in plot.y.places] == ["5.00 nJ", "10.0 nJ"]


@pytest.mark.parametrize(
    ("low", "high", "numbers"),
    [
        pytest.param(0, 100, [0, 20, 40, 60, 80, 100], id="hundred"),
        pytest.param(-0.12, 0.02, [-0.1, -0.05, 0.0], id="small"),
        pytest.param(3, 3, [], id="empty"),
    ],
)
def test_about_six_round_numbers_lie_between_two_ends(
    low: float, high: float, numbers: list[float]
) -> None:
    assert round_numbers(low, high, about=6) == pytest.approx(numbers)


def test_one_step_has_one_tick() -> None:
    assert step_axis(range(7, 8), centred=True).places == [(0.5, "7")]


@pytest.mark.minutes
@pytest.mark.parametrize(
    ("neurons", "steps"), [(20_000, 20), (64, 10_000)], ids=["neurons", "steps"]
)
def test_large_networks_and_long_recordings_make_small_pages(neurons: int, steps: int) -> None:
    r = np.random.default_rng(0)
    weights = sparse.random(
        neurons, 100, density=0.05, random_state=0, data_rvs=lambda n: r.normal(1, 1, n)
    )
    network = single(Cuba.of(neurons, decay_v=0.5, threshold=3.0), weights, steps=steps)
    played = (r.random((1, steps, 100)) < 0.3).astype(np.uint8)
    compiled = lc.compile(network, events=played)
    assert len(render_html(compose(compiled.figures, compiled.excerpt)).encode()) < 500_000
