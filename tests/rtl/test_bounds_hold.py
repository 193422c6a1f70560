"""Random and hostile recordings keep the bounds of shipped programs: modelled times, predicted cycles, and the core's own."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import bounds
import pytest

import hw_model as hw

MODEL = "two-fingertips"
ON_CORES = (("objects-hybrid", "ecp5-85f"), (MODEL, "ecp5-85f"), ("containers-hybrid", "ice40up5k"))


@pytest.mark.slow
def test_recordings_of_every_kind_keep_the_bounds_of_a_shipped_program(tmp_path: Path) -> None:
    state = tmp_path / "state.json"
    done: dict[str, dict[str, object]] = {}
    expected = bounds.TOGETHER * len(bounds.KINDS)
    bounds.play(f"{MODEL} on loihi-sim", expected, done, state)
    assert json.loads(state.read_text()) == done
    (result,) = done.values()
    assert result["recordings"] == expected
    # The share of the bound that the slowest recording reached: a bound far from it would be no use.
    assert 0.9 < result["nearest"]["recording"][0] <= 1
    # A run that goes on from a complete state plays nothing, and leaves the state as it is.
    before = state.read_bytes()
    bounds.play(f"{MODEL} on loihi-sim", expected, json.loads(before), state)
    assert state.read_bytes() == before


def test_a_bound_that_does_not_hold_ends_the_run(tmp_path: Path, monkeypatch) -> None:
    right_bound = hw.worst_case

    def too_low(program: hw.ChipProgram, rows: int, events: int) -> hw.WorstCase:
        return right_bound(program, rows, events_per_step=0)  # as if no events came

    monkeypatch.setattr(bounds.hw, "worst_case", too_low)
    with pytest.raises(SystemExit, match=f"{MODEL} on loihi-sim: any rate, recordings from 0 on: "):
        bounds.play(f"{MODEL} on loihi-sim", bounds.TOGETHER, {}, tmp_path / "state.json")


@pytest.mark.minutes
@pytest.mark.parametrize("model", bounds.MODELS)
def test_a_thousand_recordings_keep_the_bounds(model: str, tmp_path: Path) -> None:
    bounds.play(f"{model} on loihi-sim", 1_000, {}, tmp_path / "state.json")


@pytest.mark.minutes
@pytest.mark.skipif(shutil.which("verilator") is None, reason="Verilator is not installed")
@pytest.mark.parametrize(("model", "target"), ON_CORES)
def test_the_core_itself_keeps_the_bounds(model: str, target: str) -> None:
    each_kind = len(bounds.KINDS)
    *_, recordings, values, least, most, _ = bounds.play_on_core(model, target, each_kind)
    assert recordings == each_kind
    assert values > 0  # were compared with the simulator
    # The shares of the bound that recordings took.
    assert 0 < float(least) <= float(most) <= 1


def test_the_page_has_the_table_of_the_run() -> None:
    folder = Path(bounds.__file__).parent
    with (folder / "bounds.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["program", "target", "recordings", "step", "answer", "recording", "kind"]
    page = (folder / "bounds.md").read_text("utf-8")
    table = page.split("<!-- bounds: begin -->\n")[1].split("<!-- bounds: end -->")[0]
    of_page = [
        [cell.strip(" `") for cell in line.strip("|").split("|")] for line in table.splitlines()
    ]
    assert of_page[2:] == [[row[0], f"{int(row[2]):,}", *row[3:]] for row in rows]
    # Of step, answer and recording. A cell is empty where the program has no such bound.
    shares_of_bounds = [share for row in rows for share in row[3:6]]
    assert all(float(share or 0) <= 1 for share in shares_of_bounds)


def test_the_page_has_the_table_of_the_core() -> None:
    folder = Path(bounds.__file__).parent
    with (folder / "bounds-on-core.csv").open() as file:
        rows = list(csv.DictReader(file))
    page = (folder / "bounds.md").read_text("utf-8")
    table = page.split("<!-- on core: begin -->\n")[1].split("<!-- on core: end -->")[0]
    of_page = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    expected = []
    for row in rows:
        values = f"{int(row['values']):,}"
        of_row = [row["program"], row["target"], row["recordings"], values, row["most"]]
        expected.append([*of_row, row["kind"]])
    assert of_page[2:] == expected
    assert all(float(row["most"]) <= 1 for row in rows)
