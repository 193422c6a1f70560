"""The studies of ``docs/research/results`` on the chip: broken sensors, margins, points of energy, confusions and pictures.

Expected values are worked out by hand on small made-up recordings, scores and tables.
"""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

STUDY = Path(__file__).parents[2] / "docs/research/results"


@pytest.fixture(autouse=True)
def study_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let tests import the programs that lie next to their page."""
    monkeypatch.syspath_prepend(str(STUDY))


def spikes() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return 6 random recordings of 100 steps of one fingertip: 39 taxels with 2 polarities each, 78 channels."""
    return (np.random.default_rng(0).random((6, 100, 78)) < 0.3).astype(np.uint8)


# Shares of 39 taxels, rounded.
@pytest.mark.parametrize(("share", "dead"), [(0.05, 2), (0.1, 4), (0.2, 8)])
def test_dead_taxels_lose_both_polarities_in_every_recording(share: float, dead: int) -> None:
    from broken_sensors import dead_taxels

    recordings = spikes()
    changed = dead_taxels(share)(recordings, np.random.default_rng(1))
    silent = ~changed.reshape(6, 100, 39, 2).any(axis=(0, 1, 3))
    assert silent.sum() == dead
    assert np.array_equal(
        changed.reshape(6, 100, 39, 2)[:, :, ~silent],
        recordings.reshape(6, 100, 39, 2)[:, :, ~silent],
    )


def test_lost_events_are_lost_and_none_is_new() -> None:
    from broken_sensors import lost_events

    recordings = spikes()
    changed = lost_events(0.2)(recordings, np.random.default_rng(1))
    assert (changed <= recordings).all()
    # Of about 14,000 events, the share that stays has a deviation of 0.003.
    assert changed.sum() / recordings.sum() == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize(
    ("rate", "expected"), [(1.0, [0, 10, 99]), (0.9, [0, 9, 89]), (1.1, [0, 11])]
)
def test_a_clock_that_is_off_moves_events_and_loses_those_after_the_end(
    rate: float, expected: list[int]
) -> None:
    from broken_sensors import clock

    recording = np.zeros((1, 100, 2), dtype=np.uint8)
    recording[0, [0, 10, 99], 1] = 1
    changed = clock(rate)(recording, np.random.default_rng(1))
    assert np.flatnonzero(changed[0, :, 1]).tolist() == expected
    assert not changed[0, :, 0].any()


def test_the_margin_is_the_smallest_that_keeps_the_accuracy() -> None:
    from early_answers import margin_of

    labels = np.array([0, 0])
    scores = np.zeros((2, 3, 2))
    scores[0] = [[0, 2], [5, 0], [9, 0]]  # wrong by a lead of 2, then right
    scores[1] = [[3, 0], [4, 0], [8, 0]]
    # With a lead of at most 2 the first recording stops at once, and is wrong. Leads above 3 only stop later.
    assert 2 < margin_of(scores, labels) <= 3
    scores[:, -1] = [[0, 1], [0, 1]]  # nothing is right at the end, so the first lead is enough
    assert margin_of(scores, labels) == 1


def test_points_and_early_networks_name_files_that_ship_or_that_the_results_make() -> None:
    from early_answers import EARLY
    from energy_front import POINTS
    from result_rows import DATASETS, ROW_NAMES, SEEDS
    from study import MODELS, SHIPPED

    made_files = {f"{dataset}-{row}-{{}}.pt" for dataset in DATASETS for row in ROW_NAMES}
    made_files |= {name.format(seed) for name in made_files for seed in SEEDS}
    for name in {name for point in POINTS for name in point.files} | {
        shipped.file for shipped in (*SHIPPED, *EARLY)
    }:
        assert name in made_files or (MODELS / name).exists(), name


def test_points_stay_unless_as_many_seeds_replace_them() -> None:
    from energy_front import over

    point = ["Objects", "A", "windows", "auto, 8 bits", "0.900 ± 0.010", "5.00", "21"]
    other_point = ["Objects", "A", "windows", "auto, 4 bits", "0.890 ± 0.010", "4.00", "18"]
    from_one_seed, from_five_seeds = (
        [*point[:4], right, "6.00", "21"] for right in ("0.950 (1 of 5 seeds)", "0.910 ± 0.020")
    )
    assert over([point, other_point], []) == [point, other_point]
    assert over([point, other_point], [from_one_seed]) == [point, other_point]
    assert over([point, other_point], [from_five_seeds]) == [from_five_seeds, other_point]
    assert over([], [from_one_seed]) == [from_one_seed]


def test_confusions_come_apart_into_containers_and_levels(tmp_path: Path) -> None:
    from paper_pictures import apart, counts_of

    figures = {"classes": 20, "labels": [0, 6, 6], "predictions": [1, 6, 16]}
    (tmp_path / "one.json").write_text(json.dumps(figures))
    counts = counts_of([tmp_path / "one.json"] * 2)
    assert counts is not None
    containers, levels = apart(counts)
    assert (containers[0, 0], containers[1, 1], containers[1, 3], containers.sum()) == (2, 2, 2, 6)
    assert (levels[0, 1], levels[1, 1], levels.sum()) == (2, 4, 6)


def test_pictures_are_drawn_from_the_tables_that_ship_and_not_without_figures(
    tmp_path: Path,
) -> None:
    import paper_pictures
    from result_pictures import STYLE

    mpl.use("svg")
    tables = STUDY
    with mpl.rc_context(STYLE):
        assert paper_pictures.orders() is not None
        assert paper_pictures.operations(tables) is not None
        assert paper_pictures.front(tables) is not None
        # This folder is empty.
        assert paper_pictures.levels(tmp_path) is None
        assert paper_pictures.profiles(tmp_path) is None
        assert paper_pictures.curves(tmp_path) is None
        assert paper_pictures.containers(tmp_path) is None


def test_confusions_of_two_networks_are_of_the_seeds_that_both_have(tmp_path: Path) -> None:
    import paper_pictures
    from result_pictures import STYLE

    figures = {
        "classes": 20,
        "labels": list(range(20)),
        "predictions": [0] * 10 + list(range(10, 20)),
    }
    for name in ("tactile-snn-0", "tactile-snn-1", "hybrid-1", "hybrid-2"):
        (tmp_path / f"containers-{name}.json").write_text(json.dumps(figures))
    mpl.use("svg")
    with mpl.rc_context(STYLE):
        drawn = paper_pictures.containers(tmp_path)
    assert drawn is not None
    assert [axes.get_title() for axes in drawn.axes] == [
        "Tactile-SNN\n0.55 of 20 predictions right",
        "Hybrid\n0.55 of 20 predictions right",
    ]


def test_a_share_has_as_many_of_every_class_and_is_part_of_larger_ones() -> None:
    from learning_curve import share_of

    labels = np.repeat(np.arange(4), 12)
    # Three of four folds: 9 of the 12 recordings of each class.
    rows = np.flatnonzero(np.arange(48) % 4 != 0)
    shares = [share_of(labels, rows, share, 1) for share in (0.25, 0.5, 1.0)]
    assert [np.bincount(labels[share]).tolist() for share in shares] == [[2] * 4, [4] * 4, [9] * 4]
    assert set(shares[0]) < set(shares[1]) < set(shares[2]) == set(rows)
