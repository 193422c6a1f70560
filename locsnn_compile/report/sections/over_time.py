"""The section on predictions while a recording plays, and on where it could stop."""

from locsnn_compile.report.content import Curve, Document, Plot, Section, Table
from locsnn_compile.report.format import count, energy, share, short, time
from locsnn_compile.report.pictures.axis import Axis
from locsnn_compile.report.sections.accuracy import sample
from locsnn_compile.report.sections.cost_tables import ENERGY, PARTS, TIME
from locsnn_compile.report.sections.verdict import timed
from locsnn_compile.report.words import facts, section, sentence, table, words


def over_time(document: Document) -> Section:
    """The share of right predictions during a recording, and what a proven stop saves."""
    priced = document["energy"]["profile"]
    by_step = timed(document) and "activity" not in document
    costs = (
        *(ENERGY.course(document) if priced else ()),
        *(TIME.course(document) if by_step else ()),
    )
    if "over_time" not in document:
        return section("over-time", *costs, called="over-time of costs")
    entry = document["over_time"]
    if "left_out" in entry:
        return section("over-time", *costs, called="over-time left out", why=entry["left_out"])
    return section(
        "over-time",
        _plot(entry),
        _table(entry),
        sentence("time-weighted", psi=entry["psi"]) if "time_weighted" in entry["right"] else None,
        _stop(entry["proven_stop"]),
        sentence("proven stop", steps=count(entry["proven_stop"]["all_steps"])),
        facts("recordings", recordings=sample(entry, named=False)),
        *costs,
    )


def _title(entry: Document) -> str:
    if entry["right_is"] == "the label":
        return "Accuracy after each step"
    return "Recordings with the same prediction as after the last step"


def _plot(entry: Document) -> Plot:
    last, seconds = entry["steps"][-1], entry["step_seconds"]
    moment = (lambda step: short(step * seconds)) if seconds else "{:.0f}".format
    return Plot(
        title=_title(entry),
        x_label="seconds" if seconds else "steps",
        x=Axis(0.0, last, tuple(part * last for part in (0.0, *PARTS)), moment),
        y=Axis(0.0, 1.0, (0.25, 0.5, 0.75, 1.0), lambda share: f"{100 * share:.0f} %"),
        curves=tuple(
            Curve(words(name), tuple(zip(entry["steps"], values, strict=True)))
            for name, values in entry["right"].items()
        ),
    )


def _table(entry: Document) -> Table:
    steps = entry["steps"]
    at = [min(range(len(steps)), key=lambda i: abs(steps[i] - part * steps[-1])) for part in PARTS]
    return Table(
        _title(entry),
        ("prediction by", *(f"step {count(steps[i])}" for i in at)),
        tuple(
            (words(name), *(share(values[i]) for i in at))
            for name, values in entry["right"].items()
        ),
    )


def _stop(found: Document) -> Table:
    rows = {}
    for name, shown in (
        ("steps", count),
        ("synaptic_ops", count),
        ("energy_pj", energy),
        ("latency_ns", time),
    ):
        until, whole = found[name], found[f"all_{name}"]
        if whole is not None:
            what, _, unit = name.rpartition("_")
            label = f"{what}, profile {found['profile']}" if unit in ("pj", "ns") else words(name)
            saved = 1.0 - until / whole if whole else 0.0
            rows[label] = {"whole": shown(whole), "until": shown(until), "drawn": saved}
    return table("stop", rows)
