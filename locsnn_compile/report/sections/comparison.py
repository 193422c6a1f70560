"""Two builds side by side, as content without form: three questions, key figures, and everything that changed."""

from collections.abc import Callable, Iterator, Mapping, Sequence

from hw_model.values import Frozen
from locsnn_compile.errors import listed
from locsnn_compile.report.content import (
    Bar,
    Cell,
    Fact,
    Facts,
    Notice,
    Report,
    Section,
    Status,
    Table,
    Verdict,
)
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
from locsnn_compile.report.sections.builds import (
    Build,
    Change,
    agree,
    changes,
    contents_changed,
    percent,
    recordings_words,
    same_chip,
    same_profile,
    same_recordings,
)
from locsnn_compile.report.words import words
from locsnn_compile.verification.both_programs import ProgramsCompared

MAX_ROWS = 150
"""Most changed figures in a section of the page; --json has all."""
_LONGEST = 120
"""Characters of a text; the rest is cut, but only here."""


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


class KeyFigure(Frozen):
    """A figure of every report: its name, its key and how it is shown."""

    name: str
    key: str
    shown: Callable[[float], str]


_LATENCY = "latency.per_sample_ns"
_ENERGY = KeyFigure("dynamic energy per recording", "energy.per_sample_pj", energy)
_SYNAPTIC_OPS = KeyFigure("synaptic operations", "operations.per_sample.synaptic_ops", count)
_UPDATES = KeyFigure("neuron updates", "operations.per_sample.neuron_updates", count)
_COMPARTMENTS = KeyFigure("compartments", "resources.compartments", count)
_SYNAPSES = KeyFigure("synapses", "resources.synapses", count)
_KEY_FIGURES = (
    KeyFigure("time per recording", _LATENCY, time),
    _SYNAPTIC_OPS,
    _UPDATES,
    KeyFigure("spikes on the chip", "operations.per_sample.spikes", count),
    KeyFigure("spikes on one side only", "match.spike_mismatches", count),
    _COMPARTMENTS,
    _SYNAPSES,
)
_COSTS = (KeyFigure("latency", _LATENCY, time), _SYNAPTIC_OPS, _UPDATES)
_ROOM = (
    _COMPARTMENTS,
    _SYNAPSES,
    KeyFigure("synapse bits", "resources.synapse_bits", count),
)
_Known = tuple[float | None, float | None]
"""A figure before and after; None if nothing was compared."""


def comparison(before: Build, after: Build, played: ProgramsCompared | None = None) -> Report:
    """Return the comparison of two builds; ``played`` is what both programs did on recordings."""
    changed = changes(before, after)
    return Report(
        kind="locsnn diff",
        title=f"{_short(before.name)} → {_short(after.name)}",
        subtitle=f"{before.text('model.name')} on {before.text('target')}, then {after.text('model.name')} on "
        f"{after.text('target')}: {plural(len(changed), 'figure')} changed",
        verdicts=(_matches(before, after, played), _costs(before, after), _fits(before, after)),
        notices=tuple(_notices(before, after)),
        sections=(
            *(() if played is None else (_spikes_of_both(played),)),
            _key_figures(before, after),
            *_all(changed),
        ),
        footer="Figures that are equal are left out.",
    )


def _facts_of_both(played: ProgramsCompared) -> dict[str, str]:
    """Return, of both programs on the same recordings, how many classes and spikes are equal."""
    recordings = plural(played.recordings, "recording")
    facts = {"class of both programs": f"the same in {count(played.same_classes)} of {recordings}"}
    for name, match in played.by_population.items():
        if match.agreement is not None:
            facts[f"both, {name}"] = f"{share(match.agreement)} of spikes equal"
    return facts


def _spikes_of_both(played: ProgramsCompared) -> Section:
    """Return how many spikes of both programs are at the same neuron and step, by population."""
    rows = tuple(
        (
            name,
            agreed(match.agreement),
            count(match.reference_spikes),
            count(match.chip_spikes),
            count(match.mismatches),
        )
        for name, match in played.by_population.items()
    )
    columns = ("population", "spikes equal", "before", "after", "only on one side")
    lead = (
        f"Both programs predict the same class in {count(played.same_classes)} of "
        f"{plural(played.recordings, 'recording')} of {played.source}."
    )
    table = Table("Spikes of both programs", columns, rows)
    return Section("spikes-of-both", "Spikes of both programs", lead, (table,))


def _matches(before: Build, after: Build, played: ProgramsCompared | None) -> Verdict:
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
        **({} if played is None else _facts_of_both(played)),
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
        for words, (before, after) in losses.items()
        if before is not None and after is not None and after > before
    ]
    if b >= a and worse:
        return "nearly", f"{answer}, but {listed(worse)}"
    return ("no" if b < a else "yes"), answer


def _key(before: Build, after: Build) -> tuple[KeyFigure, ...]:
    """Return the figures to compare; without energy, as for an open core, time comes first."""
    figures = _timed(before, after, _KEY_FIGURES)
    priced = NONE not in (before.text("energy.profile"), after.text("energy.profile"))
    return (_ENERGY, *figures) if priced else figures


def _timed(before: Build, after: Build, figures: Sequence[KeyFigure]) -> tuple[KeyFigure, ...]:
    """Return figures without the time of a recording, if it is not known of both."""
    known = before.timed and after.timed
    return tuple(figure for figure in figures if known or figure.key != _LATENCY)


def _costs(before: Build, after: Build) -> Verdict:
    figure = _key(before, after)[0]
    what, profile = "time", ""
    if figure is _ENERGY:
        what, profile = "dynamic energy", f", profile {after.text('energy.profile')}"
    a, b = before.number(figure.key), after.number(figure.key)
    by = percent(a, b).lstrip("+-")
    status, answer = _answer(a, b, f"{by} less", f"{by} more")
    if not (same_profile(before, after) and same_recordings(before, after)):
        status, answer = "unknown", "Not comparable"
    now, then = figure.shown(b), figure.shown(a)
    return Verdict(
        question="Does it cost less?",
        status=status,
        answer=answer,
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
    return tuple(
        Fact(figure.name, _both(before, after, figure.key, figure.shown))
        for figure in _timed(before, after, group)
    )


def _notices(before: Build, after: Build) -> Iterator[Notice]:
    """Yield what makes the two less comparable."""
    models = {build.text("model.sha256") for build in (before, after)}
    changed = changes(before, after)
    known = "" not in models
    if (known and len(models) > 1) or not agree(before, after, "model.members.", ".weight"):
        yield _MODELS_DIFFER
    if changed and not known:
        yield _MODELS_NOT_KNOWN
    if not same_recordings(before, after):
        both = f"{recordings_words(before)} and {recordings_words(after)}"
        yield Notice(
            "They were checked on different recordings.",
            f"{both}: figures per recording cannot be compared.",
        )
    if not same_profile(before, after):
        yield _PROFILES_DIFFER
    if not same_chip(before, after):
        yield _CHIPS_DIFFER
    parts = contents_changed(changed, "program.")
    if parts:
        yield Notice(
            "The programs differ, but not in their sums and extremes.",
            f"They differ in {', '.join(parts)}.",
        )


def _key_figures(before: Build, after: Build) -> Section:
    table = Table(
        "Before, a full bar, and after, a hatched one",
        ("figure", "", "before", "", "after", "change"),
        tuple(_row(figure, before, after) for figure in _key(before, after)),
    )
    lead = (
        f"Before is {before.name}, after is {after.name}. Costs are modelled means per recording."
    )
    return Section.of("key-figures", "Key figures", lead, table)


def _row(figure: KeyFigure, before: Build, after: Build) -> tuple[Cell, ...]:
    number_before, number_after = before.number(figure.key), after.number(figure.key)
    largest = max(number_before, number_after) or 1.0
    then, now = figure.shown(number_before), figure.shown(number_after)
    change = (
        "no change"
        if number_before == number_after
        else percent(number_before, number_after) or NONE
    )
    return (
        figure.name,
        Bar(number_before / largest, f"before, {then}"),
        then,
        Bar(number_after / largest, f"after, {now}", 1),
        now,
        change,
    )


def _all(changed: Mapping[str, Change]) -> list[Section]:
    """Return a section for every part of the report that changed."""
    by_part: dict[str, list[tuple[str, Change]]] = {}
    for key, change in changed.items():
        part, _, name = key.partition(".")
        by_part.setdefault(part, []).append((name or part, change))
    return [
        _part(f"part-{number}", _short(words(part)), rows)
        for number, (part, rows) in enumerate(by_part.items())
    ]


def _part(key: str, title: str, changed: Sequence[tuple[str, Change]]) -> Section:
    """Return a section on the figures that changed in a part of the report."""
    cut = f", the first {MAX_ROWS}; --json has all" if len(changed) > MAX_ROWS else ""
    table = Table(
        f"{title}: {plural(len(changed), 'figure')} changed{cut}",
        ("figure", "before", "after", "change"),
        tuple(
            (_short(name), _short(any_value(a)), _short(any_value(b)), percent(a, b) or NONE)
            for name, (a, b) in changed[:MAX_ROWS]
        ),
    )
    return Section(key, title.capitalize(), "", (table,))


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
