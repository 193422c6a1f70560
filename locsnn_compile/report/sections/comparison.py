"""Compare two builds for ``locsnn diff``: three questions, key figures, and every figure that changed.

The result is a :class:`Report` without form, like the report of a single build. Numbers are written "now; then
before": the second build is now, and the first before.
"""

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
"""Most changed figures in a section of the page, chosen by hand; --json has all."""
_LONGEST = 120
"""Most characters of a name or text on the page, chosen by hand; --json has it in full."""

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
    """A figure that every report has: its name, its dotted key, and the function that writes its value."""

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
_SIZES = (
    _COMPARTMENTS,
    _SYNAPSES,
    KeyFigure("synapse bits", "resources.synapse_bits", count),
)
_BeforeAndAfter = tuple[float | None, float | None]
"""A figure before and after; None if nothing was compared."""


def comparison(before: Build, after: Build, played: ProgramsCompared | None = None) -> Report:
    """Return the comparison of two builds.

    ``played`` compares both programs on the same recordings, if the user gave any. Without it, the
    comparison uses only what the two reports say.
    """
    changed = changes(before, after)
    sections = [_key_figures(before, after), *_sections_of_changes(changed)]
    if played is not None:
        sections.insert(0, _spikes_of_both(played))
    build_before = f"{before.text('model.name')} on {before.text('target')}"
    build_after = f"{after.text('model.name')} on {after.text('target')}"
    return Report(
        kind="locsnn diff",
        title=f"{_short(before.name)} → {_short(after.name)}",
        subtitle=f"{build_before}, then {build_after}: {plural(len(changed), 'figure')} changed",
        verdicts=(_matches(before, after, played), _costs(before, after), _fits(before, after)),
        notices=tuple(_notices(before, after)),
        sections=tuple(sections),
        footer="Figures that are equal are left out.",
    )


def _facts_of_both(played: ProgramsCompared) -> dict[str, str]:
    """Return how many classes and spikes of both programs are equal on the same recordings."""
    recordings = plural(played.recordings, "recording")
    facts = {"class of both programs": f"the same in {count(played.same_classes)} of {recordings}"}
    for name, match in played.by_population.items():
        if match.agreement is not None:
            facts[f"both, {name}"] = f"{share(match.agreement)} of spikes equal"
    return facts


def _spikes_of_both(played: ProgramsCompared) -> Section:
    """Return the section on the spikes of both programs that are at the same neuron and step, by population."""
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
    """Does the program match the network as well as before?"""
    predictions = _shares(before, after, "prediction_agreement")
    spikes = _shares(before, after, "spike_agreement")
    scores = before.score_error, after.score_error
    status, answer = _change_of_match(predictions, spikes, scores)
    facts = {
        "accuracy on the chip": _accuracy(before, after),
        "equal spikes": _now(*map(agreed, spikes)),
        "spikes on one side only": _both(before, after, "match.spike_mismatches", count),
        "class scores": _now(*map(_score_words, scores)),
        "wraps and clips": _both(before, after, "match.wraps", count, "match.clips"),
    }
    if played is not None:
        facts |= _facts_of_both(played)
    same_before = agreed(predictions[0], "an unknown share")
    same = agreed(predictions[1], "an unknown share")
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


def _score_words(error: float | None) -> str:
    return "not compared" if error is None else f"{share(error)} of their spread off"


def _shares(before: Build, after: Build, key: str) -> _BeforeAndAfter:
    return before.share(f"match.{key}"), after.share(f"match.{key}")


def _change_of_match(
    predictions: _BeforeAndAfter, spikes: _BeforeAndAfter, scores: _BeforeAndAfter
) -> tuple[Status, str]:
    """Answer whether the match is as good as before, by both agreements and the error of class scores.

    Predictions decide; if they did not get worse, the answer adds what did. It is unknown if one build
    compared predictions or spikes and the other did not.
    """
    agreement_before, agreement_after = predictions
    spikes_before, spikes_after = spikes
    spikes_compared_once = (spikes_before is None) != (spikes_after is None)
    if agreement_before is None or agreement_after is None or spikes_compared_once:
        return "unknown", "Not known"
    if agreement_after < agreement_before:
        return "no", "Worse"
    answer = "As before" if agreement_after == agreement_before else "Better"
    losses = []
    if _is_larger(spikes_before, spikes_after):
        losses.append("fewer spikes are equal")
    error_before, error_after = scores
    if _is_larger(error_after, error_before):
        losses.append("class scores differ more")
    if losses:
        return "nearly", f"{answer}, but {listed(losses)}"
    return "yes", answer


def _is_larger(value: float | None, limit: float | None) -> bool:
    """Whether both values are known and the first is larger."""
    return value is not None and limit is not None and value > limit


def _figures_to_compare(before: Build, after: Build) -> tuple[KeyFigure, ...]:
    """Return the key figures that both builds have, the cost first: energy or, if not both have it, time."""
    figures = _known_of_both(before, after, _KEY_FIGURES)
    have_energy = NONE not in (before.text("energy.profile"), after.text("energy.profile"))
    return (_ENERGY, *figures) if have_energy else figures


def _known_of_both(
    before: Build, after: Build, figures: Sequence[KeyFigure]
) -> tuple[KeyFigure, ...]:
    """Return the figures, without the time of a recording unless both builds know it."""
    have_times = before.timed and after.timed
    return tuple(figure for figure in figures if have_times or figure.key != _LATENCY)


def _costs(before: Build, after: Build) -> Verdict:
    """Does the program cost less than before?"""
    figure = _figures_to_compare(before, after)[0]
    noun = "time"
    profile = ""
    if figure is _ENERGY:
        noun = "dynamic energy"
        profile = f", profile {after.text('energy.profile')}"
    cost_before = before.number(figure.key)
    cost_after = after.number(figure.key)
    difference = percent(cost_before, cost_after).lstrip("+-")
    status, answer = _answer(cost_before, cost_after, f"{difference} less", f"{difference} more")
    if not (same_profile(before, after) and same_recordings(before, after)):
        status, answer = "unknown", "Not comparable"
    now = figure.shown(cost_after)
    then = figure.shown(cost_before)
    return Verdict(
        question="Does it cost less?",
        status=status,
        answer=answer,
        figure=now,
        figure_label=f"{noun} per recording{profile}; {then} before",
        sentence=f"In the model, a recording takes {now} of {noun}, {then} before.",
        facts=_facts_of(before, after, _COSTS),
    )


def _fits(before: Build, after: Build) -> Verdict:
    """Does the program take fewer cores than before?"""
    cores_before = before.number("resources.cores")
    cores_after = after.number("resources.cores")
    status, answer = _answer(cores_before, cores_after, "fewer cores", "more cores")
    now = plural(cores_after, "core")
    then = count(cores_before)
    return Verdict(
        question="Does it use fewer resources?",
        status=status,
        answer=answer,
        figure=now,
        figure_label=f"{then} before",
        sentence=f"The program takes {now}, {then} before.",
        facts=_facts_of(before, after, _SIZES),
    )


def _answer(before: float, after: float, less: str, more: str) -> tuple[Status, str]:
    """Answer whether a number is less than before, with ``less`` or ``more`` as the words for the difference."""
    if before == after:
        return "yes", "The same"
    # Without a percentage, where the number was 0, the words begin with a space.
    if after < before:
        return "yes", f"Yes, {less.strip()}"
    return "no", f"No, {more.strip()}"


def _facts_of(before: Build, after: Build, figures: Sequence[KeyFigure]) -> tuple[Fact, ...]:
    return tuple(
        Fact(figure.name, _both(before, after, figure.key, figure.shown))
        for figure in _known_of_both(before, after, figures)
    )


def _notices(before: Build, after: Build) -> Iterator[Notice]:
    """Yield what makes the two builds less comparable."""
    checksums = {build.text("model.sha256") for build in (before, after)}
    changed = changes(before, after)
    # A network that was made in Python has no file and an empty checksum.
    are_known = "" not in checksums
    if (are_known and len(checksums) > 1) or not agree(before, after, "model.members.", ".weight"):
        yield _MODELS_DIFFER
    if changed and not are_known:
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
    """Return the section that shows the figures that matter most next to each other, with bars."""
    table = Table(
        "Before, a full bar, and after, a hatched one",
        ("figure", "", "before", "", "after", "change"),
        tuple(_row(figure, before, after) for figure in _figures_to_compare(before, after)),
    )
    lead = (
        f"Before is {before.name}, after is {after.name}. Costs are modelled means per recording."
    )
    return Section.of("key-figures", "Key figures", lead, table)


def _row(figure: KeyFigure, before: Build, after: Build) -> tuple[Cell, ...]:
    """Return the row of a key figure: a bar and a number for each build, and the change in percent."""
    number_before = before.number(figure.key)
    number_after = after.number(figure.key)
    largest = max(number_before, number_after) or 1.0
    then = figure.shown(number_before)
    now = figure.shown(number_after)
    change = "no change"
    if number_before != number_after:
        change = percent(number_before, number_after) or NONE
    return (
        figure.name,
        Bar(number_before / largest, f"before, {then}"),
        then,
        Bar(number_after / largest, f"after, {now}", pattern=1),
        now,
        change,
    )


def _sections_of_changes(changed: Mapping[str, Change]) -> list[Section]:
    """Return a section for every entry at the top of report.json in which a figure changed."""
    changes_by_entry: dict[str, list[tuple[str, Change]]] = {}
    for key, change in changed.items():
        entry, _, name = key.partition(".")
        # An entry such as ``target`` is itself a figure, without a name below it.
        changes_by_entry.setdefault(entry, []).append((name or entry, change))
    return [
        # Numbered, because an entry of a foreign file may have any name, which an anchor may not.
        _section_of_changes(f"part-{number}", _short(words(entry)), entry_changes)
        for number, (entry, entry_changes) in enumerate(changes_by_entry.items())
    ]


def _section_of_changes(key: str, title: str, changed: Sequence[tuple[str, Change]]) -> Section:
    """Return a section on the figures that changed in an entry of report.json."""
    cut = f", the first {MAX_ROWS}; --json has all" if len(changed) > MAX_ROWS else ""
    rows = []
    for name, (value_before, value_after) in changed[:MAX_ROWS]:
        rows.append(
            (
                _short(name),
                _short(any_value(value_before)),
                _short(any_value(value_after)),
                percent(value_before, value_after) or NONE,
            )
        )
    table = Table(
        f"{title}: {plural(len(changed), 'figure')} changed{cut}",
        ("figure", "before", "after", "change"),
        tuple(rows),
    )
    return Section(key, title.capitalize(), "", (table,))


def _both(
    before: Build, after: Build, key: str, shown: Callable[[float], str], also: str | None = None
) -> str:
    """Return a figure as it is now and as it was before; with ``also``, the sum of the figures of two keys."""
    keys = [key] if also is None else [key, also]
    sum_before = sum(before.number(summand) for summand in keys)
    sum_after = sum(after.number(summand) for summand in keys)
    return _now(shown(sum_before), shown(sum_after))


def _now(before: str, after: str) -> str:
    return after if before == after else f"{after}; {before} before"


def _accuracy(before: Build, after: Build) -> str:
    if not all(isinstance(build.report.get("accuracy"), dict) for build in (before, after)):
        return "not known"
    accuracy_before = before.number("accuracy.chip")
    accuracy_after = after.number("accuracy.chip")
    difference = points(accuracy_after - accuracy_before)
    return f"{share(accuracy_after)}; {share(accuracy_before)} before ({difference})"


def _short(text: str) -> str:
    return shortened(text, _LONGEST)
