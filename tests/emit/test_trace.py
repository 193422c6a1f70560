"""The timeline: of the Trace Event Format, nested where slices share a thread, and as long as the latency."""

from __future__ import annotations

import json
from collections import defaultdict

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.timeline import trace_file
from tests.support.emitted_programs import CHIP, everything, played_streams, two_phases


@pytest.fixture(
    scope="module",
    params=[
        lambda: play_recording(everything(), played_streams(everything())),
        lambda: play_recording(two_phases(), np.eye(5, 4, dtype=np.uint8)),
    ],
    ids=["cores", "phases"],
)
def case(request):
    played = request.param()
    return played, json.loads(trace_file(played)["trace.json"])


def slices(document):
    """The events of a timeline that have a duration."""
    return [event for event in document["traceEvents"] if event["ph"] == "X"]


def test_every_event_has_the_keys_of_its_kind(case):
    _, document = case
    assert set(document) == {"displayTimeUnit", "otherData", "traceEvents"}
    assert document["displayTimeUnit"] == "ns"
    for event in document["traceEvents"]:
        kinds = {"name": str, "ph": str, "pid": int, "tid": int, "ts": (int, float), "args": dict}
        kinds |= {"dur": (int, float)} if event["ph"] == "X" else {}
        assert set(event) == set(kinds)
        for key, kind in kinds.items():
            assert isinstance(event[key], kind), key
        assert event["ph"] in ("X", "M")
        assert event["ts"] >= 0
        assert event.get("dur", 1) > 0


def test_every_process_and_thread_has_a_name(case):
    played, document = case
    named = {
        (e["name"], e["pid"], e["tid"]): e["args"]["name"]
        for e in document["traceEvents"]
        if e["ph"] == "M"
    }
    for event in slices(document):
        assert ("thread_name", event["pid"], event["tid"]) in named
    phases = [name for (kind, *_), name in named.items() if kind == "process_name"]
    assert phases == [f"phase {phase.name}" for phase in played.phases]
    cores = [
        name.split(",")[0]
        for (kind, _, thread), name in named.items()
        if kind == "thread_name" and thread
    ]
    assert cores == [f"core {core.number}" for core in played.program.cores]


def test_slices_of_a_thread_follow_or_hold_each_other(case):
    _, document = case
    threads = defaultdict(list)
    for event in slices(document):
        threads[event["pid"], event["tid"]].append(event)
    for events in threads.values():
        around = []
        for event in sorted(events, key=lambda e: (e["ts"], -e["dur"])):
            end = event["ts"] + event["dur"]
            while around and around[-1] <= event["ts"] + 1e-6:
                around.pop()
            assert not around or end <= around[-1] + 1e-6
            around.append(end)


def test_it_is_as_long_as_the_latency(case):
    played, document = case
    profile = CHIP.profile("davies2018")
    activity = {phase: found[0] for phase, found in played.result.activity.items()}
    total_us = hw.latency(played.program, activity, profile).total_ns / 1000
    assert max(event["ts"] + event["dur"] for event in slices(document)) == pytest.approx(
        total_us, abs=1e-5
    )
    steps = [event for event in slices(document) if event["name"].startswith("step ")]
    assert len(steps) == sum(played.steps(phase.name) for phase in played.phases)
    assert sum(event["dur"] for event in steps) == pytest.approx(total_us, abs=1e-5)


def test_counts_are_the_simulators(case):
    played, document = case
    counts, found = played.result.counts, defaultdict(int)
    for event in slices(document):
        found[event["name"]] += event["args"].get("count", 0)
    assert found["synaptic operations"] == counts.synaptic_ops
    assert found["active updates"] == counts.neuron_updates_active
    assert found["inactive updates"] == counts.neuron_updates_inactive
    assert found["packets within the tile"] == counts.packets_within_tile


def test_it_says_that_it_is_modelled(case):
    _, document = case
    assert (
        document["otherData"]["profile"]
        == "davies2018: Davies et al., IEEE Micro 38(1), 2018, Table 2"
    )
    assert document["otherData"]["basis"].startswith("modelled, not measured; ")
