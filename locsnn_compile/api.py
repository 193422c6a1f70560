"""The Python interface: compile a network, and verify the result."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np

import hw_model as hw
from hw_model.engine.ahead import compile_ahead
from hw_model.io.build_folder import write_build
from hw_model.io.given import checked
from hw_model.program.write import program_files
from hw_model.spinnaker.chips import SpinnakerChip, SpinnakerName
from hw_model.streaming.psi import check_psi
from hw_model.targets.families import AnyChip, chip_named
from hw_model.values import ArrayLike, Frozen
from hw_model.xylo.chips import XyloChip, XyloName
from locsnn_compile.cluster.spread import Spread, spread_over
from locsnn_compile.data.channels import frames_as_channels
from locsnn_compile.data.joining import join_channels
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.emitters import Build, ShownRecording, emitted_files
from locsnn_compile.errors import InputError, counted, listed
from locsnn_compile.frontends import load
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.network.check import check_network
from locsnn_compile.network.committee import committee
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import calibrate, score_spread
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Report
from locsnn_compile.report.figures.document import (
    Findings,
    GateFigures,
    ReportFigures,
    report_figures,
)
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.grounds import grounds_of
from locsnn_compile.report.renderers.html import render_html, render_summary
from locsnn_compile.report.sections.verdict import matches
from locsnn_compile.report.written import report_files
from locsnn_compile.request.choose_strategy import Choice, choose_strategy, lower_or_advise
from locsnn_compile.request.compile_request import (
    CheckRequest,
    CompileRequest,
    Events,
    PricingRequest,
    SettingRequest,
)
from locsnn_compile.settings import AUTO, NATIVE, STRATEGIES, Value, check_dials, check_matters
from locsnn_compile.spinnaker.compile import SpinnakerRequest, compile_for_spinnaker
from locsnn_compile.spinnaker.compiled import CompiledSpinnaker
from locsnn_compile.verification.diagnosis import Diagnosis
from locsnn_compile.verification.diagnosis import diagnose as find_diagnosis
from locsnn_compile.verification.error_bounds import ErrorBudget
from locsnn_compile.verification.excerpt import Excerpt, take_excerpt
from locsnn_compile.verification.matching import Match, Progress, compare
from locsnn_compile.verification.observation import Observed
from locsnn_compile.verification.over_time import PSI, over_time
from locsnn_compile.xylo.compile import XyloRequest, compile_for_xylo
from locsnn_compile.xylo.compiled import CompiledXylo

SYNTHETIC_SAMPLES, SYNTHETIC_VALUES = 16, 10_000_000
"""How many synthetic recordings are made, and the most values in them: large recordings are fewer."""
SYNTHETIC_SEED = 0
AHEAD_OF_SESSIONS = "hw_model.streaming.ahead"
"""The module that compiles the loops of sessions in a process of its own, without which nothing here imports them."""


class CompiledModel(Frozen, eq=False):
    """A program, the network it came from, and the report of their comparison."""

    observed: Observed
    """The recordings of the check, and what both sides do on them."""
    match: Match
    figures: ReportFigures
    """The content of report.json, with types."""
    choice: Choice | None = None
    """What ``auto`` compared; None if the strategy was given, or there was nothing to choose."""
    excerpt: Excerpt | None = None
    """The part of a recording that the report shows; None without a diagnosis."""

    def __repr__(self) -> str:
        said = matches(self.figures).sentence.rstrip(".")
        return f"<CompiledModel {self.network.name[:60]!r} on {self.program.chip.name}: {said}>"

    def _repr_html_(self) -> str:
        return render_summary(self.composed)

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json, as plain values."""
        return dict(plain(self.figures))

    @cached_property
    def composed(self) -> Report:
        """The content of report.html, report.md and the summary on the terminal."""
        return compose(self.figures, self.excerpt)

    @property
    def levels(self) -> Levels:
        """The network at every level, from float to program."""
        return self.observed.levels

    @property
    def program(self) -> hw.ChipProgram:
        """The program for the chip."""
        return self.levels.program

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.levels.network

    def with_gates(self, gates: tuple[GateFigures, ...]) -> "CompiledModel":
        """Return the same with these gates in the report."""
        return replace(self, figures=replace(self.figures, gates=gates))

    def to_html(self) -> str:
        """Return report.html, a page in one file."""
        return render_html(self.composed)

    def files(
        self,
        emit: Sequence[str] = (),
        shown: ShownRecording | None = None,
    ) -> dict[str, bytes]:
        """Return the program and its reports as bytes, by name, as ``locsnn-compile`` writes them.

        ``emit`` are kinds of ``--emit``; those about one recording need the one that is ``shown``.
        Equal input, equal bytes.
        """
        files = program_files(self.program) | report_files(self.report, self.composed)
        return files | emitted_files(Build(self.program, self, shown), emit)

    @checked
    def save(self, folder: str | Path) -> None:
        """Write the program and its reports into a folder, all or none of them.

        Other files there stay, and with them what ``--emit`` wrote for an earlier build.
        """
        write_build(Path(folder), self.files())


@overload
def compile(  # type: ignore[overload-overlap]  # the names of these chips are texts, too
    network: Network | Checkpoint,
    target: XyloChip | XyloName,
    *,
    events: Events | None = None,
    labels: ArrayLike | None = None,
    progress: Progress | None = None,
) -> CompiledXylo: ...
@overload
def compile(  # type: ignore[overload-overlap]  # and so is the name of this one
    network: Network | Checkpoint,
    target: SpinnakerChip | SpinnakerName,
    strategy: str = AUTO,
    *,
    events: Events | None = None,
    labels: ArrayLike | None = None,
    progress: Progress | None = None,
    calibration: Events | None = None,
) -> CompiledSpinnaker: ...
@overload
def compile(
    network: Network | Checkpoint | Sequence[Network | Checkpoint],
    target: str | Path | hw.Chip = "loihi-sim",
    strategy: str = AUTO,
    weight_bits: int | None = None,
    events: Events | None = None,
    labels: ArrayLike | None = None,
    progress: Progress | None = None,
    diagnosis: bool = True,
    calibration: Events | None = None,
    budget: ErrorBudget | None = None,
    psi: float | None = None,
    split_weights: float | None = None,
    profile: str | Path | None = None,
    scheduler: str | None = None,
    weights: Sequence[float] | None = None,
    **dials: Value | None,
) -> CompiledModel: ...


@checked
def compile(
    network: Network | Checkpoint | Sequence[Network | Checkpoint],
    target: str | Path | AnyChip = "loihi-sim",
    strategy: str = AUTO,
    weight_bits: int | None = None,
    events: Events | None = None,
    labels: ArrayLike | None = None,
    progress: Progress | None = None,
    diagnosis: bool = True,
    calibration: Events | None = None,
    budget: ErrorBudget | None = None,
    psi: float | None = None,
    split_weights: float | None = None,
    profile: str | Path | None = None,
    scheduler: str | None = None,
    weights: Sequence[float] | None = None,
    **dials: Value | None,
) -> CompiledModel | CompiledXylo | CompiledSpinnaker:
    """Compile a network, or what ``train`` returned, for a chip, and check it against the float reference.

    Several networks become one program that adds their class scores.

    - ``target``: a chip, its name, or the path of a chip YAML. For a Xylo, the result is a ``CompiledXylo``, for
      SpiNNaker a ``CompiledSpinnaker``, and everything below that does not apply to it is refused
    - ``strategy``: how SRM neurons are lowered; ``auto`` takes the cheapest that keeps the bounds
    - ``weight_bits``: 1 to 6, or 8; by default the chip's widest. With a ``budget``, the widest to try
    - ``events``: recordings to check on, as a file, an archive, a folder or an array (samples, steps, channels) of 0
      and 1; by default those in the model, or else synthetic touches. ``labels`` (samples,) belong to an array
    - ``calibration``: recordings, given like ``events``, for which weights are rounded and settings chosen; from a
      divided archive, the train part. By default those in the model, or else synthetic touches, so that the program
      does not depend on the recordings of the check; if there are neither, ``events``
    - ``budget``: take the cheapest setting tried of strategy, split weights and weight bits that keeps these bounds on
      ``calibration``
    - ``split_weights``: the share of the weights onto SRM neurons, 0 to 1, that get a second synapse
    - ``profile``: the costs of operations, as a profile of the chip (by default its first) or the path of a YAML file
    - ``diagnosis``: also break the error down and follow predictions over time, both on some of the recordings, and
      keep an excerpt of one
    - ``psi``: of the time-weighted prediction, by default the model's own or 10; the program keeps it
    - ``weights``: those of the class scores of several networks; by default as :func:`join` finds them
    - ``scheduler``: the address of a Dask cluster that plays the recordings, with the same results
    - ``dials``: further rows of :data:`locsnn_compile.settings.DIALS`, by name
    - ``progress``: a function that is called with how much is done, and of how much

    Raises ``InputError`` for something that cannot be used, and ``TargetError`` for a model that the chip cannot hold.
    """
    check_dials(dials, "compile")
    chip = chip_named(target)
    dials |= {"strategy": strategy, "weight_bits": weight_bits, "split_weights": split_weights}
    asked = SettingRequest.of(chip, dials, budget, calibration)
    check = CheckRequest(events, labels, psi, diagnosis, scheduler, progress)
    whole = _one_network(network, weights, calibration)
    return fulfil(CompileRequest(whole, chip, asked, check, PricingRequest(profile)))


def _one_network(
    network: Network | Checkpoint | Sequence[Network | Checkpoint],
    weights: Sequence[float] | None,
    calibration: Events | None,
) -> Network:
    """Return what is given as one network: several are joined, with their class scores added."""
    if isinstance(network, Sequence):
        members = [load(one) if isinstance(one, Checkpoint) else one for one in network]
        return join(members, weights, calibration)
    if weights is not None:
        raise InputError("weights", "they apply only to several networks", fix="Leave them out.")
    return load(network) if isinstance(network, Checkpoint) else network


@overload
def fulfil(request: CompileRequest[hw.Chip]) -> CompiledModel: ...
@overload
def fulfil(request: CompileRequest[XyloChip]) -> CompiledXylo: ...
@overload
def fulfil(request: CompileRequest[SpinnakerChip]) -> CompiledSpinnaker: ...
@overload
def fulfil(
    request: CompileRequest[AnyChip],
) -> CompiledModel | CompiledXylo | CompiledSpinnaker: ...


def fulfil(
    request: CompileRequest[AnyChip],
) -> CompiledModel | CompiledXylo | CompiledSpinnaker:
    """Compile a network as requested, and check it against the float reference.

    Raises ``InputError`` for something that cannot be used, and ``TargetError`` for a model that
    the chip cannot hold.
    """
    chip = request.chip
    if isinstance(chip, XyloChip):
        return _fulfil_for_xylo(request, chip)
    if isinstance(chip, SpinnakerChip):
        return _fulfil_for_spinnaker(request, chip)
    chip = request.pricing.priced(chip)
    check = request.check
    network = _with_psi(request.network, check.psi)
    recordings = recordings_for(network, check.events, check.labels)
    network = network.with_step_of(recordings)
    if network.any_length:
        network = replace(network, steps=recordings.spikes.shape[1])
    # Recordings that do not fit are refused before all the work.
    fitted = network.fitted(recordings)
    calibration = _calibration(network, recordings, request.setting.calibration)
    fitted_calibration = fitted if calibration is recordings else network.fitted(calibration)
    if check.diagnosis:
        compile_ahead(AHEAD_OF_SESSIONS)
    with spread_over(check.scheduler) as spread:
        levels, choice = _lower(network, chip, request.setting, fitted_calibration, spread)
        observed = _observed(levels, fitted)
        match = compare(observed, progress=check.progress, spread=spread)
    network = _with_bounds_of(choice, network, request.setting)
    diagnosis, followed, excerpt = None, None, None
    if check.diagnosis:
        diagnosis = find_diagnosis(observed, match.first_divergence)
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
    findings = Findings(diagnosis, followed, choice)
    figures = report_figures(levels, match, grounds, findings)
    return CompiledModel(observed, match, figures, choice, excerpt)


def _fulfil_for_xylo(request: CompileRequest[AnyChip], chip: XyloChip) -> CompiledXylo:
    """Compile for a Xylo; refuse what a request may ask of other chips only."""
    check = request.check
    _check_unpriced(request, chip, f"no energies of {chip.name} are published")
    if request.setting.calibration is not None:
        check_matters(request.network, {"calibration": "calibration"})
    network = _with_psi(request.network, check.psi)
    recordings = recordings_for(network, check.events, check.labels)
    return compile_for_xylo(XyloRequest(network, chip, recordings, check.progress))


def _fulfil_for_spinnaker(
    request: CompileRequest[AnyChip], chip: SpinnakerChip
) -> CompiledSpinnaker:
    """Compile for SpiNNaker; refuse what a request may ask of other chips only."""
    check = request.check
    _check_unpriced(request, chip, f"no table of the energies of {chip.name} was checked")
    if request.setting.budget.given:
        what = f"there is one setting for {chip.name}, and bounds choose among several"
        raise InputError("budget", what, fix="Leave out the bounds, and ask for gates.")
    network = _with_psi(request.network, check.psi)
    recordings = recordings_for(network, check.events, check.labels)
    calibration = _calibration(network, recordings, request.setting.calibration)
    return compile_for_spinnaker(
        SpinnakerRequest(network, chip, recordings, calibration, check.progress)
    )


def _check_unpriced(request: CompileRequest[AnyChip], chip: AnyChip, why: str) -> None:
    """Refuse a profile where no energies are known, and a scheduler where this process plays."""
    if request.pricing.profile is not None:
        raise InputError(f"profile {str(request.pricing.profile)!r}", why, fix="Leave it out.")
    if request.check.scheduler is not None:
        what = f"recordings are played to {chip.name} in this process"
        raise InputError("scheduler", what, fix="Leave it out.")


def _with_bounds_of(choice: Choice | None, network: Network, asked: SettingRequest) -> Network:
    """Return the network; where an unusual strategy sets the bounds of ``auto``, it says so."""
    if choice is None or asked.setting.strategy != AUTO or asked.budget.given:
        return network
    usual = next(iter(STRATEGIES))
    first = choice.candidates[0].strategy
    if first == usual:
        return network
    chip = choice.levels.program.chip
    said = (
        f"{chip.name} cannot hold strategy {usual}, which sets the bounds of auto. "
        f"Here {first} sets them."
    )
    return replace(network, assumptions=(*network.assumptions, said))


def _with_psi(network: Network, psi: float | None) -> Network:
    """Return the network, checked, with the psi asked for; a network of one branch has none."""
    check_network(network)
    if psi is None:
        return network
    check_psi(psi)
    return replace(network, psi=psi if network.has_both_axes else None)


def join(
    networks: Sequence[Network],
    weights: Sequence[float] | None = None,
    calibration: Events | None = None,
    reading: Mapping[str, Any] | None = None,
) -> Network:
    """Return several networks as one that adds their class scores.

    Without ``weights``, scores are weighed so that those of all networks vary alike on recordings: ``calibration``, or
    else the recordings in a network. If there are none, scores are added as they are.
    """
    joined = committee(networks, weights or (1.0,) * len(networks))
    if weights:
        return joined
    recordings = (
        joined.recordings
        if calibration is None
        else calibration_recordings(joined, calibration, reading)
    )
    if recordings is None:
        said = "Class scores of the networks are added as they are (--weights)."
        return replace(joined, assumptions=(*joined.assumptions, said))
    spreads = [score_spread(network, network.fitted(recordings)) for network in networks]
    if 0.0 in spreads:
        silent = listed(
            [network.name for network, spread in zip(networks, spreads, strict=True) if not spread]
        )
        said = f"Class scores of {silent} are equal on {recordings.source}: scores are added as they are (--weights)."
        return replace(joined, assumptions=(*joined.assumptions, said))
    found = committee(networks, [spreads[0] / spread for spread in spreads])
    said = ", ".join(f"{member.name} {member.weight:.4g}" for member in found.members)
    on = f"{counted(len(recordings), 'recording')} of {recordings.source}"
    said = f"Class scores vary alike on {on}: weights {said} (--weights)."
    return replace(found, assumptions=(*found.assumptions, said))


@checked
def verify(
    compiled: CompiledModel,
    events: Events,
    labels: ArrayLike | None = None,
    progress: Progress | None = None,
    scheduler: str | None = None,
) -> Match:
    """Compare a compiled model with its float reference on other recordings, spike by spike.

    ``scheduler`` is the address of a Dask cluster that plays them, with the same result.
    """
    with spread_over(scheduler) as spread:
        observed = _observed_events(compiled, events, labels)
        return compare(observed, progress=progress, spread=spread)


@checked
def diagnose(
    compiled: CompiledModel,
    events: Events,
    labels: ArrayLike | None = None,
    samples: int | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Break down the error of a compiled model on other recordings: on all of them or at most ``samples``."""
    observed = _observed_events(compiled, events, labels)
    first = compare(observed).first_divergence
    return find_diagnosis(observed, first, samples=samples, progress=progress)


def recordings_for(
    network: Network, events: Events | None, labels: ArrayLike | None = None
) -> Recordings:
    """Return the recordings to check on; without events those in the model, or else synthetic ones."""
    if labels is not None and (events is None or isinstance(events, str | Path | Recordings)):
        raise InputError(
            "labels",
            "they belong to an array, and other events bring their own",
            fix="Leave labels out.",
        )
    if events is None:
        if network.recordings is not None:
            return network.recordings
        if network.sensor is None:
            what = "carries no recordings, and its sensor is not known"
            raise InputError(f"model {network.name!r}", what, fix="Give events.")
        samples = min(SYNTHETIC_SAMPLES, 1 + SYNTHETIC_VALUES // (network.steps * network.channels))
        touches = synthetic_touches(
            samples, steps=network.steps, sensor=network.sensor, seed=SYNTHETIC_SEED
        )
        # Their labels are motions of the generator, not classes of this model.
        return Recordings(
            touches.spikes, None, network.stated_step_seconds, touches.source, touches.origin
        )
    if isinstance(events, Recordings):
        network.expected.check(events)
        return join_channels(events, network.expected)
    if isinstance(events, str | Path):
        return read_recordings(events, model=network.expected)
    given = None if labels is None else np.asarray(labels)
    spikes, pixels = frames_as_channels(np.asarray(events))
    step_seconds = network.stated_step_seconds
    recordings = Recordings(spikes, given, step_seconds, "array", channels=pixels)
    return join_channels(recordings, network.expected)


def calibration_recordings(
    network: Network, calibration: Events | None, reading: Mapping[str, Any] | None = None
) -> Recordings:
    """Return the recordings to make choices on: if a file or folder is divided, its train part.

    ``reading``: what ``read_recordings`` has to know of the sensor.
    """
    if not isinstance(calibration, str | Path):
        return recordings_for(network, calibration)
    part = "train" if "train" in recording_parts(calibration) else None
    return read_recordings(calibration, split=part, model=network.expected, **reading or {})


def _lower(
    network: Network,
    chip: hw.Chip,
    asked: SettingRequest,
    calibration: Recordings,
    spread: Spread,
) -> tuple[Levels, Choice | None]:
    """Lower as asked, or by a setting that is chosen; refuse a strategy that no neuron uses."""
    choice = None
    if asked.chooses:
        choice = choose_strategy(network, chip, asked, calibration, spread)
    if choice:
        levels = choice.levels
    else:
        setting = asked.setting
        if setting.strategy == AUTO:
            setting = replace(setting, strategy=next(iter(STRATEGIES)))
        calibrated = calibrate(network, calibration, chip.registers)
        levels = lower_or_advise(network, chip, setting, calibrated)
    _check_used(asked.setting.strategy, levels)
    return levels, choice


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


def _calibration(
    network: Network, recordings: Recordings, calibration: Events | None
) -> Recordings:
    """Return the recordings that choices are made on: never those of the check, if there are others."""
    if calibration is None and network.recordings is None and network.sensor is None:
        return recordings
    return calibration_recordings(network, calibration)


def _observed_events(compiled: CompiledModel, events: Events, labels: ArrayLike | None) -> Observed:
    recordings = recordings_for(compiled.network, events, labels)
    return _observed(compiled.levels, compiled.network.fitted(recordings))


def _observed(levels: Levels, fitted: Recordings) -> Observed:
    return Observed(levels, fitted.spikes, fitted.labels, fitted.source)
