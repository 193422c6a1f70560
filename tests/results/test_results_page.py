"""The results page: what it computes from figures of runs, what it says of missing ones, and that its commands parse.

Figures of runs are made up, so that means, deviations and ratios can be checked by hand; the page that ships must follow from its
tables and templates.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from locsnn_compile.cli.shell import add_command
from locsnn_compile.data.read import read_recordings

STUDY = Path(__file__).parents[2] / "docs/research/results"


@pytest.fixture(autouse=True)
def study_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let tests import the programs that lie next to their page."""
    monkeypatch.syspath_prepend(str(STUDY))


def figures(**own: Any) -> dict[str, Any]:
    """Return the figures of a made-up run of the hybrid on two recordings of Containers; ``own`` replaces some."""
    return {
        "epochs": 10, "chosen_epoch": 8, "validation_accuracy": 0.5, "test_accuracy": 0.75, "test_recordings": 4,
        "steps": 325, "fingertips": 1, "classes": 20, "chip_accuracy": 0.5, "reference_accuracy": 0.75,
        "spike_agreement": 0.9, "prediction_agreement": 0.8, "additions": {"time": [100, 300], "location": [50, 150]},
        "transposed": [10, 30], "energy_pj": 2e6, "predictions": [0, 1, 1, 3], "labels": [0, 1, 2, 3], "psi": 10.0,
        "chip": dict.fromkeys(("synaptic_ops", "neuron_updates", "spikes", "input_events", "transpose_events"), 7.0),
        "synaptic_ops": [100, 300],
        "right": {"together": [0.0, 0.5]}, "command": "",
    } | own  # fmt: skip


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """Return a folder with the figures of two seeds of the hybrid on Containers, and none of any other network."""
    for seed, accuracy in ((0, 0.75), (1, 0.25)):
        text = json.dumps(figures(test_accuracy=accuracy))
        (tmp_path / f"containers-hybrid-{seed}.json").write_text(text)
    return tmp_path


def test_ratios_of_the_printed_operations_are_those_of_the_other_column() -> None:
    from operation_tables import PRINTED_RATIOS, corrected_ratios

    assert corrected_ratios() == ["13.90-19.78", "9.81-14.30", "77.78-121.78"]
    assert (PRINTED_RATIOS[1], PRINTED_RATIOS[2]) == (corrected_ratios()[0], corrected_ratios()[2])


def test_published_operations_of_artificial_networks_are_ours_rounded() -> None:
    from operation_tables import ann_table
    from tables import markdown

    assert markdown(ann_table()).splitlines()[2:4] == [
        "| GRU-MLP | 11.87 | 11,868,704 | 11.87 | 11,867,680 | 5.48 | 5,476,928 |",
        "| CNN-3D | 8.34 | 8,340,480 | 8.14 | 8,140,800 | 3.5 | 3,501,120 |",
    ]


def test_a_row_has_mean_and_deviation_of_the_seeds_that_are_there(work: Path) -> None:
    from results_page import accuracy, read
    from tables import markdown

    lines = {line.split(" | ")[0]: line for line in markdown(accuracy(read(work))).splitlines()}
    assert lines["| Hybrid, lambda 1, loop"] == (
        "| Hybrid, lambda 1, loop | 0.91 | not run | not run | 0.86 | 0.500 ± 0.354 (2 of 5 seeds) "
        "| 0.500 ± 0.000 (2 of 5 seeds) | 1.0 | not run | not run |"
    )


def test_operations_by_branch_with_the_transposition(work: Path) -> None:
    from operation_tables import operations, ratios
    from results_page import read

    runs = read(work)
    assert operations(runs)[1] == [
        ["Hybrid, lambda 1, loop, Containers: SNN_TSRM", "200", "200", "300", "300"],
        ["Hybrid, lambda 1, loop, Containers: SNN_LSRM", "100", "100", "150", "150"],
        ["Hybrid, lambda 1, loop, Containers: events transposed", "20", "20", "30", "30"],
        ["Hybrid, lambda 1, loop, Containers: together", "320", "320", "480", "480"],
    ]
    assert ratios(runs)[1][1] == [
        "Hybrid, lambda 1, loop, Containers, against CNN-3D", "4,070,400", "12720.0", "8480.0", "8480.0",
    ]  # fmt: skip


def test_multiplications_and_additions_stand_apart(work: Path) -> None:
    """CNN-3D has no operation but multiplications followed by additions, half of 4,070,400 each."""
    from operation_tables import costs, operations
    from results_page import read

    _, cnn_3d, hybrid = costs(operations(read(work)))[1]
    assert cnn_3d == ["CNN-3D, Containers", "2,035,200", "2,035,200", "", "", ""]
    assert hybrid == ["Hybrid, lambda 1, loop, Containers", "0", "320", "62 %", "31 %", "6 %"]


def test_ratios_to_the_synaptic_operations_of_the_chip_say_of_how_many_seeds(work: Path) -> None:
    from operation_tables import chip_ratios
    from results_page import read

    (work / "objects-windows-and-hybrid-0.json").write_text(
        json.dumps(figures(steps=250, classes=36))
    )
    (work / "containers-cnn-3d-0.json").write_text(json.dumps({"test_accuracy": 0.5}))
    one, two = " (1 of 5 seeds)", " (2 of 5 seeds)"
    assert chip_ratios(read(work))[1] == [
        ["Window-SNN and hybrid, joined, Objects", "networks joined", f"0.500{one}",
         f"200{one}", f"300{one}", f"15685.2{one}", f"10456.8{one}"],
        ["Hybrid, lambda 1, loop, Containers", "one network", f"0.500 ± 0.000{two}",
         f"200{two}", f"300{two}", f"20352.0{two}", f"13568.0{two}"],
    ]  # fmt: skip


def test_few_seeds_fill_only_the_operations_that_were_not_counted(work: Path) -> None:
    from results_page import read, write_tables
    from tables import NOT_RUN, write_table

    tables = write_tables(read(work), work / "results")
    head, rows = tables["chip-ratios"]
    write_table(
        work / "results/chip-ratios.csv", (head, [[*rows[0][:3], "7", NOT_RUN, "9.9", NOT_RUN]])
    )
    (work / "containers-hybrid-1.json").unlink()
    tables_of_one_seed = write_tables(read(work), work / "results")
    assert tables_of_one_seed["chip-ratios"][1][0][3:] == [
        "7",
        "300 (1 of 5 seeds)",
        "9.9",
        "13568.0 (1 of 5 seeds)",
    ]
    assert tables_of_one_seed["accuracy"] == tables["accuracy"]


def test_confusions_name_the_pairs(work: Path) -> None:
    from results_page import confusions, read

    assert confusions(read(work))[1] == [
        ["Hybrid, lambda 1, loop, Containers", "2", "2 taken for 1: 2"]
    ]


def test_five_splits_stand_next_to_five_seeds(work: Path) -> None:
    from results_page import accuracy, read, splits_beside_seeds

    # 0.5, 0.6 and 0.7 twice: 0.62 in the mean, squared errors of 0.0280 together, a quarter of which is 0.0837 squared.
    split_by_split = ["0.5000", "0.6000", "0.7000", "0.7000", "0.6000"]
    splits = (
        ["network", *(f"split {number}" for number in range(1, 6))],
        [
            ["Hybrid, lambda 1, loop, Containers", *split_by_split],
            ["Hybrid, published training, Containers", *split_by_split[:4], "not run"],
        ],
    )
    assert splits_beside_seeds(splits, accuracy(read(work)))[1] == [
        [
            "Hybrid, lambda 1, loop, Containers",
            "0.86",
            "0.620 ± 0.084",
            "0.500 ± 0.354 (2 of 5 seeds)",
        ]
    ]


def test_missing_rows_are_named_where_they_belong(work: Path) -> None:
    from results_page import accuracy, missing, read

    objects, containers, _ = missing(accuracy(read(work))).splitlines()
    assert containers.startswith(
        "- Containers: Tactile-SNN; TactileSGNet (12 min per seed); GRU-MLP (3 min per seed); CNN-3D; "
    )
    assert "; Hybrid, lambda 1, loop (2 of 5 seeds); " in containers
    assert ("joined" in objects, "neighbouring levels" in objects) == (True, False)
    assert ("joined" in containers, "neighbouring levels" in containers) == (False, True)


def test_missing_seeds_say_how_many_are_there_and_how_long_one_takes() -> None:
    from results_page import missing
    from tables import NOT_RUN

    row = ["TactileSGNet", "", "0.5 (1 of 5 seeds)", "", "", "0.5 ± 0.1", "", "", NOT_RUN, ""]
    assert missing(([], [row])).splitlines() == [
        "- Objects: TactileSGNet (1 of 5 seeds, 18 min per seed).",
        "- Slip (synthetic): TactileSGNet (1 min per seed).",
    ]


def test_every_part_of_the_page_is_filled(work: Path) -> None:
    from results_page import pages, read, write_tables

    for runs in (read(work), {}):
        assert not [
            text
            for text in pages(write_tables(runs, work / "results"), None).values()
            if "{{" in text
        ]


def test_the_pages_are_those_of_their_tables_and_templates(tmp_path: Path) -> None:
    from results_page import pages, write_tables
    from tables import read_table

    docs = STUDY.parent
    shutil.copytree(docs / "results", tmp_path / "results")
    splits = read_table(docs / "results/splits.csv")
    texts = pages(write_tables({}, tmp_path / "results"), splits)
    assert texts["results"] == (docs / "results.md").read_text(encoding="utf-8")
    assert texts["operations"] == (docs / "results/operations.md").read_text(encoding="utf-8")


def test_long_tables_are_files_next_to_the_page(work: Path) -> None:
    import chip_studies
    from results_page import TABLES, read, write_tables

    write_tables(read(work), work / "results")
    assert {path.stem for path in (work / "results").iterdir()} == {*TABLES}
    written = (work / "results/confusions.csv").read_text(encoding="utf-8")
    assert written.splitlines()[1] == '"Hybrid, lambda 1, loop, Containers",2,2 taken for 1: 2'
    # Tables of other programs, and of runs that no program repeats (what-was-tried.md).
    tried = {"tried-hybrid", "tried-training", "tried-windows"}
    assert {path.stem for path in STUDY.glob("*.csv")} == {
        *TABLES,
        *chip_studies.TABLES,
        *tried,
        "data",
        "first-try",
        "learning-curve",
        "splits",
    }


def test_rows_without_figures_keep_what_stands_in_the_file(work: Path) -> None:
    from results_page import read, write_tables
    from tables import NOT_RUN, write_table

    folder = work / "results"
    tables = write_tables(read(work), folder)
    (head, rows), before_chip = tables["accuracy"], tables["chip"]
    number_of_label = {row[0]: k for k, row in enumerate(rows)}
    measured = ["0.9", "0.700 ± 0.100", "0.600 (1 of 5 seeds)"]
    rows[number_of_label["Hybrid, lambda 1, loop"]][4:7] = measured
    rows[number_of_label["Tactile-SNN"]][5:7] = measured[1:]
    write_table(folder / "accuracy.csv", (head, rows))
    row_of_label = dict((row[0], row) for row in write_tables(read(work), folder)["accuracy"][1])
    # Five seeds stay against two, in every column, and what was measured elsewhere stays.
    assert row_of_label["Hybrid, lambda 1, loop"][4:7] == ["0.86", *measured[1:]]
    assert row_of_label["Tactile-SNN"][5:7] == measured[1:]
    assert row_of_label["CNN-3D"][5:7] == [NOT_RUN, NOT_RUN]
    chip = write_tables({}, folder)["chip"]
    assert chip == before_chip


def test_commands_are_those_of_locsnn_train() -> None:
    from measure_run import config_of
    from result_rows import DATASETS, ROWS, command

    parser = argparse.ArgumentParser()
    add_command(parser.add_subparsers(), "train")
    for row in (row for row in ROWS if not row.parts):
        for dataset in DATASETS.values():
            args = parser.parse_args(command(row, dataset, 3).split()[1:])
            config = config_of(row, dataset, 3)
            assert (args.seed, args.model or "hybrid", args.order or "loop", args.location_weight or 1.0) == (
                config.seed, config.model, config.order, config.location_weight,
            )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "trained", "files"),
    [
        ("windows-and-hybrid", "hybrid window-snn", "hybrid.pt window-snn.pt"),
        (
            "three-windows-and-hybrid",
            "hybrid window-snn window-snn-quarter window-snn-prototypes",
            "hybrid.pt window-snn.pt window-snn-quarter.pt window-snn-prototypes.pt",
        ),
        (
            "three-windows-and-trained-hybrid",
            "hybrid window-snn window-snn-quarter window-snn-prototypes hybrid-reset",
            "hybrid-reset.pt window-snn.pt window-snn-quarter.pt window-snn-prototypes.pt",
        ),
    ],
    ids=["windows and hybrid", "three windows", "a hybrid trained further"],
)
def test_commands_of_a_joined_row_train_its_parts_on_the_whole_train_part(
    name: str, trained: str, files: str
) -> None:
    from measure_run import part_config
    from result_rows import DATASETS, ROWS, command

    parser = argparse.ArgumentParser()
    add_command(parser.add_subparsers(), "train")
    row = next(row for row in ROWS if row.name == name)
    *lines, joined = command(row, DATASETS["objects"], 3).split(" && ")
    for line, part in zip(lines, trained.split(), strict=True):
        args, config = (
            parser.parse_args(line.split()[1:]),
            part_config(part, DATASETS["objects"], 3),
        )
        assert (args.seed, args.validation_fraction, args.output) == (3, 0.0, f"{part}.pt")
        assert (config.seed, config.validation_fraction) == (3, 0.0)
        assert part.startswith(config.model)
        assert args.config == f"examples/configs/objects-{part}.yaml"
        assert args.from_model == ("hybrid.pt" if part == row.further else None)
    assert (
        joined
        == f"python docs/research/results/join_branches.py {files} -o {name}.pt --test Ev-Objects.zip"
    )


def test_slip_is_synthetic_and_small() -> None:
    from measure_run import parts
    from result_rows import DATASETS

    train_part, test_part = parts(Path("nowhere"), DATASETS["slip"])
    assert (train_part.spikes.shape, test_part.spikes.shape) == ((80, 150, 78), (20, 150, 78))
    assert (train_part.source, train_part.step_seconds) == ("synthetic touches", 0.001)


def test_slip_is_trained_with_the_configuration_of_objects() -> None:
    from result_rows import DATASETS, ROWS

    row = next(row for row in ROWS if row.name == "window-snn")
    assert [row.config_for(dataset) for dataset in DATASETS.values()] == [
        "objects-window-snn.yaml", "containers-window-snn.yaml", "objects-window-snn.yaml",
    ]  # fmt: skip


def test_slip_recordings_are_written_where_the_commands_look(tmp_path: Path) -> None:
    from measure_run import parts
    from result_rows import DATASETS

    subprocess.run([sys.executable, STUDY / "slip_recordings.py"], cwd=tmp_path, check=True)
    for name, expected in zip(
        ("slip.npz", "slip-test.npz"), parts(tmp_path, DATASETS["slip"]), strict=True
    ):
        written = read_recordings(tmp_path / name)
        assert np.array_equal(written.spikes, expected.spikes)
        assert np.array_equal(written.labels, expected.labels)
        assert written.step_seconds == expected.step_seconds
