"""The section on predictions while a recording plays, and on what stopping early would save."""

from collections.abc import Callable, Sequence

from locsnn_compile.report.content import Bar, Cell, Curve, Facts, Folded, Plot, Section, Table
from locsnn_compile.report.figures.checks import NotFollowed, OverTimeFigures
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.format import count, energy, share, short, time
from locsnn_compile.report.pictures.axis import Axis
from locsnn_compile.report.sections.accuracy import sample_words
from locsnn_compile.report.sections.cost_tables import PARTS, energy_course, time_course
from locsnn_compile.report.words import words
from locsnn_compile.verification.savings import Savings

_TITLE = "Over time"
_LEAD = (
    "What the chip predicts after every step of a recording. The time branch has run so far; the "
    "location branch runs on what was recorded so far, as if nothing followed."
)


def over_time(report: ReportFigures) -> Section:
    """Return the section on right predictions during a recording, and on what a proven stop saves.

    Without predictions over time, it shows only the cost of steps. A stop is proven as soon as no further
    input can change the prediction.
    """
    figures = report.over_time
    costs = _costs_of_steps(report)
    if figures is None:
        return Section.of("over-time", _TITLE, "What the steps of a recording cost.", *costs)
    if isinstance(figures, NotFollowed):
        lead = f"Predictions were not followed step by step: {figures.left_out}."
        return Section.of("over-time", _TITLE, lead, *costs)
    return Section.of(
        "over-time",
        _TITLE,
        _LEAD,
        _plot(figures),
        _stop(figures.proven_stop),
        _proven_stop(figures.proven_stop),
        Folded.of(
            "In figures, and how branches are weighted",
            _table(figures),
            _time_weighted(figures.psi) if "time_weighted" in figures.right else None,
            Facts.of({"recordings": sample_words(figures.sample, named=False)}),
        ),
        Folded.of("Energy and time of a step", *costs),
    )


def _costs_of_steps(report: ReportFigures) -> tuple[Plot | Table, ...]:
    """Return a plot and a table of the energy over the steps, and of the time, where they are known."""
    costs: tuple[Plot | Table, ...] = ()
    if report.energy is not None:
        costs += energy_course(report.energy)
    latency = report.latency
    if latency.timed and latency.mesh is not None:
        costs += time_course(latency.mesh.by_step_ns, latency.profile)
    return costs


def _time_weighted(psi: float) -> str:
    return (
        "Time-weighted: spikes of the time branch count 1 - w and those of the location branch w, "
        f"where w = 1 / (1 + exp(-psi (t / T - 1))) after step t of T, with psi {psi:g}. Published "
        "values of psi are 15 for Objects, 10 for Containers and 2 for Slip."
    )


def _proven_stop(savings: Savings) -> str:
    return (
        "A recording stops as soon as no further input could change the class with the highest score, "
        "so the predictions are those of the whole recording. Its "
        f"{count(savings.all_steps)} steps are those of all branches, one after the other."
    )


def _title(figures: OverTimeFigures) -> str:
    if figures.right_is == "the label":
        return "Accuracy after each step"
    return "Recordings with the same prediction as after the last step"


def _plot(figures: OverTimeFigures) -> Plot:
    """Draw the share of right predictions over the steps, or over seconds if the length of a step is known."""
    last_step = figures.steps[-1]
    step_seconds = figures.step_seconds

    def tick_text(step: float) -> str:
        return short(step * step_seconds) if step_seconds else f"{step:.0f}"

    ticks = tuple(part * last_step for part in (0.0, *PARTS))
    return Plot(
        title=_title(figures),
        x_label="seconds" if step_seconds else "steps",
        x=Axis(0.0, last_step, ticks, tick_text),
        y=Axis(
            low=0.0,
            high=1.0,
            ticks=(0.25, 0.5, 0.75, 1.0),
            text=lambda share: f"{100 * share:.0f} %",
        ),
        curves=tuple(
            Curve(words(name), tuple(zip(figures.steps, shares, strict=True)))
            for name, shares in figures.right.items()
        ),
    )


def _table(figures: OverTimeFigures) -> Table:
    """Return the share of right predictions after five steps: those nearest to ``PARTS`` of the last one."""
    steps = figures.steps
    columns = [_nearest(steps, part * steps[-1]) for part in PARTS]
    rows = []
    for name, shares in figures.right.items():
        rows.append((words(name), *(share(shares[i]) for i in columns)))
    headings = (f"step {count(steps[i])}" for i in columns)
    return Table(_title(figures), ("prediction by", *headings), tuple(rows))


def _nearest(steps: Sequence[int], wanted_step: float) -> int:
    """Return the index of the step that is nearest to one of any number."""
    return min(range(len(steps)), key=lambda i: abs(steps[i] - wanted_step))


def _stop(savings: Savings) -> Table:
    """Return what a proven stop saves; a cost that is unknown has no row."""
    of_profile = f", profile {savings.profile}"
    rows = (
        _saved("steps", savings.steps, savings.all_steps, count),
        _saved("synaptic operations", savings.synaptic_ops, savings.all_synaptic_ops, count),
        _saved(f"energy{of_profile}", savings.energy_pj, savings.all_energy_pj, energy),
        _saved(f"latency{of_profile}", savings.latency_ns, savings.all_latency_ns, time),
    )
    return Table(
        "Stopped as soon as the winner is proven, mean per recording",
        ("cost", "", "whole recording", "until the stop", "saved"),
        tuple(row for row in rows if row),
    )


def _saved(
    name: str, until: float | None, whole: float | None, shown: Callable[[float], str]
) -> tuple[Cell, ...]:
    """Return the row of a cost until the stop and for the whole recording; an empty row if it is unknown."""
    if until is None or whole is None:
        return ()
    saved = 1.0 - until / whole if whole else 0.0
    return name, Bar(saved, f"{share(saved)} saved"), shown(whole), shown(until), share(saved)
