"""The verdict that answers "How fast at worst?": the slowest recording and step of the check, and bounds."""

from locsnn_compile.report.content import Facts, Verdict
from locsnn_compile.report.figures.bounds import BoundFigures
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.latency import LatencyFigures, RealTime
from locsnn_compile.report.format import plural, ratio, time
from locsnn_compile.report.sections.bounds import bound_facts
from locsnn_compile.report.sections.placed import at_clock_of_board
from locsnn_compile.report.sections.verdict import counts_cores, pace

QUESTION = "How fast at worst?"


def worst_time(report: ReportFigures) -> Verdict:
    """Say how long the slowest recording takes, and whether its time is exact or modelled."""
    latency = report.latency
    if not latency.timed:
        return Verdict(
            question=QUESTION,
            status="unknown",
            answer="Not known",
            figure="not known",
            figure_label=f"profile {latency.profile} has no times of operations",
            sentence="No operation has a time, so the time of a recording is not known.",
            facts=(),
        )
    slowest = time(latency.over_samples_ns.max)
    answer = "Cycles exact, on these recordings"
    if counts_cores(report):
        answer = "Modelled, on these recordings"
    return Verdict(
        question=QUESTION,
        status="modelled",
        answer=answer,
        figure=slowest,
        figure_label=f"the slowest of {plural(report.match.samples, 'recording')}",
        sentence=f"The slowest recording takes {slowest}{_against_recorded(latency)}"
        f"{_bound(report.bounds)}.",
        facts=_facts(report).facts,
    )


def _against_recorded(latency: LatencyFigures) -> str:
    if latency.recording_ns is None:
        return ""
    return f", {pace(latency.over_samples_ns.max, latency.recording_ns)}"


def _bound(figures: BoundFigures | None) -> str:
    """Return what no recording exceeds, after a semicolon; nothing if that is not known."""
    if figures is None:
        return ""
    expected = figures.expected
    events = plural(expected.events_per_step, "event")
    longest = time(expected.recording_ns.bound)
    return f"; none with up to {events} in a step takes more than {longest}"


def _facts(report: ReportFigures) -> Facts:
    """Return the longest times, first those of the played recordings and then of any recording."""
    latency = report.latency
    facts: dict[str, str | None] = {
        "worst recording": f"recording {latency.worst_recording.recording}"
    }
    if latency.after_last_row_ns is not None:
        facts["answer"] = f"at most {time(latency.after_last_row_ns.max)} after the last row"
    if latency.real_time is not None:
        facts["slowest step"] = slowest_step(latency.real_time)
    facts |= bound_facts(report.bounds)
    on_board = at_clock_of_board(report)
    if on_board is not None:
        facts[on_board.label] = on_board.value
    return Facts.of(facts)


def slowest_step(real: RealTime) -> str | None:
    """Compare the slowest step with the time between two rows of the sensor; None if no step has a time."""
    if not (real.slowest_step_ns and real.slowest_step_factor):
        return None
    return (
        f"{time(real.slowest_step_ns)} of the {time(real.step_ns)} between two rows, "
        f"{ratio(real.slowest_step_factor)} times faster"
    )
