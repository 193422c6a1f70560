"""What any input can take at most, next to what the recordings of the check took."""

from collections.abc import Callable

from locsnn_compile.report.content import Table
from locsnn_compile.report.figures.bounds import Bounded, BoundFigures
from locsnn_compile.report.format import NONE, count, known, plural, share, time

_ROWS: tuple[tuple[str, str, Callable[[float], str]], ...] = (
    ("slowest_step_ns", "step of a row", time),
    ("answer_ns", "answer after the last row", time),
    ("recording_ns", "recording", time),
    ("queued_packets", "spikes queued, on a link or in the core", count),
    ("buffered_events", "events in the transpose buffer", count),
)


def bounds_table(figures: BoundFigures | None) -> Table | None:
    """Return a row for every bound, with the share of it that was measured; None without bounds."""
    if figures is None:
        return None
    recorded = vars(figures.as_recorded)
    any_input = vars(figures.any_input)
    rows = []
    for key, name, said in _ROWS:
        if any_input[key].bound:
            rows.append(_row(name, said, recorded[key], any_input[key]))
    events = plural(figures.as_recorded.events_per_step, "event")
    return Table(
        "Bounds, which no recording exceeds; all compartments may spike that can",
        (
            "at most",
            "in these recordings",
            f"at up to {events} in a step",
            "measured of it",
            f"with all {count(figures.channels)} channels",
        ),
        tuple(rows),
    )


def _row(
    name: str, said: Callable[[float], str], recorded: Bounded, any_input: Bounded
) -> tuple[str, ...]:
    return (
        name,
        known(recorded.measured, said, NONE),
        said(recorded.bound),
        known(recorded.share, share, NONE),
        said(any_input.bound),
    )


def bound_facts(figures: BoundFigures | None) -> dict[str, str]:
    """Return what holds for any input, and which rate of events the target sustains."""
    if figures is None:
        return {}
    recorded = figures.as_recorded
    events = plural(recorded.events_per_step, "event")
    facts = {
        "bound": f"no recording with up to {events} in a step takes more than "
        f"{time(recorded.recording_ns.bound)}, its answer {time(recorded.answer_ns.bound)} after "
        f"the last row; with all {count(figures.channels)} channels "
        f"{time(figures.any_input.recording_ns.bound)}"
    }
    sustained = _sustained(figures)
    if sustained:
        facts["sustained"] = sustained
    return facts


def _sustained(figures: BoundFigures) -> str:
    if figures.step_ns is None or not figures.any_input.slowest_step_ns.bound:
        return ""
    step = f"the {time(figures.step_ns)} between two rows"
    events = figures.sustained_events_per_step
    if events is None:
        return f"none: inner spikes alone may take more than {step}"
    if events == figures.channels:
        return f"events of all {plural(events, 'channel')} in every step are done within {step}"
    most = plural(events, "event")
    return f"up to {most} of {count(figures.channels)} in every step are done within {step}"
