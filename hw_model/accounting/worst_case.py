"""The longest that any input can take on a mesh of cores, as long as it keeps a rate of events.

The time of a step (:mod:`hw_model.accounting.cost`) only grows with spikes and events. So in every
step of the bound all compartments spike that can cross their threshold at all, all work on
something, and of the events that the rate allows those come that cost a core most, for each core::

    step  <=  max over cores (time without events + the dearest events for that core) + barrier

Through the transpose buffer, a step reads the rows of the channels that it visits: of each row, no
more events than the rate allows in a step of the recording.
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
"""Input lines whose effects are counted at a time."""


class WorstCase(Shown):
    """The most that a recording takes whose steps have at most ``events_per_step`` events, all streams together.

    - ``slowest_step_ns``: for one row as it arrives; 0 if no phase plays rows as they arrive
    - ``answer_ns``: from the last row to the answer
    - ``recording_ns``: for all steps of all phases
    - ``queued_packets``: on a link of the mesh in a step or, on the open core, spikes in its queue
    - ``buffered_events``: in the transpose buffer
    """

    events_per_step: int
    slowest_step_ns: float
    answer_ns: float
    recording_ns: float
    queued_packets: int
    buffered_events: int


class _PhaseCosts(Frozen, eq=False):
    """What a phase can cost each core.

    - ``spikes_ns`` (cores,): when a core is done in a step in which all compartments spike that can
    - ``direct_ns`` (channels + 1, cores): the dearest events of a row, by how many there are
    - ``turned_ns[step]`` (visited channels + 1, cores): the same of all rows that a step reads
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
        """Return a bound for every step, (steps,)."""
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
    """Return the costs of a phase for recordings of ``rows`` rows. Programs are hashed by identity."""
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
    """Return the times of a step in which every update takes as long as the dearer kind."""
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
        some = np.arange(first, min(first + _LINES_TOGETHER, lines))
        sent = np.zeros((len(some), lines + columns), dtype=np.uint8)
        sent[np.arange(len(some)), some] = 1
        activity = busiest_activity(program, phase.name, sent)
        times = step_times(program, phase.name, activity, profile)
        parts.append(times.buffer_ns + times.of(DELIVERIES + SYNAPSES))
    return np.concatenate(parts)


def _direct_costs(program: ChipProgram, phase: Phase, line_ns: FloatArray) -> FloatArray:
    """Return what the dearest events of a row cost, by how many there are, (channels + 1, cores)."""
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
    """Return for every step what the dearest events of all rows cost, by how many a row has."""
    lines = program.lines_of(phase.name)
    turned = [item for item in program.inputs_of(phase.name) if item.positions is not None]
    if not turned:
        return ()
    # Several inputs may read the same channel in one step: each of its events is then on a line of each.
    read: list[dict[tuple[str, int], FloatArray]] = [{} for _ in range(steps)]
    for item in turned:
        own_ns = line_ns[lines[item.name]]
        for channel, (step, of_rows) in enumerate(_visits(item, own_ns, rows)):
            if step < steps:
                before = read[step].get((item.stream, channel), np.zeros((rows, line_ns.shape[1])))
                read[step][item.stream, channel] = before + of_rows
    nothing = np.zeros((1, line_ns.shape[1]))
    costs = []
    for of_channels in read:
        costs.append(_dearest_of_rows(list(of_channels.values())) if of_channels else nothing)
    return tuple(costs)


def _visits(item: Input, line_ns: FloatArray, rows: int) -> list[tuple[int, FloatArray]]:
    """Return for every channel the step at which it is read, and what its rows cost, (rows, cores)."""
    steps, first_lines = item.visits
    kept_rows = min(item.rows, rows)
    visits = []
    for step, first_line in zip(steps.tolist(), first_lines.tolist(), strict=True):
        of_rows = np.zeros((rows, line_ns.shape[1]))
        of_rows[:kept_rows] = line_ns[first_line : first_line + kept_rows]
        visits.append((step, of_rows))
    return visits


def _dearest_of_rows(channels: list[FloatArray]) -> FloatArray:
    """Return what the dearest events of all rows cost, (channels + 1, cores); each is (rows, cores)."""
    of_rows: FloatArray = dearest_first(np.stack(channels)).sum(axis=1)
    return of_rows


def dearest_first(costs: FloatArray) -> FloatArray:
    """Return sums of the 0, 1, 2, ... largest along the first axis: (n, ...) becomes (n + 1, ...)."""
    sums = np.zeros((len(costs) + 1, *costs.shape[1:]))
    np.cumsum(-np.sort(-costs, axis=0), axis=0, out=sums[1:])
    return sums


def of_dearest(sums: FloatArray, events: int) -> FloatArray:
    """Return the sum of the dearest ``events``, or of all if there are fewer; ``sums`` as by :func:`dearest_first`."""
    dearest: FloatArray = sums[min(events, len(sums) - 1)]
    return dearest
