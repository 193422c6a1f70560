"""What the float network does on calibration recordings: what weights are rounded for, and scales are chosen by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.description.chip import Registers
from hw_model.engine.trace import ByteArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network
from locsnn_compile.network.recordings import fit_recordings
from locsnn_compile.reference.evaluate import evaluate

SAMPLES = 256
"""Of more recordings, so many are taken, evenly spaced: beyond, agreement on others hardly rises."""
CHUNK = 16


@dataclass(frozen=True, eq=False)
class Calibration:
    """``spikes[name]`` (samples, steps, n) of views and populations; ``potential[name]`` likewise, of populations."""

    samples: int
    source: str
    spikes: Mapping[str, ByteArray]
    potential: Mapping[str, npt.NDArray[np.float64]]


def calibrate(network: Network, recordings: Recordings, registers: Registers) -> Calibration:
    """Evaluate the float network on at most :data:`SAMPLES` recordings."""
    count = len(recordings.spikes)
    chosen = np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).astype(np.int64))
    played = fit_recordings(network, recordings.spikes[chosen], recordings.source)
    chunks = [
        evaluate(network, played[start : start + CHUNK], potentials=True, registers=registers)
        for start in range(0, len(played), CHUNK)
    ]
    return Calibration(
        len(played),
        recordings.source,
        {name: np.concatenate([chunk.spikes[name] for chunk in chunks]) for name in chunks[0].spikes},
        {name: np.concatenate([chunk.potential[name] for chunk in chunks]) for name in chunks[0].potential},
    )
