"""The model as the command line names it: a file, and what some formats need beside it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import astuple, dataclass
from pathlib import Path

from locsnn_compile.frontends import load
from locsnn_compile.network.network import Network


@dataclass(frozen=True)
class ModelFile:
    """A path and the options of :func:`locsnn_compile.load`, None where they were not given."""

    path: str
    config: str | None = None
    dt: float | None = None
    reset: str | None = None
    discretisation: str | None = None

    def load(self) -> Network:
        """Read the model; ``InputError`` for what cannot be read or used."""
        return load(self.path, config=self.config, dt=self.dt, reset=self.reset, discretisation=self.discretisation)

    def arguments(self) -> list[str]:
        """Return the arguments of ``locsnn-compile``."""
        options = ("config", "dt", "reset", "discretisation")
        given = [(name, getattr(self, name)) for name in options if getattr(self, name) is not None]
        return [self.path, *(text for name, value in given for text in (f"--{name}", str(value)))]

    def digest(self) -> str:
        """Return a hash of all that decides the network: the bytes of its files, and the options."""
        contents = [Path(path).read_bytes() for path in (self.path, self.config) if path is not None]
        digest = hashlib.sha256(json.dumps([astuple(self)[2:], [len(content) for content in contents]]).encode())
        for content in contents:
            digest.update(content)
        return digest.hexdigest()
