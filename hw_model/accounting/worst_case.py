"""A bound on the time of any recording on a mesh of cores, given the most events that a row may have.

The time of a step (:mod:`hw_model.accounting.cost`) only grows with spikes and events. So the bound
assumes that in every step all compartments spike that can cross their threshold at all, that all
compartments are active, and, for each core separately, that the events are those that cost this
core the most::

    step  <=  max over cores (time without events + the dearest events for that core) + barrier

Some phases read a recording channel by channel, through the transpose buffer: a step *visits* some
channels and reads all rows of them, of each row no more events than a row may have.
"""

from functools import lru_cache

import numpy as np

from hw_model.accounting.activity import StepActivity, busiest_activity
from hw_model.accounting.cost import DELIVERIES, SYNAPSES, StepTimes, step_times
from hw_model.description.profile import Profile
from hw_model.engine.playing import length_of
from hw_model.mapping.graph import Input, Phase
from hw_model.program.chip_program import ChipProgram
from hw_model.range_proof import can_spike
from hw_model.values import FloatArray, Frozen, Shown

_LINES_TOGETHER = 256
"""Input lines whose effects are counted at a time, which limits memory; chosen by hand."""


class WorstCase(Shown):
    """Bounds for recordings whose rows have at most ``events_per_step`` events, all streams together.

    - ``slowest_step_ns``: for one row as it arrives; 0 if no phase plays rows as they arrive
    - ``answer_ns``: from the last row to the answer
    - ``recording_ns``: for all steps of all phases
    - ``queued_packets``: packets on a link of the mesh in a step or, on the open core, spikes in its queue
    - ``buffered_events``: events in the transpose buffer
    """

    events_per_step: int
    slowest_step_ns: float
    answer_ns: float
    recording_ns: float
    queued_packets: int
    buffered_events: int


class _PhaseCosts(Frozen, eq=False):
    """The largest costs of a phase for each core.

    - ``spikes_ns`` (cores,): when a core is done in a step without events, if all compartments spike that can
    - ``direct_ns[n]`` (cores,): the time of the n dearest events of a row that is played as it arrives
    - ``turned_ns[step][n]`` (cores,): the time of the n dearest events of every row that a step reads from the buffer
    - ``link_packets``: the most on any link in a step
    """

    steps: int
    plays_rows: bool
    spikes_ns: FloatArray
    direct_ns: FloatArray
    turned_ns: tuple[FloatArray, ...]
    barrier_ns: float
    link_packets: int

    def step_ns(self, events_per_step: int) -> FloatArray:
        """Return a bound of the time of every step, (steps,)."""
        row = self.spikes_ns + of_dearest(self.direct_ns, events_per_step)
        bounds = np.full(self.steps, row.max() + self.barrier_ns)
        for step, turned_ns in enumerate(self.turned_ns):
            bounds[step] = (row + of_dearest(turned_ns, events_per_step)).max() + self.barrier_ns
        return bounds


def worst_case(program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
    """Bound the time of recordings of ``rows`` rows by the chip's first profile."""
    slowest_step_ns = 0.0
    answer_ns = 0.0
    recording_ns = 0.0
    queued_packets = 0
    for phase in program.phases:
        costs = _phase_costs(program, phase, rows)
        step_ns = costs.step_ns(events_per_step)
        recording_ns += float(step_ns.sum())
        queued_packets = max(queued_packets, costs.link_packets)
        if costs.plays_rows:
            slowest_step_ns = max(slowest_step_ns, float(step_ns.max()))
            answer_ns += float(step_ns[-1])
        else:
            answer_ns += float(step_ns.sum())
    return WorstCase(
        events_per_step=events_per_step,
        slowest_step_ns=slowest_step_ns,
        answer_ns=answer_ns,
        recording_ns=recording_ns,
        queued_packets=queued_packets,
        buffered_events=buffered_events(program, rows, events_per_step),
    )


def buffered_events(program: ChipProgram, rows: int, events_per_step: int) -> int:
    """Return the most events of a recording that the transpose buffer can hold."""
    turned = [item for item in program.inputs if item.positions is not None]
    channels_of_stream = {item.stream: item.channels for item in turned}
    kept_rows = max((min(item.rows, rows) for item in turned), default=0)
    return kept_rows * min(events_per_step, sum(channels_of_stream.values()))


@lru_cache(maxsize=32)
def _phase_costs(program: ChipProgram, phase: Phase, rows: int) -> _PhaseCosts:
    """Return the costs of a phase for recordings of ``rows`` rows.

    The cache is keyed by the identity of the program.
    """
    profile = program.chip.costs
    inputs = program.inputs_of(phase.name)
    lines = sum(item.size for item in inputs)
    spiking = can_spike(program, phase.name)
    sent = np.zeros((1, lines + len(spiking)), dtype=np.uint8)
    sent[0, lines:] = spiking
    activity = busiest_activity(program, phase.name, sent)
    times = _times(program, phase, activity, profile)
    line_ns = _line_costs(program, phase, lines, len(spiking), profile)
    steps = length_of(program, phase, rows)
    loads = activity.routes.loads(activity.packets)
    return _PhaseCosts(
        steps=steps,
        plays_rows=any(item.positions is None for item in inputs),
        spikes_ns=times.core_ns[0],
        direct_ns=_direct_costs(program, phase, line_ns),
        turned_ns=_turned_costs(program, phase, line_ns, rows, steps),
        barrier_ns=times.barrier_ns,
        link_packets=int(loads.max(initial=0)),
    )


def _times(
    program: ChipProgram, phase: Phase, activity: StepActivity, profile: Profile
) -> StepTimes:
    """Return the times of a step in which every update is of the dearer kind, active or at rest."""
    active_ns = profile.time_ns.get("neuron_updates_active", 0.0)
    resting_ns = profile.time_ns.get("neuron_updates_inactive", 0.0)
    if resting_ns > active_ns:
        at_rest = np.zeros_like(activity.by_piece["neuron_updates_active"])
        activity.by_piece["neuron_updates_active"] = at_rest
    return step_times(program, phase.name, activity, profile)


def _line_costs(
    program: ChipProgram, phase: Phase, lines: int, columns: int, profile: Profile
) -> FloatArray:
    """Return what an event on each input line costs each core, (lines, cores)."""
    parts = [np.zeros((0, len(program.cores_of(phase.name))))]
    for first in range(0, lines, _LINES_TOGETHER):
        line = np.arange(first, min(first + _LINES_TOGETHER, lines))
        # A step for each line, in which only this line has an event.
        sent = np.zeros((len(line), lines + columns), dtype=np.uint8)
        sent[np.arange(len(line)), line] = 1
        activity = busiest_activity(program, phase.name, sent)
        times = step_times(program, phase.name, activity, profile)
        parts.append(times.buffer_ns + times.of(DELIVERIES + SYNAPSES))
    return np.concatenate(parts)


def _direct_costs(program: ChipProgram, phase: Phase, line_ns: FloatArray) -> FloatArray:
    """Return the cost of the 0, 1, 2, ... dearest events of a row, (channels + 1, cores)."""
    by_channel: dict[str, FloatArray] = {}
    lines = program.lines_of(phase.name)
    for item in program.inputs_of(phase.name):
        if item.positions is None:
            before = by_channel.get(item.stream, 0.0)
            by_channel[item.stream] = before + line_ns[lines[item.name]]
    nothing = np.zeros((0, line_ns.shape[1]))
    return dearest_first(np.concatenate([nothing, *by_channel.values()]))


def _turned_costs(
    program: ChipProgram, phase: Phase, line_ns: FloatArray, rows: int, steps: int
) -> tuple[FloatArray, ...]:
    """Return, for every step, the cost of the 0, 1, 2, ... dearest events of every row that it reads."""
    lines = program.lines_of(phase.name)
    turned = [item for item in program.inputs_of(phase.name) if item.positions is not None]
    if not turned:
        return ()
    # By step and channel. Several inputs may read the same channel in one step: its events then cost the sum.
    costs_of_step: list[dict[tuple[str, int], FloatArray]] = [{} for _ in range(steps)]
    for item in turned:
        ns_of_lines = line_ns[lines[item.name]]
        for channel, (step, ns_of_rows) in enumerate(_visits(item, ns_of_lines, rows)):
            if step < steps:
                costs = costs_of_step[step]
                key = (item.stream, channel)
                before = costs.get(key, np.zeros((rows, line_ns.shape[1])))
                costs[key] = before + ns_of_rows
    nothing = np.zeros((1, line_ns.shape[1]))
    dearest = []
    for costs in costs_of_step:
        dearest.append(_dearest_of_rows(list(costs.values())) if costs else nothing)
    return tuple(dearest)


def _visits(item: Input, line_ns: FloatArray, rows: int) -> list[tuple[int, FloatArray]]:
    """Return, for every channel, the step that reads it and the cost of an event of each row, (rows, cores)."""
    steps, first_lines = item.visits
    kept_rows = min(item.rows, rows)
    visits = []
    for step, first_line in zip(steps.tolist(), first_lines.tolist(), strict=True):
        of_rows = np.zeros((rows, line_ns.shape[1]))
        of_rows[:kept_rows] = line_ns[first_line : first_line + kept_rows]
        visits.append((step, of_rows))
    return visits


def _dearest_of_rows(channels: list[FloatArray]) -> FloatArray:
    """Return the cost of the 0, 1, ... dearest events of every row, (channels + 1, cores).

    ``channels`` are the costs of events of each channel, (rows, cores).
    """
    of_rows: FloatArray = dearest_first(np.stack(channels)).sum(axis=1)
    return of_rows


def dearest_first(costs: FloatArray) -> FloatArray:
    """Return the sums of the 0, 1, 2, ... largest numbers along the first axis: (n, ...) becomes (n + 1, ...)."""
    sums = np.zeros((len(costs) + 1, *costs.shape[1:]))
    np.cumsum(-np.sort(-costs, axis=0), axis=0, out=sums[1:])
    return sums


def of_dearest(sums: FloatArray, events: int) -> FloatArray:
    """Return the sum of the dearest ``events``, or of all if there are fewer; ``sums`` as by :func:`dearest_first`."""
    dearest: FloatArray = sums[min(events, len(sums) - 1)]
    return dearest
