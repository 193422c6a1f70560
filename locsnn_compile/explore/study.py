"""What all points of an exploration share: a model, a chip, recordings, and the engines that are timed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property

import hw_model as hw
from hw_model.simulation import Engine
from locsnn_compile.cluster.code import code_version
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network
from locsnn_compile.settings import Setting


@dataclass(frozen=True, eq=False)
class Study:
    """``network`` is the model of the digest, :meth:`ModelFile.digest`; ``engines`` are timed on each point.

    Settings are checked on ``recordings``, and compiled for the ``calibration`` recordings.
    """

    network: Network
    model_digest: str
    chip: hw.Chip
    recordings: Recordings
    calibration: Recordings
    engines: tuple[Engine, ...] = ()

    def key(self, setting: Setting) -> str:
        """Return the name of a point: a hash of model, recordings, chip, engines, setting and code."""
        parts = [self._digest, asdict(setting), code_version()]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()

    @cached_property
    def _digest(self) -> str:
        played = [_recordings_digest(self.recordings), _recordings_digest(self.calibration)]
        about = [self.network.name, self.model_digest, self.chip.document, self.engines, played]
        return hashlib.sha256(json.dumps(about).encode()).hexdigest()


def _recordings_digest(recordings: Recordings) -> str:
    spikes, labels = recordings.spikes, recordings.labels
    digest = hashlib.sha256(json.dumps([spikes.shape, labels is not None, recordings.step_seconds]).encode())
    digest.update(spikes.tobytes())
    digest.update(b"" if labels is None else labels.astype("<i8").tobytes())
    return digest.hexdigest()
