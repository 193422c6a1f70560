"""Two builds side by side, as content without form: three questions, key figures, and everything that changed."""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any

from hw_model.values import Frozen
from locsnn_compile.errors import InputError, listed
from locsnn_compile.report.content import (
    Bar,
    Document,
    Fact,
    Facts,
    Notice,
    Report,
    Section,
    Status,
    Table,
    Verdict,
)
from locsnn_compile.report.figures.flat import Figures, flatten
from locsnn_compile.report.format import (
    NONE,
    agreed,
    any_value,
    count,
    energy,
    plural,
    points,
    share,
    shortened,
    time,
)
from locsnn_compile.report.words import words

MAX_ROWS = 150
"""Most changed figures in a section of the page; --json has all."""
_LONGEST = 120
"""Characters of a text; the rest is cut, but only here."""


class Build(Frozen):
    """The name of a build, its report, and the figures of its program."""

    name: str
    report: Document
    program: Document

    @cached_property
    def figures(self) -> Figures:
        """Figures of the report by their dotted keys."""
        return flatten(self.report)

    @property
    def timed(self) -> bool:
        """Whether the report knows how long a recording takes; reports of earlier versions do not say."""
        return self.figures.get("latency.timed") is not False

    def number(self, key: str) -> float:
        """Return a number of the report by its dotted key; ``InputError`` if there is none."""
        value: Any = self.figures.get(key)
        if not _is_number(value):
            what, fix = f"report.json has no number {key!r}", "Compile it again with this version."
            raise InputError(f"build {self.name!r}", what, fix=fix)
        return float(value)

    def share(self, key: str) -> float | None:
        """Return a share of what was compared; None if the report says that nothing was."""
        return None if self.figures.get(key, 0) is None else self.number(key)

    @property
    def score_error(self) -> float | None:
        """How far class scores are off; None if nothing was compared, and in reports of versions without scores."""
        return self.share("match.score_error") if "match.score_error" in self.figures else None

    def text(self, key: str) -> str:
        """Return a text of the report; a dash if it has no such text."""
        value = self.figures.get(key)
        return value if isinstance(value, str) else NONE


_MODELS_DIFFER = Notice(
    "The models differ.", "What changed may come from the model, not from the compiler."
)
_MODELS_NOT_KNOWN = Notice(
    "Whether the models are equal is not known.",
    "A network that was made in Python has no file to tell by. What changed may come from the model.",
)
_PROFILES_DIFFER = Notice(
    "Their energy profiles differ.", "Their energies and times cannot be compared."
)
_CHIPS_DIFFER = Notice(
    "The chips differ.", "What changed may come from what their cores and registers hold."
)
KeyFigure = tuple[str, str, Callable[[float], str]]
"""A figure of the report: its name, its key and how it is shown."""


_LATENCY = "latency.per_sample_ns"
_SYNAPTIC_OPS: KeyFigure = ("synaptic operations", "operations.per_sample.synaptic_ops", count)
_UPDATES: KeyFigure = ("neuron updates", "operations.per_sample.neuron_updates", count)
_COMPARTMENTS: KeyFigure = ("compartments", "resources.compartments", count)
_SYNAPSES: KeyFigure = ("synapses", "resources.synapses", count)
_KEY_FIGURES: tuple[KeyFigure, ...] = (
    ("dynamic energy per recording", "energy.per_sample_pj", energy),
    ("time per recording", _LATENCY, time),
    _SYNAPTIC_OPS,
    _UPDATES,
    ("spikes on the chip", "operations.per_sample.spikes", count),
    ("spikes on one side only", "match.spike_mismatches", count),
    _COMPARTMENTS,
    _SYNAPSES,
)
_COSTS: tuple[KeyFigure, ...] = (("latency", _LATENCY, time), _SYNAPTIC_OPS, _UPDATES)
_ROOM: tuple[KeyFigure, ...] = (
    _COMPARTMENTS,
    _SYNAPSES,
    ("synapse bits", "resources.synapse_bits", count),
)
_CONTENTS = "program.contents."
_EVENTS = ("input_events", "transpose_events")
_LARGEST = 1e200
"""Numbers must be smaller, so that ratios of them can be computed."""
Change = tuple[Any, Any]
_Known = tuple[float | None, float | None]
"""A figure before and after; None if nothing was compared."""


def changes(before: Build, after: Build) -> dict[str, Change]:
    """Return both values of every figure of reports and programs that differs, apart from histograms."""
    a, b = (_figures(build) for build in (before, after))
    keys = [*a, *(key for key in b if key not in a)]
    return {key: (a.get(key), b.get(key)) for key in keys if a.get(key) != b.get(key)}


def contents_changed(changed: Iterable[str], within: str = "") -> list[str]:
    """Return what differs in two programs, if all keys of figures that ``changed`` and begin with ``within`` say that.

    Then figures, which are sums and extremes, are equal, and programs are not.
    """
    keys = [key for key in changed if key.startswith(within)]
    parts = [key.removeprefix(_CONTENTS) for key in keys if key.startswith(_CONTENTS)]
    return parts if len(parts) == len(keys) else []


def comparison(before: Build, after: Build) -> Report:
    """Return the comparison of two builds."""
    changed = changes(before, after)
    return Report(
        kind="locsnn diff",
        title=f"{_short(before.name)} → {_short(after.name)}",
        subtitle=f"{before.text('model.name')} on {before.text('target')}, then {after.text('model.name')} on "
        f"{after.text('target')}: {plural(len(changed), 'figure')} changed",
        verdicts=(_matches(before, after), _costs(before, after), _fits(before, after)),
        notices=_notices(before, after),
        sections=(_key_figures(before, after), *_all(changed)),
        footer="Figures that are equal are left out.",
    )


def percent(before: Any, after: Any) -> str:
    """Return the change of a number in percent; an empty text if either is not a number, or the first is 0."""
    if not (_is_number(before) and _is_number(after) and before):
        return ""
    return f"{100 * (after / before - 1):+.1f} %"


def _is_number(value: Any) -> bool:
    """Tell whether a value is a number to calculate with; reports may hold values of any kind and size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST


def _figures(build: Build) -> Figures:
    found = build.figures | flatten(build.program, "program")
    return {
        key: value
        for key, value in found.items()
        if not any(p.endswith("_histogram") for p in key.split("."))
    }


def _matches(before: Build, after: Build) -> Verdict:
    predictions = _shares(before, after, "prediction_agreement")
    spikes = _shares(before, after, "spike_agreement")
    scores = before.score_error, after.score_error
    status, answer = _change_of_match(predictions, spikes, scores)
    off = [
        "not compared" if error is None else f"{share(error)} of their spread off"
        for error in scores
    ]
    facts = {
        "accuracy on the chip": _accuracy(before, after),
        "equal spikes": _now(*map(agreed, spikes)),
        "spikes on one side only": _both(before, after, "match.spike_mismatches", count),
        "class scores": _now(*off),
        "wraps and clips": _both(before, after, "match.wraps", count, "match.clips"),
    }
    same = agreed(predictions[1], "an unknown share")
    same_before = agreed(predictions[0], "an unknown share")
    return Verdict(
        question="Does it match as well?",
        status=status,
        answer=answer,
        figure=same,
        figure_label=f"same prediction; {same_before} before",
        sentence=f"The chip predicts the same class as the network in {same} of recordings, "
        f"{same_before} before.",
        facts=Facts.of(facts).facts,
    )


def _shares(before: Build, after: Build, key: str) -> _Known:
    return before.share(f"match.{key}"), after.share(f"match.{key}")


def _change_of_match(predictions: _Known, spikes: _Known, scores: _Known) -> tuple[Status, str]:
    """Answer by both agreements and the error of scores; not known if a build compared none of what the other did."""
    a, b = predictions
    if a is None or b is None or (spikes[0] is None) != (spikes[1] is None):
        return "unknown", "Not known"
    answer = "As before" if a == b else "Better" if b > a else "Worse"
    losses = {"fewer spikes are equal": spikes[::-1], "class scores differ more": scores}
    worse = [
        words
        for words, (least, most) in losses.items()
        if least is not None and most is not None and most > least
    ]
    if b >= a and worse:
        return "nearly", f"{answer}, but {listed(worse)}"
    return ("no" if b < a else "yes"), answer


def _key(before: Build, after: Build) -> tuple[KeyFigure, ...]:
    """Return the figures to compare; without energy, as for an open core, time comes first."""
    priced = NONE not in (before.text("energy.profile"), after.text("energy.profile"))
    return _timed(before, after, _KEY_FIGURES if priced else _KEY_FIGURES[1:])


def _timed(before: Build, after: Build, figures: Sequence[KeyFigure]) -> tuple[KeyFigure, ...]:
    """Return figures without the time of a recording, if it is not known of both."""
    known = before.timed and after.timed
    return tuple(figure for figure in figures if known or not figure[1].startswith("latency."))


def _costs(before: Build, after: Build) -> Verdict:
    figures = _key(before, after)
    _, key, shown = figures[0]
    what, profile = (
        ("dynamic energy", f", profile {after.text('energy.profile')}")
        if key.startswith("energy.")
        else ("time", "")
    )
    a, b = before.number(key), after.number(key)
    comparable = _same_profile(before, after) and _same_recordings(before, after)
    by = percent(a, b).lstrip("+-")
    answer = (
        _answer(a, b, f"{by} less", f"{by} more") if comparable else ("unknown", "Not comparable")
    )
    now, then = shown(b), shown(a)
    status, text = answer
    return Verdict(
        question="Does it cost less?",
        status=status,
        answer=text,
        figure=now,
        figure_label=f"{what} per recording{profile}; {then} before",
        sentence=f"In the model, a recording takes {now} of {what}, {then} before.",
        facts=_changed(before, after, _COSTS),
    )


def _fits(before: Build, after: Build) -> Verdict:
    a, b = (build.number("resources.cores") for build in (before, after))
    status, answer = _answer(a, b, "fewer cores", "more cores")
    now, then = plural(b, "core"), count(a)
    return Verdict(
        question="Does it use fewer resources?",
        status=status,
        answer=answer,
        figure=now,
        figure_label=f"{then} before",
        sentence=f"The program takes {now}, {then} before.",
        facts=_changed(before, after, _ROOM),
    )


def _answer(before: float, after: float, less: str, more: str) -> tuple[Status, str]:
    """Return whether it is less now, and say how much."""
    if before == after:
        return "yes", "The same"
    return ("yes", f"Yes, {less.strip()}") if after < before else ("no", f"No, {more.strip()}")


def _changed(before: Build, after: Build, group: Sequence[KeyFigure]) -> tuple[Fact, ...]:
    named = _timed(before, after, group)
    return tuple(Fact(label, _both(before, after, key, shown)) for label, key, shown in named)


def _recordings(build: Build) -> str:
    """Return how many recordings a build was checked on, and which."""
    return f"{plural(build.number('match.samples'), 'recording')} of {build.text('match.events_source')}"


def _same_recordings(before: Build, after: Build) -> bool:
    """Tell whether recordings have one source and number, and as many events in every phase that both builds have."""
    return _recordings(before) == _recordings(after) and _agree(
        before, after, "operations.by_branch.", _EVENTS
    )


def _same_profile(before: Build, after: Build) -> bool:
    """Tell whether both are priced by a profile of one name and, since chip files may change it, of equal constants."""
    a, b = (build.text("energy.profile") for build in (before, after))
    return a == b and _agree(before, after, f"energy.profiles.{a}.")


def _same_chip(before: Build, after: Build) -> bool:
    """Tell whether both are for a target of one name, whose registers and cores hold the same."""
    equal = _agree(before, after, ("program.registers.", "resources.mesh."))
    equal &= _agree(
        before, after, "resources.limits.", ".limit"
    )  # how much of it is used is the program's
    return before.text("target") == after.text("target") and equal


def _agree(
    before: Build, after: Build, begin: str | tuple[str, ...], end: str | tuple[str, ...] = ""
) -> bool:
    """Tell whether figures that both have are equal, by the beginning and the end of their keys."""
    a, b = (_figures(build) for build in (before, after))
    return all(
        a[key] == b[key] for key in a if key in b and key.startswith(begin) and key.endswith(end)
    )


def _notices(before: Build, after: Build) -> tuple[Notice, ...]:
    """Return what makes the two less comparable."""
    models, changed = (
        {build.text("model.sha256") for build in (before, after)},
        changes(before, after),
    )
    parts = contents_changed(changed, "program.")
    both = " and ".join(map(_recordings, (before, after)))
    notices = (
        (
            (len(models) > 1 and "" not in models)
            or not _agree(before, after, "model.members.", ".weight"),
            _MODELS_DIFFER,
        ),
        ("" in models and bool(changed), _MODELS_NOT_KNOWN),
        (
            not _same_recordings(before, after),
            Notice(
                "They were checked on different recordings.",
                f"{both}: figures per recording cannot be compared.",
            ),
        ),
        (not _same_profile(before, after), _PROFILES_DIFFER),
        (not _same_chip(before, after), _CHIPS_DIFFER),
        (
            bool(parts),
            Notice(
                "The programs differ, but not in their sums and extremes.",
                f"They differ in {', '.join(parts)}.",
            ),
        ),
    )
    return tuple(notice for holds, notice in notices if holds)


def _key_figures(before: Build, after: Build) -> Section:
    its = Table(
        "Before, a full bar, and after, a hatched one",
        ("figure", "", "before", "", "after", "change"),
        tuple(
            _row(name, before.number(key), after.number(key), shown)
            for name, key, shown in _key(before, after)
        ),
    )
    lead = (
        f"Before is {before.name}, after is {after.name}. Costs are modelled means per recording."
    )
    return Section.of("key-figures", "Key figures", lead, its)


def _row(name: str, a: float, b: float, shown: Callable[[float], str]) -> tuple[str | Bar, ...]:
    most = max(a, b) or 1.0
    bars = Bar(a / most, f"before, {shown(a)}"), Bar(b / most, f"after, {shown(b)}", 1)
    return (
        name,
        bars[0],
        shown(a),
        bars[1],
        shown(b),
        "no change" if a == b else percent(a, b) or NONE,
    )


def _all(changed: dict[str, Change]) -> list[Section]:
    """Return a section for every part of the report that changed."""
    by_part: dict[str, list[tuple[str, Change]]] = {}
    for key, change in changed.items():
        part, _, name = key.partition(".")
        by_part.setdefault(part, []).append((name or part, change))
    sections = []
    for i, (part, rows) in enumerate(by_part.items()):
        cut = f", the first {MAX_ROWS}; --json has all" if len(rows) > MAX_ROWS else ""
        title = _short(words(part))
        changed_rows = tuple(
            (_short(name), _short(any_value(a)), _short(any_value(b)), percent(a, b) or NONE)
            for name, (a, b) in rows[:MAX_ROWS]
        )
        changes = Table(
            f"{title}: {plural(len(rows), 'figure')} changed{cut}",
            ("figure", "before", "after", "change"),
            changed_rows,
        )
        sections.append(Section(f"part-{i}", title.capitalize(), "", (changes,)))
    return sections


def _both(
    before: Build, after: Build, key: str, shown: Callable[[float], str], also: str | None = None
) -> str:
    """Return a figure, or the sum of two, as it is now and as it was before."""
    a, b = (build.number(key) + (build.number(also) if also else 0) for build in (before, after))
    return shown(b) if a == b else _now(shown(a), shown(b))


def _now(before: str, after: str) -> str:
    return after if before == after else f"{after}; {before} before"


def _accuracy(before: Build, after: Build) -> str:
    if not all(isinstance(build.report.get("accuracy"), dict) for build in (before, after)):
        return "not known"
    a, b = (build.number("accuracy.chip") for build in (before, after))
    return f"{share(b)}; {share(a)} before ({points(b - a)})"


def _short(text: str) -> str:
    return shortened(text, _LONGEST)
