"""What all points of an exploration share: a model, its file, a chip, recordings, and the engines that are timed."""

import hashlib
import json
from dataclasses import asdict, astuple
from functools import cached_property
from pathlib import Path
from typing import Any

import hw_model as hw
from hw_model.simulation import Engine
from hw_model.values import Frozen
from locsnn_compile.cluster.code import code_version
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.frontends import load
from locsnn_compile.network.network import Network
from locsnn_compile.settings import Setting


class ModelFile(Frozen):
    """A path and the options of :func:`locsnn_compile.load`, None where they were not given."""

    path: str
    config: str | None = None
    dt: float | None = None
    reset: str | None = None
    discretisation: str | None = None

    def load(self) -> Network:
        """Read the model; ``InputError`` for what cannot be read or used."""
        path, options = self._parts()
        return load(path, **options)

    def arguments(self) -> list[str]:
        """Return the arguments of ``locsnn-compile``."""
        path, options = self._parts()
        given = ((name, value) for name, value in options.items() if value is not None)
        return [path, *(text for name, value in given for text in (f"--{name}", str(value)))]

    def digest(self) -> str:
        """Return a hash of all that decides the network: the bytes of its files, and the options."""
        contents = [Path(path).read_bytes() for path in (self.path, self.config) if path is not None]
        return digest_of([astuple(self)[2:], [len(content) for content in contents]], *contents)

    def _parts(self) -> tuple[str, dict[str, Any]]:
        options = asdict(self)
        return options.pop("path"), options


class Study(Frozen, eq=False):
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
        return digest_of([self._digest, asdict(setting), code_version()])

    @cached_property
    def _digest(self) -> str:
        played = [_recordings_digest(self.recordings), _recordings_digest(self.calibration)]
        return digest_of([self.network.name, self.model_digest, self.chip.document, self.engines, played])


def digest_of(about: object, *contents: bytes) -> str:
    """Return a hash of plain values, and of bytes."""
    digest = hashlib.sha256(json.dumps(about).encode())
    for content in contents:
        digest.update(content)
    return digest.hexdigest()


def _recordings_digest(recordings: Recordings) -> str:
    spikes, labels = recordings.spikes, recordings.labels
    known = b"" if labels is None else labels.astype("<i8").tobytes()
    return digest_of([spikes.shape, labels is not None, recordings.step_seconds], spikes.tobytes(), known)
