"""``--profile``: the costs of a build and of a run, from the chip or from a file.

Energies and times are compared with counts times the constants of a profile that is written here, and every breakdown
must add up to its total.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from locsnn_compile.cli.compile import main as compile_model
from locsnn_compile.cli.main import main as locsnn

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid-loihi.pt"
MINE = {
    "source": "our board, run 7",
    "basis": "measured on one board",
    "energy_pj": {"synaptic_ops": 30.0, "neuron_updates": 70.0, "input_events": 100.0},
    "energy_pj_range": {"synaptic_ops": [25.0, 35.0]},
    "time_ns": {"synaptic_ops": 4.0},
    "barrier_ns": {"one_tile": 0.0, "all_tiles": 0.0},
    "not_included": ["host"],
}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Two short recordings, a profile and a build that is priced by it."""
    folder = tmp_path_factory.mktemp("priced")
    np.save(
        folder / "few.npy", (np.random.default_rng(0).random((2, 78, 60)) < 0.1).astype(np.uint8)
    )
    (folder / "board.yaml").write_text(yaml.safe_dump(MINE))
    arguments = [
        MODEL,
        "--events",
        folder / "few.npy",
        "--profile",
        folder / "board.yaml",
        "-o",
        folder / "out",
        "--quiet",
    ]
    assert compile_model([str(argument) for argument in arguments]) == 0
    return folder, json.loads((folder / "out/report.json").read_text())


def test_a_build_is_priced_by_a_file(built):
    _, report = built
    energy, counts = report["energy"], report["operations"]["per_sample"]
    assert (energy["profile"], report["latency"]["profile"]) == ("board", "board")
    assert (energy["source"], energy["voltage_v"], energy["static"]) == (
        "our board, run 7",
        None,
        None,
    )
    assert list(energy["other_profiles_pj"]) == ["davies2018", "sanafe"]
    synapses, updates, inputs = (
        counts[name] for name in ("synaptic_ops", "neuron_updates", "input_events")
    )
    assert energy["breakdown_pj"] == pytest.approx(
        {
            "synaptic_ops": 30 * synapses,
            "neuron_updates": 70 * updates,
            "input_events": 100 * inputs,
        }
    )
    fixed = 70 * updates + 100 * inputs
    assert energy["range_pj"] == pytest.approx([25 * synapses + fixed, 35 * synapses + fixed])
    assert energy["elsewhere_pj"] == pytest.approx(100 * inputs)
    assert energy["not_included_bounds"] == [
        {"what": "host", "at_most_pj": None, "bound_source": None}
    ]


def test_breakdowns_of_a_build_add_up(built):
    energy = built[1]["energy"]
    total = pytest.approx(energy["per_sample_pj"], rel=1e-12)
    assert sum(energy["breakdown_pj"].values()) == total
    assert sum(energy["by_branch_pj"].values()) == total
    assert (
        sum(pj for branch in energy["by_branch_breakdown_pj"].values() for pj in branch.values())
        == total
    )
    populations = energy["by_population_pj"]
    for population in populations.values():
        assert sum(population["compartments"].values()) == pytest.approx(
            population["pj"], rel=1e-12
        )
    for parts in (
        [population["pj"] for population in populations.values()],
        [row["pj"] for row in energy["by_core_pj"]],
        [pj for course in energy["by_step_pj"].values() for pj in course["bins"]],
    ):
        assert sum(parts) + energy["elsewhere_pj"] == total


def test_times_of_a_build_add_up(built):
    latency = built[1]["latency"]
    total = pytest.approx(latency["per_sample_ns"], rel=1e-12)
    for parts in (
        latency["by_branch_ns"].values(),
        latency["by_part_ns"].values(),
        [ns for branch in latency["by_branch_part_ns"].values() for ns in branch.values()],
        [ns for course in latency["by_step_ns"].values() for ns in course["bins"]],
        [row["last_ns"] for row in latency["by_core"]],
        [row["ns"] for row in latency["critical_paths"]],
    ):
        assert sum(parts) == total
    events = built[1]["operations"]["per_sample"]["transpose_events"]
    assert latency["by_part_ns"]["buffer"] == pytest.approx(events)
    assert latency["range_ns"] == [total, total]
    real_time = latency["real_time"]
    assert real_time["factor"] == pytest.approx(latency["recording_ns"] / latency["per_sample_ns"])
    # The last row is silent and this profile's barrier takes no time: what is left is the location branch.
    assert latency["after_last_row_ns"]["mean"] == latency["by_branch_ns"]["location"]


def test_the_report_names_every_constant(built):
    page = (built[0] / "out/report.md").read_text()
    assert "| synaptic operations | 30 pJ (25 to 35) | 4 ns | our board, run 7 |" in page
    assert "**Constants of profile board: measured on one board; voltage not stated**" in page
    assert "| host | not known | – |" in page  # noqa: RUF001 - an en dash stands for a number that does not exist


def test_static_energy_stands_apart(built, tmp_path):
    few = str(built[0] / "few.npy")
    assert compile_model([str(MODEL), "--events", few, "-o", str(tmp_path / "out"), "--quiet"]) == 0
    report = json.loads((tmp_path / "out/report.json").read_text())
    energy, latency = report["energy"], report["latency"]
    static = energy["static"]
    # a milliwatt is a picojoule a nanosecond
    assert static["at_latency_pj"] == pytest.approx(104.4 * latency["per_sample_ns"])
    assert static["at_real_time_pj"] == pytest.approx(104.4 * 250 * 0.02e9)
    assert energy["per_sample_pj"] == pytest.approx(sum(energy["breakdown_pj"].values()))
    assert (energy["range_pj"][1], latency["range_ns"][0]) == (None, None)
    bounds = {
        row["what"].split(" (")[0]: row["at_most_pj"] for row in energy["not_included_bounds"]
    }
    assert bounds == {
        "barrier synchronisation energy": None,
        "host input and output": None,
        "weight loading": None,
        "the transpose buffer of the location phase": 20
        * report["operations"]["per_sample"]["transpose_events"],
        "static power": static["at_real_time_pj"],
    }


def test_a_run_is_priced_by_name(built, capsys):
    folder, report = built
    assert (
        locsnn(
            ["run", str(folder / "out"), "--events", str(folder / "few.npy"), "--profile", "sanafe"]
        )
        == 0
    )
    sanafe = report["energy"]["other_profiles_pj"]["sanafe"]
    assert f"{sanafe / 1e6:.2f} µJ (profile sanafe)" in capsys.readouterr().out


def test_a_profile_without_times_gives_no_time(built, tmp_path, capsys):
    profile, few = tmp_path / "energy.yaml", str(built[0] / "few.npy")
    static = {"chip_mw": 90.0, "source": "the same board"}
    profile.write_text(yaml.safe_dump(MINE | {"time_ns": {}, "static_power": static}))
    options = ["--events", few, "--profile", str(profile)]
    assert compile_model([str(MODEL), *options, "-o", str(tmp_path / "out"), "--quiet"]) == 0
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert (report["latency"]["timed"], report["energy"]["static"]["at_latency_pj"]) == (
        False,
        None,
    )
    assert report["over_time"]["proven_stop"]["latency_ns"] is None
    assert locsnn(["run", str(tmp_path / "out"), *options, "--stop", "proven"]) == 0
    assert "µJ, and an unknown time (profile energy)\n" in capsys.readouterr().out


def test_a_profile_that_does_not_exist_stops_the_build(built, tmp_path, capsys):
    assert compile_model([str(MODEL), "--profile", "sanfe", "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == (
        "chip loihi-sim: there is no energy profile 'sanfe'. Did you mean 'sanafe'? "
        "A profile of your own is a file that ends in .yaml.\n"
    )
    assert not (tmp_path / "out").exists()
