"""Which recordings a network is checked on, and which its choices are made on."""

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
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import HostLayers, Network
from locsnn_compile.reference.host import host_recordings
from locsnn_compile.request.compile_request import Events

SYNTHETIC_SAMPLES, SYNTHETIC_VALUES = 16, 10_000_000
"""How many synthetic recordings are made, and the most values in them: large recordings are fewer."""
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
        samples = min(SYNTHETIC_SAMPLES, 1 + SYNTHETIC_VALUES // (network.steps * network.channels))
        touches = synthetic_touches(
            samples, steps=network.steps, sensor=network.sensor, seed=SYNTHETIC_SEED
        )
        # Their labels are motions of the generator, not classes of this model.
        return Recordings(
            touches.spikes,
            labels=None,
            step_seconds=network.stated_step_seconds,
            source=touches.source,
            origin=touches.origin,
        )
    if isinstance(events, Recordings):
        network.expected.check(events)
        return join_channels(events, network.expected)
    if isinstance(events, str | Path):
        return read_recordings(events, model=network.expected)
    labels_array = None if labels is None else np.asarray(labels)
    spikes, pixels = frames_as_channels(np.asarray(events))
    step_seconds = network.stated_step_seconds
    recordings = Recordings(spikes, labels_array, step_seconds, "array", channels=pixels)
    return join_channels(recordings, network.expected)


def _through_host(
    network: Network, host: HostLayers, inputs: str | Path | ArrayLike, labels: ArrayLike | None
) -> Recordings:
    """Return the spikes that the host's layers send for arrays of numbers."""
    if isinstance(inputs, str | Path):
        values = read_real_values(inputs)
    else:
        values = real_values(inputs, labels)
    recordings = host_recordings(host, values, None if network.any_length else network.steps)
    if recordings.step_seconds is None:
        recordings = replace(recordings, step_seconds=network.stated_step_seconds)
    return recordings


def calibration_recordings(
    network: Network, calibration: Events | None, reading: Mapping[str, Any] | None = None
) -> Recordings:
    """Return the recordings to make choices on: if a file or folder is divided, its train part.

    ``reading``: what ``read_recordings`` has to know of the sensor.
    """
    if not isinstance(calibration, str | Path) or network.host is not None:
        return recordings_for(network, calibration)
    part = "train" if "train" in recording_parts(calibration) else None
    return read_recordings(calibration, split=part, model=network.expected, **reading or {})


def calibration_for(
    network: Network, recordings: Recordings, calibration: Events | None
) -> Recordings:
    """Return the recordings that choices are made on: never those of the check, if there are others."""
    if calibration is None and network.recordings is None and network.sensor is None:
        return recordings
    return calibration_recordings(network, calibration)


def with_psi(network: Network, psi: float | None) -> Network:
    """Return the network, checked, with the psi asked for; a network of one branch has none."""
    check_network(network)
    if psi is None:
        return network
    check_psi(psi)
    return replace(network, psi=psi if network.has_both_axes else None)
