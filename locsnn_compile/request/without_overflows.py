"""Look for settings with which no register overflows, and what they cost.

A charge or current that leaves its register *wraps* to the other end, and a voltage is *clipped* to
the end: the chip then computes something else than the float network. If that happened in the check,
the report names settings (strategy, weight bits) that avoid it. They are tried on recordings in which
registers overflowed.

Registers of a chip have fixed widths. Another strategy can still avoid overflows, because it divides a
neuron into other compartments, and so can narrower weights, because they allow a smaller scale.
"""

import math
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
"""Of the recordings with overflows, settings are compared on at most so many: chosen by hand, for speed."""


class OverflowSearch(Frozen):
    """Settings that were tried on ``recordings`` recordings in which registers wrapped or clipped.

    ``taken`` is the setting of the program, measured on these recordings, and ``others`` are the
    settings that were tried, in this order.
    """

    recordings: int
    taken: Candidate
    others: tuple[Candidate, ...]

    @property
    def without_overflows(self) -> tuple[Candidate, ...]:
        """The settings with which nothing wrapped or clipped, the one that loses least first.

        There is at most one for each strategy, with the widest weights: narrower ones only lose more.
        """
        clean = [candidate for candidate in self.others if not candidate.overflows]
        clean.sort(key=lambda candidate: candidate.setting.weight_bits, reverse=True)
        widest: dict[str, Candidate] = {}
        for candidate in clean:
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
    """Try other strategies and narrower weights on the ``overflowing`` recordings.

    ``taken`` is the setting of the program, and ``lowered`` has the settings that were lowered
    already, rounded for the same ``calibration``: they are not lowered again. Returns None if there
    is nothing to try.
    """
    narrower = _narrower(network, chip, taken)
    other_strategies = _other_strategies(network, taken)
    if not narrower and not other_strategies:
        return None
    trial = Trial(
        network=network,
        chip=chip,
        recordings=overflowing,
        # In this process: there are at most MOST_RECORDINGS recordings.
        spread=here,
        known_calibration=calibrate(network, calibration, chip.registers),
        # A copy, because the trial adds what it lowers.
        levels=dict(lowered),
    )
    taken_candidate = trial.measure(taken)
    # None: the chip cannot hold the setting. That of the program fits, unless a caller passes another one.
    if taken_candidate is None:
        return None
    # Strategies first, each with the weights of the program: they are listed first in `others`, too.
    for setting in other_strategies:
        trial.measure(setting)
    try_widths(trial, narrower)
    others = [candidate for candidate in trial.candidates.values() if candidate.setting != taken]
    return OverflowSearch(len(overflowing), taken_candidate, tuple(others))


def try_widths(trial: Trial, narrower: list[Setting]) -> None:
    """Bisect for the widest weights without overflows; ``narrower`` begins with the widest.

    Narrower weights let the compiler choose a smaller scale, which leaves more room in registers. So if
    even the narrowest weights that the chip can hold have overflows, no others are tried. The results are
    in ``trial.candidates``.
    """
    settings = list(narrower)
    # measure returns None for a setting that the chip cannot hold: drop the narrowest weights for as long as it does.
    while settings and trial.measure(settings[-1]) is None:
        settings.pop()
    if not settings:
        return

    def is_clean(index: int) -> bool:
        candidate = trial.measure(settings[index])
        return candidate is not None and not candidate.overflows

    # Indices into settings: smaller is wider. Those from widest_clean on are taken to be without overflows, and those
    # before first_unknown to have some.
    widest_clean = len(settings) - 1
    if not is_clean(widest_clean):
        return
    first_unknown = 0
    while first_unknown < widest_clean:
        middle = (first_unknown + widest_clean) // 2
        if is_clean(middle):
            widest_clean = middle
        else:
            first_unknown = middle + 1


def evenly_chosen(recordings: Recordings, numbers: IntArray) -> Recordings:
    """Return at most :data:`MOST_RECORDINGS` of the recordings with these numbers: every n-th of them."""
    stride = max(1, math.ceil(len(numbers) / MOST_RECORDINGS))
    return recordings.subset(numbers[::stride])


def _narrower(network: Network, chip: hw.Chip, taken: Setting) -> list[Setting]:
    """Return the setting with all narrower weights of the chip, the widest first."""
    if not network.has_float_weights:  # its weights are integers of the chip already
        return []
    widths = [bits for bits in reversed(chip.registers.weight_bits) if bits < taken.weight_bits]
    return [replace(taken, weight_bits=bits) for bits in widths]


def _other_strategies(network: Network, taken: Setting) -> list[Setting]:
    """Return the setting with each other usual strategy; none if its neurons need no strategy.

    ``USUAL`` has all strategies except ``paired-dendrite``, the last resort, which costs more than any other.
    """
    if not network.by_strategy or taken.strategy not in STRATEGIES:
        return []
    return [replace(taken, strategy=name) for name in USUAL if name != taken.strategy]
