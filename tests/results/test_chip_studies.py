"""What the studies on the chip do to recordings, and what they read off scores; pictures of what is there."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

STUDY = Path(__file__).parents[2] / "docs/research/results"


@pytest.fixture(autouse=True)
def own_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(STUDY))


def spikes() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return (np.random.default_rng(0).random((6, 100, 78)) < 0.3).astype(np.uint8)


@pytest.mark.parametrize(("share", "dead"), [(0.05, 2), (0.1, 4), (0.2, 8)])
def test_dead_taxels_lose_both_polarities_in_every_recording(share: float, dead: int) -> None:
    from broken_sensors import dead_taxels

    given = spikes()
    found = dead_taxels(share)(given, np.random.default_rng(1))
    silent = ~found.reshape(6, 100, 39, 2).any(axis=(0, 1, 3))
    assert silent.sum() == dead
    assert np.array_equal(
        found.reshape(6, 100, 39, 2)[:, :, ~silent], given.reshape(6, 100, 39, 2)[:, :, ~silent]
    )


def test_lost_events_are_lost_and_none_is_new() -> None:
    from broken_sensors import lost_events

    given = spikes()
    found = lost_events(0.2)(given, np.random.default_rng(1))
    assert (found <= given).all()
    assert found.sum() / given.sum() == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize(
    ("rate", "wanted"), [(1.0, [0, 10, 99]), (0.9, [0, 9, 89]), (1.1, [0, 11])]
)
def test_a_clock_moves_events(rate: float, wanted: list[int]) -> None:
    from broken_sensors import clock

    given = np.zeros((1, 100, 2), dtype=np.uint8)
    given[0, [0, 10, 99], 1] = 1
    found = clock(rate)(given, np.random.default_rng(1))
    assert np.flatnonzero(found[0, :, 1]).tolist() == wanted
    assert not found[0, :, 0].any()


def test_the_margin_is_the_smallest_that_keeps_the_accuracy() -> None:
    from early_answers import margin_of

    labels = np.array([0, 0])
    scores = np.zeros((2, 3, 2))
    scores[0] = [[0, 2], [5, 0], [9, 0]]  # wrong by a lead of 2, then right
    scores[1] = [[3, 0], [4, 0], [8, 0]]
    assert 2 < margin_of(scores, labels) <= 3
    scores[:, -1] = [[0, 1], [0, 1]]  # nothing is right at the end, so the first lead is enough
    assert margin_of(scores, labels) == 1


def test_the_points_name_files_that_ship_or_are_made() -> None:
    from early_answers import EARLY
    from energy_front import POINTS
    from result_rows import DATASETS, ROW_NAMES, SEEDS
    from study import MODELS, SHIPPED

    made = {f"{dataset}-{row}-{{}}.pt" for dataset in DATASETS for row in ROW_NAMES}
    made |= {name.format(seed) for name in made for seed in SEEDS}
    for name in {name for point in POINTS for name in point.files} | {
        shipped.file for shipped in (*SHIPPED, *EARLY)
    }:
        assert name in made or (MODELS / name).exists(), name


def test_points_whose_networks_are_gone_stay() -> None:
    from energy_front import over

    stood = ["Objects", "A", "windows", "auto, 8 bits", "0.900 ± 0.010", "5.00", "21"]
    other = ["Objects", "A", "windows", "auto, 4 bits", "0.890 ± 0.010", "4.00", "18"]
    fewer, all_seeds = (
        [*stood[:4], right, "6.00", "21"] for right in ("0.950 (1 of 5 seeds)", "0.910 ± 0.020")
    )
    assert over([stood, other], []) == [stood, other]
    assert over([stood, other], [fewer]) == [stood, other]
    assert over([stood, other], [all_seeds]) == [all_seeds, other]
    assert over([], [fewer]) == [fewer]


def test_confusions_come_apart_into_containers_and_levels(tmp_path: Path) -> None:
    from paper_pictures import apart, counts_of

    figures = {"classes": 20, "labels": [0, 6, 6], "predictions": [1, 6, 16]}
    (tmp_path / "one.json").write_text(json.dumps(figures))
    counts = counts_of([tmp_path / "one.json"] * 2)
    assert counts is not None
    containers, levels = apart(counts)
    assert (containers[0, 0], containers[1, 1], containers[1, 3], containers.sum()) == (2, 2, 2, 6)
    assert (levels[0, 1], levels[1, 1], levels.sum()) == (2, 4, 6)


def test_pictures_are_drawn_of_the_tables_that_ship(tmp_path: Path) -> None:
    import paper_pictures
    from result_pictures import STYLE

    mpl.use("svg")
    tables = STUDY
    with mpl.rc_context(STYLE):
        drawn = [
            paper_pictures.orders(),
            *(draw(tables) for draw in (paper_pictures.operations, paper_pictures.front)),
        ]
        assert all(figure is not None for figure in drawn)
        assert (
            paper_pictures.levels(tmp_path)
            is paper_pictures.profiles(tmp_path)
            is paper_pictures.curves(tmp_path)
            is paper_pictures.containers(tmp_path)
            is None
        )


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
    rows = np.flatnonzero(np.arange(48) % 4 != 0)
    shares = [share_of(labels, rows, share, 1) for share in (0.25, 0.5, 1.0)]
    assert [np.bincount(labels[share]).tolist() for share in shares] == [[2] * 4, [4] * 4, [9] * 4]
    assert set(shares[0]) < set(shares[1]) < set(shares[2]) == set(rows)
