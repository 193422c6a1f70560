"""Sections on where the error of the program comes from: the error budget, and the margins.

The error budget takes the stages of compiling one by one, such as rounding of weights or wraps of registers,
and says which spikes each of them changes. Margins are the distances of potentials from their thresholds.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate

from locsnn_compile.report.content import Bar, Curve, Facts, Folded, Plot, Section, Table
from locsnn_compile.report.figures.checks import (
    BudgetFigures,
    DeviationFigures,
    MarginFigures,
    MarginsOfPopulation,
    RegisterFigures,
    Sample,
)
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.match import MatchFigures, ReadoutFigures
from locsnn_compile.report.format import (
    NONE,
    SILENT,
    agreed,
    any_value,
    count,
    known,
    plural,
    ratio,
    share,
    short,
)
from locsnn_compile.report.pictures.axis import Axis
from locsnn_compile.report.words import STAGES, listed, stage_words
from locsnn_compile.verification.error_bounds import within

_DRAWN = 8
"""Populations whose margins are drawn, chosen by hand; a table has the margins of all."""
_LEAST_SHARE = 1e-5
"""The lower end of the vertical axis of the margins, a share of neurons times steps; smaller shares are not drawn."""
_FULL_BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Round scales for bars of spikes that differ: the least of these that no bar exceeds fills a bar.

Agreements are mostly above 95 %, so bars of equal spikes would all look the same.
"""
_OF_INTEGERS = (
    "Nothing was rounded: every number of the network is an integer of the chip. "
    "There is no error to break down."
)
_BUDGET = (
    "The effect of each stage by itself: the float network with only this stage as on the chip, and "
    "the chip with only this stage exact. A spike that differs also changes later spikes."
)
_MARGINS = (
    "How far each neuron's potential is from its threshold at every step, in thresholds, next to the "
    "error of the chip's arithmetic when all earlier spikes are equal. A spike can differ only where "
    "the error is larger."
)
_COMPLETE = (
    "The breakdown is complete: without any stage, every spike is the float network's; with all of "
    "them, every spike is the chip's."
)
_KERNELS_CUT = (
    "The network cuts its kernels where they fall below 0.01, as slayerPytorch does; the program "
    "keeps their tails. Other stages alone are compared with the network of whole kernels."
)


def error_budget(report: ReportFigures) -> Section | None:
    """Return the section on what each stage changes alone, and what remains if that stage is exact.

    None if no diagnosis was made. Margins tell whether one was made: they come from the same diagnosis,
    and a network of integers has no budget.
    """
    if report.margins is None:
        return None
    budget = report.error_budget
    if budget is None:
        return Section.of("error-budget", "Error budget", _OF_INTEGERS)
    variants = {stage_words(stage): deviation for stage, deviation in budget.alone.items()}
    variants["all together"] = budget.together
    return Section.of(
        "error-budget",
        "Error budget",
        _BUDGET,
        _checked(budget),
        _stages(variants, budget),
        Folded.of(
            "Each stage by population",
            _by_population(
                variants, compared_by_spikes(budget.together.by_population, report.match)
            ),
        ),
        _kernel_tail(budget.kernel_tail),
        _KERNELS_CUT if "tails" in budget.alone else None,
        Facts.of({"recordings": sample_words(budget.sample)}),
    )


def margins(report: ReportFigures) -> Section | None:
    """Return the section on distances from the threshold, errors, and how full registers get.

    None if no diagnosis was made.
    """
    figures = report.margins
    if figures is None:
        return None
    drawn = compared_by_spikes(figures.by_population, report.match)[:_DRAWN]
    return Section.of(
        "margins",
        "Margins",
        _MARGINS,
        _distances(figures),
        _errors(figures),
        *(_plot(name, figures.by_population[name], figures.histogram_edges) for name in drawn),
        _registers(figures.registers),
        Facts.of({"recordings": sample_words(figures.sample)}),
    )


def cause(match: MatchFigures) -> str | None:
    """Say which stages moved the potential that decided the first spike that differs; None if that is unknown."""
    first = match.first_divergence
    if first is None or first.cause is None:
        return None
    figures = first.cause
    parts = [
        f"{stage_words(stage)} {_signed(moved)}"
        for stage, moved in figures.moved_by.items()
        if moved
    ]
    parts.append(f"their interaction {_signed(figures.moved_by_interaction)}")
    side = _side(first.place.reference_potential - first.place.threshold)
    enough = [stage_words(stage) for stage in figures.enough_alone] or ["no stage"]
    return (
        f"Cause: the float potential lies {side} the threshold, and the chip's arithmetic moves it "
        f"by {_signed(figures.moved_together)}: {listed(parts)}. "
        f"Sufficient by itself: {listed(enough)}."
    )


def _side(distance: float) -> str:
    """Return how far from the threshold a potential lies, and on which side of it."""
    if distance == 0:
        return "at"
    side = "below" if distance < 0 else "above"
    return f"{abs(distance):.3g} {side}"


def sample_words(sample: Sample, *, named: bool = True) -> str:
    """Return on how many recordings a diagnosis was made and, if ``named``, the numbers of these recordings."""
    numbers = sample.recordings
    available = sample.recordings_available
    if len(numbers) == available:
        return f"all {count(available)}"
    names = f": {any_value(numbers)}" if named else ""
    return f"{count(len(numbers))} of {count(available)}, evenly spread{names}"


def _checked(budget: BudgetFigures) -> str:
    """Say whether the stages explain every spike that differs, and which stages cannot change anything."""
    # "tails" is not a stage of the compiler: only networks that cut their kernels have it.
    idle = [stage_words(stage) for stage in STAGES if stage not in ("tails", *budget.alone)]
    about_idle = ""
    if idle:
        about_idle = f" {listed(idle).capitalize()} change nothing here, by construction."
    if budget.unexplained_spikes:
        unexplained = plural(budget.unexplained_spikes, "spike")
        return f"All stages together leave {unexplained} unexplained.{about_idle}"
    return f"{_COMPLETE}{about_idle}"


def _stages(variants: Mapping[str, DeviationFigures], budget: BudgetFigures) -> Table:
    """Return a row per stage, and the row of all stages together as the last."""
    full_at = differing_at_most(deviation.spikes.spike_agreement for deviation in variants.values())
    equal_without_stage = [
        agreed(deviation.spikes.spike_agreement) for deviation in budget.all_but.values()
    ]
    # Without "all together", the last row, nothing is left to compare.
    equal_without_stage.append(NONE)
    return Table(
        f"Each stage alone, over {plural(len(budget.sample.recordings), 'recording')}; "
        f"{bars_words(full_at)}",
        (
            "stage",
            "",
            "spikes equal",
            "only on one side",
            "predictions changed",
            "error of class scores",
            "equal without it",
        ),
        tuple(
            (
                name,
                compared_bar(deviation.spikes.spike_agreement, SILENT, full_at),
                agreed(deviation.spikes.spike_agreement),
                count(deviation.spikes.spike_mismatches),
                count(deviation.predictions_changed),
                known(deviation.score_error, share, "all tie"),
                equal,
            )
            for (name, deviation), equal in zip(variants.items(), equal_without_stage, strict=True)
        ),
        total=True,
    )


def differing_at_most(agreements: Iterable[float | None]) -> float:
    """Return the scale for bars of spikes that differ: the least of ``_FULL_BARS`` that no share exceeds."""
    largest = max((1 - agreement for agreement in agreements if agreement is not None), default=0.0)
    return next(full for full in _FULL_BARS if within(largest, full))


def compared_bar(agreement: float | None, none: str, full_at: float) -> Bar:
    """Return a bar of the share of spikes that differ, which is full at ``full_at``.

    If neither side spikes, the bar is empty and its label begins with ``none``.
    """
    compared = ", no spikes to compare" if agreement is None else " of spikes equal"
    return Bar(agreement, f"{agreed(agreement, none)}{compared}", full_at=full_at)


def bars_words(full_at: float) -> str:
    """Return the words of a caption that explain bars of spikes that differ."""
    return f"bars: spikes that differ, full at {share(full_at)}"


def no_spikes(readout: ReadoutFigures, population: str) -> str:
    """Return the words for the spike agreement of a population in which no neuron spikes."""
    return "read by potential" if readout.is_by_potential(population) else SILENT


def compared_by_spikes(populations: Iterable[str], match: MatchFigures) -> list[str]:
    """Return the populations except those that are read by potential and do not spike.

    Such a population is not silent by mistake: it is not meant to spike, so its spikes are not shown.
    """
    return [
        name
        for name in populations
        if no_spikes(match.readout, name) == SILENT
        or match.by_population[name].spike_agreement is not None
    ]


def _by_population(variants: Mapping[str, DeviationFigures], populations: Sequence[str]) -> Table:
    """Return a row per population, with a column of equal spikes per stage."""
    rows = []
    for name in populations:
        agreements = [
            deviation.by_population[name].spike_agreement for deviation in variants.values()
        ]
        rows.append((name, *map(agreed, agreements)))
    return Table(
        "Spikes equal by population, each stage alone", ("population", *variants), tuple(rows)
    )


def _kernel_tail(tail: DeviationFigures | None) -> str | None:
    """Say how much a network trained with cut kernels differs for that alone; None without such kernels."""
    if tail is None:
        return None
    equal = agreed(tail.spikes.spike_agreement, "none")
    return (
        "slayerPytorch cuts kernels where they fall below 0.01; this program keeps their tails. "
        f"Cutting them in the float network, with nothing else changed, leaves {equal} of its spikes "
        f"equal and changes {plural(tail.predictions_changed, 'prediction')}: a network trained with "
        "cut kernels differs by that much before anything is rounded."
    )


def _distances(figures: MarginFigures) -> Table:
    """Return a row per population: the distance below which the nearest 0.01 % of the potentials lie, 0.1 %, ..."""
    populations = figures.by_population
    # All populations have the same shares, which are keys of report.json and so texts.
    shares = next(iter(populations.values())).nearest
    headings = (f"nearest {100 * float(part):g} %" for part in shares)
    return Table(
        "Distance of potentials to the threshold, in thresholds",
        ("population", "neurons times steps", *headings),
        tuple(
            (
                name,
                count(population.neuron_steps),
                *(short(population.nearest[part]) for part in shares),
            )
            for name, population in populations.items()
        ),
    )


def _errors(figures: MarginFigures) -> Table:
    rows = []
    for name, population in figures.by_population.items():
        median, percentile_95, largest = population.error.values()
        rows.append(
            (
                name,
                short(median),
                short(percentile_95),
                short(largest),
                share(population.within_error),
                share(population.decided_otherwise),
            )
        )
    return Table(
        "Error of the chip's arithmetic, in thresholds, and how many potentials lie within it",
        (
            "population",
            "median error",
            "95 % below",
            "largest",
            "closer than the error",
            "decided differently",
        ),
        tuple(rows),
    )


def _registers(registers: Mapping[str, RegisterFigures]) -> Table:
    rows = []
    for name, use in registers.items():
        fuller = max(use.share_u, use.share_v)
        rows.append(
            (
                name,
                Bar(fuller, f"{share(fuller)} used"),
                share(use.share_u),
                share(use.share_v),
                known(use.headroom_bits, "{:.1f}".format),
                count(use.wraps),
                count(use.clips),
            )
        )
    return Table(
        "Registers of the chip: largest magnitudes against their capacity",
        ("compartments", "", "current u", "voltage v", "headroom in bits", "wraps", "clips"),
        tuple(rows),
    )


def _plot(name: str, margins: MarginsOfPopulation, edges: Sequence[float]) -> Plot:
    """Draw the distributions of distances and of errors on logarithmic axes.

    At x, one curve is the share of neurons and steps nearer to the threshold than x, and the other the share
    with an error larger than x. Where the curves cross at a high share, many spikes may change.
    """
    total = margins.neuron_steps
    nearer = _running_shares(margins.distance_histogram, total)
    # Added up from the largest error down, and turned round again to the order of the edges.
    larger = _running_shares(margins.error_histogram[::-1], total)[::-1]
    # An axis with ``log`` has its ends as powers of ten.
    low_power = math.log10(edges[0])
    high_power = math.log10(edges[-1])
    decades = tuple(10.0**power for power in range(round(low_power), round(high_power) + 1))
    return Plot(
        title=f"{name}: distance to the threshold, and error",
        x_label="thresholds",
        x=Axis(low_power, high_power, decades, _power, log=True),
        y=Axis(
            math.log10(_LEAST_SHARE),
            0.0,
            (1e-4, 1e-3, 0.01, 0.1, 1.0),
            lambda part: f"{100 * part:g} %",
            log=True,
        ),
        curves=(
            *_curve("nearer to the threshold", edges, nearer),
            *_curve("with a larger error", edges, larger),
        ),
    )


def _curve(label: str, edges: Sequence[float], shares: Sequence[float]) -> tuple[Curve, ...]:
    """Return the curve through the shares that are large enough to draw; no curve if none is."""
    pairs = zip(edges, shares, strict=True)
    points = tuple((edge, part) for edge, part in pairs if part >= _LEAST_SHARE)
    return (Curve(f"neurons and steps {label} than that", points),) if points else ()


def _power(value: float) -> str:
    """Return a power of ten as text; with a superscript exponent below 0.001. The exponent is above -10."""
    exponent = round(math.log10(value))
    if exponent >= -3:
        return f"{value:g}"
    superscript = "⁰¹²³⁴⁵⁶⁷⁸⁹"[-exponent]
    return f"10⁻{superscript}"


def _running_shares(counts: Sequence[int], total: int) -> list[float]:
    """Return the sum of the counts before each edge of a histogram, as a share of ``total``; the first is 0."""
    return [so_far / total for so_far in accumulate(counts, initial=0)]


def _signed(value: float) -> str:
    """Return a number with its sign, with three significant digits."""
    # Without an exponent where few zeros precede the digits; 1e-6 is chosen by hand.
    size = ratio(abs(value)) if abs(value) >= 1e-6 else f"{abs(value):.3g}"
    sign = "−" if value < 0 else "+"  # noqa: RUF001 - a minus sign, as wide as the plus
    return f"{sign}{size}"
