"""Sections on the program itself: resources, what was left out, rounding, its origin, and the settings compared."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from locsnn_compile.report.content import Bar, Bullets, Cell, Document, Section, Table, facts, of, section, table
from locsnn_compile.report.format import NONE, agreed, any_value, count, energy, memory, plural, share, time
from locsnn_compile.report.sections.verdict import fullness, outside
from locsnn_compile.report.words import limit_words, listed, sentence, words
from locsnn_compile.settings import LAYOUTS

if TYPE_CHECKING:
    from locsnn_compile.choose_strategy import Candidate, Choice

_WITHOUT_JOINED = {"reset", "native"}
_GATE_FIGURES = tuple((key, of(key, any_value)) for key in ("bound", "measured", "passed"))


def resources(document: Document) -> Section:
    """Use against every limit, fullest core first, then core by core."""
    found = document["resources"]
    limits = sorted(found["limits"].items(), key=lambda limit: -fullness(limit[1]))
    return section(
        "resources",
        facts(
            ("compartments", count(found["compartments"])),
            ("synapses", f"{count(found['synapses'])}, {memory(found['synapse_bits'])} of synapse memory"),
            ("axons", f"{count(found['axons_in'])} in, {count(found['axons_out'])} out"),
        ),
        Table(
            "Limits, the fullest first; for limits of a core, its fullest core",
            ("limit", "", "used", "of", "share"),
            tuple(_limit(name, entry, fullness(entry)) for name, entry in limits),
        ),
        _by_core(document),
        target=document["target"],
    )


def _limit(name: str, entry: Document, full: float) -> tuple[Cell, ...]:
    used = share(full)
    return limit_words(name), Bar(min(1.0, full), f"{used} used"), count(entry["used"]), count(entry["limit"]), used


def left_out(document: Document) -> Section:
    """Steps skipped, events dropped, synapses and compartments pruned."""
    found, late = document["skipped"], document.get("input")
    before = (
        listed([f"{steps:.1f} ({words(name)})" for name, steps in late["aligned_steps_by_branch"].items()])
        if late
        else ""
    )
    lost = found.get("biases_lost")
    its = facts(
        ("steps skipped", f"{count(found['steps'])} over all recordings, in which nothing could change"),
        ("steps before the touch", f"{before} per recording, which starts after them" if late else None),
        ("events dropped", f"{count(found['events_dropped'])} over all recordings, {outside(document)}"),
        ("binning", found["binning"]["words"] if "binning" in found else None),
        ("synapses pruned", f"{count(found['synapses_pruned'])}, whose weight rounds to 0"),
        ("compartments pruned", count(found["compartments_pruned"])),
        ("biases lost", f"{count(lost)}, which round to 0" if lost else None),
    )
    return section("left-out", its)


def quantization(document: Document) -> Section:
    """Scales, decays and rounding errors by population."""
    populations = document["quantization"]
    keys = list(dict.fromkeys(key for entry in populations.values() for key in entry))
    rows = tuple((name, *(_number(key, entry.get(key)) for key in keys)) for name, entry in populations.items())
    its = Table("Numbers of the chip by population", ("population", *(words(key) for key in keys)), rows)
    return section("quantization", its)


def ranges(document: Document) -> Section:
    """What is proven of the registers, whatever the input, and up to which input rate."""
    its = table(
        "Compartments that are safe for any input",
        ({"name": name, **row} for name, row in document["range"].items()),
        ("compartments", of("name", str)),
        ("number", of("compartments", count)),
        ("cannot wrap", of("cannot_wrap", count)),
        ("cannot clip", of("cannot_clip", count)),
        ("all safe if no source spikes twice within", of("safe_period_steps", _period)),
    )
    return section("range", its)


def provenance(document: Document) -> Section:
    """What was compiled for what, with which options, checked on what; what is assumed."""
    strategies = document["strategy"].split(", ")
    meaning = "; ".join(f"{name}: {LAYOUTS[name]}" if name in LAYOUTS else name for name in strategies)
    joined = [] if _WITHOUT_JOINED.issuperset(strategies) else ["joined"]
    modelled = ["modelled"] if document["energy"]["profile"] else []
    notes = tuple(sentence(name) for name in (*modelled, *joined, "silent sources"))
    gates, choice = document["gates"], document.get("strategy_choice")
    return section(
        "provenance",
        facts(
            ("model", document["model"]["name"]),
            ("model sha256", document["model"]["sha256"] or NONE),
            ("target", document["target"]),
            ("strategy", meaning),
            ("weight bits", any_value(document["weight_bits"])),
            ("recordings", f"{count(document['match']['samples'])} of {document['match']['events_source']}"),
            ("schema", document["schema"]),
        ),
        table("Gates", gates, ("gate", of("name", any_value)), *_GATE_FIGURES) if gates else None,
        settings_compared(choice) if choice else None,
        Bullets("Keep in mind with these figures", notes),
    )


def _by_core(document: Document) -> Table | str:
    rows = document["resources"]["by_core"]
    if not rows:
        return "No core is in use."
    keys = [key for key in rows[0] if key not in ("core", "phase", "slot", "tile")]
    return Table(
        "Core by core",
        ("core", *(words(key) for key in keys)),
        tuple((f"{row['core']}, {row['phase']}", *(any_value(row[key]) for key in keys)) for row in rows),
    )


def _period(steps: int | None) -> str:
    if steps is None:
        return "no rate is proven safe"
    return "any input is safe" if steps == 1 else f"{count(steps)} steps"


def _number(key: str, value: object) -> str:
    if isinstance(value, float) and key.endswith("_error"):
        return share(value)
    if isinstance(value, dict):
        return ", ".join(f"{words(name)} {share(part)}" for name, part in value.items() if part is not None)
    return any_value(value)


def settings_compared(choice: Document) -> Table:
    """Return a table of the settings that were compared."""
    taken = {**choice, "strategy": choice["taken"]}
    priced = choice["candidates"][0]["energy_pj"] is not None
    return table(
        f"Settings compared on {plural(choice['calibration_samples'], 'recording')} of "
        f"{choice['calibration_source']}; taken: {setting_words(taken, 'taken_')}, {_reason(choice)}",
        choice["candidates"],
        ("setting", setting_words),
        ("same prediction", of("prediction_agreement", lambda share: agreed(share, "all tie"))),
        ("spikes that differ", of("spike_error", agreed)),
        ("energy", of("energy_pj", energy)) if priced else ("time", of("chip_time_ns", time)),
        ("within the error budget", of("within_budget", any_value)),
    )


def unmet_budget(choice: "Choice") -> str:
    """Say in a line what a budget that no setting keeps came to, and a way out."""
    best, bounds = choice.taken, choice.budget
    silent = best.spike_agreement is None or (bounds.min_agreement is not None and best.prediction_agreement is None)
    fix = (
        "Give --calibration recordings in which outputs spike."
        if silent
        else "Train for the chip with locsnn train --target, or allow more."
    )
    setting = setting_words(asdict(best.setting))
    return (
        f"no setting keeps {bounds.words()} on {plural(choice.samples, 'recording')} of {choice.source}: "
        f"the best of {len(choice.candidates)} is {setting}, with {_lost(best)}. {fix}"
    )


def _lost(candidate: "Candidate") -> str:
    agreement, error = candidate.prediction_agreement, candidate.spike_error
    predictions = "no prediction compared" if agreement is None else f"prediction agreement {agreement:.4f}"
    return f"{predictions} and {'no spike compared' if error is None else f'{error:.4f} of the spikes different'}"


def setting_words(row: dict[str, Any], prefix: str = "") -> str:
    """Name a setting."""
    part = row[f"{prefix}split_weights"]
    split = f", {'all' if part == 1 else share(part) + ' of'} weights split" if part else ""
    return f"{row['strategy']}, {row[f'{prefix}weight_bits']} bits{split}"


def _reason(choice: dict[str, Any]) -> str:
    if choice["min_agreement"] is choice["max_spike_error"] is None:
        return "the most exact one, as nothing was compared"
    if choice["kept"]:
        return "the cheapest within the error budget"
    return "the most accurate, as none is within the error budget"
