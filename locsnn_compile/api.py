"""The Python interface: compile a network, and verify the result.

The commands do the same through :func:`fulfil`. What is asked of the compiler is a request
(``request/compile_request.py``), and each family of chips fulfils it in its own way (``families.py``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, overload

import hw_model as hw
from hw_model.io.arguments import checked
from hw_model.spinnaker.chips import SpinnakerChip, SpinnakerName
from hw_model.targets.families import AnyChip, chip_named
from hw_model.values import ArrayLike
from hw_model.xylo.chips import XyloChip, XyloName
from locsnn_compile.cluster.spread import spread_over
from locsnn_compile.compiled import Compiled
from locsnn_compile.errors import InputError, counted, listed
from locsnn_compile.families import family_of, setting_of
from locsnn_compile.frontends import load
from locsnn_compile.mesh.compile import observed_by
from locsnn_compile.mesh.compiled import CompiledModel
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.network.committee import committee
from locsnn_compile.network.network import Network
from locsnn_compile.reference.evaluate import score_spread
from locsnn_compile.request.compile_request import (
    CheckRequest,
    CompileRequest,
    Events,
    PricingRequest,
    SettingRequest,
)
from locsnn_compile.request.recordings import calibration_recordings, recordings_for
from locsnn_compile.settings import AUTO, Value, check_dials
from locsnn_compile.spinnaker.compiled import CompiledSpinnaker
from locsnn_compile.verification.diagnosis import Diagnosis
from locsnn_compile.verification.diagnosis import diagnose as find_diagnosis
from locsnn_compile.verification.error_bounds import ErrorBudget
from locsnn_compile.verification.matching import Match, Progress, compare
from locsnn_compile.verification.observation import Observed
from locsnn_compile.xylo.compiled import CompiledXylo


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
    events_per_step: int | None = None,
    **dials: Value | None,
) -> CompiledModel: ...


@checked
def compile(  # noqa: PLR0913 - public: each is an option of its own
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
    events_per_step: int | None = None,
    **dials: Value | None,
) -> Compiled:
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
      does not depend on the recordings of the check; if there are neither, ``events``. Strategy ``reset`` rounds each
      weight by itself, so by itself it needs none
    - ``budget``: take the cheapest setting tried of strategy, split weights and weight bits that keeps these bounds on
      ``calibration``
    - ``split_weights``: the share of the weights onto SRM neurons, 0 to 1, that get a second synapse
    - ``profile``: the costs of operations, as a profile of the chip (by default its first) or the path of a YAML file
    - ``diagnosis``: also break the error down and follow predictions over time, both on some of the recordings, and
      keep an excerpt of one
    - ``psi``: of the time-weighted prediction, by default the model's own or 10; the program keeps it
    - ``weights``: those of the class scores of several networks; by default as :func:`join` finds them
    - ``scheduler``: the address of a Dask cluster that plays the recordings, with the same results
    - ``events_per_step``: bound the time of any recording with at most so many events in a step; by default, of those
      no busier than the busiest step of ``events``
    - ``dials``: further rows of :data:`locsnn_compile.settings.DIALS`, by name
    - ``progress``: a function that is called with how much is done, and of how much

    Raises ``InputError`` for something that cannot be used, and ``TargetError`` for a model that the chip cannot hold.
    """
    # A dial is a choice of the compiler; a setting is one value for each (settings.py). The first
    # three are arguments of their own, and any others come as keywords.
    check_dials(dials, "compile")
    chip = chip_named(target)
    dials |= {"strategy": strategy, "weight_bits": weight_bits, "split_weights": split_weights}
    joined_network = _one_network(network, weights, calibration)
    setting = setting_of(chip, joined_network, dials)
    setting_request = SettingRequest.of(setting, dials, budget, calibration)
    check_request = CheckRequest(
        events=events,
        labels=labels,
        psi=psi,
        diagnosis=diagnosis,
        scheduler=scheduler,
        progress=progress,
        events_per_step=events_per_step,
    )
    pricing_request = PricingRequest(profile)
    return fulfil(
        CompileRequest(joined_network, chip, setting_request, check_request, pricing_request)
    )


def _one_network(
    network: Network | Checkpoint | Sequence[Network | Checkpoint],
    weights: Sequence[float] | None,
    calibration: Events | None,
) -> Network:
    """Return one network; several are joined, so that their class scores are added."""
    if isinstance(network, Sequence):
        members = [_as_network(member) for member in network]
        return join(members, weights, calibration)
    if weights is not None:
        raise InputError("weights", "they apply only to several networks", fix="Leave them out.")
    return _as_network(network)


def _as_network(network: Network | Checkpoint) -> Network:
    """Return the network of a checkpoint, as ``train`` returns one; a network as it is."""
    return load(network) if isinstance(network, Checkpoint) else network


@overload
def fulfil(request: CompileRequest[hw.Chip]) -> CompiledModel: ...
@overload
def fulfil(request: CompileRequest[XyloChip]) -> CompiledXylo: ...
@overload
def fulfil(request: CompileRequest[SpinnakerChip]) -> CompiledSpinnaker: ...
@overload
def fulfil(request: CompileRequest[AnyChip]) -> Compiled: ...


def fulfil(request: CompileRequest[AnyChip]) -> Compiled:
    """Compile a network as requested, and check it against the float reference.

    Raises ``InputError`` for something that cannot be used, and ``TargetError`` for a model that
    the chip cannot hold.
    """
    compiled: Compiled = family_of(request.chip).fulfil(request)
    return compiled


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
    if weights:
        return committee(networks, weights)
    unweighted = committee(networks, (1.0,) * len(networks))
    recordings = unweighted.recordings
    if calibration is not None:
        recordings = calibration_recordings(unweighted, calibration, reading)
    if recordings is None:
        sentence = "Class scores of the networks are added as they are (--weights)."
        return _assuming(unweighted, sentence)
    # The deviation of the class scores of each network, over recordings and classes.
    deviations = [score_spread(network, network.fitted(recordings)) for network in networks]
    if 0.0 in deviations:
        # Such a network has no deviation to divide by.
        rows = zip(networks, deviations, strict=True)
        silent = listed([network.name for network, deviation in rows if not deviation])
        sentence = (
            f"Class scores of {silent} are equal on {recordings.source}: scores are added as they are "
            "(--weights)."
        )
        return _assuming(unweighted, sentence)
    # The first network has a weight of 1; the others are scaled to its deviation.
    weighted = committee(networks, [deviations[0] / deviation for deviation in deviations])
    weights_text = ", ".join(f"{member.name} {member.weight:.4g}" for member in weighted.members)
    recordings_text = f"{counted(len(recordings), 'recording')} of {recordings.source}"
    sentence = f"Class scores vary alike on {recordings_text}: weights {weights_text} (--weights)."
    return _assuming(weighted, sentence)


def _assuming(network: Network, sentence: str) -> Network:
    """Return the network with a further sentence among its assumptions, which the report lists."""
    return replace(network, assumptions=(*network.assumptions, sentence))


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


def _observed_events(compiled: CompiledModel, events: Events, labels: ArrayLike | None) -> Observed:
    """Return what the program and the float network do on recordings, which are fitted to the network."""
    recordings = recordings_for(compiled.network, events, labels)
    return observed_by(compiled.levels, compiled.network.fitted(recordings))
