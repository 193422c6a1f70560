"""Compile a network for a mesh of cores or the open core, and check it against the float reference."""

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
from locsnn_compile.request.without_overflows import search_without_overflows, spread_of
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
    # Recordings that do not fit are refused before all the work.
    fitted = network.fitted(recordings)
    _check_bounded(fitted.spikes.shape[2], chip, check)
    calibration = calibration_for(network, recordings, request.setting.calibration)
    fitted_calibration = fitted if calibration is recordings else network.fitted(calibration)
    compile_loops_ahead(sessions=check.diagnosis)
    start_compiling()
    with spread_over(check.scheduler) as spread:
        lowered = _lower(network, chip, request.setting, fitted_calibration, spread)
        levels = lowered.levels
        choice = lowered.choice
        observed = observed_by(levels, fitted)
        match = compare(observed, progress=check.progress, spread=spread)
    network = _with_bounds_of(choice, network, request.setting)
    wide = compare_wide(observed, match)
    diagnosis, followed, excerpt, search, peaks = None, None, None, None, None
    if check.diagnosis:
        if asks_for_another_setting(wide):
            overflowing = spread_of(fitted, overflowing_recordings(match))
            search = search_without_overflows(
                network,
                chip,
                lowered.setting,
                fitted_calibration,
                overflowing,
                lowered.known,
            )
        diagnosis = find_diagnosis(observed, match.first_divergence)
        peaks = event_peaks(levels.program, fitted.spikes, check.events_per_step)
        followed = over_time(observed, PSI if network.psi is None else network.psi)
        excerpt = take_excerpt(observed, match.first_divergence)
    grounds = grounds_of(
        network,
        recordings,
        calibration,
        chip.registers,
        chosen=choice is not None,
        rounded=levels.quantized.populations,
    )
    findings = Findings(diagnosis, followed, choice, wide, search, peaks)
    figures = report_figures(levels, match, grounds, findings)
    return CompiledModel(observed, match, figures, choice, excerpt)


def _check_bounded(channels: int, chip: hw.Chip, check: CheckRequest) -> None:
    """Refuse a rate of events for which nothing is bounded."""
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


def _with_bounds_of(choice: Choice | None, network: Network, request: SettingRequest) -> Network:
    """Return the network; where an unusual strategy sets the bounds of ``auto``, it says so."""
    if choice is None or request.setting.strategy != AUTO or request.budget.given:
        return network
    usual = next(iter(STRATEGIES))
    first = choice.candidates[0].strategy
    if first == usual:
        return network
    chip = choice.levels.program.chip
    sentence = (
        f"{chip.name} cannot hold strategy {usual}, which sets the bounds of auto. "
        f"Here {first} sets them."
    )
    return replace(network, assumptions=(*network.assumptions, sentence))


class _Lowered(NamedTuple):
    """A network at every level, the setting that led there, and what it was chosen from, if it was."""

    levels: Levels
    setting: Setting
    choice: Choice | None

    @property
    def known(self) -> Mapping[Setting, Levels]:
        """The network at every level, by every setting that was tried."""
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
    """Lower as asked, or by a setting that is chosen; refuse a strategy that no neuron uses."""
    choice = None
    if request.chooses:
        choice = choose_strategy(network, chip, request, calibration, spread)
    setting = request.setting
    if choice:
        levels = choice.levels
        setting = choice.taken.setting
    else:
        if setting.strategy == AUTO:
            setting = replace(setting, strategy=next(iter(STRATEGIES)))
        calibrated = calibrate(network, calibration, chip.registers)
        levels = lower_or_advise(network, chip, setting, calibrated)
    _check_used(request.setting.strategy, levels)
    return _Lowered(levels, setting, choice)


def _check_used(strategy: str, levels: Levels) -> None:
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
    """Return what both sides do on recordings of the network's own steps and channels."""
    return Observed(levels, fitted.spikes, fitted.labels, fitted.source)
