"""Worst-case bounds in the report: what the summary and the table say, and the figures of a build.

Sentences are written out by hand for the small report. Figures of builds are compared with ``hw.worst_case``, which
defines the bounds and has tests of its own, and with the recordings that were played.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.report.sections.bounds import bound_facts, bounds_table
from locsnn_compile.report.sections.worst_time import worst_time
from tests.support.networks import hybrid, recordings
from tests.support.small_checks import bounds_at
from tests.support.small_report import figures

CHANNELS = 6
STEPS = 30
"""The size of the networks that are built here."""


def test_the_summary_says_what_no_recording_exceeds(document: dict[str, Any]) -> None:
    verdict = worst_time(figures(document))
    facts = {fact.label: fact.value for fact in verdict.facts}
    assert verdict.sentence == (
        "The slowest recording takes 2.80 ms, 2,500 times faster than the 7.00 s recorded; none with "
        "up to 3 events in a step takes more than 5.00 ms."
    )
    assert facts["bound"] == (
        "with up to 3 events in a step, the answer comes at most 1.04 ms after the last row; with all "
        "5 channels, a recording takes at most 6.00 ms"
    )
    assert facts["sustained"] == (
        "events of all 5 channels in every step are done within the 20.0 ms between two rows"
    )


@pytest.mark.parametrize(
    ("changes", "fact"),
    [
        pytest.param(
            {"sustained_events_per_step": 2},
            "up to 2 events of 5 in every step are done within the 20.0 ms between two rows",
            id="some",
        ),
        pytest.param(
            {"sustained_events_per_step": None},
            "none: inner spikes alone may take more than the 20.0 ms between two rows",
            id="none",
        ),
        pytest.param({"step_ns": None}, None, id="length of a step not known"),
    ],
)
def test_the_summary_says_which_rate_of_events_is_always_done_in_time(
    document: dict[str, Any], changes: dict[str, Any], fact: str | None
) -> None:
    document["bounds"] |= changes
    assert bound_facts(figures(document).bounds).get("sustained") == fact


def test_bounds_of_nothing_have_no_row(document: dict[str, Any]) -> None:
    """The small report has no queue of packets: its bound is 0."""
    table = bounds_table(figures(document).bounds)
    assert table is not None
    assert table.rows == (
        ("step of a row", "4.00 µs", "40.0 µs", "10.0 %", "50.0 µs"),
        ("answer after the last row", "900 µs", "1.04 ms", "86.5 %", "1.05 ms"),
        ("recording", "2.80 ms", "5.00 ms", "56.0 %", "6.00 ms"),
        ("events in the transpose buffer", "80", "300", "26.7 %", "500"),
    )


def test_a_stated_rate_takes_the_place_of_the_recorded_one_in_the_answer(
    document: dict[str, Any],
) -> None:
    document["bounds"]["as_stated"] = bounds_at(4, 45_000.0)
    report = figures(document)
    verdict = worst_time(report)
    facts = {fact.label: fact.value for fact in verdict.facts}
    assert verdict.sentence.endswith(
        "; none with up to 4 events in a step takes more than 5.50 ms."
    )
    assert facts["bound"] == (
        "with up to 4 events in a step, the answer comes at most 1.04 ms after the last row; with all "
        "5 channels, a recording takes at most 6.00 ms"
    )
    table = bounds_table(report.bounds)
    assert table is not None
    assert table.columns == (
        "at most",
        "in these recordings",
        "at up to 3 events in a step",
        "measured of it",
        "at up to 4 events in a step",
        "with all 5 channels",
    )
    assert table.rows == (
        ("step of a row", "4.00 µs", "40.0 µs", "10.0 %", "45.0 µs", "50.0 µs"),
        ("answer after the last row", "900 µs", "1.04 ms", "86.5 %", "1.04 ms", "1.05 ms"),
        ("recording", "2.80 ms", "5.00 ms", "56.0 %", "5.50 ms", "6.00 ms"),
        ("events in the transpose buffer", "80", "300", "26.7 %", "400", "500"),
    )


@pytest.mark.parametrize("target", ["loihi-sim", "ecp5-25f"])
def test_a_build_bounds_what_is_stated(target: str) -> None:
    network = hybrid(channels=CHANNELS, steps=STEPS)
    played = recordings(network, samples=4, rate=0.1)
    stated = 5
    compiled = lc.compile(
        network, target, events=played, strategy="dendrite", events_per_step=stated
    )
    bounds = compiled.report["bounds"]
    worst = hw.worst_case(compiled.program, STEPS, stated)
    busiest_step = int(played.sum(axis=2).max())
    assert bounds["as_recorded"]["events_per_step"] == busiest_step < stated
    assert bounds["as_stated"]["events_per_step"] == stated
    assert bounds["as_stated"]["recording_ns"] == {
        "bound": worst.recording_ns,
        "measured": None,
        "share": None,
    }


UNTIMED = (
    "{source: ours, basis: measured, energy_pj: {synaptic_ops: 30.0}, time_ns: {}, "
    "barrier_ns: {one_tile: 1.0, all_tiles: 4.0}, not_included: []}"
)
"""A profile of costs in which no operation has a time."""
REFUSED = {
    "more events than channels": (
        "loihi-sim",
        {"events_per_step": 7},
        "events_per_step 7: it is out of range for a network of 6 channels. Give 0 to 6.",
    ),
    "fewer than none": (
        "loihi-sim",
        {"events_per_step": -1},
        "events_per_step -1: it is out of range for a network of 6 channels. Give 0 to 6.",
    ),
    "costs without times": (
        "loihi-sim",
        {"events_per_step": 3, "profile": "UNTIMED"},
        "events_per_step 3: no operation of the profile of costs has a time, so no time is bounded. Leave it out.",
    ),
    "without a diagnosis": (
        "loihi-sim",
        {"events_per_step": 3, "diagnosis": False},
        "events_per_step 3: bounds are part of the diagnosis, which is left out. Leave it out.",
    ),
    "a chip whose times are not known": (
        "spinnaker1",
        {"events_per_step": 3},
        "events_per_step: the time of a recording on spinnaker1 is not bounded. Leave it out.",
    ),
}


@pytest.mark.parametrize(("target", "options", "message"), REFUSED.values(), ids=REFUSED)
def test_a_rate_for_which_nothing_is_bounded_is_refused(
    tmp_path: Path, target: str, options: dict[str, Any], message: str
) -> None:
    network = hybrid(channels=CHANNELS, steps=STEPS)
    if options.get("profile") == "UNTIMED":
        profile = tmp_path / "untimed.yaml"
        profile.write_text(UNTIMED)
        options = {**options, "profile": profile}
    with pytest.raises(lc.InputError) as caught:
        lc.compile(network, target, events=recordings(network), **options)
    assert str(caught.value) == message


@pytest.mark.parametrize("target", ["loihi-sim", "ecp5-25f"])
def test_a_build_reports_bounds_at_the_rate_of_its_recordings(target: str) -> None:
    network = hybrid(channels=CHANNELS, steps=STEPS)
    played = recordings(network, samples=4, rate=0.4)
    compiled = lc.compile(network, target, events=played, strategy="dendrite")
    bounds = compiled.report["bounds"]
    busiest_step = int(played.sum(axis=2).max())
    assert bounds["channels"] == CHANNELS
    assert bounds["as_recorded"]["events_per_step"] == busiest_step
    assert bounds["any_input"]["events_per_step"] == CHANNELS
    for entry, events in (("as_recorded", busiest_step), ("any_input", CHANNELS)):
        worst = hw.worst_case(compiled.program, STEPS, events)
        slowest_ns = max(latency.total_ns for latency in compiled.match.latencies)
        assert bounds[entry]["recording_ns"] == {
            "bound": worst.recording_ns,
            "measured": slowest_ns,
            "share": slowest_ns / worst.recording_ns,
        }
        assert bounds[entry]["buffered_events"]["measured"] == played.sum(axis=(1, 2)).max()
        assert bounds[entry]["buffered_events"]["bound"] == STEPS * events
    assert bounds["sustained_events_per_step"] == CHANNELS
    # An input that has every event comes near to the bounds on any input.
    all_events = np.ones((1, STEPS, CHANNELS), dtype=np.uint8)
    compiled = lc.compile(
        network, target, events=all_events, strategy="dendrite", calibration=played
    )
    bounds = compiled.report["bounds"]
    assert bounds["as_recorded"] == bounds["any_input"]
    assert 0.5 < bounds["any_input"]["recording_ns"]["share"] <= 1


def test_without_a_diagnosis_nothing_is_bounded() -> None:
    network = hybrid()
    compiled = lc.compile(network, "loihi-sim", events=recordings(network), diagnosis=False)
    assert "bounds" not in compiled.report
