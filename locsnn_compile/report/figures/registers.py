"""The entry ``overflows`` of report.json, wraps and clips: whether they matter, and which settings have none.

A charge or current that leaves its register wraps to the other end, and a voltage clips at the end. The
check replays the affected recordings with registers too wide for either, and compares.
"""

from typing import Annotated, Literal

from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import INLINED, Entry
from locsnn_compile.request.choose_strategy import Candidate
from locsnn_compile.request.without_overflows import OverflowSearch
from locsnn_compile.settings import Setting
from locsnn_compile.verification.matching import Match
from locsnn_compile.verification.wide_registers import WideComparison, matters

Matters = Literal[
    "nothing overflows",
    "no",
    "as in the network",
    "spikes or scores",
    "predictions",
    "not known",
]
"""What wraps and clips change in the result.

``as in the network``: the network was trained in integers with the same registers, so it wraps and clips as well.
"""


class WideFigures(Entry):
    """What changes with registers that are wide enough.

    The two counts are over the recordings that overflow. Agreements and the score error compare the
    program with wide registers to the network, over all recordings of the check.
    """

    spikes_changed: int
    predictions_changed: int
    prediction_agreement: float | None
    spike_agreement: float | None
    score_error: float | None


class SettingFigures(Entry):
    """What a setting of the compiler loses and costs.

    A ratio is to the energy or time of the program's own setting, None where that is 0 or unknown.
    """

    setting: Annotated[Setting, INLINED]
    wraps_and_clips: int
    prediction_agreement: float | None
    spike_agreement: float | None
    score_error: float | None
    energy_ratio: float | None
    time_ratio: float | None


class SearchFigures(Entry):
    """Other settings that were tried because something overflows.

    - ``recordings``: how many of the overflowing recordings they were tried on
    - ``taken``: the setting of the program
    - ``tried``: the number of other settings
    - ``without``: the settings among them with which nothing wraps or clips
    """

    recordings: int
    taken: SettingFigures
    tried: int
    without: tuple[SettingFigures, ...]


class OverflowFigures(Entry):
    """``overflows``: whether it matters that registers wrapped or clipped in ``recordings`` recordings.

    ``not_known`` is the reason if that is unknown.
    """

    matters: Matters
    recordings: int
    not_known: str | None
    wide_registers: WideFigures | None
    settings: SearchFigures | None


def overflow_figures(
    network: Network,
    match: Match,
    wide: WideComparison | str | None,
    search: OverflowSearch | None,
) -> OverflowFigures | None:
    """Return ``overflows``; None if the check with wide registers was not made.

    ``wide`` is its result, or the reason why it has none.
    """
    if wide is None:
        return None
    recordings = sum(counts.wraps + counts.clips > 0 for counts in match.counts)
    if isinstance(wide, str):
        return OverflowFigures(
            matters="not known",
            recordings=recordings,
            not_known=wide,
            wide_registers=None,
            settings=None,
        )
    return OverflowFigures(
        matters=_matters(network, wide),
        recordings=recordings,
        not_known=None,
        wide_registers=_wide(wide) if recordings else None,
        settings=None if search is None else _search(search),
    )


def _matters(network: Network, wide: WideComparison) -> Matters:
    """Return whether overflows change a spike, a class score or a prediction."""
    if not wide.recordings:
        return "nothing overflows"
    if not matters(wide):
        return "no"
    # A network of integers was trained with these wraps and clips, so they are not an error.
    if not network.has_float_weights:
        return "as in the network"
    return "predictions" if wide.predictions_changed else "spikes or scores"


def _wide(wide: WideComparison) -> WideFigures:
    """Return what changes where the registers are so wide that nothing overflows."""
    return WideFigures(
        spikes_changed=wide.spikes_changed,
        predictions_changed=wide.predictions_changed,
        prediction_agreement=wide.match.prediction_agreement,
        spike_agreement=wide.match.spikes.agreement,
        score_error=wide.match.scores.relative_error,
    )


def _search(search: OverflowSearch) -> SearchFigures:
    return SearchFigures(
        recordings=search.recordings,
        taken=_setting(search.taken, search.taken),
        tried=len(search.others),
        without=tuple(_setting(candidate, search.taken) for candidate in search.without_overflows),
    )


def _setting(candidate: Candidate, taken: Candidate) -> SettingFigures:
    """Return what one setting does, with its costs divided by those of the setting taken."""
    energy_ratio = None
    if candidate.energy_pj is not None and taken.energy_pj:
        energy_ratio = candidate.energy_pj / taken.energy_pj
    time_ratio = None
    if taken.chip_time_ns:
        time_ratio = candidate.chip_time_ns / taken.chip_time_ns
    return SettingFigures(
        setting=candidate.setting,
        wraps_and_clips=candidate.overflows,
        prediction_agreement=candidate.prediction_agreement,
        spike_agreement=candidate.spike_agreement,
        score_error=candidate.score_error,
        energy_ratio=energy_ratio,
        time_ratio=time_ratio,
    )
