"""Sections on the program itself: resources, what was left out, rounding, provenance, and the settings compared."""

from collections.abc import Iterator
from typing import Any

from locsnn_compile.report.content import Bullets, Document, Section, Table
from locsnn_compile.report.format import NONE, any_value, count, share
from locsnn_compile.report.sections.verdict import counts_cores, fullness, outside, starts
from locsnn_compile.report.words import facts, limit_words, listed, section, sentence, table, words
from locsnn_compile.request.choose_strategy import Choice
from locsnn_compile.settings import DIALS, LAYOUTS, Setting

_WITHOUT_JOINED = {"reset", "native"}


def resources(document: Document) -> Section:
    """Use of every limit, the fullest first, and then core by core."""
    found = document["resources"]
    given = (limit for limit in found["limits"].items() if any(limit[1].values()))
    limits = sorted(given, key=lambda limit: -fullness(limit[1]))
    return section(
        "resources",
        facts("resources", **found),
        table(
            "limits",
            {limit_words(name): entry | {"drawn": fullness(entry)} for name, entry in limits},
        ),
        _by_core(found["by_core"]),
        target=document["target"],
    )


def left_out(document: Document) -> Section:
    """Steps skipped, events dropped, synapses and compartments pruned."""
    found, late = document["skipped"], starts(document)
    before, lost = None, found.get("biases_lost")
    if late:
        branches = [f"{steps:.1f} ({words(name)})" for name, steps in late.items()]
        before = f"{listed(branches)} per recording, which starts after them"
    given = {
        "before": before,
        "outside": outside(document),
        "binned": found["binning"]["words"] if "binning" in found else None,
        "lost": f"{count(lost)}, which round to 0" if lost else None,
    }
    return section("left-out", facts("left-out", **found, **given))


def quantization(document: Document) -> Section:
    """Scales, decays and rounding errors by population."""
    populations = document["quantization"]
    keys = list(dict.fromkeys(key for entry in populations.values() for key in entry))
    rows = tuple(
        (name, *(_number(key, entry.get(key)) for key in keys))
        for name, entry in populations.items()
    )
    its = Table(
        "Numbers of the chip by population", ("population", *(words(key) for key in keys)), rows
    )
    return section("quantization", its)


def ranges(document: Document) -> Section:
    """What is proven of the registers for any input, and up to which input rate."""
    proven = document["range"].items()
    return section(
        "range", table("ranges", {name: row | {"period": _period(**row)} for name, row in proven})
    )


def provenance(document: Document) -> Section:
    """What was compiled, for which target, with which options, checked on which recordings; what is assumed."""
    strategies = document["strategy"].split(", ")
    meaning = "; ".join(
        f"{name}: {LAYOUTS[name]}" if name in LAYOUTS else name for name in strategies
    )
    notes = tuple(sentence(name) for name in _kept_in_mind(document, strategies))
    gates, choice = document["gates"], document.get("strategy_choice")
    return section(
        "provenance",
        facts("provenance", meaning=meaning, **document),
        table("gates", gates) if gates else None,
        settings_compared(choice) if choice else None,
        Bullets("Keep in mind", notes) if notes else None,
    )


def _kept_in_mind(document: Document, strategies: list[str]) -> Iterator[str]:
    """Give the names of the notes on the chip: nothing is assumed of a single core that its sources define."""
    if document["energy"]["profile"]:
        yield "modelled"
    if not counts_cores(document):
        return
    if not _WITHOUT_JOINED.issuperset(strategies):
        yield "joined"
    yield "silent sources"


def _by_core(rows: list[Document]) -> Table | str:
    if not rows:
        return "No core is in use."
    keys = [key for key in rows[0] if key not in ("core", "phase", "slot", "tile")]
    return table(
        "core by core", rows, columns={words(key): f"{{{key}:any_value or {NONE}}}" for key in keys}
    )


def _period(safe_period_steps: int | None, **_: int) -> str:
    if safe_period_steps is None:
        return "no rate is proven safe"
    return "any input is safe" if safe_period_steps == 1 else f"{count(safe_period_steps)} steps"


def _number(key: str, value: object) -> str:
    if isinstance(value, float) and key.endswith("_error"):
        return share(value)
    if isinstance(value, dict):
        return ", ".join(
            f"{words(name)} {share(part)}" for name, part in value.items() if part is not None
        )
    return any_value(value)


def settings_compared(choice: Document) -> Table:
    """Return a table of the settings that were compared."""
    priced = choice["candidates"][0]["energy_pj"] is not None
    rows = (
        row | {"setting": Setting(*(row[dial.name] for dial in DIALS))}
        for row in choice["candidates"]
    )
    cost = {"energy": "{energy_pj:energy}"} if priced else {"time": "{chip_time_ns:time}"}
    taken = Setting(*(choice[dial.taken_key] for dial in DIALS))
    return table("settings", rows, columns=cost, setting=taken, why=_reason(choice), **choice)


def unmet_budget(choice: Choice) -> str:
    """Say in one line that no setting keeps the budget, what the best one loses, and what to do."""
    best, bounds = choice.taken, choice.budget
    silent = best.spike_agreement is None or (
        bounds.min_agreement is not None and best.prediction_agreement is None
    )
    fix = "Train for the chip with locsnn train --target, or allow more."
    if silent:
        fix = "Give --calibration recordings in which outputs spike."
    return sentence(
        "unmet budget", bounds=bounds.words(), choice=choice, many=len(choice.candidates), fix=fix
    )


def _reason(choice: dict[str, Any]) -> str:
    if choice["min_agreement"] is choice["max_spike_error"] is choice["max_score_error"] is None:
        return "the most exact one, as nothing was compared"
    if choice["kept"]:
        return "the cheapest within the error budget"
    return "the most accurate, as none is within the error budget"
