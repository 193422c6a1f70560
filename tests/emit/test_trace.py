"""``--emit trace``: the file has the Trace Event Format, and its events add up to the latency and the counts.

In this format a process is a group of threads, and an event belongs to a thread. Here a process is a phase of the
program, and a thread a core.

``hw.latency`` and the counts of the simulator are the independent answers; both have tests of their own.
"""

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
    """A recording that was played to a program, and its timeline: on several cores, or in two phases."""
    played = request.param()
    return played, json.loads(trace_file(played)["trace.json"])


def slices(document):
    """Return the events of a timeline that have a duration (ph X; those of ph M name processes and threads)."""
    return [event for event in document["traceEvents"] if event["ph"] == "X"]


def test_every_event_has_the_keys_of_its_kind(case):
    _, document = case
    assert set(document) == {"displayTimeUnit", "otherData", "traceEvents"}
    assert document["displayTimeUnit"] == "ns"
    # X: an event with a duration. M: the name of a process or thread, which has no duration ("dur").
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
    names = {
        (event["name"], event["pid"], event["tid"]): event["args"]["name"]
        for event in document["traceEvents"]
        if event["ph"] == "M"
    }
    for event in slices(document):
        assert ("thread_name", event["pid"], event["tid"]) in names
    phases = [name for (kind, *_), name in names.items() if kind == "process_name"]
    assert phases == [f"phase {phase.name}" for phase in played.phases]
    # Thread 0 of a phase has its steps, all others are cores, such as "core 3, tile 0,1". A core works in one phase only,
    # so it occurs once.
    cores = [
        name.split(",")[0]
        for (kind, _, thread), name in names.items()
        if kind == "thread_name" and thread > 0
    ]
    assert cores == [f"core {core.number}" for core in played.program.cores]


def test_events_of_a_thread_follow_or_contain_each_other(case):
    """Viewers show an event within another as nested. They cannot show two events that overlap partly."""
    rounding_us = 1e-6
    _, document = case
    threads = defaultdict(list)
    for event in slices(document):
        threads[event["pid"], event["tid"]].append(event)
    for events in threads.values():
        # The ends of the events that are open at the beginning of the next, the innermost last.
        open_ends = []
        for event in sorted(events, key=lambda event: (event["ts"], -event["dur"])):
            end = event["ts"] + event["dur"]
            while open_ends and open_ends[-1] <= event["ts"] + rounding_us:
                open_ends.pop()
            assert not open_ends or end <= open_ends[-1] + rounding_us
            open_ends.append(end)


def test_the_timeline_is_as_long_as_the_latency(case):
    # Times are rounded to 1e-7 us, and some dozens of them are added.
    rounding_us = 1e-5
    played, document = case
    profile = CHIP.profile("davies2018")
    activity = {phase: activities[0] for phase, activities in played.result.activity.items()}
    total_us = hw.latency(played.program, activity, profile).total_ns / 1000
    end_us = max(event["ts"] + event["dur"] for event in slices(document))
    assert end_us == pytest.approx(total_us, abs=rounding_us)
    steps = [event for event in slices(document) if event["name"].startswith("step ")]
    assert len(steps) == sum(played.steps(phase.name) for phase in played.phases)
    assert sum(event["dur"] for event in steps) == pytest.approx(total_us, abs=rounding_us)


def test_counts_of_operations_are_those_of_the_simulator(case):
    played, document = case
    counts = played.result.counts
    counts_by_name = defaultdict(int)
    for event in slices(document):
        counts_by_name[event["name"]] += event["args"].get("count", 0)
    assert counts_by_name["synaptic operations"] == counts.synaptic_ops
    assert counts_by_name["active updates"] == counts.neuron_updates_active
    assert counts_by_name["inactive updates"] == counts.neuron_updates_inactive
    assert counts_by_name["packets within the tile"] == counts.packets_within_tile


def test_the_file_says_that_times_are_modelled(case):
    _, document = case
    assert (
        document["otherData"]["profile"]
        == "davies2018: Davies et al., IEEE Micro 38(1), 2018, Table 2"
    )
    assert document["otherData"]["basis"].startswith("modelled, not measured; ")
