"""What any input can take at most, next to what the recordings of the check took."""

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


def bounds_table(figures: BoundFigures | None) -> Table | None:
    """Return a row for every bound, with the share of it that was measured; None without bounds."""
    if figures is None:
        return None
    at_other_rates = [figures.any_input]
    if figures.as_stated is not None:
        at_other_rates.insert(0, figures.as_stated)
    rows = []
    for key, name, text_of in _ROWS:
        if vars(figures.any_input)[key].bound:
            others = [vars(rate)[key] for rate in at_other_rates]
            rows.append(_row(name, text_of, vars(figures.as_recorded)[key], others))
    columns = ["at most", "in these recordings", _at(figures.as_recorded), "measured of it"]
    if figures.as_stated is not None:
        columns.append(_at(figures.as_stated))
    columns.append(f"with all {count(figures.channels)} channels")
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
    at_other_rates: Sequence[Bounded],
) -> tuple[str, ...]:
    return (
        name,
        known(recorded.measured, text_of, NONE),
        text_of(recorded.bound),
        known(recorded.share, share, NONE),
        *(text_of(bounded.bound) for bounded in at_other_rates),
    )


def bound_facts(figures: BoundFigures | None) -> dict[str, str]:
    """Return what holds for any input, and which rate of events the target sustains."""
    if figures is None:
        return {}
    expected = figures.expected
    events = plural(expected.events_per_step, "event")
    facts = {
        "bound": f"with up to {events} in a step, the answer comes at most "
        f"{time(expected.answer_ns.bound)} after the last row; with all {count(figures.channels)} "
        f"channels, a recording takes at most {time(figures.any_input.recording_ns.bound)}"
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
