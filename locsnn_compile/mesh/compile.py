"""Compile a network for a mesh of cores or the open core, and check it against the float reference.

The steps: read the recordings, choose a setting and lower the network by it (``pipeline.py``), play the
recordings to the program and to the float network, and make the figures of the report. A setting is one
value for each dial of the compiler: strategy, weight bits and split weights (``settings.py``).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import hw_model as hw
from hw_model.simulation import start_compiling
from hw_model.targets import target_of
from locsnn_compile.cluster.spread import Spread, spread_over
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.mesh.ahead import compile_loops_ahead
from locsnn_compile.mesh.compiled import CompiledModel
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import calibrate
from locsnn_compile.report.figures.document import Findings, report_figures
from locsnn_compile.report.grounds import grounds_of
from locsnn_compile.request.choose_strategy import Choice, choose_strategy, lower_or_advise
from locsnn_compile.request.compile_request import CheckRequest, CompileRequest, SettingRequest
from locsnn_compile.request.recordings import calibration_for, recordings_for, with_psi
from locsnn_compile.request.without_overflows import evenly_chosen, search_without_overflows
from locsnn_compile.settings import AUTO, NATIVE, STRATEGIES, Setting
from locsnn_compile.verification.diagnosis import diagnose as find_diagnosis
from locsnn_compile.verification.event_peaks import event_peaks
from locsnn_compile.verification.excerpt import take_excerpt
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from locsnn_compile.verification.over_time import PSI, over_time
from locsnn_compile.verification.wide_registers import (
    asks_for_another_setting,
    compare_wide,
    overflowing_recordings,
)


def fulfil_for_mesh(request: CompileRequest[hw.Chip]) -> CompiledModel:
    """Compile a network as requested, and check it against the float reference.

    Raises ``InputError`` for something that cannot be used, and ``TargetError`` for a model that
    the chip cannot hold.
    """
    chip = request.pricing.priced(request.chip)
    check = request.check
    network = with_psi(request.network, check.psi)
    recordings = recordings_for(network, check.events, check.labels)
    network = network.with_steps_of(recordings)
    # ``fitted`` has the steps and channels of the network; recordings that do not fit are refused before all the work.
    fitted = network.fitted(recordings)
    _check_events_per_step(fitted.spikes.shape[2], chip, check)
    calibration = calibration_for(network, recordings, request.setting.calibration)
    fitted_calibration = fitted if calibration is recordings else network.fitted(calibration)
    # The simulator's loops, which numba compiles in seconds, are compiled by other processes while this one lowers the
    # network. The first call says which: those that play whole recordings and, for a diagnosis, those that play them
    # step by step. The second starts the processes if numba's cache does not have the loops yet.
    compile_loops_ahead(sessions=check.diagnosis)
    start_compiling()
    # A spread is a function that runs the parts of a job: in this process, in several, or on a cluster.
    with spread_over(check.scheduler) as spread:
        lowered = _lower(network, chip, request.setting, fitted_calibration, spread)
        levels = lowered.levels
        choice = lowered.choice
        observed = observed_by(levels, fitted)
        match = compare(observed, progress=check.progress, spread=spread)
    network = _noting_bounds(network, choice, request.setting)
    # Recordings in which registers overflowed are played again with registers that are wide enough: whatever differs
    # then was changed by the overflows alone.
    wide = compare_wide(observed, match)
    diagnosis = None
    predictions_over_time = None
    excerpt = None
    overflow_search = None
    peaks = None
    if check.diagnosis:
        if asks_for_another_setting(wide):
            overflowing = evenly_chosen(fitted, overflowing_recordings(match))
            overflow_search = search_without_overflows(
                network,
                chip,
                lowered.setting,
                fitted_calibration,
                overflowing,
                lowered.known,
            )
        diagnosis = find_diagnosis(observed, match.first_divergence)
        # The busiest steps of the recordings: the report bounds energy and time for recordings that are no busier.
        peaks = event_peaks(levels.program, fitted.spikes, check.events_per_step)
        # How steeply the location branch's weight in the prediction rises while a recording plays.
        psi = PSI if network.psi is None else network.psi
        predictions_over_time = over_time(observed, psi)
        excerpt = take_excerpt(observed, match.first_divergence)
    # What was assumed, which the report lists.
    grounds = grounds_of(
        network,
        recordings,
        calibration,
        chip.registers,
        chosen=choice is not None,
        rounded=levels.quantized.populations,
    )
    findings = Findings(diagnosis, predictions_over_time, choice, wide, overflow_search, peaks)
    figures = report_figures(levels, match, grounds, findings)
    return CompiledModel(observed, match, figures, choice, excerpt)


def _check_events_per_step(channels: int, chip: hw.Chip, check: CheckRequest) -> None:
    """Refuse ``events_per_step`` if no bound on the time of a recording would be stated for it."""
    events = check.events_per_step
    if events is None:
        return
    where = f"events_per_step {events}"
    if not 0 <= events <= channels:
        what = f"it is out of range for a network of {channels} channels"
        fix = f"Give 0 to {channels}."
        raise InputError(where, what, fix=fix)
    if not target_of(chip).timed:
        what = "no operation of the profile of costs has a time, so no time is bounded"
        raise InputError(where, what, fix="Leave it out.")
    if not check.diagnosis:
        what = "bounds are part of the diagnosis, which is left out"
        raise InputError(where, what, fix="Leave it out.")


def _noting_bounds(network: Network, choice: Choice | None, request: SettingRequest) -> Network:
    """Return the network, with a sentence among its assumptions if an unusual strategy sets the bounds of ``auto``.

    If the user gives no error budget, ``auto`` measures the first strategy that the chip can hold, and
    accepts other strategies only if their errors are little larger (``default_budget`` of
    ``verification/error_bounds.py``). Usually that is the first of ``STRATEGIES``. If the chip cannot
    hold that one, the next one sets the bounds, and the report says so.
    """
    if choice is None or request.setting.strategy != AUTO or request.budget.given:
        return network
    usual_strategy = next(iter(STRATEGIES))
    first_strategy = choice.candidates[0].strategy
    if first_strategy == usual_strategy:
        return network
    chip = choice.levels.program.chip
    sentence = (
        f"{chip.name} cannot hold strategy {usual_strategy}, which sets the bounds of auto. "
        f"Here {first_strategy} sets them."
    )
    return replace(network, assumptions=(*network.assumptions, sentence))


class _Lowered(NamedTuple):
    """A network at every level, the setting by which it was lowered, and what that was chosen from.

    ``choice`` is None if the setting was not chosen.
    """

    levels: Levels
    setting: Setting
    choice: Choice | None

    @property
    def known(self) -> Mapping[Setting, Levels]:
        """The network at every level, by every setting that was tried: none needs to be lowered again."""
        if self.choice is None:
            return {self.setting: self.levels}
        return self.choice.levels_by_setting


def _lower(
    network: Network,
    chip: hw.Chip,
    request: SettingRequest,
    calibration: Recordings,
    spread: Spread,
) -> _Lowered:
    """Lower by the setting asked for, or by one that is chosen; refuse a strategy that no neuron uses."""
    choice = None
    if request.chooses:
        choice = choose_strategy(network, chip, request, calibration, spread)
    if choice is not None:
        setting = choice.taken.setting
        levels = choice.levels
    else:
        setting = request.setting
        if setting.strategy == AUTO:  # there was nothing to choose, so that any strategy will do
            setting = replace(setting, strategy=next(iter(STRATEGIES)))
        calibrated = calibrate(network, calibration, chip.registers)
        levels = lower_or_advise(network, chip, setting, calibrated)
    _check_strategy_is_used(request.setting.strategy, levels)
    return _Lowered(levels, setting, choice)


def _check_strategy_is_used(strategy: str, levels: Levels) -> None:
    """Refuse a strategy that no neuron of the model uses."""
    used = {population.strategy for population in levels.quantized.populations}
    if strategy == AUTO or strategy in used:
        return
    # Neurons with a reset of their own are already what ``reset`` turns others into.
    if strategy == "reset" and used == {NATIVE}:
        return
    raise InputError(
        f"strategy {strategy!r}",
        "no neuron of this model uses it",
        measured=f"its neurons are {levels.quantized.strategy}",
        fix="Leave the strategy out.",
    )


def observed_by(levels: Levels, fitted: Recordings) -> Observed:
    """Return what the program and the float network do on recordings of the network's own steps and channels."""
    return Observed(levels, fitted.spikes, fitted.labels, fitted.source)
