"""``--emit trace``: write a timeline of steps and cores in the Trace Event Format, for chrome://tracing and Perfetto.

A phase is a process of the format, and a core a thread; a first thread has the steps. In each step, a core updates its
compartments and sends packets; when the last packet to it has arrived, it receives all packets and adds up the
synapses. All times are modelled (:mod:`hw_model.accounting.cost`).
"""

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from hw_model.accounting.activity import StepActivity
from hw_model.accounting.cost import DELIVERIES, SENDING, SYNAPSES, UPDATES, StepTimes, step_times
from locsnn_compile.backends.played import Played

FILE = "trace.json"
_STEPS_THREAD = 0
"""The thread of a phase that shows its steps; that of core n is n + 1."""
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
"""An event of the format."""


class _Work(NamedTuple):
    """A piece of work of a core in a step: when it begins and how long it takes, with values to show."""

    title: str
    start_ns: float
    duration_ns: float
    values: dict[str, Any]


def trace_file(played: Played) -> dict[str, bytes]:
    """Return the content of the file, by its name; times are those of the chip's default profile."""
    chip = played.program.chip
    profile = chip.costs
    events: list[Event] = []
    start_ns = 0.0
    for process, phase in enumerate(played.phases, start=1):
        activity = played.result.activity[phase.name][0]  # of the only recording
        times = step_times(played.program, phase.name, activity, profile)
        events += _names(played, phase.name, process)
        # Steps that the engine skipped take no time.
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
    # One event per line, so that the file can be read and compared.
    lines = ",\n".join(_json(event) for event in events)
    text = f'{{"displayTimeUnit":"ns","otherData":{_json(about)},"traceEvents":[\n{lines}\n]}}\n'
    return {FILE: text.encode()}


def _json(value: dict[str, Any]) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"))


def _names(played: Played, phase: str, process: int) -> Iterator[Event]:
    """Yield the events that name the process of a phase and its threads."""
    yield _name_event("process_name", process, _STEPS_THREAD, f"phase {phase}")
    yield _name_event("thread_name", process, _STEPS_THREAD, "steps")
    for core in played.program.cores_of(phase):
        x, y = played.program.chip.tile_of(core.slot)
        name = f"core {core.number}, tile {x},{y}"
        yield _name_event("thread_name", process, core.number + 1, name)


def _step(
    played: Played, phase: str, process: int, step: int, times: StepTimes, start_ns: float
) -> Iterator[Event]:
    """Yield the events of a step: the step itself, its barrier, and the work of each core.

    The barrier is the time from the last core to the end of the step, in which all cores synchronise.
    """
    cores = played.program.cores_of(phase)
    slowest_ns = float(times.core_ns[step].max())
    slowest_core = cores[int(times.core_ns[step].argmax())]
    whole_step = _Work(
        title=f"step {step}",
        start_ns=start_ns,
        duration_ns=slowest_ns + times.barrier_ns,
        values={"slowest core": slowest_core.number},
    )
    barrier = _Work("barrier", start_ns + slowest_ns, times.barrier_ns, {})
    yield _complete_event(process, _STEPS_THREAD, whole_step)
    yield _complete_event(process, _STEPS_THREAD, barrier)
    activity = played.result.activity[phase][0]
    for i, core in enumerate(cores):
        for work in _core_work(activity, times, step, i, start_ns):
            # Viewers cannot show events that take no time.
            if work.duration_ns > 0:
                yield _complete_event(process, core.number + 1, work)


def _core_work(
    activity: StepActivity, times: StepTimes, step: int, core: int, start_ns: float
) -> Iterator[_Work]:
    """Yield the work of a core in a step that begins at ``start_ns``; ``core`` is its index in the phase."""
    sent_ns = start_ns + float(times.sent_ns[step, core])
    begin_ns = float(times.begin_ns[step, core])
    buffer_ns = float(times.buffer_ns[step, core])
    wait_ns = begin_ns - float(times.sent_ns[step, core])
    buffered = {"count": int(activity.buffered[step])}
    yield _Work("transposed events", start_ns + begin_ns, buffer_ns, buffered)
    yield _Work("wait for packets", sent_ns, wait_ns, {})
    # Updates and sending begin with the step; deliveries and synapses follow the transpose buffer.
    for first_ns, names in (
        (0.0, UPDATES + SENDING),
        (begin_ns + buffer_ns, DELIVERIES + SYNAPSES),
    ):
        work_start_ns = start_ns + first_ns
        for name in names:
            # Operations that the profile does not time are left out.
            if name in times.work_ns:
                duration_ns = float(times.work_ns[name][step, core])
                values = {"count": int(activity.count(name)[step, core])}
                yield _Work(OPERATIONS[name], work_start_ns, duration_ns, values)
                work_start_ns += duration_ns


def _complete_event(process: int, thread: int, work: _Work) -> Event:
    """Return a complete event (ph X), with a beginning and a duration; the format counts in microseconds."""
    # Start and end are rounded, to 0.1 ps, and the duration is their difference, so that events that follow each other
    # do not overlap in the last digit: viewers would nest them.
    start_us = float(np.round(work.start_ns / 1000, 7))
    end_us = float(np.round((work.start_ns + work.duration_ns) / 1000, 7))
    return {
        "name": work.title,
        "ph": "X",
        "pid": process,
        "tid": thread,
        "ts": start_us,
        "dur": round(end_us - start_us, 7),
        "args": work.values,
    }


def _name_event(kind: str, process: int, thread: int, name: str) -> Event:
    """Return a metadata event (ph M) that names a process or a thread."""
    return {
        "name": kind,
        "ph": "M",
        "pid": process,
        "tid": thread,
        "ts": 0,
        "args": {"name": name},
    }
