"""The recordings on which a network is checked, and those on which the compiler makes its choices.

Choices are made on calibration recordings: weights are rounded and settings chosen for them. They
differ from the recordings of the check wherever possible, so that the check tests the choices.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.streaming.psi import check_psi
from hw_model.values import ArrayLike
from locsnn_compile.data.channels import frames_as_channels
from locsnn_compile.data.joining import join_channels
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.real_values import read_real_values, real_values
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import HostLayers, Network
from locsnn_compile.reference.host import host_recordings
from locsnn_compile.request.compile_request import Events

SYNTHETIC_SAMPLES = 16
"""How many synthetic recordings are made, unless they are large."""
SYNTHETIC_VALUES = 10_000_000
"""Values (steps times channels) of all synthetic recordings, beyond which there are fewer: chosen by hand."""
SYNTHETIC_SEED = 0


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
    if network.host is not None and events is not None and not isinstance(events, Recordings):
        return _through_host(network, network.host, events, labels)
    if events is None:
        if network.recordings is not None:
            return network.recordings
        if network.sensor is None:
            what = "carries no recordings, and its sensor is not known"
            raise InputError(f"model {network.name!r}", what, fix="Give events.")
        return _synthetic_touches(network, network.sensor)
    if isinstance(events, Recordings):
        network.expected.check(events)
        return join_channels(events, network.expected)
    if isinstance(events, str | Path):
        return read_recordings(events, model=network.expected)
    # An array holds no width of a step, so it gets the model's.
    labels_array = None if labels is None else np.asarray(labels)
    spikes, pixels = frames_as_channels(np.asarray(events))
    recordings = Recordings(
        spikes,
        labels_array,
        step_seconds=network.stated_step_seconds,
        source="array",
        channels=pixels,
    )
    return join_channels(recordings, network.expected)


def _synthetic_touches(network: Network, sensor: SensorLayout) -> Recordings:
    """Return synthetic touches of a sensor, with the steps of a network."""
    values_per_recording = network.steps * network.channels
    samples = min(SYNTHETIC_SAMPLES, 1 + SYNTHETIC_VALUES // values_per_recording)
    touches = synthetic_touches(samples, steps=network.steps, sensor=sensor, seed=SYNTHETIC_SEED)
    # Without labels: those of the generator are its motions, not classes of this model.
    return Recordings(
        touches.spikes,
        labels=None,
        step_seconds=network.stated_step_seconds,
        source=touches.source,
        origin=touches.origin,
    )


def _through_host(
    network: Network, host: HostLayers, inputs: str | Path | ArrayLike, labels: ArrayLike | None
) -> Recordings:
    """Return the spikes that layers on the host computer send for arrays of numbers.

    The first layers of such a network do not run on the chip: they turn numbers into spikes.
    """
    if isinstance(inputs, str | Path):
        values = read_real_values(inputs)
    else:
        values = real_values(inputs, labels)
    steps = None if network.any_length else network.steps
    recordings = host_recordings(host, values, steps)
    if recordings.step_seconds is None:
        recordings = replace(recordings, step_seconds=network.stated_step_seconds)
    return recordings


def calibration_recordings(
    network: Network, calibration: Events | None, reading: Mapping[str, Any] | None = None
) -> Recordings:
    """Return the recordings of ``calibration``: if it is a file or folder that is divided, its train part.

    None stands for the recordings in the model, or else synthetic ones. ``reading``: further
    arguments of ``read_recordings``, such as the sensor.
    """
    if not isinstance(calibration, str | Path) or network.host is not None:
        return recordings_for(network, calibration)
    part = "train" if "train" in recording_parts(calibration) else None
    return read_recordings(calibration, split=part, model=network.expected, **reading or {})


def calibration_for(
    network: Network, recordings: Recordings, calibration: Events | None
) -> Recordings:
    """Return the recordings on which choices are made: never those of the check, if there are others.

    ``recordings`` are those of the check. There are no others if none are given, the model carries
    none, and none can be made up because its sensor is unknown.
    """
    if calibration is None and network.recordings is None and network.sensor is None:
        return recordings
    return calibration_recordings(network, calibration)


def with_psi(network: Network, psi: float | None) -> Network:
    """Check the network, and return it with the psi asked for.

    Psi says how late the prediction shifts from the time branch to the location branch, so a network
    with one branch keeps none.
    """
    check_network(network)
    if psi is None:
        return network
    check_psi(psi)
    return replace(network, psi=psi if network.has_both_axes else None)
