"""The width of a bin: the recordings' own, else --step-seconds, else the model's, else 0.02 s; never a graph's --dt.

Expected times are computed by hand from the times of the events that are written here.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import nir
import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn

CHANNELS, STEPS = 3, 100


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    """A graph of a LIF of tau 1e-3."""
    ones = np.ones(2)
    nodes = {
        "input": nir.Input(np.array([CHANNELS])),
        "w": nir.Linear(np.full((2, CHANNELS), 0.5)),
        "out": nir.LIF(
            tau=1e-3 * ones, r=10 * ones, v_leak=0 * ones, v_threshold=ones, v_reset=0 * ones
        ),
        "output": nir.Output(np.array([2])),
    }
    edges = [("input", "w"), ("w", "out"), ("out", "output")]
    nir.write(tmp_path / "g.nir", nir.NIRGraph(nodes, edges, type_check=False))
    return tmp_path / "g.nir"


def bins_of_10_ms(folder: Path) -> Path:
    """Write recordings of 1.00 s."""
    spikes = np.random.default_rng(0).random((4, CHANNELS, STEPS)) < 0.1
    np.savez(folder / "bins.npz", spikes=spikes, step_seconds=0.01)
    return folder / "bins.npz"


def events_of_1_s(folder: Path) -> Path:
    """Write one recording of single events, in which channel k spikes at k ms, 100 + k ms, ... up to 902 ms."""
    times = [100_000 * i + 1000 * k for i in range(10) for k in range(CHANNELS)]
    events = np.array(
        [(t, k % CHANNELS, 0) for k, t in enumerate(times)],
        dtype=[("t", "i8"), ("x", "i8"), ("p", "i1")],
    )
    np.save(folder / "events.npy", events)
    return folder / "events.npy"


def report_of(folder: Path, *arguments: Any) -> dict[str, Any]:
    """Compile, and return the report."""
    assert compile_main([*map(str, arguments), "-o", str(folder / "out"), "--quiet"]) == 0
    return json.loads((folder / "out/report.json").read_text())


def about_steps(report: dict[str, Any]) -> list[str]:
    """Return what is assumed about the length of a step at the sensor."""
    return [sentence for sentence in report["assumptions"] if "step lasts" in sentence]


def step_sentence(seconds: str, why: str) -> str:
    """Return the sentence of the report on the length of a step."""
    return f"A step lasts {seconds} s, {why}"


AS_THE_BINS = "like the bins of the recordings, because the model does not say."
BY_DEFAULT = "the default, because neither the model nor the recordings say (--step-seconds)."


@pytest.mark.parametrize(
    "options",
    [(), ("--dt", "1e-4"), ("--dt", "1e-3"), ("--dt", "1e-3", "--discretisation", "exact")],
    ids=" ".join,
)
def test_recordings_of_10_ms_last_1_s_whatever_the_step_of_a_graphs_constants(
    graph: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    report = report_of(tmp_path, graph, "--events", bins_of_10_ms(tmp_path), *options)
    assert report["latency"]["recording_ns"] == pytest.approx(1e9)
    static_pj = report["energy"]["static"]["at_real_time_pj"]
    assert static_pj == pytest.approx(1e9 * report["energy"]["static"]["chip_mw"])
    assert about_steps(report) == [step_sentence("0.01", AS_THE_BINS)]


@pytest.mark.parametrize("dt", ["1", "1e-6", "1e-4"], ids=["sinabs", "norse", "snnTorch"])
def test_events_become_bins_of_20_ms_whatever_the_step_of_a_graphs_constants(
    graph: Path, tmp_path: Path, dt: str
) -> None:
    options = ("--dt", dt, "--discretisation", "hold")
    report = report_of(tmp_path, graph, "--events", events_of_1_s(tmp_path), *options)
    assert report["latency"]["recording_ns"] == pytest.approx(46 * 20e6)  # 902 ms in bins of 20 ms
    assert report["operations"]["per_sample"]["input_events"] == 30
    assert about_steps(report) == [step_sentence("0.02", BY_DEFAULT)]


def test_bins_of_10_ms_can_be_had_for_a_graph_of_steps_of_100_us(
    graph: Path, tmp_path: Path
) -> None:
    options = ("--dt", "1e-4", "--step-seconds", "0.01")
    report = report_of(tmp_path, graph, "--events", events_of_1_s(tmp_path), *options)
    assert report["latency"]["recording_ns"] == pytest.approx(91 * 10e6)  # 902 ms in bins of 10 ms
    assert about_steps(report) == []


def test_a_program_of_a_graph_bins_as_it_was_asked_to(
    graph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events = events_of_1_s(tmp_path)
    report_of(tmp_path, graph, "--events", events, "--dt", "1e-4", "--step-seconds", "0.01")
    assert locsnn(["run", str(tmp_path / "out"), "--events", str(events), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["counts"]


def test_a_width_that_contradicts_the_recordings_is_refused(
    graph: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(graph), "--events", str(bins_of_10_ms(tmp_path)), "--step-seconds", "0.02"]
    assert compile_main(arguments) == 2
    assert capsys.readouterr().err == (
        "step_seconds: file 'bins.npz' holds bins of another width (got 0.02 against 0.01). "
        "Leave it out.\n"
    )


def test_the_step_of_a_graphs_constants_is_kept_in_the_graph_that_is_written(
    graph: Path, tmp_path: Path
) -> None:
    report_of(tmp_path, graph, "--dt", "2e-4", "--emit", "nir")
    reloaded = lc.load(tmp_path / "out/network.nir")
    original = lc.load(graph, dt=2e-4)
    assert reloaded.step_seconds is reloaded.usual_step_seconds is None
    decays = [network.populations[0].neuron.decay_v for network in (original, reloaded)]
    np.testing.assert_array_equal(*decays)
