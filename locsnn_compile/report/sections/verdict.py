"""The three questions that a report answers first, and what to know before believing its figures."""

from locsnn_compile.report.content import Document, Fact, Facts, Notice, Status, Verdict
from locsnn_compile.report.format import (
    NONE,
    SILENT,
    count,
    energy,
    known,
    plural,
    points,
    ratio,
    share,
    time,
)
from locsnn_compile.report.sections.behaviour import defined_anns
from locsnn_compile.report.words import (
    facts,
    limit_words,
    listed,
    notice,
    sentence,
    stage_words,
    verdict,
    words,
)

_SIDES = {
    "paper operations": ("ratio", "the trained network, by the published method"),
    "chip operations": ("chip_ratio", "synaptic operations of the program"),
}
"""What is compared with conventional networks: the key of the ratio, and whose operations they are."""
NEARLY = 0.95
"""The least prediction agreement for the answer "nearly"."""
MOST_SCORE_ERROR = 0.05
"""The largest error of class scores, as a share of their spread, for the answer "yes" where potentials are read.

Nothing else compares potentials, and a few recordings keep their class at errors that change the class of others.
"""
_ROUNDING = 1e-9
"""Class scores whose error is smaller differ only as floats round."""
_WIDTHS = {"charge", "join", "step", "later"}
"""Limits of the open core that are bits of a number: a program needs them, but does not fill them."""
SPIKE_FOR_SPIKE = "Yes, spike for spike"
SAME_CLASSES = "Nearly, in every prediction"


def matches(document: Document) -> Verdict:
    """Does the chip do what the network does?"""
    match = document["match"]
    tied, agreement = match["tied_predictions"], match["prediction_agreement"]
    predicted = match["samples"] - tied
    network = (
        "the network in its own integers"
        if match["reference"] == "integers"
        else "the float network"
    )
    same = (
        f"in {count(round(agreement * predicted))} of {plural(predicted, 'recording')}"
        if predicted
        else ""
    )
    equal = (
        f"The chip predicts the same class as {network} {same}"
        if predicted
        else "Every class score ties"
    )
    status, answer = _answer(match)
    said = f"{equal}, and every spike is equal" if answer == SPIKE_FOR_SPIKE else equal
    if status == "unknown":
        unproven = (
            "nothing was compared"
            if match["spike_agreement"] is None
            else "no prediction was compared"
        )
        said = f"{_not_compared(match)}, in {network} or on the chip: {unproven}"
    elif predicted and tied:
        said += f"; {count(tied)} more are not predicted, as all class scores tie on both sides"
    if answer == SAME_CLASSES:
        said += f", but class scores {_scores(match)}"
    chance = document.get("chance")
    if chance and not chance["told_apart"]:
        said += (
            f". {sentence('at chance', **chance, accuracy=chance['right'] / chance['recordings'])}"
        )
        if status == "yes":
            status, answer = "nearly", f"{answer}, but it predicts no better than chance"
    silent = SILENT if match["readout"]["silent"] else NONE
    its = facts(
        "match",
        accuracy=_accuracy(document),
        spikes=known(
            match["spike_agreement"],
            lambda part: f"{share(part)} at the same neuron and step",
            "none on either side",
        ),
        first=_first_difference(document),
        scores=_scores(match) if "potentials" in match["readout"]["by"] else "",
        registers=_registers(document),
    )
    label = f"same prediction, {same}" if predicted else "no prediction to compare"
    return verdict(
        "match", status, answer, its, figure=known(agreement, share, silent), label=label, said=said
    )


def _answer(match: Document) -> tuple[Status, str]:
    """Return what was proven; nothing if the readout is silent, or if spikes differ but no class is predicted."""
    agreement, exact = match["prediction_agreement"], match["spike_mismatches"] == 0
    if match["readout"]["silent"] or (agreement is None and not exact):
        return "unknown", "Not known"
    if (
        agreement == 1
        and "potentials" in match["readout"]["by"]
        and (match["score_error"] or 0) > MOST_SCORE_ERROR
    ):
        return "nearly", SAME_CLASSES
    if exact and match["spike_agreement"] is not None and agreement in (None, 1):
        return "yes", SPIKE_FOR_SPIKE
    if agreement == 1:
        return "yes", "Yes, in every prediction"
    return ("nearly", "Nearly") if agreement >= NEARLY else ("no", "No")


def _not_compared(match: Document) -> str:
    if not match["readout"]["silent"] or match["readout"]["by"] != "spikes":
        return "No class score is above another"
    return "No neuron spiked" if match["spike_agreement"] is None else "No output neuron spiked"


def costs(document: Document) -> Verdict:
    """How much energy and time does a recording take in the model?"""
    found, time_of = document["energy"], document["latency"]
    latency = time_of["per_sample_ns"] if timed(document) else None
    spread, duration = found["over_samples_pj"], time_of["recording_ns"]
    real = "" if latency is None or duration is None else f", {pace(latency, duration)}"
    its = [
        Fact(
            "range",
            f"{energy(spread['min'])} to {energy(spread['max'])}, median {energy(spread['p50'])}",
        ),
        *(
            Fact("other profile", f"{energy(pj)} with {name}")
            for name, pj in found["other_profiles_pj"].items()
        ),
        Fact(
            "latency", sentence("latency", latency=latency, real=real, profile=time_of["profile"])
        ),
        *(
            Fact(member["name"], sentence("member", **member))
            for member in document["model"].get("members", ())
        ),
    ]
    if starts(document):
        its.append(Fact("start", sentence("start", **document["input"])))
    its += against_anns(document)
    return verdict(
        "cost", "modelled", "Modelled, not measured", Facts(tuple(its)), latency=latency, **found
    )


def fits(document: Document) -> Verdict:
    """Does the chip hold it, and how much room is left?"""
    resources = document["resources"]
    limits = resources["limits"]
    over = {name for name, entry in limits.items() if entry["used"] > entry["limit"]}
    worst = max(
        limits,
        key=lambda name: (name in over, _is_filled(name, limits[name]), fullness(limits[name])),
    )
    of_cores = "the open core"
    if counts_cores(document):
        cores = limits["cores"]
        of_cores = f"{count(cores['used'])} of {plural(cores['limit'], 'core')}"
    entry = limits[worst]
    its = facts("fit", worst=limit_words(worst), full=fullness(entry), **entry, **resources)
    status: tuple[Status, str] = ("no", "No") if over else ("yes", "Yes")
    return verdict("fit", *status, its, of_cores=of_cores, target=document["target"])


def _is_filled(name: str, entry: Document) -> bool:
    """Return whether a limit is a resource that a program fills, and not a width or what a core can do."""
    return entry["limit"] > 1 and name not in _WIDTHS


def counts_cores(document: Document) -> bool:
    """Return whether the target has cores that a program fills one after the other."""
    return "cores" in document["resources"]["limits"]


def notices(document: Document) -> tuple[Notice, ...]:
    """Return what limits the figures of this report, which is mostly nothing."""
    found = []
    match, dropped = document["match"], document["skipped"]["events_dropped"]
    if match["wraps"]:
        found.append(notice("wraps", times=plural(match["wraps"], "time")))
    if dropped:
        found.append(notice("dropped", events=dropped, outside=outside(document)))
    binning = document["skipped"].get("binning")
    if binning and binning["dropped"]:
        found.append(notice("binning", **binning))
    return tuple(found)


def outside(document: Document) -> str:
    """Return where the events lie that are not played."""
    return "before the start or after the last step" if starts(document) else "after the last step"


def starts(document: Document) -> dict[str, float]:
    """Return the steps before the start of each branch; nothing if all start with the recording."""
    found: dict[str, float] = document.get("input", {}).get("aligned_steps_by_branch", {})
    return found


def timed(document: Document) -> bool:
    """Return whether the latency is known: a profile may have no times. Earlier versions did not say."""
    return bool(document["latency"].get("timed", True))


def pace(latency_ns: float, recording_ns: float) -> str:
    """Return how a latency compares with the duration of the recording."""
    if latency_ns <= 0:
        return "no time at all"
    return f"{_times(recording_ns / latency_ns, 'faster', 'slower')} than the {time(recording_ns)} recorded"


def against(name: str, times: float) -> str:
    """Return how operations compare with those of a conventional network."""
    return f"{_times(times, 'fewer', 'more')} than {words(name)}"


def _times(factor: float, more: str, less: str) -> str:
    """Return a factor in words, by its inverse if it is below 1."""
    if factor >= 1:
        return f"{ratio(factor)} times {more}"
    return f"{ratio(1 / factor) if factor else 'infinitely many'} times {less}"


def against_anns(document: Document) -> list[Fact]:
    """Return how the network's operations compare with those of conventional networks, counted in both ways."""
    sides = _SIDES if defined_anns(document) else {}
    return [Fact(label, _against_anns(document, *side)) for label, side in sides.items()]


def _against_anns(document: Document, key: str, whose: str) -> str:
    """Return how operations, with the ratio under ``key``, compare with those of each conventional network."""
    ratios = {name: entry[key] for name, entry in defined_anns(document).items()}
    if None in ratios.values():
        return f"nothing to compare: there were none ({whose})"
    return f"{listed([against(name, times) for name, times in ratios.items()])} ({whose})"


def _accuracy(document: Document) -> str:
    accuracy = document["accuracy"]
    if document["match"]["events_origin"] == "made up":
        return "not known, because the recordings are made up"
    if accuracy is None:
        return "not known, because the recordings have no labels"
    chip, reference = accuracy["chip"], accuracy["reference"]
    network = "as trained" if document["match"]["reference"] == "integers" else "float"
    return f"{share(chip)} on the chip, {share(reference)} {network} ({points(chip - reference)})"


def _scores(match: Document) -> str:
    return known(
        match["score_error"],
        lambda error: f"differ by {share(error)} of their spread" if error > _ROUNDING else "equal",
        "not compared",
    )


def _first_difference(document: Document) -> str:
    first = document["match"]["first_divergence"]
    if first is None:
        return (
            "none, every spike is equal"
            if document["match"]["spike_agreement"] is not None
            else NONE
        )
    place = f"{first['population']}, neuron {first['neuron']}, step {first['step']} of recording {first['recording']}"
    return f"{place}, by {stage_words(first['cause']['largest'])}" if first["cause"] else place


def _registers(document: Document) -> str:
    """Return wraps and clips, with clips also as a share of all compartment updates."""
    match = document["match"]
    text = f"{plural(match['wraps'], 'wrap')}, {plural(match['clips'], 'clip')}"
    updates = document["operations"]["per_sample"]["neuron_updates"] * match["samples"]
    return (
        f"{text} ({share(match['clips'] / updates)} of updates)"
        if match["clips"] and updates
        else text
    )


def fullness(entry: dict[str, int]) -> float:
    """Return the share of a limit in use; a limit of 0 is full as soon as anything is used."""
    if entry["limit"]:
        return entry["used"] / entry["limit"]
    return float(entry["used"] > 0)
