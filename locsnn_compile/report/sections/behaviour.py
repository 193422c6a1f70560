"""Sections on what the program does: agreement with the float network, operations, and other networks."""

import math

from locsnn_compile.report.content import Block, Document, Section, Table
from locsnn_compile.report.format import (
    NONE,
    any_value,
    count,
    energy,
    known,
    plural,
    ratio,
    share,
    told_apart,
)
from locsnn_compile.report.sections.accuracy import cause, equal_spikes
from locsnn_compile.report.words import listed, no_spikes, section, sentence, share_of, table, words

_SCORE = 1.959964
"""Two-sided 95 % point of the normal distribution."""
_FIRES = {(True, False): "the float neuron fires", (False, True): "the chip fires"}
"""The sentence for which side reaches the threshold: the float network, the chip."""


def agreement(document: Document) -> Section:
    """Agreement by population, the first differing spike, wraps and clips."""
    match = document["match"]
    helpers = match["helper_neurons"]
    return section(
        "agreement",
        _first_divergence(document),
        cause(document),
        _interval(document),
        _scores(match),
        _populations(document),
        _helpers(helpers) if helpers else None,
        _wraps_and_clips(match["wraps_and_clips_by_population"]),
    )


def operations(document: Document) -> Section:
    """Counts of the chip by branch, next to those of the published method."""
    found = document["operations"]
    branches, total = found["by_branch"], found["per_sample"]
    paper = found["published_method"]
    published = {f"additions, {words(name)}": n for name, n in paper["additions_by_branch"].items()}
    published |= {words(key): paper[key] for key in ("transpose_events", "operations")}
    columns = {words(name): counts for name, counts in branches.items()} | {"all": total}
    return section(
        "operations",
        Table(
            "Counted on the chip, mean per recording",
            ("operation", *columns),
            tuple(
                (words(key), *(count(counts[key]) for counts in columns.values())) for key in total
            ),
        ),
        table("published operations", published, total=True),
    )


def defined_anns(document: Document) -> Document:
    """Return the entries of the conventional networks that are defined for this network's input."""
    return {
        name: entry
        for name, entry in document["ann_comparison"].items()
        if entry["operations"] is not None
    }


def comparison(document: Document) -> Section:
    """Operations of conventional networks on the same input."""
    entries = defined_anns(document)
    own = document["operations"]["published_method"]["operations"]
    if not entries:
        return section(
            "comparison",
            "No comparison: the published networks are not defined for this network's input.",
        )
    chip = document["operations"]["per_sample"]["synaptic_ops"]
    rows: Document = {
        "the trained network, on paper": {
            "operations": own,
            "ratio": 1 if own else None,
            "chip_ratio": None,
        },
        "the program, synaptic operations": {
            "operations": chip,
            "ratio": None,
            "chip_ratio": 1 if chip else None,
        },
        **{words(name): entry for name, entry in entries.items()},
    }
    most = max(row["operations"] for row in rows.values())
    drawn = {name: row | {"drawn": share_of(row["operations"], most)} for name, row in rows.items()}
    priced = _ann_energy(document) if document["energy"]["profile"] else ()
    return section("comparison", table("operations compared", drawn), *priced)


def _ann_energy(document: Document) -> tuple[Block, ...]:
    """The energy of the conventional networks' arithmetic, next to the whole modelled energy of this network."""
    entries, own = defined_anns(document), document["energy"]
    first = next(iter(entries.values()))
    arithmetics = list(first["energy_pj"])
    rows = [
        (
            "this network, as modelled",
            NONE,
            NONE,
            *(energy(own["per_sample_pj"]) for _ in arithmetics),
        )
    ]
    for name, entry in entries.items():
        times = {key: known(value, ratio) for key, value in entry["energy_ratio"].items()}
        cells = [f"{energy(entry['energy_pj'][key])} ({times[key]})" for key in arithmetics]
        rows.append(
            (words(name), count(entry["multiplications"]), count(entry["additions"]), *cells)
        )
    return (
        Table(
            f"Energy of the arithmetic only; in brackets, as a multiple of this network's (profile {own['profile']})",
            ("network", "multiplications", "additions", *(words(key) for key in arithmetics)),
            tuple(rows),
        ),
        sentence(
            "conventional energy",
            source=first["energy_source"],
            left_out=listed(first["energy_not_included"]),
        ),
    )


def _scores(match: Document) -> str:
    """Return how far class scores are apart: classes and spikes may be equal where they are not."""
    error = match["score_error"]
    if error is None:
        return sentence("scores tie")
    return sentence("scores apart", share=share(error), **match["class_scores"])


def _populations(document: Document) -> Table:
    match = document["match"]
    rows = {
        name: found | equal_spikes(found["spike_agreement"], no_spikes(match, name))
        for name, found in (*match["by_population"].items(), ("all", match))
    }
    side = "network" if match["reference"] == "integers" else "float"
    return table("spikes", rows, total=True, side=side, **match)


def _helpers(helpers: Document) -> str:
    """Say which neurons were not compared."""
    spikes = [
        f"{name} ({plural(of['reference_spikes'], 'spike')} in the network, {count(of['chip_spikes'])} on the chip)"
        for name, of in helpers.items()
    ]
    return f"Not counted, because only the compiler needs these neurons and the model has none: {listed(spikes)}."


def _wraps_and_clips(events: Document) -> Table | None:
    kinds = sorted({kind for counts in events.values() for kind in counts})
    found = [(name, counts) for name, counts in events.items() if any(counts.values())]
    rows = tuple((name, *(count(counts.get(kind, 0)) for kind in kinds)) for name, counts in found)
    columns = ("compartments", *(words(kind) for kind in kinds))
    return (
        Table("Wraps and clips over all recordings, where there are any", columns, rows)
        if rows
        else None
    )


def _first_divergence(document: Document) -> str:
    first = document["match"]["first_divergence"]
    if first is None and document["match"]["spike_agreement"] is None:
        return "First difference: not known, because neither side spikes."
    if first is None:
        return "First difference: none, every spike is equal."
    reference, chip, threshold = (
        first["reference_potential"],
        first["chip_potential"],
        first["threshold"],
    )
    a, b, at = told_apart((reference, chip, threshold))
    fires = _FIRES.get((reference >= threshold, chip >= threshold), "the sides differ")
    place = {key: any_value(first[key]) for key in ("recording", "population", "neuron", "step")}
    return (
        f"{sentence('first difference', **place)} {sentence(fires, float=a, chip=b, threshold=at)}"
    )


def _interval(document: Document) -> str:
    """Return the Wilson interval of the prediction agreement: few recordings prove little."""
    match = document["match"]
    n, p = match["samples"] - match["tied_predictions"], match["prediction_agreement"]
    if p is None:
        return sentence("no prediction")
    z2 = _SCORE * _SCORE
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = _SCORE / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    low, high = max(0.0, centre - half), min(1.0, centre + half)
    recordings = plural(n, "recording")
    return sentence(
        "confidence", share=share(p), recordings=recordings, low=100 * low, high=100 * high
    )
