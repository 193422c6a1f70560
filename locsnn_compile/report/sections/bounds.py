"""Show worst cases: what any input up to a rate of events can take at most, next to what the recordings took."""

from collections.abc import Callable, Sequence

from locsnn_compile.report.content import Table
from locsnn_compile.report.figures.bounds import Bounded, BoundFigures, RateBounds
from locsnn_compile.report.format import NONE, count, known, plural, share, time

_ROWS: tuple[tuple[str, str, Callable[[float], str]], ...] = (
    ("slowest_step_ns", "step of a row", time),
    ("answer_ns", "answer after the last row", time),
    ("recording_ns", "recording", time),
    ("queued_packets", "spikes queued, on a link or in the core", count),
    ("buffered_events", "events in the transpose buffer", count),
)
"""Rows of the table: the field of ``RateBounds``, its name, and the function that writes its numbers."""


def bounds_table(figures: BoundFigures | None) -> Table | None:
    """Return a row for every bound: what was measured, and the bounds at two or three rates. None without bounds."""
    if figures is None:
        return None
    # Columns from the lowest rate to the highest: as recorded, as stated by the user, any input.
    columns = ["at most", "in these recordings", _at(figures.as_recorded), "measured of it"]
    higher_rates = []
    if figures.as_stated is not None:
        columns.append(_at(figures.as_stated))
        higher_rates.append(figures.as_stated)
    columns.append(f"with all {count(figures.channels)} channels")
    higher_rates.append(figures.any_input)
    rows = []
    for key, name, text_of in _ROWS:
        # A bound of 0 at the highest rate is of something that the target does not have, such as a buffer.
        if vars(figures.any_input)[key].bound:
            at_higher_rates = [vars(rate)[key] for rate in higher_rates]
            rows.append(_row(name, text_of, vars(figures.as_recorded)[key], at_higher_rates))
    return Table(
        "Bounds, which no recording exceeds; all compartments may spike that can",
        tuple(columns),
        tuple(rows),
    )


def _at(rate: RateBounds) -> str:
    return f"at up to {plural(rate.events_per_step, 'event')} in a step"


def _row(
    name: str,
    text_of: Callable[[float], str],
    recorded: Bounded,
    at_higher_rates: Sequence[Bounded],
) -> tuple[str, ...]:
    return (
        name,
        known(recorded.measured, text_of, NONE),
        text_of(recorded.bound),
        known(recorded.share, share, NONE),
        *(text_of(bounded.bound) for bounded in at_higher_rates),
    )


def bound_facts(figures: BoundFigures | None) -> dict[str, str]:
    """Return the facts that hold for any input: bounds on time, and which rate of events the target sustains."""
    if figures is None:
        return {}
    expected = figures.expected
    events = plural(expected.events_per_step, "event")
    answer = time(expected.answer_ns.bound)
    recording = time(figures.any_input.recording_ns.bound)
    facts = {
        "bound": f"with up to {events} in a step, the answer comes at most "
        f"{answer} after the last row; with all {count(figures.channels)} "
        f"channels, a recording takes at most {recording}"
    }
    sustained = _sustained(figures)
    if sustained:
        facts["sustained"] = sustained
    return facts


def _sustained(figures: BoundFigures) -> str:
    """Say how many events per step the target always finishes in time; nothing if that is unknown."""
    # No bound on the step of a row: no phase plays rows as they arrive.
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
