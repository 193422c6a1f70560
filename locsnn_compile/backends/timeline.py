"""``--emit trace``: a timeline of steps and cores in the Trace Event Format, which chrome://tracing and Perfetto show.

A phase is a process, and a core a thread. A core updates and sends; when its last packet has arrived, it receives all
packets and adds up the synapses (:mod:`hw_model.accounting.cost`).
"""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from hw_model.accounting.cost import DELIVERIES, SENDING, SYNAPSES, UPDATES, StepTimes, step_times
from locsnn_compile.backends.played import Played

FILE = "trace.json"
_STEPS_THREAD = 0
OPERATIONS = {
    "neuron_updates": "compartment updates",
    "neuron_updates_active": "active updates",
    "neuron_updates_inactive": "inactive updates",
    "spikes": "spikes",
    "axon_packets": "packets sent",
    "packets_within_tile": "packets within the tile",
    "packets_received": "packets received",
    "synaptic_ops": "synaptic operations",
}
"""Operations that a profile may time, in words."""

Event = dict[str, Any]


def trace_file(played: Played) -> dict[str, bytes]:
    """Return the file by name, timed by the chip's default profile."""
    chip = played.program.chip
    profile = chip.costs
    events: list[Event] = []
    start_ns = 0.0
    for process, phase in enumerate(played.phases, start=1):
        activity = played.result.activity[phase.name][0]
        times = step_times(played.program, phase.name, activity, profile)
        events += _names(played, phase.name, process)
        for step in np.flatnonzero(times.runs).tolist():
            events += _step(played, phase.name, process, step, times, start_ns)
            start_ns += float(times.step_ns[step])
    about = {
        "program": played.program.name,
        "target": chip.name,
        "recording": played.title,
        "profile": f"{chip.default_profile}: {profile.source}",
        "basis": f"modelled, not measured; {profile.basis}",
    }
    lines = ",\n".join(_json(event) for event in events)
    text = f'{{"displayTimeUnit":"ns","otherData":{_json(about)},"traceEvents":[\n{lines}\n]}}\n'
    return {FILE: text.encode()}


def _json(value: dict[str, Any]) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"))


def _names(played: Played, phase: str, process: int) -> Iterator[Event]:
    yield _meta("process_name", process, _STEPS_THREAD, {"name": f"phase {phase}"})
    yield _meta("thread_name", process, _STEPS_THREAD, {"name": "steps"})
    for core in played.program.cores_of(phase):
        x, y = played.program.chip.tile_of(core.slot)
        yield _meta("thread_name", process, _thread(core.number), {"name": f"core {core.number}, tile {x},{y}"})


def _step(played: Played, phase: str, process: int, step: int, times: StepTimes, start_ns: float) -> Iterator[Event]:
    """Yield the events of a step: the step itself, its barrier, and the work of each core."""
    core_ns, begin_ns, sent_ns = times.core_ns[step], times.begin_ns[step], times.sent_ns[step]
    slowest = float(core_ns.max())
    cores = played.program.cores_of(phase)
    critical = {"slowest core": cores[int(core_ns.argmax())].number}
    yield _slice(f"step {step}", process, _STEPS_THREAD, start_ns, slowest + times.barrier_ns, critical)
    yield _slice("barrier", process, _STEPS_THREAD, start_ns + slowest, times.barrier_ns, {})
    activity = played.result.activity[phase][0]
    for i, core in enumerate(cores):
        thread = _thread(core.number)
        before = [(OPERATIONS[name], name) for name in UPDATES + SENDING if name in times.work_ns]
        after = [(OPERATIONS[name], name) for name in DELIVERIES + SYNAPSES if name in times.work_ns]
        if times.buffer_ns[step, i] > 0:
            events = {"count": int(activity.buffered[step])}
            begin = start_ns + float(begin_ns[i])
            yield _slice("transposed events", process, thread, begin, float(times.buffer_ns[step, i]), events)
        if begin_ns[i] > sent_ns[i]:
            waits = float(begin_ns[i] - sent_ns[i])
            yield _slice("wait for packets", process, thread, start_ns + float(sent_ns[i]), waits, {})
        for drawn, first_ns in ((before, 0.0), (after, float(begin_ns[i] + times.buffer_ns[step, i]))):
            at_ns = start_ns + first_ns
            for title, name in drawn:
                took_ns = float(times.work_ns[name][step, i])
                if took_ns > 0:
                    yield _slice(title, process, thread, at_ns, took_ns, {"count": int(activity.count(name)[step, i])})
                    at_ns += took_ns


def _thread(core: int) -> int:
    return core + 1


def _slice(name: str, process: int, thread: int, start_ns: float, took_ns: float, values: dict[str, Any]) -> Event:
    """Return a complete event; the format counts in microseconds."""
    ts, end = (float(np.round(ns / 1000, 7)) for ns in (start_ns, start_ns + took_ns))
    return {"name": name, "ph": "X", "pid": process, "tid": thread, "ts": ts, "dur": round(end - ts, 7), "args": values}


def _meta(name: str, process: int, thread: int, values: dict[str, Any]) -> Event:
    return {"name": name, "ph": "M", "pid": process, "tid": thread, "ts": 0, "args": values}
