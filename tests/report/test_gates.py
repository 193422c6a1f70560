"""Gates: bounds on figures of the report that a user sets. A figure that equals its bound keeps it.

Every gate is tested at its bound and next to it, and with figures that are unknown, which never keep a bound. A bound on
spikes is also one of the error budget, within which the compiler chooses a setting; the two must agree.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from locsnn_compile.cli.compile import main
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.gates import GATES, check_gates
from locsnn_compile.verification.error_bounds import ErrorBudget, Losses
from tests.support.small_report import figures

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid-loihi.pt"


class GateCase(NamedTuple):
    """A gate with a bound that the report just keeps, and a bound that it just breaks, with the sentence for each."""

    option: str
    kept: float
    broken: float
    sentence_kept: str
    sentence_broken: str


CASES = [
    GateCase("--min-agreement", kept=0.75, broken=0.7501, sentence_kept="prediction agreement is 0.7500, not below 0.75", sentence_broken="prediction agreement is 0.7500, below 0.7501"),
    GateCase("--max-spike-error", kept=0.125, broken=0.1249, sentence_kept="0.1250 of the spikes differ, not above 0.125", sentence_broken="0.1250 of the spikes differ, above 0.1249"),
    GateCase("--max-score-error", kept=0.25, broken=0.2499, sentence_kept="class scores differ by 0.2500 of their spread, not above 0.25", sentence_broken="class scores differ by 0.2500 of their spread, above 0.2499"),
    GateCase("--max-energy-nj", kept=2.5, broken=2.4999, sentence_kept="a recording takes 2.5 nJ, not above 2.5", sentence_broken="a recording takes 2.5 nJ, above 2.4999"),
    GateCase("--max-latency-us", kept=1.5, broken=1.4999, sentence_kept="a recording takes 1.5 µs, not above 1.5", sentence_broken="a recording takes 1.5 µs, above 1.4999"),
    GateCase("--max-cores", kept=3, broken=2, sentence_kept="the program takes 3 cores, not above 3", sentence_broken="the program takes 3 cores, above 2"),
]  # fmt: skip


@pytest.fixture
def report(document: dict[str, Any]) -> ReportFigures:
    """A report of 3 cores. Its figures are exact in floats, so a bound can equal them: 0.875 is 7/8, for example."""
    document["match"] |= {
        "prediction_agreement": 0.75,
        "spike_agreement": 0.875,
        "score_error": 0.25,
        "samples": 4,
    }
    document["energy"]["per_sample_pj"] = 2500.0
    document["latency"]["per_sample_ns"] = 1500.0
    document["resources"]["cores"] = 3
    return figures(document)


def with_spike_agreement(report: ReportFigures, agreement: float | None) -> ReportFigures:
    """Return the report with another agreement of spikes."""
    spikes = replace(report.match.spikes, spike_agreement=agreement)
    return replace(report, match=replace(report.match, spikes=spikes))


@pytest.mark.parametrize("case", CASES, ids=[case.option for case in CASES])
def test_a_figure_that_equals_its_bound_keeps_it(report, case):
    (gate,) = check_gates(report, {case.option: case.kept})
    assert (gate.option, gate.holds, gate.found) == (case.option, True, case.sentence_kept)
    (gate,) = check_gates(report, {case.option: case.broken})
    assert (gate.option, gate.holds, gate.found) == (case.option, False, case.sentence_broken)


# Of the bounds of whole percents, some of those for which 1 minus the agreement is above the bound in floats.
@pytest.mark.parametrize("bound", [0.01, 0.02, 0.05, 0.15, 0.3])
def test_a_share_of_spikes_that_equals_a_bound_keeps_it_in_floats(report, bound):
    """1 - 0.99 is 0.010000000000000009 in floats, which is above 0.01. Gates and the error budget both forgive it."""
    equal_percent = round((1 - bound) * 100)
    agreement = equal_percent / 100  # a quotient of counts, as agreements are
    (gate,) = check_gates(with_spike_agreement(report, agreement), {"--max-spike-error": bound})
    assert gate.holds
    losses = Losses(
        prediction_agreement=1.0,
        spike_agreement=agreement,
        score_error=0.0,
        energy_pj=1.0,
        chip_time_ns=1.0,
    )
    assert losses.keeps(ErrorBudget(max_spike_error=bound))
    assert not losses.keeps(ErrorBudget(max_spike_error=bound - 1e-6))


def test_every_gate_is_tested_and_results_come_in_the_order_of_gates(report):
    bounds = {case.option: case.kept for case in reversed(CASES)}
    assert tuple(gate.option for gate in check_gates(report, bounds)) == GATES
    assert tuple(case.option for case in CASES) == GATES


@pytest.mark.parametrize("option", ["--min-agreement", "--max-spike-error", "--max-score-error"])
def test_a_gate_on_what_was_not_compared_fails(report, option):
    report = with_spike_agreement(report, agreement=None)
    match = replace(report.match, prediction_agreement=None, score_error=None)
    # A bound that any figure keeps.
    bound = 0.0 if option == "--min-agreement" else 1.0
    (gate,) = check_gates(replace(report, match=match), {option: bound})
    assert (gate.holds, gate.measured) == (False, None)


def test_a_gate_on_energy_fails_where_no_energy_is_known(report):
    (gate,) = check_gates(replace(report, energy=None), {"--max-energy-nj": 1e12})
    assert (gate.holds, gate.measured) == (False, None)
    assert gate.found == "the energy of this target is not known"


def test_a_gate_on_latency_fails_where_no_operation_has_a_time(report):
    untimed = replace(report, latency=replace(report.latency, timed=False))
    (gate,) = check_gates(untimed, {"--max-latency-us": 1e12})
    assert (gate.holds, gate.measured) == (False, None)
    assert gate.found == "the latency is not known, as the profile has no times of operations"


def test_a_build_with_a_profile_without_times_of_operations_fails_a_gate_on_latency(
    tmp_path, capsys
):
    """The barrier between steps has a time, which is not enough: a recording takes mostly operations."""
    profile = tmp_path / "energy-only.yaml"
    profile.write_text(
        "{source: ours, basis: measured, energy_pj: {synaptic_ops: 30.0}, time_ns: {}, "
        "barrier_ns: {one_tile: 100.0, all_tiles: 400.0}, not_included: []}"
    )
    arguments = [
        str(MODEL),
        "--profile",
        str(profile),
        "--max-latency-us",
        "1e9",
        "--max-energy-nj",
        "1e9",
        "--quiet",
    ]
    exit_code = main([*arguments, "-o", str(tmp_path / "out")])
    assert exit_code == 3  # a gate failed
    assert capsys.readouterr().err == (
        "gate failed: --max-latency-us: the latency is not known, as the profile has no times of operations.\n"
    )
