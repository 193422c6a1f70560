"""The content of a report on a program for a Xylo, from which HTML, Markdown and terminal text are rendered.

The constants are texts of the report. The functions turn figures of report.json into verdicts, notices and sections.
"""

from locsnn_compile.own_arithmetic.page import (
    FamilyPage,
    compose_page,
    costs_verdict,
    fits_verdict,
    limits_section,
    numbers_section,
    operations_section,
    provenance_section,
    worst_verdict,
)
from locsnn_compile.report.content import Notice, Report, Section, Verdict
from locsnn_compile.report.figures.operations import OperationFigures
from locsnn_compile.report.format import any_value, count, plural, share
from locsnn_compile.report.sections import build
from locsnn_compile.xylo.document import NO_TABLE, XyloFigures, XyloNumbers

KEEP_IN_MIND = (
    "The arithmetic was compared with xylosim, the vendor's simulator, value by value. That the chip "
    "computes as xylosim does is the vendor's word: no chip was used.",
)
OF_FLOAT_NETWORKS = (
    "A spike subtracts the threshold, and a hidden neuron may send up to 31 spikes in a step. The "
    "float network sends one at most.",
)
_OPERATIONS = (
    "A synaptic operation is one addition to a current; a neuron is updated in every step. The "
    "published method counts on paper: spikes of the trained network times their fan-out."
)
_NUMBERS = (
    "A potential of 1 in the float network is the scale in the chip's registers. A decay takes away "
    "a share of 2^-dash; the errors of decays are shares of the float decay. Where two numbers are "
    "given, they are the smallest and the largest of the population."
)
_SHARES = ("current_decay_error", "potential_decay_error")
"""The keys of :class:`XyloNumbers` that are shares."""


def compose_xylo(report: XyloFigures) -> Report:
    """Return the whole report."""
    page = FamilyPage(
        lowering="decays by shifts",
        costs=costs_verdict(
            report,
            answer="Energy and time not known",
            sentence=f"Energy and time are not known, because {NO_TABLE}.",
        ),
        fits=_fits(report),
        worst=worst_verdict(
            figure="not known",
            figure_label="no times are published",
            sentence=f"Neither the time of a recording nor a bound on it is known, because {NO_TABLE}.",
        ),
        not_known={
            "worst time": NO_TABLE,
            "energy": NO_TABLE,
            "on a chip": "equal to the vendor's simulator; nothing ran on a chip",
        },
        notices=_notices(report.match.clips),
        sections=(
            _operations(report.operations),
            limits_section(report),
            build.left_out(report),
            numbers_section(report.quantization, XyloNumbers, _NUMBERS, _number),
            provenance_section(report, _keep_in_mind(report)),
        ),
    )
    return compose_page(report, page, report.host)


def _fits(report: XyloFigures) -> Verdict:
    hidden = report.resources.limits["hidden_neurons"]
    neurons = f"{count(hidden.used)} of {plural(hidden.limit, 'hidden neuron')}"
    return fits_verdict(report, neurons, taker="The program")


def _notices(saturations: int) -> tuple[Notice, ...]:
    """Return the notice that registers saturated, if they did."""
    if not saturations:
        return ()
    text = (
        f"A current or a potential reached the end of its 16 bits {plural(saturations, 'time')} and "
        "stayed there. What the neuron does after that says little about the float network."
    )
    return (Notice("Registers saturated.", text),)


def _operations(figures: OperationFigures) -> Section:
    extra_spikes = count(figures.extra_spikes or 0.0)
    note = f"Spikes of hidden neurons beyond the first in a step: {extra_spikes} per recording."
    return operations_section(figures, _OPERATIONS, note)


def _number(key: str, value: object) -> str:
    """Return a number of :class:`XyloNumbers` as text."""
    if isinstance(value, float) and key in _SHARES:
        return share(value)
    return any_value(value)


def _keep_in_mind(report: XyloFigures) -> tuple[str, ...]:
    if report.match.reference == "float64":
        return KEEP_IN_MIND + OF_FLOAT_NETWORKS
    return KEEP_IN_MIND
