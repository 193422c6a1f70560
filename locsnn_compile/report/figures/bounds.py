"""The entry ``bounds`` of report.json, the worst cases: bounds on time and queues that hold for any input.

A bound is stated for a rate, the most events in a step. It is computed from the program alone, so it
also holds for recordings that nobody played. The report shows it next to what was measured.
"""

from typing import NamedTuple

import hw_model as hw
from hw_model.targets import target_of
from locsnn_compile.report.figures.entries import Entry, IfKnown
from locsnn_compile.verification.event_peaks import EventPeaks
from locsnn_compile.verification.matching import Match


class Bounded(Entry):
    """A bound, the largest value measured over the recordings of the check, and that value's share of the bound.

    ``measured`` and ``share`` are None if unknown; ``share`` is also None where the bound is 0.
    """

    bound: float
    measured: float | None
    share: float | None


class RateBounds(Entry):
    """Bounds for any recording with at most ``events_per_step`` events in a step.

    - ``answer_ns``: the time from the last row (step of the recording) to the answer
    - ``queued_packets``: packets of one link of the mesh in a step or, on the open core, the spikes in its queue
    - ``buffered_events``: events in the transpose buffer
    """

    events_per_step: int
    slowest_step_ns: Bounded
    answer_ns: Bounded
    recording_ns: Bounded
    queued_packets: Bounded
    buffered_events: Bounded


class BoundFigures(Entry):
    """``bounds``: worst cases at two or three rates of events.

    - ``as_recorded``: at the rate of the busiest step of the recordings
    - ``any_input``: if all ``channels`` have an event in every step, which no input can exceed
    - ``as_stated``: at the rate that ``--events-per-step`` states; nothing is measured at this rate
    - ``sustained_events_per_step``: the most events per step with which the chip always finishes a step
      within ``step_ns``. None if the chip may need longer even without events, because of spikes between
      its neurons, if the length of a step is unknown, or if no phase plays rows as they arrive
    """

    channels: int
    as_recorded: RateBounds
    any_input: RateBounds
    step_ns: float | None
    sustained_events_per_step: int | None
    as_stated: IfKnown[RateBounds] = None

    @property
    def expected(self) -> RateBounds:
        """The bounds at the rate that the user expects: the stated rate, or else that of the recordings."""
        return self.as_recorded if self.as_stated is None else self.as_stated


class _Measured(NamedTuple):
    """The largest values over the recordings of the check; None where nothing is measured."""

    slowest_step_ns: float | None
    answer_ns: float | None
    recording_ns: float | None
    queued_packets: float | None
    buffered_events: float | None


_NOT_MEASURED = _Measured(
    slowest_step_ns=None,
    answer_ns=None,
    recording_ns=None,
    queued_packets=None,
    buffered_events=None,
)


def bound_figures(
    program: hw.ChipProgram,
    match: Match,
    steps: int,
    peaks: EventPeaks | None,
    step_seconds: float | None,
) -> BoundFigures | None:
    """Return ``bounds`` for recordings of ``steps`` steps; None if not asked for, or for a chip without times."""
    target = target_of(program.chip)
    if peaks is None or not target.timed:
        return None
    channels = sum(program.streams.values())
    measured = _measured(match, peaks, times_cores=target.times_cores)
    as_recorded = hw.worst_case(program, steps, peaks.of_step)
    any_input = hw.worst_case(program, steps, channels)
    step_ns = None if step_seconds is None else step_seconds * 1e9
    sustained = None
    # The slowest step has no time if no phase plays rows as they arrive.
    if step_ns is not None and any_input.slowest_step_ns:
        sustained = hw.sustained_events(program, steps, step_ns)
    as_stated = None
    if peaks.stated is not None:
        as_stated = _bounds(hw.worst_case(program, steps, peaks.stated), _NOT_MEASURED)
    return BoundFigures(
        channels=channels,
        as_recorded=_bounds(as_recorded, measured),
        any_input=_bounds(any_input, measured),
        step_ns=step_ns,
        sustained_events_per_step=sustained,
        as_stated=as_stated,
    )


def _measured(match: Match, peaks: EventPeaks, *, times_cores: bool) -> _Measured:
    """Return the largest values over the recordings of the check.

    ``times_cores``: whether the chip has times of single cores and steps, or of whole recordings only.
    """
    recording_ns = max(latency.total_ns for latency in match.latencies)
    if not times_cores:
        return _Measured(
            slowest_step_ns=None,
            answer_ns=None,
            recording_ns=recording_ns,
            queued_packets=None,
            buffered_events=peaks.of_buffer,
        )
    most_packets_by_phase = [int(usage.link_most.max(initial=0)) for usage in match.usage.values()]
    return _Measured(
        slowest_step_ns=max(latency.slowest_step_ns for latency in match.latencies),
        answer_ns=max(latency.after_last_row_ns for latency in match.latencies),
        recording_ns=recording_ns,
        queued_packets=max(most_packets_by_phase),
        buffered_events=peaks.of_buffer,
    )


def _bounds(worst: hw.WorstCase, measured: _Measured) -> RateBounds:
    """Return the bounds at one rate, each next to the largest value that was measured."""
    return RateBounds(
        events_per_step=worst.events_per_step,
        slowest_step_ns=_bounded(worst.slowest_step_ns, measured.slowest_step_ns),
        answer_ns=_bounded(worst.answer_ns, measured.answer_ns),
        recording_ns=_bounded(worst.recording_ns, measured.recording_ns),
        queued_packets=_bounded(worst.queued_packets, measured.queued_packets),
        buffered_events=_bounded(worst.buffered_events, measured.buffered_events),
    )


def _bounded(bound: float, measured: float | None) -> Bounded:
    # Counts become floats, so that report.json has one type for all bounds.
    if measured is None:
        return Bounded(float(bound), measured=None, share=None)
    share = measured / bound if bound else None
    return Bounded(float(bound), float(measured), share)
