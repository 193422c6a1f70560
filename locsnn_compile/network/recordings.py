"""Recordings as a network takes them: its channels, and as many steps as it has."""

from __future__ import annotations

import numpy as np

from hw_model.engine.trace import ByteArray
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network


def fit_recordings(network: Network, recordings: ByteArray, source: str) -> ByteArray:
    """Check channels and steps; a shorter recording is followed by silence, a longer one is refused.

    A network of any length takes recordings as they are.
    """
    where = f"events {source!r}"
    if recordings.ndim != 3 or recordings.shape[2] != network.channels:
        raise InputError(
            where,
            "the channel count differs from the model's",
            measured=f"{recordings.shape[-1]} channels against {network.channels}",
            fix=f"Give recordings of shape (samples, steps, {network.channels}).",
        )
    missing = 0 if network.any_length else network.steps - recordings.shape[1]
    if missing < 0:
        raise InputError(
            where,
            "the recordings are longer than the model's",
            measured=f"{recordings.shape[1]} steps against {network.steps}",
            fix=f"Cut them to {network.steps} steps.",
        )
    return np.pad(recordings, ((0, 0), (0, missing), (0, 0))) if missing else recordings
