"""What is not known? What the check could not show, next to the figures that it limits."""

from collections.abc import Mapping, Sequence

from locsnn_compile.report.content import Facts, Verdict
from locsnn_compile.report.figures.document import ReportFigures, SharedFigures
from locsnn_compile.report.figures.energy import EnergyFigures
from locsnn_compile.report.format import plural
from locsnn_compile.report.sections.behaviour import agreement_interval
from locsnn_compile.report.sections.verdict import counts_cores
from locsnn_compile.report.words import listed


def unknowns_of(report: ReportFigures) -> Verdict:
    """List what nobody knows of this build for a mesh of cores or the open core."""
    return unknowns(report, {"energy": _energy(report), "on a board": _on_a_board(report)})


def unknowns(report: SharedFigures, of_chip: Mapping[str, str]) -> Verdict:
    """List what nobody knows of this build, and how many assumptions stand besides.

    ``of_chip`` is what is not known of the chip, by what it is of.
    """
    points = Facts.of(
        {
            "accuracy": _accuracy(report),
            "other recordings": _other_recordings(report),
            **of_chip,
        }
    ).facts
    assumed = len(report.assumptions)
    return Verdict(
        question="What is not known?",
        status="unknown",
        answer=plural(len(points), "point"),
        figure=str(len(points)),
        figure_label=f"and {plural(assumed, 'assumption')}" if assumed else "and no assumptions",
        sentence=f"Not known: {listed([point.label for point in points])}.",
        facts=points,
    )


def _accuracy(report: SharedFigures) -> str | None:
    if report.match.events_origin == "made up":
        return "the recordings are made up"
    return "the recordings have no labels" if report.accuracy is None else None


def _other_recordings(report: SharedFigures) -> str:
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
    left_out = _not_bounded(report.energy)
    besides = f"; it leaves out {listed(left_out)}" if left_out else ""
    return f"a model of published costs, not measured{besides}"


def _not_bounded(energy: EnergyFigures) -> Sequence[str]:
    """Return what the energy does not include, with no bound."""
    return [item.what for item in energy.not_included_bounds if item.at_most_pj is None]


def _on_a_board(report: ReportFigures) -> str:
    if counts_cores(report):
        return "times are a model; nothing ran on a board"
    return "cycles are those of the simulated core; nothing ran on a board"
