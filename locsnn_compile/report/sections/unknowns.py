"""The verdict that answers "What is not known?": what the check of a build could not show."""

from collections.abc import Mapping, Sequence

from locsnn_compile.report.content import Facts, Verdict
from locsnn_compile.report.figures.document import ReportFigures, SharedFigures
from locsnn_compile.report.figures.energy import EnergyFigures
from locsnn_compile.report.format import plural
from locsnn_compile.report.sections.behaviour import agreement_interval
from locsnn_compile.report.sections.verdict import counts_cores
from locsnn_compile.report.words import listed


def unknowns_of(report: ReportFigures) -> Verdict:
    """List what is unknown about a build for a mesh of cores or the open core."""
    return unknowns(report, {"energy": _energy(report), "on a board": _on_a_board(report)})


def unknowns(report: SharedFigures, of_chip: Mapping[str, str]) -> Verdict:
    """List what is unknown about a build for any kind of target, and count the assumptions.

    ``of_chip`` is what is unknown about the chip, by subject, such as ``energy``.
    """
    points = Facts.of(
        {
            "accuracy": _accuracy(report),
            "other recordings": _other_recordings(report),
            **of_chip,
        }
    ).facts
    assumptions = len(report.assumptions)
    return Verdict(
        question="What is not known?",
        status="unknown",
        answer=plural(len(points), "point"),
        figure=str(len(points)),
        figure_label=(
            f"and {plural(assumptions, 'assumption')}" if assumptions else "and no assumptions"
        ),
        sentence=f"Not known: {listed([point.label for point in points])}.",
        facts=points,
    )


def _accuracy(report: SharedFigures) -> str | None:
    """Say why the accuracy is unknown; None if it is known."""
    if report.match.events_origin == "made up":
        return "the recordings are made up"
    return "the recordings have no labels" if report.accuracy is None else None


def _other_recordings(report: SharedFigures) -> str:
    """Say what the recordings of the check prove about other recordings of the same kind."""
    interval = agreement_interval(report.match)
    if interval is None:
        return "no prediction was compared"
    low, high = interval
    return (
        f"the same prediction in {100 * low:.1f} to {100 * high:.1f} % of them (95 % confidence), "
        f"from {plural(report.match.samples, 'recording')}"
    )


def _energy(report: ReportFigures) -> str:
    if report.energy is None:
        return "no power model of such devices is public"
    left_out = _without_bound(report.energy)
    about_left_out = f"; it leaves out {listed(left_out)}" if left_out else ""
    return f"a model of published costs, not measured{about_left_out}"


def _without_bound(energy: EnergyFigures) -> Sequence[str]:
    """Return what the energy leaves out without even an upper bound."""
    return [item.what for item in energy.not_included_bounds if item.at_most_pj is None]


def _on_a_board(report: ReportFigures) -> str:
    if counts_cores(report):
        return "times are a model; nothing ran on a board"
    return "cycles are those of the simulated core; nothing ran on a board"
