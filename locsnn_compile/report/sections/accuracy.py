"""Sections on where the error comes from: the error budget, and the margins."""

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
"""Populations whose margins are drawn; a table has those of all."""
_LEAST_SHARE = 1e-5
"""The lower end of the vertical axis of the margins; what lies below it is not drawn."""
_FULL_BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Shares of spikes that differ at which bars may be full."""
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
    """What each stage changes by itself, and what is left if only that stage is exact; None without a diagnosis."""
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
            _by_population(variants, that_spike(budget.together.by_population, report.match)),
        ),
        _kernel_tail(budget.kernel_tail),
        _KERNELS_CUT if "tails" in budget.alone else None,
        Facts.of({"recordings": sample_words(budget.sample)}),
    )


def margins(report: ReportFigures) -> Section | None:
    """How near potentials come to the threshold, the error, and how full registers get; None without a diagnosis."""
    figures = report.margins
    if figures is None:
        return None
    drawn = that_spike(figures.by_population, report.match)[:_DRAWN]
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
    """Return what moved the potential that decided the first differing spike, in a sentence or two."""
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
    """Return on which side of the threshold a potential lies, and how far from it."""
    if distance == 0:
        return "at"
    return f"{abs(distance):.3g} {'below' if distance < 0 else 'above'}"


def sample_words(sample: Sample, *, named: bool = True) -> str:
    """Return on how many recordings a diagnosis was made and, if ``named``, on which."""
    numbers, available = sample.recordings, sample.recordings_available
    if len(numbers) == available:
        return f"all {count(available)}"
    which = f": {any_value(numbers)}" if named else ""
    return f"{count(len(numbers))} of {count(available)}, evenly spread{which}"


def _checked(budget: BudgetFigures) -> str:
    exact = [stage_words(stage) for stage in STAGES if stage not in ("tails", *budget.alone)]
    idle = f" {listed(exact).capitalize()} change nothing here, by construction." if exact else ""
    if budget.unexplained_spikes:
        left = plural(budget.unexplained_spikes, "spike")
        return f"All stages together leave {left} unexplained.{idle}"
    return f"{_COMPLETE}{idle}"


def _stages(variants: Mapping[str, DeviationFigures], budget: BudgetFigures) -> Table:
    without = [agreed(deviation.spikes.spike_agreement) for deviation in budget.all_but.values()]
    full_at = differing_at_most(deviation.spikes.spike_agreement for deviation in variants.values())
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
                left,
            )
            for (name, deviation), left in zip(variants.items(), [*without, NONE], strict=True)
        ),
        total=True,
    )


def differing_at_most(agreements: Iterable[float | None]) -> float:
    """Return the least round share that none of the shares of spikes that differ is above."""
    largest = max((1 - agreement for agreement in agreements if agreement is not None), default=0.0)
    return next(full for full in _FULL_BARS if within(largest, full))


def compared_bar(agreement: float | None, none: str, full_at: float) -> Bar:
    """Draw the share of spikes that differ, up to ``full_at``.

    Nothing is drawn, and ``none`` said, if neither side spikes.
    """
    compared = ", no spikes to compare" if agreement is None else " of spikes equal"
    return Bar(agreement, f"{agreed(agreement, none)}{compared}", full_at=full_at)


def bars_words(full_at: float) -> str:
    """Return what bars of spikes that differ show."""
    return f"bars: spikes that differ, full at {share(full_at)}"


def no_spikes(readout: ReadoutFigures, population: str) -> str:
    """Return the word for the equal spikes of a population without any spikes."""
    return "read by potential" if readout.is_by_potential(population) else SILENT


def that_spike(populations: Iterable[str], match: MatchFigures) -> list[str]:
    """Return the populations without those that are read by potential and do not spike."""
    return [
        name
        for name in populations
        if no_spikes(match.readout, name) == SILENT
        or match.by_population[name].spike_agreement is not None
    ]


def _by_population(variants: Mapping[str, DeviationFigures], shown: Sequence[str]) -> Table:
    rows = []
    for name in shown:
        of_variants = (deviation.by_population[name] for deviation in variants.values())
        rows.append((name, *(agreed(spikes.spike_agreement) for spikes in of_variants)))
    return Table(
        "Spikes equal by population, each stage alone", ("population", *variants), tuple(rows)
    )


def _kernel_tail(tail: DeviationFigures | None) -> str | None:
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
    populations = figures.by_population
    shares = next(iter(populations.values())).nearest
    nearest = (f"nearest {100 * float(part):g} %" for part in shares)
    return Table(
        "Distance of potentials to the threshold, in thresholds",
        ("population", "neurons times steps", *nearest),
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
        median, near_largest, largest = population.error.values()
        errors = short(median), short(near_largest), short(largest)
        rows.append(
            (name, *errors, share(population.within_error), share(population.decided_otherwise))
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
        shares = Bar(fuller, f"{share(fuller)} used"), share(use.share_u), share(use.share_v)
        headroom = known(use.headroom_bits, "{:.1f}".format)
        rows.append((name, *shares, headroom, count(use.wraps), count(use.clips)))
    return Table(
        "Registers of the chip: largest magnitudes against their capacity",
        ("compartments", "", "current u", "voltage v", "headroom in bits", "wraps", "clips"),
        tuple(rows),
    )


def _plot(name: str, margins: MarginsOfPopulation, edges: Sequence[float]) -> Plot:
    """Draw both distributions on logarithmic axes, each added up from its own end."""
    total = margins.neuron_steps
    nearer = _running(margins.distance_histogram, total)
    larger = _running(margins.error_histogram[::-1], total)[::-1]
    first, last = math.log10(edges[0]), math.log10(edges[-1])
    decades = tuple(10.0**power for power in range(round(first), round(last) + 1))
    return Plot(
        title=f"{name}: distance to the threshold, and error",
        x_label="thresholds",
        x=Axis(first, last, decades, _power, log=True),
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
    """Return the curve of the shares that are drawn; no curve if none is."""
    pairs = zip(edges, shares, strict=True)
    points = tuple((edge, part) for edge, part in pairs if part >= _LEAST_SHARE)
    return (Curve(f"neurons and steps {label} than that", points),) if points else ()


def _power(value: float) -> str:
    """Return a power of ten; a small one with a superscript exponent."""
    exponent = round(math.log10(value))
    return f"{value:g}" if exponent >= -3 else f"10⁻{'⁰¹²³⁴⁵⁶⁷⁸⁹'[-exponent]}"


def _running(counts: Sequence[int], total: int) -> list[float]:
    """Return the share of the counts before each edge, from none to all."""
    return [so_far / total for so_far in accumulate(counts, initial=0)]


def _signed(value: float) -> str:
    size = ratio(abs(value)) if abs(value) >= 1e-6 else f"{abs(value):.3g}"
    return f"{'−' if value < 0 else '+'}{size}"  # noqa: RUF001 - a minus sign, as wide as the plus
