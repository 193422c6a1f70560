"""Choose a setting by its results on calibration recordings.

A setting is one value for each dial: the strategy (how neurons become compartments of the chip), the
weight bits, and the share of split weights. A budget says what the chip may lose of the float
network: predictions, spikes and class scores. Strategies of *last resort* cost more than any other.

How each dial is varied stands in its row: see :class:`locsnn_compile.settings.Search`. Without a
budget, the first settings (one for each strategy) are compared as they are. With a budget, each is
made finer (more weights are split) until it keeps the budget; if none does, those of last resort
are tried in the same way. Then, if spikes or class scores are bounded, the cheapest setting that
keeps the budget is made coarser (weights of fewer bits).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import hw_model as hw
from hw_model.description.counts import total
from hw_model.targets import target_of
from hw_model.values import Shown
from locsnn_compile.cluster.spread import Spread, here
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import TargetError
from locsnn_compile.network.network import Network
from locsnn_compile.passes.rounding.task import FINE
from locsnn_compile.pipeline import Levels, lower_by
from locsnn_compile.reference.evaluate import Calibration, FloatRuns, calibrate
from locsnn_compile.request.compile_request import SettingRequest
from locsnn_compile.settings import STRATEGIES, Setting, first_settings
from locsnn_compile.verification.error_bounds import (
    ErrorBudget,
    Losses,
    default_budget,
    weighed_best,
)
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed


class Candidate(Losses):
    """A setting that was tried, and what it loses and costs on some recordings (see ``Losses``).

    Registers wrapped or clipped ``overflows`` times in them.
    """

    setting: Setting
    overflows: int = 0

    @property
    def strategy(self) -> str:
        """The strategy of the setting."""
        return self.setting.strategy


class Choice(Shown):
    """What was chosen, and from what.

    - ``taken``: the candidate that was chosen among ``candidates``
    - ``levels_by_setting``: the network at every level of the compiler, by the settings tried
    - ``budget``: the bounds that were to be kept, given or by default
    - ``samples``, ``source``: the number and the source of the calibration recordings
    - ``spike_worth``: the weight of errors against costs; None where a budget says what may be lost
    """

    taken: Candidate
    levels_by_setting: Mapping[Setting, Levels]
    candidates: tuple[Candidate, ...]
    budget: ErrorBudget
    samples: int
    source: str
    spike_worth: float | None = None

    @property
    def levels(self) -> Levels:
        """The network at every level, by the setting taken."""
        return self.levels_by_setting[self.taken.setting]

    @property
    def keeps_budget(self) -> bool:
        """Whether the candidate taken keeps the budget on the calibration recordings."""
        return self.taken.keeps(self.budget)


def choose_strategy(
    network: Network,
    chip: hw.Chip,
    request: SettingRequest,
    recordings: Recordings,
    spread: Spread = here,
) -> Choice | None:
    """Take the cheapest setting tried that keeps the budget or, if none does, the most accurate.

    Without a budget, the cost is weighed against errors: a percent of the spikes is worth
    ``spike_worth`` percent of the least cost.

    The setting of the ``request`` has one strategy or ``auto``, and the most weight bits to try.
    Settings that this chip cannot hold are skipped; if it holds none, the first ``TargetError`` is
    raised. Returns None if there is nothing to choose: no weight is rounded, or no neuron is
    lowered by a strategy and no budget is given.
    """
    budget = request.budget
    if not (network.by_strategy or (budget.given and network.has_float_weights)):
        return None
    trial = Trial(network, chip, recordings, spread)
    firsts = first_settings(network, request.setting)
    usual = [setting for setting in firsts if not setting.is_last_resort]
    if not usual:  # the user asked for a strategy of last resort
        usual = firsts
    for setting in usual:
        trial.measure(setting)
    if not trial.candidates:
        raise trial.errors[0]
    if budget.given:
        _keep_budget(trial, firsts, usual, request)
    candidates = tuple(trial.candidates.values())
    limits = budget if budget.given else default_budget(candidates[0])
    spike_worth = None if budget.given else request.spike_worth
    return Choice(
        taken=_best(candidates, limits, spike_worth),
        levels_by_setting=trial.levels,
        candidates=candidates,
        budget=limits,
        samples=len(recordings),
        source=recordings.source,
        spike_worth=spike_worth,
    )


def _keep_budget(
    trial: "Trial", firsts: Sequence[Setting], usual: Sequence[Setting], request: SettingRequest
) -> None:
    """Try finer settings until some keep the budget, then coarser and cheaper ones that still do.

    ``firsts`` are the settings to begin with, and ``usual`` those of them that are not a last resort.
    """
    budget = request.budget
    for setting in usual:
        _make_finer(trial, setting, budget, request.given)
    if not any(candidate.keeps(budget) for candidate in trial.candidates.values()):
        for setting in firsts:
            if setting not in usual:
                _make_finer(trial, setting, budget, request.given)
    _make_coarser(trial, request.setting, budget)


def _make_finer(
    trial: "Trial", setting: Setting, budget: ErrorBudget, given: Collection[str]
) -> None:
    """Try a setting with finer values, one dial after the other, until it keeps the budget.

    Dials in ``given`` keep their values, because the user chose them. A setting that the chip cannot
    hold ends the search, because finer ones take more room.
    """
    candidate = trial.measure(setting)
    for dial, _ in setting.by_dial:
        if dial.name in given:
            continue
        for value in dial.search.finer:
            if candidate is None or candidate.keeps(budget):
                return
            setting = setting.with_value(dial, value)
            candidate = trial.measure(setting)


def _make_coarser(trial: "Trial", asked: Setting, budget: ErrorBudget) -> None:
    """Try the cheapest setting that keeps the budget with every coarser value of each dial.

    Every value is tried, because losses need not grow with coarseness: a coarser setting may keep
    the budget although a finer one does not.
    """
    # A few recordings say much about spikes and scores but little about predictions. So nothing is
    # made coarser if predictions are all that the budget bounds.
    bounds_only_predictions = budget == ErrorBudget(budget.min_agreement)
    if bounds_only_predictions:
        return
    for dial, _ in asked.by_dial:
        cheapest = _cheapest(tuple(trial.candidates.values()), budget)
        if dial.search.coarser is None or cheapest is None:
            continue
        for value in dial.search.coarser(trial.chip, getattr(cheapest.setting, dial.name)):
            trial.measure(cheapest.setting.with_value(dial, value))


def _best(
    candidates: Sequence[Candidate], limits: ErrorBudget, spike_worth: float | None
) -> Candidate:
    """Return the cheapest candidate within the limits, with errors weighed in if ``spike_worth`` is given.

    If none is within them, return the most accurate.
    """
    within_limits: list[Candidate] = []
    # Limits that bound nothing are default ones, where nothing was compared: then a low cost is no
    # reason to take a candidate.
    if limits.given:
        within_limits = [candidate for candidate in candidates if candidate.keeps(limits)]
    if not within_limits:
        return min(candidates, key=lambda candidate: candidate.losses)
    # A budget says what may be lost, so errors within it weigh nothing.
    error_weight = 0.0 if spike_worth is None else spike_worth
    return weighed_best(within_limits, error_weight) or within_limits[0]


def _cheapest(candidates: Sequence[Candidate], budget: ErrorBudget) -> Candidate | None:
    """Return the cheapest candidate that keeps the budget; None if none does."""
    within_budget = [candidate for candidate in candidates if candidate.keeps(budget)]
    return min(within_budget, key=lambda candidate: candidate.cost, default=None)


@dataclass(eq=False)
class Trial:
    """Compiles and plays settings, each once, and keeps the results.

    The recordings have the network's own steps and channels.
    """

    network: Network
    chip: hw.Chip
    recordings: Recordings
    spread: Spread
    known_calibration: Calibration | None = None
    """What weights are rounded for, if it was computed already; None for the recordings above."""
    candidates: dict[Setting, Candidate] = field(default_factory=dict)
    levels: dict[Setting, Levels] = field(default_factory=dict)
    """The network at every level, by setting; settings that are in it from the start are not lowered again."""
    errors: list[TargetError] = field(default_factory=list)
    """Why the chip cannot hold some of the settings, in the order in which they were tried."""

    @cached_property
    def calibration(self) -> Calibration:
        """What weights are rounded for: the activity of the float network on some recordings."""
        if self.known_calibration is not None:
            return self.known_calibration
        return calibrate(self.network, self.recordings, self.chip.registers)

    @cached_property
    def float_runs(self) -> FloatRuns | None:
        """The runs of the float network, which all candidates are compared with.

        None if other processes or machines do the work: they play the float network themselves.
        """
        if self.spread is not here:
            return None
        return FloatRuns(self.network, self.recordings.spikes, self.chip.registers)

    def measure(self, setting: Setting) -> Candidate | None:
        """Return what a setting loses and costs; None if the chip cannot hold it."""
        if setting in self.candidates:
            return self.candidates[setting]
        if setting not in self.levels:
            try:
                self.levels[setting] = lower_as(self.network, self.chip, setting, self.calibration)
            except TargetError as error:
                self.errors.append(error)
                return None
        candidate = self._play(setting, self.levels[setting])
        self.candidates[setting] = candidate
        return candidate

    def _play(self, setting: Setting, levels: Levels) -> Candidate:
        """Play the recordings to the program of a setting and to the float network, and compare them."""
        observed = Observed(levels, self.recordings.spikes, source=self.recordings.source)
        match = compare(observed, spread=self.spread, explain=False, float_runs=self.float_runs)
        chip = levels.program.chip
        counts = total(match.counts)
        total_pj = math.fsum(hw.energy_pj(counts, chip.costs).values())
        return Candidate(
            prediction_agreement=match.prediction_agreement,
            spike_agreement=match.spikes.agreement,
            score_error=match.scores.relative_error,
            energy_pj=total_pj / match.samples if chip.profiles else None,
            chip_time_ns=match.mean_ns,
            setting=setting,
            overflows=counts.wraps + counts.clips,
        )


def lower_as(
    network: Network, chip: hw.Chip, setting: Setting, calibration: Calibration | None
) -> Levels:
    """Lower a network by a setting, with every step of rounding and its share of split weights."""
    rounding = replace(FINE, split=setting.split_weights)
    return lower_by(network, chip, setting, rounding, calibration)


def lower_or_advise(
    network: Network, chip: hw.Chip, setting: Setting, calibration: Calibration | None
) -> Levels:
    """Lower a network by a setting; if it does not fit, the error advises the first strategy that does.

    Only targets with ``advises_strategies``, the open core, give this advice.
    """
    try:
        return lower_as(network, chip, setting, calibration)
    except TargetError as error:
        if not target_of(chip).advises_strategies:
            raise
        error_parts = vars(error)
        for name in STRATEGIES:
            with suppress(TargetError):
                lower_as(network, chip, replace(setting, strategy=name), calibration)
                error_parts = error_parts | {"fix": f"Use strategy {name}."}
                break
        raise TargetError(**error_parts) from None
