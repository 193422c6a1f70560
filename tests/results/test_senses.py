"""The study of touch, sight and sound, docs/research/senses.

Its scripts divide recordings correctly, continue an interrupted study, and count what a branch can see; its tables, page
and example configurations agree with each other. A made-up set of sixty recordings stands for the four sets of the
study, which are too large for the repository.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs/research/senses"))

import run_senses
from sense import Sense, balanced
from summary import BEGIN, END, TITLES, mean_of, reported_table, summary
from trainings import COLUMNS, Task, Training, read_rows, task_of, write_rows
from views import WHOLE, View, counts, measure, read_figures

from locsnn_compile.data.recordings import Recordings
from locsnn_compile.training.config import config_from_mapping, read_config
from locsnn_compile.training.event_counts import ridge_scores
from locsnn_compile.training.rates import rate_for_updates

STUDY = Path(run_senses.__file__).parent
RECORDINGS = 60
CHANNELS = 8
STEPS = 10
ROUNDS = 5
"""A share of 0.2 makes five test parts."""
FOLDS = 4
"""A share of 0.25 (``sense.FOLD_SHARE``) makes four parts to hold out."""
MADE_UP = Sense(name="made_up", file="made_up.npz", grid="4x1", tie="still", test_share=1 / ROUNDS)
"""A set without a published test part. Each of the 4 taxels of its grid has two polarities: 8 channels."""
CLASS_NAMES = np.array(["left", "right", "still"])
TASK = Task(
    sense="made_up",
    purpose="choose",
    network="tactile-snn",
    walk="",
    delays="0 2",
    hidden=4,
    options='{"theta": 2.0}',
    round=1,
    fold=1,
    seed=3,
    epochs=2,
)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a set of sixty recordings; channel and step of the only event of each give its number."""
    folder = tmp_path_factory.mktemp("sets")
    spikes = np.zeros((RECORDINGS, CHANNELS, STEPS), dtype=np.uint8)
    for number in range(RECORDINGS):
        spikes[number, number % CHANNELS, number // CHANNELS] = 1
    labels = np.arange(RECORDINGS) % len(CLASS_NAMES)
    np.savez(folder / "made_up.npz", spikes=spikes, labels=labels, class_names=CLASS_NAMES)
    return folder


def numbers(recordings: Recordings) -> list[int]:
    """Return the numbers of the recordings in the set, sorted, by their only events (see :func:`data`)."""
    _, step, channel = np.nonzero(recordings.spikes)
    return sorted((CHANNELS * step + channel).tolist())


def test_rounds_test_every_recording_once(data: Path) -> None:
    tested = [
        numbers(MADE_UP.to_report(data, round_number).measured)
        for round_number in range(1, ROUNDS + 1)
    ]
    assert sorted(chain.from_iterable(tested)) == list(range(RECORDINGS))


@pytest.mark.parametrize("round_number", [1, 4])
def test_networks_are_chosen_without_the_test_part(data: Path, round_number: int) -> None:
    reported = MADE_UP.to_report(data, round_number)
    held_out = []
    for fold in range(1, FOLDS + 1):
        parts = MADE_UP.to_choose(data, round_number, fold)
        together = numbers(parts.learned) + numbers(parts.measured)
        assert sorted(together) == numbers(reported.learned)
        held_out += numbers(parts.measured)
    assert sorted(held_out) == numbers(reported.learned)


def test_a_share_of_recordings_has_equally_many_of_each_class() -> None:
    labels = np.repeat([0, 1, 2], [50, 20, 20])
    recordings = Recordings(
        np.zeros((90, 2, 2), dtype=np.uint8), labels, step_seconds=None, source="made up"
    )
    assert np.bincount(balanced(recordings, 30).labels).tolist() == [10, 10, 10]


def test_an_entry_asks_for_rounds_folds_and_seeds() -> None:
    entries = [
        {"sense": "fsdd", "purpose": "choose", "network": "hybrid", "folds": [1, 2], "epochs": 5},
        {"sense": "fsdd", "purpose": "report", "network": "window-snn", "seeds": [0, 1]},
    ]
    plain = replace(TASK, sense="fsdd", delays="", hidden=0, options="{}", seed=0)
    chosen = replace(plain, purpose="choose", network="hybrid", round=1, epochs=5)
    # To report, no fold is held out: its number is 0. Without an entry `epochs` there is one.
    reported = replace(plain, purpose="report", network="window-snn", round=1, fold=0, epochs=1)
    assert list(run_senses.tasks(entries)) == [
        replace(chosen, fold=1),
        replace(chosen, fold=2),
        replace(reported, seed=0),
        replace(reported, seed=1),
    ]


def test_training_options_are_those_of_the_task_and_the_set() -> None:
    assert TASK.config(MADE_UP, Path("sets")) == {
        "model": "tactile-snn",
        "seed": 3,
        "epochs": 2,
        "validation_fraction": 0.0,
        "refit": False,
        "grid": "4x1",
        "tie": "still",
        "delays": "0 2",
        "hidden": 4,
        "theta": 2.0,
    }


def training_of(**results: float) -> Training:
    """Return a training on 36 of 48 recordings and measured on the other 12, on one core."""
    return Training(task=TASK, learned_from=36, measured_on=12, cores=1, **results)


def test_a_row_says_which_task_it_was(tmp_path: Path) -> None:
    training = training_of(
        float_accuracy=0.5,
        chip_accuracy=0.25,
        counts=0.1,
        counts_in_bins=0.2,
        energy_nj=3.5,
        seconds=0.7,
    )
    table = tmp_path / "trainings.csv"
    write_rows(table, [training.row()])
    (row,) = read_rows(table)
    assert tuple(row) == COLUMNS
    assert task_of(row) == TASK
    assert (row["float_accuracy"], row["chip_accuracy"], row["energy_nj"]) == ("0.5", "0.25", "3.5")


def test_a_study_goes_on_from_its_table(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(run_senses.SENSES, "made_up", MADE_UP)
    table = tmp_path / "trainings.csv"
    asked = tmp_path / "tasks.yaml"
    entry = "- {sense: made_up, purpose: choose, network: tactile-snn, hidden: 4, folds: [1]}\n"
    asked.write_text(entry)
    words = f"run_senses --data {data} --work {tmp_path} --table {table} --tasks {asked}".split()
    monkeypatch.setattr(sys, "argv", [*words, "--senses", "made_up"])
    run_senses.main()
    (first,) = read_rows(table)
    # The test part is 12 of 60 recordings; of the other 48, a fold of 12 is held out.
    assert (first["learned_from"], first["measured_on"]) == ("36", "12")
    checkpoints = list(tmp_path.glob("*.pt"))
    assert len(checkpoints) == 1

    asked.write_text(entry.replace("[1]", "[1, 2]"))
    checkpoints[0].unlink()
    run_senses.main()
    assert [row["fold"] for row in read_rows(table)] == ["1", "2"]
    assert read_rows(table)[0] == first
    assert len(list(tmp_path.glob("*.pt"))) == 1  # fold 1 was not trained again


def test_every_task_of_the_study_can_be_trained() -> None:
    entries = run_senses.entries_of(STUDY / "tasks.yaml")
    asked = list(run_senses.tasks(entries))
    assert len(set(asked)) == len(asked)
    for task in asked:
        sense = run_senses.SENSES[task.sense]
        config_from_mapping(task.config(sense, Path("data")))


def test_every_row_of_the_table_is_asked_for() -> None:
    asked = set(run_senses.tasks(run_senses.entries_of(STUDY / "tasks.yaml")))
    assert {task_of(row) for row in read_rows(STUDY / "trainings.csv")} <= asked


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        # Channels 0 to 3 over steps 0 to 2; bins of two steps, then the last step alone.
        pytest.param(View("time", "", 2), [1, 1, 0, 1, 1, 0, 1, 0], id="channels, coarse steps"),
        pytest.param(View("time", "", WHOLE), [2, 1, 1, 1], id="channels, all steps"),
        pytest.param(View("location", "", WHOLE), [1, 2, 2], id="steps, all channels"),
        # The walk 3, 0, 1, 2: channels 3 and 0 are a bin, channels 1 and 2 another.
        pytest.param(View("location", "a", 2), [1, 1, 1, 0, 1, 1], id="steps, coarse channels"),
    ],
)
def test_a_view_smears_one_axis(view: View, expected: list[int]) -> None:
    """Counts come bin by bin, and within a bin in the order of the axis that is not smeared."""
    recording = np.array([[1, 0, 0, 0], [0, 1, 0, 1], [1, 0, 1, 0]], dtype=np.uint8)
    walk = np.array([3, 0, 1, 2])
    assert counts(recording[np.newaxis], view, walk).tolist() == [expected]


def test_a_view_measures_recordings_that_it_did_not_learn_from(data: Path) -> None:
    parts = MADE_UP.to_choose(data, round_number=1, fold=2)
    figure = measure(MADE_UP, View("location", "reverse", width=2), parts, data, fold=2)
    # From the last taxel to the first; the two channels of a taxel, its polarities, stay in order.
    walk = [6, 7, 4, 5, 2, 3, 0, 1]
    # A bin is two channels of the walk. Counts are ordered by bin, then by step.
    bins = CHANNELS // 2
    known, unknown = (
        part.spikes[:, :, walk].reshape(len(part), STEPS, bins, 2).sum(axis=3).transpose(0, 2, 1)
        for part in (parts.learned, parts.measured)
    )
    scores = ridge_scores(
        known.reshape(len(known), -1).astype(float),
        parts.learned.labels,
        unknown.reshape(len(unknown), -1).astype(float),
    )
    right = float((scores.argmax(axis=1) == parts.measured.labels).mean())
    assert (figure.counts, figure.accuracy) == (bins * STEPS, round(right, 4))


def test_a_line_of_the_summary_is_over_rounds_folds_and_seeds() -> None:
    first = training_of(
        float_accuracy=0.5,
        chip_accuracy=0.25,
        counts=0.1,
        counts_in_bins=0.2,
        energy_nj=3.5,
        seconds=0.7,
    ).row()
    second = training_of(
        float_accuracy=0.7,
        chip_accuracy=0.35,
        counts=0.3,
        counts_in_bins=0.4,
        energy_nj=4.5,
        seconds=0.9,
    ).row() | {"seed": 4}
    other = first | {"hidden": 8}
    rows = [{name: str(value) for name, value in row.items()} for row in (first, second, other)]
    both, alone = summary(rows)
    assert both["trainings"] == "2"
    # The sample deviation of two values is their distance over the root of 2.
    assert (both["float_accuracy"], both["float_accuracy_sd"]) == ("0.600", "0.141")
    assert (both["chip_accuracy"], both["chip_accuracy_sd"]) == ("0.300", "0.071")
    assert (both["counts"], both["energy_nj"], both["cores"]) == ("0.200", "4.0", "1.0")
    assert (alone["trainings"], alone["float_accuracy_sd"]) == ("1", "")


def test_the_summary_is_that_of_the_table() -> None:
    lines = summary(read_rows(STUDY / "trainings.csv"))
    assert read_rows(STUDY / "summary.csv") == lines


def cells_of(line: str) -> list[str]:
    """Return the cells of a row of a Markdown table."""
    return [cell.strip() for cell in line.removeprefix("|").removesuffix("|").split("|")]


def rows_of_views() -> list[list[str]]:
    """Return the cells of the page's table of views."""
    page = (STUDY.parent / "senses.md").read_text("utf-8")
    _, table = page.split("| set | every channel, all steps |")
    # The first two lines are the rest of the heads, and the line of dashes.
    lines = table.split("\n\n")[0].splitlines()[2:]
    return [cells_of(line) for line in lines]


@pytest.mark.parametrize("cells", rows_of_views(), ids=lambda cells: f"{cells[0]}, {cells[5]}")
def test_the_views_of_the_page_are_those_of_the_table(cells: list[str]) -> None:
    # `time` has three cells: all steps in one bin, then bins of 20 and of 5 steps.
    title, *time, steps_alone, words, coarse, fine = cells
    # The name of the walk stands between backticks.
    walk = words.split("`")[1]
    figures = [row for row in read_figures(STUDY / "views.csv") if TITLES[row["sense"]] == title]
    expected = [mean_of(figures, "time", "", width) for width in (WHOLE, 20, 5)]
    expected += [mean_of(figures, "location", "", WHOLE)]
    expected += [mean_of(figures, "location", walk, width) for width in (20, 5)]
    assert [*time, steps_alone, coarse, fine] == [f"{figure:.3f}" for figure in expected]


CONFIGURED = {
    "grasps-hybrid": ("icub_grasp", 160, {"theta": 2.0}),
    "fsdd-hybrid": ("fsdd", 2_700, {}),
    "braille-hybrid": ("braille", 6_480, {}),
}
"""Configuration -> its set, the number of recordings that it learns from, and the options that ``locsnn train`` chooses
by the steps of a recording: a low threshold for the 24 steps of a grasp (``training/chosen.py: SHORT_THETA``)."""


@pytest.mark.parametrize("name", CONFIGURED)
def test_configurations_are_those_that_the_study_reports(name: str) -> None:
    """The study leaves the walk and the learning rate open; the configuration says what was chosen."""
    sense, recordings, by_length = CONFIGURED[name]
    written = read_config(STUDY.parents[2] / f"examples/configs/{name}.yaml")
    batch_size = config_from_mapping(written).batch_size
    updates = written["epochs"] * math.ceil(recordings / batch_size)
    # Options are chosen with two digits.
    chosen = {"order": "loop", "learning_rate": float(f"{rate_for_updates(updates):.2g}")}
    asked = [
        config_from_mapping(
            task.config(run_senses.SENSES[sense], Path("data"))
            | by_length
            | chosen
            | {"defaults": "fixed"}
        )
        for task in run_senses.tasks(run_senses.entries_of(STUDY / "tasks.yaml"))
        if (task.sense, task.purpose, task.seed) == (sense, "report", 0)
        and task.network == "hybrid"
        # The study also reports a hybrid with default options; the configuration is the other one.
        and task.options != "{}"
    ]
    of_files = {"layout": None, "split": None, "step_seconds": None}
    configuration = replace(config_from_mapping(written), **of_files)
    assert asked
    assert {replace(config, **of_files) for config in asked} == {configuration}


def test_the_test_figures_of_the_page_are_those_of_the_table() -> None:
    page = (STUDY.parent / "senses.md").read_text("utf-8")
    table = page.split(BEGIN)[1].split(END)[0]
    assert table == reported_table(read_rows(STUDY / "summary.csv"))


def test_a_row_of_test_figures_says_what_the_network_is() -> None:
    training = training_of(
        float_accuracy=0.5,
        chip_accuracy=0.25,
        counts=0.1,
        counts_in_bins=0.2,
        energy_nj=3.5,
        seconds=0.7,
    ).row()
    reported = training | {"sense": "fsdd", "purpose": "report"}
    lines = summary([{name: str(value) for name, value in reported.items()}])
    heads, _, row = reported_table(lines).splitlines()
    words = "`tactile-snn`, 4 neurons, delays of 0 to 2 steps, chosen options"
    assert dict(zip(cells_of(heads), cells_of(row), strict=True)) == {
        "set": "spoken digits",
        "network": words,
        "trainings": "1",
        "float": "0.500",
        "on the chip": "0.250",
        # One training has no deviation.
        "deviation": "",
        "nJ a recording": "4",
        "cores": "1.0",
    }
