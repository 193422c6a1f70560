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
        yield _meta(
            "thread_name", process, core.number + 1, {"name": f"core {core.number}, tile {x},{y}"}
        )


def _step(
    played: Played, phase: str, process: int, step: int, times: StepTimes, start_ns: float
) -> Iterator[Event]:
    """Yield the events of a step: the step itself, its barrier, and the work of each core."""
    cores, activity = played.program.cores_of(phase), played.result.activity[phase][0]
    slowest = float(times.core_ns[step].max())
    critical = {"slowest core": cores[int(times.core_ns[step].argmax())].number}
    yield _slice(
        f"step {step}", process, _STEPS_THREAD, start_ns, slowest + times.barrier_ns, critical
    )
    yield _slice("barrier", process, _STEPS_THREAD, start_ns + slowest, times.barrier_ns, {})
    for i, core in enumerate(cores):
        begin, sent, buffer = (
            float(ns[step, i]) for ns in (times.begin_ns, times.sent_ns, times.buffer_ns)
        )
        drawn = [
            (
                "transposed events",
                start_ns + begin,
                buffer,
                {"count": int(activity.buffered[step])},
            ),
            ("wait for packets", start_ns + sent, begin - sent, {}),
        ]
        for first_ns, names in ((0.0, UPDATES + SENDING), (begin + buffer, DELIVERIES + SYNAPSES)):
            at_ns = start_ns + first_ns
            for name in (name for name in names if name in times.work_ns):
                took_ns = float(times.work_ns[name][step, i])
                drawn.append(
                    (
                        OPERATIONS[name],
                        at_ns,
                        took_ns,
                        {"count": int(activity.count(name)[step, i])},
                    )
                )
                at_ns += took_ns
        for title, at_ns, took_ns, values in drawn:
            if took_ns > 0:
                yield _slice(title, process, core.number + 1, at_ns, took_ns, values)


def _slice(
    name: str, process: int, thread: int, start_ns: float, took_ns: float, values: dict[str, Any]
) -> Event:
    """Return a complete event; the format counts in microseconds."""
    ts, end = (float(np.round(ns / 1000, 7)) for ns in (start_ns, start_ns + took_ns))
    return {
        "name": name,
        "ph": "X",
        "pid": process,
        "tid": thread,
        "ts": ts,
        "dur": round(end - ts, 7),
        "args": values,
    }


def _meta(name: str, process: int, thread: int, values: dict[str, Any]) -> Event:
    return {"name": name, "ph": "M", "pid": process, "tid": thread, "ts": 0, "args": values}
