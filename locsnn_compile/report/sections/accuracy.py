"""Sections on where the error comes from: the error budget, and the margins."""

import math
from collections.abc import Iterable, Sequence
from itertools import accumulate

from locsnn_compile.report.content import Curve, Document, Plot, Section, Table
from locsnn_compile.report.format import NONE, SILENT, agreed, any_value, count, plural, ratio
from locsnn_compile.report.pictures.axis import Axis
from locsnn_compile.report.words import (
    STAGES,
    facts,
    listed,
    no_spikes,
    section,
    sentence,
    stage_words,
    table,
)

_DRAWN = 8
"""Populations whose margins are drawn; a table has those of all."""
_LEAST_SHARE = 1e-5
"""The lower end of the vertical axis of the margins; what lies below it is not drawn."""


def error_budget(document: Document) -> Section | None:
    """What each stage changes by itself, and what is left if only that stage is exact; None without a diagnosis."""
    if "error_budget" not in document:
        return None
    budget = document["error_budget"]
    if budget is None:
        return section("error-budget", called="error-budget of integers")
    variants = {stage_words(stage): found for stage, found in budget["alone"].items()}
    variants["all together"] = budget["together"]
    without = [agreed(found["spike_agreement"]) for found in budget["all_but"].values()]
    return section(
        "error-budget",
        _checked(budget),
        table(
            "stages",
            _stages(variants, [*without, NONE]),
            total=True,
            recordings=len(budget["recordings"]),
        ),
        _by_population(
            variants, that_spike(budget["together"]["by_population"], document["match"])
        ),
        _kernel_tail(budget["kernel_tail"]),
        sentence("kernels cut") if "tails" in budget["alone"] else None,
        facts("recordings", recordings=sample(budget)),
    )


def margins(document: Document) -> Section | None:
    """How near potentials come to the threshold, the error, and how full registers get; None without a diagnosis."""
    if "margins" not in document:
        return None
    found = document["margins"]
    populations = found["by_population"]
    drawn = that_spike(populations, document["match"])
    registers = {
        name: one | {"drawn": max(one["share_u"], one["share_v"])}
        for name, one in found["registers"].items()
    }
    return section(
        "margins",
        table("distances", populations, columns=_nearest(populations)),
        table(
            "errors",
            {name: one | {"errors": [*one["error"].values()]} for name, one in populations.items()},
        ),
        *(_plot(name, populations[name], found["histogram_edges"]) for name in drawn[:_DRAWN]),
        table("registers", registers),
        facts("recordings", recordings=sample(found)),
    )


def cause(document: Document) -> str | None:
    """Return what moved the potential that decided the first differing spike, in a sentence or two."""
    first = document["match"]["first_divergence"]
    found = first and first["cause"]
    if not found:
        return None
    parts = [
        f"{stage_words(stage)} {_signed(moved)}"
        for stage, moved in found["moved_by"].items()
        if moved
    ]
    parts.append(f"their interaction {_signed(found['moved_by_interaction'])}")
    distance = first["reference_potential"] - first["threshold"]
    side = f"{abs(distance):.3g} {'below' if distance < 0 else 'above'}" if distance else "at"
    enough = listed([stage_words(stage) for stage in found["enough_alone"]] or ["no stage"])
    return sentence(
        "cause",
        side=side,
        moved=_signed(found["moved_together"]),
        parts=listed(parts),
        enough=enough,
    )


def sample(entry: Document, *, named: bool = True) -> str:
    """Return on how many recordings a diagnosis was made and, if ``named``, on which."""
    numbers, available = entry["recordings"], entry["recordings_available"]
    if len(numbers) == available:
        return f"all {count(available)}"
    which = f": {any_value(numbers)}" if named else ""
    return f"{count(len(numbers))} of {count(available)}, evenly spread{which}"


def _checked(budget: Document) -> str:
    exact = [stage_words(stage) for stage in STAGES if stage not in ("tails", *budget["alone"])]
    idle = f" {listed(exact).capitalize()} change nothing here, by construction." if exact else ""
    left = budget["unexplained_spikes"]
    if left:
        return f"All stages together leave {plural(left, 'spike')} unexplained.{idle}"
    return f"{sentence('complete')}{idle}"


def _stages(variants: Document, without: Sequence[str]) -> Document:
    return {
        name: found | equal_spikes(found["spike_agreement"]) | {"left": left}
        for (name, found), left in zip(variants.items(), without, strict=True)
    }


def equal_spikes(agreement: float | None, none: str = SILENT) -> Document:
    """Return the figure of equal spikes, to be drawn as well; nothing is drawn if neither side spikes."""
    compared = ", no spikes to compare" if agreement is None else " of spikes equal"
    return {"drawn": agreement, "equal": agreed(agreement, none), "compared": compared}


def that_spike(populations: Iterable[str], match: Document) -> list[str]:
    """Return the populations without those that are read by potential and do not spike."""
    found = match["by_population"]
    return [
        p
        for p in populations
        if no_spikes(match, p) == SILENT or found[p]["spike_agreement"] is not None
    ]


def _by_population(variants: Document, shown: Sequence[str]) -> Table:
    rows = tuple(
        (
            name,
            *(
                agreed(found["by_population"][name]["spike_agreement"], SILENT)
                for found in variants.values()
            ),
        )
        for name in shown
    )
    return Table("Spikes equal by population, each stage alone", ("population", *variants), rows)


def _kernel_tail(tail: Document | None) -> str | None:
    if tail is None:
        return None
    equal, changed = (
        agreed(tail["spike_agreement"], "none"),
        plural(tail["predictions_changed"], "prediction"),
    )
    return sentence("kernel tail", equal=equal, predictions=changed)


def _nearest(populations: Document) -> dict[str, str]:
    """Return a column for each share of the potentials that is given."""
    shares = next(iter(populations.values()))["nearest"]
    return {f"nearest {100 * float(key):g} %": f"{{nearest[{key}]:short}}" for key in shares}


def _plot(name: str, one: Document, edges: Sequence[float]) -> Plot:
    """Draw both distributions on logarithmic axes, each added up from its own end."""
    total = one["neuron_steps"]
    nearer = _running(one["distance_histogram"], total)
    larger = _running(one["error_histogram"][::-1], total)[::-1]
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
        curves=tuple(
            Curve(f"neurons and steps {label} than that", points)
            for label, shares in (
                ("nearer to the threshold", nearer),
                ("with a larger error", larger),
            )
            if (
                points := tuple(
                    point for point in zip(edges, shares, strict=True) if point[1] >= _LEAST_SHARE
                )
            )
        ),
    )


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
