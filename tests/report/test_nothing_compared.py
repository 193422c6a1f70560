"""Networks of which little or nothing can be compared, because neurons stay silent or class scores tie.

What was not compared must not look like perfect agreement: the terminal, report.json, the pages and the gates say that it
is unknown. Faults that are planted in a program show which of them the check can notice.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import nir
import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.api import CompiledModel
from locsnn_compile.cli.compile import main
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Verdict
from locsnn_compile.report.figures.document import report_figures
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.report.sections.verdict import matches
from locsnn_compile.verification.matching import Match

STEPS = 40
GROUNDS = Grounds(step_seconds=0.02, events_origin="given", assumptions=())


def checkpoint(path: Path, **weights: float) -> Path:
    """A time branch of random weights; those of the populations named are all equal."""
    description = NetworkDescription(
        "tactile-snn",
        InputLayout(neutouch(1), STEPS, step_seconds=0.02),
        classes=3,
        hidden=6,
        name=path.stem,
    )
    random = np.random.default_rng(0)
    arrays = {}
    for name, shape in description.weight_shapes.items():
        # Drawn for every population, so that fixed weights do not change those of the others.
        arrays[name] = random.normal(0.5, 2.0, shape).astype(np.float32)
        if name in weights:
            arrays[name] = np.full_like(arrays[name], weights[name])
    Checkpoint(description, arrays).save(path)
    return path


def graph_with_biases(
    path: Path,
    threshold: float = 100.0,
    biases: tuple[float, ...] = (0.1, 0.1, 0.1),
    *,
    potentials: bool = False,
) -> Path:
    """Two layers of LIF neurons whose thresholds nothing reaches, with biases, as a NIR file.

    The compiler adds a neuron of its own, ``nir/bias``, whose spikes are the biases. With ``potentials`` the second
    layer has no threshold, and its potentials are read.
    """

    def neurons(size: int) -> nir.LIF:
        parameters = {
            "tau": 0.01,
            "r": 1.0,
            "v_leak": 0.0,
            "v_threshold": threshold,
            "v_reset": 0.0,
        }
        return nir.LIF(**{name: np.full(size, value) for name, value in parameters.items()})

    random = np.random.default_rng(0)
    readout = nir.LI(np.full(3, 0.01), np.ones(3), np.zeros(3)) if potentials else neurons(3)
    nodes = {
        "input": nir.Input(np.array([10])),
        "fc1": nir.Affine(random.normal(0, 0.5, (6, 10)), np.full(6, 0.3)),
        "hidden": neurons(6),
        "fc2": nir.Affine(random.normal(0, 0.5, (3, 6)), np.array(biases)),
        "out": readout,
        "output": nir.Output(np.array([3])),
    }
    nir.write(path, nir.NIRGraph(nodes, list(itertools.pairwise(nodes)), type_check=False))
    return path


# What the terminal shows; made-up recordings have no labels.
SILENT_PART = """\
? Does it match? Not known. No neuron spiked, in the float network or on the
  chip: nothing was compared.
  accuracy          not known, because the recordings are made up
  spikes            none on either side
  first difference  –
  {first:<17} silent
  {second:<17} silent
"""  # noqa: RUF001
OUTPUTS_PART = """\
? Does it match? Not known. No output neuron spiked, in the float network or on
  the chip: no prediction was compared.
  accuracy          not known, because the recordings are made up
  spikes            100 % at the same neuron and step
  first difference  none, every spike is equal
  time_hidden       ████████████████████████ 100 %
  time_output       silent
"""
SILENT_NETWORK = SILENT_PART.format(first="time_hidden", second="time_output")
SILENT_GRAPH = SILENT_PART.format(first="hidden", second="out")
# What the gates print.
TIES = "gate failed: --min-agreement: no prediction was compared, as all class scores tie in every recording.\n"
SILENCE = "gate failed: --max-spike-error: no spike was compared, as no neuron spiked.\n"

CASES = [
    pytest.param(
        lambda folder: checkpoint(folder / "silent.pt", time_hidden=-0.5, time_output=-0.5),
        SILENT_NETWORK,
        {"time_hidden": None, "time_output": None},
        {},
        TIES + SILENCE,
        id="a silent network",
    ),
    pytest.param(
        lambda folder: checkpoint(folder / "outputs.pt", time_output=-0.5),
        OUTPUTS_PART,
        {"time_hidden": 1.0, "time_output": None},
        {},
        TIES,
        id="silent outputs, live hidden layer",
    ),
    pytest.param(
        lambda folder: graph_with_biases(folder / "biases.nir"),
        SILENT_GRAPH,
        {"hidden": None, "out": None},
        {
            "nir/bias": {
                "spike_agreement": 1.0,
                "spike_mismatches": 0,
                "reference_spikes": 800,
                "chip_spikes": 800,
            }
        },
        TIES + SILENCE,
        id="a graph with biases in which no neuron spikes",
    ),
]


# The columns are: a function that writes the model, the text on the terminal, the spike agreement by population, the
# neurons that the compiler added, and the messages of the gates.
@pytest.mark.parametrize(("make", "summary", "agreement", "helpers", "failures"), CASES)
def test_what_was_not_compared_is_not_100_percent(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[Path], Path],
    summary: str,
    agreement: dict[str, float | None],
    helpers: dict[str, Any],
    failures: str,
) -> None:
    gates = (
        "--min-agreement",
        "1",
        "--max-spike-error",
        "0",
        "--junit",
        str(tmp_path / "gates.xml"),
    )
    assert main([str(make(tmp_path)), "-o", str(tmp_path / "out"), *gates]) == 3
    printed = capsys.readouterr()
    assert summary in printed.out
    assert printed.err.startswith(failures)

    report = json.loads((tmp_path / "out/report.json").read_text())
    match = report["match"]
    populations = match["by_population"].items()
    assert {name: population["spike_agreement"] for name, population in populations} == agreement
    assert match["prediction_agreement"] is None
    assert match["tied_predictions"] == match["samples"]
    assert match["helper_neurons"] == helpers
    spikes_compared = 1.0 in agreement.values()
    assert match["spike_agreement"] == (1.0 if spikes_compared else None)
    assert report["gates"] == [
        {"name": "--min-agreement", "bound": 1.0, "measured": None, "passed": False},
        {
            "name": "--max-spike-error",
            "bound": 0.0,
            "measured": 0.0 if spikes_compared else None,
            "passed": spikes_compared,
        },
    ]
    cases = ElementTree.parse(tmp_path / "gates.xml").iter("testcase")
    failed_cases = {case.get("name") for case in cases if case.find("failure") is not None}
    failed_gates = {gate["name"] for gate in report["gates"] if not gate["passed"]}
    assert failed_cases == failed_gates

    page = (tmp_path / "out/report.html").read_text()
    text = (tmp_path / "out/report.md").read_text()
    assert (
        '<p class="figure">silent</p><p class="figure-label">no prediction to compare</p>' in page
    )
    assert (
        "No prediction was compared: all class scores tie in every recording, on both sides."
        in text
    )
    table = text[text.index("## Agreement") :]
    for name, share in agreement.items():
        row = re.search(rf"\| {name.replace('_', '.')} \| ([^|]*) \|", table)
        assert row is not None
        assert row[1] == ("100 %" if share else "silent")
    assert ("nir/bias (800 spikes in the network, 800 on the chip)." in text) == bool(helpers)


def test_the_json_output_has_the_gates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = checkpoint(tmp_path / "loud.pt")
    assert (
        main(
            [
                str(model),
                "-o",
                str(tmp_path / "out"),
                "--json",
                "--min-agreement",
                "0.5",
                "--max-cores",
                "0",
            ]
        )
        == 3
    )
    printed = capsys.readouterr()
    report = json.loads(printed.out)
    assert report == json.loads((tmp_path / "out/report.json").read_text())
    agreement = report["match"]["prediction_agreement"]
    assert report["gates"] == [
        {"name": "--min-agreement", "bound": 0.5, "measured": agreement, "passed": True},
        {"name": "--max-cores", "bound": 0, "measured": 1, "passed": False},
    ]
    assert printed.err == "gate failed: --max-cores: the program takes 1 core, above 0.\n"
    assert main([str(model), "-o", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["gates"] == []


@pytest.mark.parametrize(
    ("option", "bound", "accepted"),
    [
        ("--max-energy-nj", "inf", "a number from 0 up"),
        ("--min-agreement", "inf", "a number from 0 to 1"),
        ("--max-energy-nj", "nan", "a number from 0 up"),
    ],
)
def test_a_bound_without_end_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, bound: str, accepted: str
) -> None:
    model = checkpoint(tmp_path / "loud.pt")
    assert main([str(model), "-o", str(tmp_path / "out"), option, bound]) == 2
    assert capsys.readouterr().err == f"{option} {bound}: it is out of range. Give {accepted}.\n"
    assert not (tmp_path / "out").exists()


def events() -> Recordings:
    """Return six random recordings without labels."""
    random = np.random.default_rng(5)
    return Recordings(
        (random.random((6, STEPS, 78)) < 0.2).astype(np.uint8),
        labels=None,
        step_seconds=0.02,
        source="array",
    )


def compiled(path: Path) -> CompiledModel:
    """Compile a checkpoint, and check it on :func:`events`."""
    return lc.compile(lc.load(path), strategy="dendrite", events=events(), diagnosis=False)


# The columns are: fixed weights of the network, fixed weights of the program on the chip, status and answer.
FAULTS = [
    pytest.param({}, {}, "yes", "Yes, in every prediction", id="no fault"),
    pytest.param({}, {"time_output": -0.5}, "no", "No", id="outputs fall silent"),
    pytest.param({"time_output": -0.5}, {}, "no", "No", id="outputs spike that should not"),
    pytest.param(
        {"time_output": -0.5},
        {"time_output": -0.25},
        "unknown",
        "Not known",
        id="a fault no output shows",
    ),
    pytest.param(
        {"time_output": -0.5},
        {"time_hidden": 3.0, "time_output": -0.5},
        "unknown",
        "Not known",
        id="hidden spikes only",
    ),
    pytest.param(
        {"time_hidden": -0.5, "time_output": -0.5},
        {"time_hidden": -0.5, "time_output": 0.5},
        "unknown",
        "Not known",
        id="a fault no spike shows",
    ),
]


def verdict_of(levels: Levels, match: Match) -> Verdict:
    """Return the verdict of a report of this match on whether the chip does what the network does."""
    return matches(report_figures(levels, match, GROUNDS))


@pytest.mark.parametrize(("trained", "on_chip", "status", "answer"), FAULTS)
def test_a_planted_fault_is_noticed_where_it_can_be(
    tmp_path: Path, trained: dict[str, float], on_chip: dict[str, float], status: str, answer: str
) -> None:
    """The chip has the program of another network; the verdict is that of the comparison."""
    model = compiled(checkpoint(tmp_path / "a.pt", **trained))
    faulty = compiled(checkpoint(tmp_path / "b.pt", **on_chip))
    levels = replace(model.levels, program=faulty.levels.program)
    with_fault = replace(model, observed=replace(model.observed, levels=levels))
    match = lc.verify(with_fault, events())
    verdict = verdict_of(with_fault.levels, match)
    assert (verdict.status, verdict.answer) == (status, answer)


EQUAL = (0.1, 0.1, 0.1)
DIFFERENT = (0.1, 0.2, 0.3)
"""Biases of three neurons whose potentials are read: equal ones tie where no spike arrives."""


@pytest.mark.parametrize(
    ("threshold", "biases", "answer"),
    [
        pytest.param(0.05, EQUAL, "Yes, in every prediction", id="live hidden layer"),
        pytest.param(100.0, DIFFERENT, "Yes, in every prediction", id="silent hidden layer"),
        pytest.param(100.0, EQUAL, "Not known", id="equal potentials"),
    ],
)
def test_potentials_never_spike_and_are_silent_only_where_all_are_equal(
    tmp_path: Path, threshold: float, biases: tuple[float, ...], answer: str
) -> None:
    """Where every spike is equal, or there is none, the chip may still predict otherwise."""
    network = lc.load(
        graph_with_biases(tmp_path / "read.nir", threshold, biases, potentials=True), dt=1e-3
    )
    model = lc.compile(network, diagnosis=False)
    match = model.match
    figures = model.report["match"]
    assert figures["readout"] == {
        "populations": ["out"],
        "by": "potentials",
        "silent": answer == "Not known",
    }
    assert figures["by_population"]["out"]["spike_agreement"] is None
    assert (figures["spike_agreement"] is None) == (threshold == 100.0)
    agreeing = replace(match, chip_prediction=match.reference_prediction)
    assert verdict_of(model.levels, agreeing).answer == answer
    assert "| out | read by potential | 0 | 0 | 0 |" in render_markdown(compose(model.figures))
    next_class = (match.chip_prediction + 1) % network.classes
    disagreeing = replace(match, chip_prediction=next_class)
    assert verdict_of(model.levels, disagreeing).answer == "No"
    tied = np.full(match.samples, -1)
    silent = replace(match, chip_prediction=tied, reference_prediction=tied)
    assert verdict_of(model.levels, silent).answer == "Not known"
