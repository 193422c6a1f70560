"""Look for settings with which nothing wraps or clips, and what they cost."""

from collections.abc import Mapping
from dataclasses import replace

import hw_model as hw
from hw_model.values import Frozen, IntArray
from locsnn_compile.cluster.spread import here
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import calibrate
from locsnn_compile.request.choose_strategy import Candidate, Trial
from locsnn_compile.settings import STRATEGIES, USUAL, Setting

MOST_RECORDINGS = 16
"""Recordings that settings are compared on, of those in which something wrapped or clipped."""


class OverflowSearch(Frozen):
    """Settings that were tried on ``recordings`` recordings in which registers wrapped or clipped.

    ``taken`` is the setting of the program on these, and ``others`` are those that were tried, in
    order.
    """

    recordings: int
    taken: Candidate
    others: tuple[Candidate, ...]

    @property
    def without_overflows(self) -> tuple[Candidate, ...]:
        """The settings with which nothing wrapped or clipped, the one that loses least first.

        Of a strategy, it is the one with the widest weights: narrower ones only lose more.
        """
        clean = [candidate for candidate in self.others if not candidate.overflows]
        widest: dict[str, Candidate] = {}
        for candidate in sorted(clean, key=lambda each: -each.setting.weight_bits):
            widest.setdefault(candidate.strategy, candidate)
        return tuple(sorted(widest.values(), key=lambda candidate: candidate.losses))


def search_without_overflows(
    network: Network,
    chip: hw.Chip,
    taken: Setting,
    calibration: Recordings,
    overflowing: Recordings,
    lowered: Mapping[Setting, Levels],
) -> OverflowSearch | None:
    """Try other strategies and narrower weights; None where there is nothing to try.

    ``lowered`` is what is known already: the network at every level, by settings that were rounded
    for the same calibration.
    """
    narrower = _narrower(network, chip, taken)
    strategies = _strategies(network, taken)
    if not narrower and not strategies:
        return None
    known_calibration = calibrate(network, calibration, chip.registers)
    trial = Trial(network, chip, overflowing, here, known_calibration, levels=dict(lowered))
    candidate = trial.measure(taken)
    if candidate is None:
        return None
    for setting in strategies:
        trial.measure(setting)
    try_widths(trial, narrower)
    others = [tried for tried in trial.candidates.values() if tried.setting != taken]
    return OverflowSearch(len(overflowing), candidate, tuple(others))


def try_widths(trial: Trial, narrower: list[Setting]) -> None:
    """Bisect for the widest weights without overflows; ``narrower`` begins with the widest.

    Narrower weights let the compiler choose a smaller scale, which leaves more room in registers.
    So where the narrowest that the chip can hold have overflows, those between are not tried.
    """
    settings = list(narrower)
    while settings and trial.measure(settings[-1]) is None:
        settings.pop()

    def is_clean(index: int) -> bool:
        tried = trial.measure(settings[index])
        return tried is not None and not tried.overflows

    widest_clean = len(settings) - 1
    if not settings or not is_clean(widest_clean):
        return
    first_unknown = 0
    while first_unknown < widest_clean:
        middle = (first_unknown + widest_clean) // 2
        if is_clean(middle):
            widest_clean = middle
        else:
            first_unknown = middle + 1


def spread_of(recordings: Recordings, numbers: IntArray) -> Recordings:
    """Return at most :data:`MOST_RECORDINGS` of the recordings with these numbers, evenly spread."""
    every = max(1, -(-len(numbers) // MOST_RECORDINGS))
    return recordings.subset(numbers[::every])


def _narrower(network: Network, chip: hw.Chip, taken: Setting) -> list[Setting]:
    if not network.has_float_weights:
        return []
    widths = [bits for bits in reversed(chip.registers.weight_bits) if bits < taken.weight_bits]
    return [replace(taken, weight_bits=bits) for bits in widths]


def _strategies(network: Network, taken: Setting) -> list[Setting]:
    if not network.by_strategy or taken.strategy not in STRATEGIES:
        return []
    return [replace(taken, strategy=name) for name in USUAL if name != taken.strategy]
