"""Sections on the program itself: resources, what was left out, rounding, and where it came from."""

from __future__ import annotations

from locsnn_compile.report.content import Bar, Bullets, Document, Fact, Facts, Paragraph, Section, Table
from locsnn_compile.report.format import NONE, any_value, count, memory, share
from locsnn_compile.report.sections.choice import choice_blocks
from locsnn_compile.report.sections.verdict import fullness
from locsnn_compile.report.words import words
from locsnn_compile.strategies import LAYOUTS

_WITHOUT_JOINED = {"reset", "native"}


def resources(document: Document) -> Section:
    """Use against every limit, fullest core first, then core by core."""
    found = document["resources"]
    limits = sorted(found["limits"].items(), key=lambda item: -fullness(item[1]))
    table = Table(
        "Limits, the fullest first; of a core's limits its fullest core",
        ("limit", "", "used", "of", "share"),
        tuple(
            (
                words(name),
                Bar(min(1.0, fullness(entry)), f"{share(fullness(entry))} used"),
                count(entry["used"]),
                count(entry["limit"]),
                share(fullness(entry)),
            )
            for name, entry in limits
        ),
    )
    totals = Facts(
        (
            Fact("compartments", count(found["compartments"])),
            Fact("synapses", f"{count(found['synapses'])}, {memory(found['synapse_bits'])} of synapse memory"),
            Fact("axons", f"{count(found['axons_in'])} in, {count(found['axons_out'])} out"),
        )
    )
    return Section(
        "resources",
        "Resources",
        f"What the program takes of {document['target']}.",
        (totals, table, _by_core(document)),
    )


def left_out(document: Document) -> Section:
    """Steps skipped, events dropped, synapses and compartments pruned."""
    found = document["skipped"]
    facts = (
        Fact("steps skipped", f"{count(found['steps'])}, of all recordings; nothing could change in them"),
        Fact("events dropped", f"{count(found['events_dropped'])}, of all recordings; after the last step"),
        *([Fact("binning", found["binning"]["words"])] if "binning" in found else []),
        Fact("synapses pruned", f"{count(found['synapses_pruned'])}, whose weight rounds to 0"),
        Fact("compartments pruned", count(found["compartments_pruned"])),
        *(
            [Fact("biases lost", f"{count(found['biases_lost'])}, which round to 0")]
            if found.get("biases_lost")
            else []
        ),
    )
    return Section("left-out", "Left out", "What the program does not have or do.", (Facts(facts),))


def quantization(document: Document) -> Section:
    """Scales, decays and rounding errors by population."""
    populations = document["quantization"]
    keys = list(dict.fromkeys(key for entry in populations.values() for key in entry))
    table = Table(
        "Numbers of the chip by population",
        ("population", *(words(key) for key in keys)),
        tuple((name, *(_number(key, entry.get(key)) for key in keys)) for name, entry in populations.items()),
    )
    return Section(
        "quantization",
        "Quantisation",
        "A potential of 1 in the float network is the scale in the chip's registers. Decays are of 4096. Two numbers "
        "are the least and the largest of the population. The kernel fit is measured on the chip's integers: how far "
        "the response to an input spike, and what an own spike takes away, are from the kernels, as shares of them: at "
        "most, and as root mean square (rms).",
        (table,),
    )


def ranges(document: Document) -> Section:
    """What is proven of the registers, whatever the input, and up to which input rate."""
    table = Table(
        "Compartments that are safe, whatever the input",
        ("compartments", "number", "cannot wrap", "cannot clip", "all safe if no source spikes twice within"),
        tuple(
            (
                name,
                count(row["compartments"]),
                count(row["cannot_wrap"]),
                count(row["cannot_clip"]),
                _period(row["safe_period_steps"]),
            )
            for name, row in document["range"].items()
        ),
    )
    return Section(
        "range",
        "Proof of range",
        "Bounds of every register from weights, decays and thresholds alone. What is not proven safe was watched: the "
        "wraps and clips above are all there were.",
        (table,),
    )


def provenance(document: Document) -> Section:
    """What was compiled for what, with which options, checked on what; what is assumed."""
    strategies = document["strategy"].split(", ")
    meaning = "; ".join(f"{name}: {LAYOUTS[name]}" if name in LAYOUTS else name for name in strategies)
    facts = (
        Fact("model", document["model"]["name"]),
        Fact("model sha256", document["model"]["sha256"] or NONE),
        Fact("target", document["target"]),
        Fact("strategy", meaning),
        Fact("weight bits", any_value(document["weight_bits"])),
        Fact("recordings", f"{count(document['match']['samples'])} of {document['match']['events_source']}"),
        Fact("schema", document["schema"]),
    )
    notes = ["Energy and latency are models: counts times published costs. No board was used."]
    if not _WITHOUT_JOINED.issuperset(strategies):
        notes.append(
            "Joined compartments (dendrites) are an assumption about the chip: public sources name them, and none "
            "gives their integer timing."
        )
    notes.append("Where public sources on the chip are silent or disagree, the target's description decides.")
    lead = "Enough to make this report again; the same input gives the same bytes."
    blocks = (
        Facts(facts),
        *_gates(document),
        *choice_blocks(document),
        Bullets("To be read with these figures", tuple(notes)),
    )
    return Section("provenance", "Provenance", lead, blocks)


def _gates(document: Document) -> tuple[Table, ...]:
    """What the build had to keep; nothing where no bound was given."""
    rows = [
        (gate["name"], any_value(gate["bound"]), any_value(gate["measured"]), any_value(gate["passed"]))
        for gate in document["gates"]
    ]
    return (Table("Gates", ("gate", "bound", "measured", "passed"), tuple(rows)),) if rows else ()


def _by_core(document: Document) -> Table | Paragraph:
    rows = document["resources"]["by_core"]
    if not rows:
        return Paragraph("No core is in use.")
    keys = [key for key in rows[0] if key not in ("core", "phase", "slot", "tile")]
    return Table(
        "Core by core",
        ("core", *(words(key).replace(" of a core", "") for key in keys)),
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
