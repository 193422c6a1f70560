"""Say whether wraps and clips matter, in a verdict at the top of the report and in a section of its own.

A charge or current that leaves its register wraps to the other end, and a voltage clips at the end. The check
replays the affected recordings with registers too wide for that, and tries other settings of the compiler.
"""

from collections.abc import Mapping

from locsnn_compile.report.content import Facts, Section, Status, Table, Verdict
from locsnn_compile.report.figures.document import SharedFigures
from locsnn_compile.report.figures.match import MatchFigures
from locsnn_compile.report.figures.registers import (
    Matters,
    OverflowFigures,
    SearchFigures,
    SettingFigures,
    WideFigures,
)
from locsnn_compile.report.figures.resources import ProvenRange
from locsnn_compile.report.format import count, known, plural, ratio, share
from locsnn_compile.report.words import listed
from locsnn_compile.settings import Setting

_ANSWERS: dict[Matters, tuple[Status, str]] = {
    "nothing overflows": ("yes", "Yes"),
    "no": ("yes", "Yes, clips change nothing"),
    "as in the network": ("yes", "Yes, as in the network"),
    "spikes or scores": ("nearly", "Nearly, no prediction changes"),
    "predictions": ("no", "No"),
    "not known": ("unknown", "Not known"),
}
"""Status and answer of the verdict, by what wraps and clips change."""
_OTHER_ARITHMETIC = "this arithmetic is not played with wider registers"
_TIES = "all tie"
_SILENT = "silent"
_LEAD = (
    "Recordings in which a register wrapped or was clipped are played again with registers that are "
    "wide enough. If that changes anything, other settings are tried on some of these recordings: "
    "narrower weights, which leave more room in registers, and other strategies."
)


def registers(
    report: SharedFigures,
    overflows: OverflowFigures | None = None,
    proven: Mapping[str, ProvenRange] | None = None,
) -> Verdict:
    """Are registers wide enough for these recordings?

    ``overflows`` says what wide registers change, and ``proven`` what is proven for any input, by group of
    compartments. Chips with an arithmetic of their own have neither.
    """
    match = report.match
    events = _events(match)
    status, answer = _ANSWERS[_matters(match, overflows)]
    return Verdict(
        question="Are registers wide enough?",
        status=status,
        answer=answer,
        figure=events,
        figure_label=f"in {plural(match.samples, 'recording')}{_share_of_updates(report)}",
        sentence=f"{_sentence(match, overflows)}.",
        facts=_facts(match, overflows, proven).facts,
    )


def overflows(figures: OverflowFigures | None) -> Section | None:
    """Return the section on settings without wraps and clips; None where wraps and clips change too little to look."""
    if figures is None or figures.settings is None:
        return None
    search = figures.settings
    rows = [_row("this program", search.taken)]
    for setting in search.without:
        rows.append(_row(_options(setting.setting, search.taken.setting), setting))
    table = Table(
        f"Settings without wraps and clips, of {plural(search.tried, 'other setting')} tried on "
        f"{plural(search.recordings, 'recording')} that have some",
        (
            "setting",
            "wraps and clips",
            "same prediction",
            "spikes equal",
            "error of class scores",
            "times the energy",
            "times the time",
        ),
        tuple(rows),
    )
    return Section.of("overflows", "Wraps and clips", _LEAD, table)


def _row(name: str, setting: SettingFigures) -> tuple[str, ...]:
    return (
        name,
        count(setting.wraps_and_clips),
        known(setting.prediction_agreement, share, _TIES),
        known(setting.spike_agreement, share, _SILENT),
        known(setting.score_error, share, _TIES),
        known(setting.energy_ratio, ratio),
        known(setting.time_ratio, ratio),
    )


def _matters(match: MatchFigures, overflows: OverflowFigures | None) -> Matters:
    if overflows is not None:
        return overflows.matters
    return "not known" if match.wraps or match.clips else "nothing overflows"


def _events(match: MatchFigures) -> str:
    """Return how many wraps and clips there were, as in ``3 wraps and 1 clip``; a count of 0 is left out."""
    kinds = []
    if match.wraps:
        kinds.append(plural(match.wraps, "wrap"))
    if match.clips:
        kinds.append(plural(match.clips, "clip"))
    return listed(kinds) if kinds else "no wraps, no clips"


def _share_of_updates(report: SharedFigures) -> str:
    """Return which share of the neuron updates clipped; nothing without clips."""
    match = report.match
    # Operations are means per recording, and clips a sum over all recordings.
    updates = report.operations.per_sample.neuron_updates * match.samples
    if not (match.clips and updates):
        return ""
    return f"; clips are {share(match.clips / updates)} of updates"


def _sentence(match: MatchFigures, overflows: OverflowFigures | None) -> str:
    """Say whether wraps and clips matter, without the full stop."""
    matters = _matters(match, overflows)
    if matters == "nothing overflows":
        return "No register wrapped or was clipped"
    events = _events(match)
    if overflows is None or overflows.wide_registers is None:
        reason = _OTHER_ARITHMETIC
        if overflows is not None and overflows.not_known is not None:
            reason = overflows.not_known
        return f"Whether {events} change anything is not known: {reason}"
    where = f"{events} in {count(overflows.recordings)} of {plural(match.samples, 'recording')}"
    changed = _changed(overflows.wide_registers)
    if matters == "no":
        return f"{where} change no spike and no class score: wide registers give the same"
    if matters == "as in the network":
        return (
            f"{where} are those of the network's own integers, which have the same registers; wide "
            f"ones would change {changed}"
        )
    return f"{where} change {changed}"


def _changed(wide: WideFigures) -> str:
    """Return what wide registers change; where no spike changes, class scores do."""
    spikes = plural(wide.spikes_changed, "spike")
    predictions = plural(wide.predictions_changed, "prediction")
    if not wide.spikes_changed:
        spikes = "class scores"
    if not wide.predictions_changed:
        predictions = "no prediction"
    return f"{spikes} and {predictions}"


def _facts(
    match: MatchFigures,
    overflows: OverflowFigures | None,
    proven: Mapping[str, ProvenRange] | None,
) -> Facts:
    """Return what would change without overflows, what removes them, and whether any are possible."""
    facts: dict[str, str] = {}
    if overflows is not None and overflows.matters in ("spikes or scores", "predictions"):
        # What changes is known only because the recordings were played with wide registers.
        assert overflows.wide_registers is not None
        facts["without them"] = _without(match, overflows.wide_registers)
        facts["removed by"] = _removed_by(overflows.settings)
    if proven is not None:
        facts["any recording"] = _proof(proven)
    return Facts.of(facts)


def _without(match: MatchFigures, wide: WideFigures) -> str:
    """Return the agreement with the network with wide registers, and with those of the chip."""
    parts = []
    if wide.prediction_agreement is not None and match.prediction_agreement is not None:
        predictions = share(wide.prediction_agreement)
        parts.append(
            f"{predictions} of the predictions equal instead of {share(match.prediction_agreement)}"
        )
    spikes_on_chip = match.spikes.spike_agreement
    if wide.spike_agreement is not None and spikes_on_chip is not None:
        spikes = share(wide.spike_agreement)
        parts.append(f"{spikes} of the spikes equal instead of {share(spikes_on_chip)}")
    if match.readout.reads_potentials and wide.score_error is not None:
        error_on_chip = known(match.score_error, share)
        parts.append(f"class scores off by {share(wide.score_error)} instead of {error_on_chip}")
    return ", ".join(parts) or "nothing to compare"


def _removed_by(search: SearchFigures | None) -> str:
    """Return the setting without wraps and clips that loses least, and its price."""
    if search is None:
        return "not looked for"
    if not search.without:
        return f"none of {plural(search.tried, 'other setting')}"
    # The settings are sorted: the first loses least.
    best = search.without[0]
    taken = search.taken
    price = []
    if best.prediction_agreement is not None and taken.prediction_agreement is not None:
        price.append(
            f"{share(best.prediction_agreement)} of the predictions equal instead of "
            f"{share(taken.prediction_agreement)}"
        )
    if best.spike_agreement is not None and taken.spike_agreement is not None:
        price.append(
            f"{share(best.spike_agreement)} of the spikes equal instead of "
            f"{share(taken.spike_agreement)}"
        )
    if best.energy_ratio is not None:
        price.append(f"{ratio(best.energy_ratio)} times the energy")
    if best.time_ratio is not None:
        price.append(f"{ratio(best.time_ratio)} times the time")
    options = _options(best.setting, taken.setting)
    tried_on = f"on {plural(search.recordings, 'recording')} that have some"
    return f"{options} ({tried_on}: {', '.join(price)})"


def _options(setting: Setting, taken: Setting) -> str:
    """Return the command-line options that select ``setting``, as far as it differs from the setting ``taken``."""
    options = []
    for (dial, value), taken_value in zip(setting.by_dial, taken.values, strict=True):
        if value != taken_value:
            options.append(f"{dial.option} {value}")
    return " ".join(options)


def _proof(proven: Mapping[str, ProvenRange]) -> str:
    """Say what is proven for any input."""
    periods = [group.safe_period_steps for group in proven.values()]
    unproven = sum(period is None for period in periods)
    if unproven:
        groups = plural(len(periods), "group")
        return f"no rate of input is proven safe for {count(unproven)} of {groups} of compartments"
    longest = max((period for period in periods if period is not None), default=1)
    if longest == 1:
        return "proven: no input can wrap or clip anything"
    return f"proven safe while no source spikes twice within {count(longest)} steps"
