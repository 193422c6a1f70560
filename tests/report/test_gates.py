"""Gates at their bounds: what is equal to a bound keeps it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from locsnn_compile.cli.compile import main
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.gates import GATES, check_gates
from locsnn_compile.verification.error_bounds import ErrorBudget, Losses
from tests.support.small_report import figures

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid-loihi.pt"
ROWS = [
    # gate, bound that is just kept, one that is not, what is said of each
    ("--min-agreement", 0.75, 0.7501, "prediction agreement is 0.7500, not below 0.75", "prediction agreement is 0.7500, below 0.7501"),
    ("--max-spike-error", 0.125, 0.1249, "0.1250 of the spikes differ, not above 0.125", "0.1250 of the spikes differ, above 0.1249"),
    ("--max-score-error", 0.25, 0.2499, "class scores differ by 0.2500 of their spread, not above 0.25", "class scores differ by 0.2500 of their spread, above 0.2499"),
    ("--max-energy-nj", 2.5, 2.4999, "a recording takes 2.5 nJ, not above 2.5", "a recording takes 2.5 nJ, above 2.4999"),
    ("--max-latency-us", 1.5, 1.4999, "a recording takes 1.5 µs, not above 1.5", "a recording takes 1.5 µs, above 1.4999"),
    ("--max-cores", 3, 2, "the program takes 3 cores, not above 3", "the program takes 3 cores, above 2"),
]  # fmt: skip


@pytest.fixture
def report(document: dict[str, Any]) -> ReportFigures:
    """A report of 3 cores whose figures have few digits."""
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


def with_agreement(report: ReportFigures, agreement: float | None) -> ReportFigures:
    spikes = replace(report.match.spikes, spike_agreement=agreement)
    return replace(report, match=replace(report.match, spikes=spikes))


@pytest.mark.parametrize(
    ("gate", "kept", "broken", "said", "blamed"), ROWS, ids=[row[0] for row in ROWS]
)
def test_a_bound_is_kept_by_what_is_equal_to_it(report, gate, kept, broken, said, blamed):
    (one,), (other,) = (check_gates(report, {gate: bound}) for bound in (kept, broken))
    assert (one.option, one.holds, one.found) == (gate, True, said)
    assert (other.option, other.holds, other.found) == (gate, False, blamed)


@pytest.mark.parametrize("bound", [0.01, 0.02, 0.05, 0.15, 0.3])
def test_a_share_of_spikes_that_is_equal_to_a_bound_keeps_it(report, bound):
    """1 - 0.99 is 0.010000000000000009 in floats: the message said that 0.0100 is above 0.01."""
    agreement = round((1 - bound) * 100) / 100
    (found,) = check_gates(with_agreement(report, agreement), {"--max-spike-error": bound})
    assert found.holds
    losses = Losses(1.0, agreement, 0.0, 1.0, 1.0)
    assert losses.keeps(ErrorBudget(max_spike_error=bound))
    assert not losses.keeps(ErrorBudget(max_spike_error=bound - 1e-6))


def test_every_gate_has_its_row_and_they_come_in_order(report):
    bounds = {gate: kept for gate, kept, *_ in reversed(ROWS)}
    assert (
        tuple(gate.option for gate in check_gates(report, bounds))
        == GATES
        == tuple(row[0] for row in ROWS)
    )


@pytest.mark.parametrize("gate", ["--min-agreement", "--max-spike-error", "--max-score-error"])
def test_a_gate_on_what_was_not_compared_fails(report, gate):
    silent = with_agreement(report, None)
    match = replace(silent.match, prediction_agreement=None, score_error=None)
    silent = replace(silent, match=match)
    (found,) = check_gates(silent, {gate: 0.0 if gate == "--min-agreement" else 1.0})
    assert (found.holds, found.measured) == (False, None)


def test_a_gate_on_energy_fails_where_no_energy_is_known(report):
    (found,) = check_gates(replace(report, energy=None), {"--max-energy-nj": 1e12})
    assert (found.holds, found.measured, found.found) == (
        False,
        None,
        "the energy of this target is not known",
    )


def test_a_gate_on_latency_fails_where_no_operation_has_a_time(report):
    untimed = replace(report, latency=replace(report.latency, timed=False))
    (found,) = check_gates(untimed, {"--max-latency-us": 1e12})
    said = "the latency is not known, as the profile has no times of operations"
    assert (found.holds, found.measured, found.found) == (False, None, said)


def test_a_profile_without_times_keeps_no_bound_of_latency(tmp_path, capsys):
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
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 3
    assert capsys.readouterr().err == (
        "gate failed: --max-latency-us: the latency is not known, as the profile has no times of operations.\n"
    )
