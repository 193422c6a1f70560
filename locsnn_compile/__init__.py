"""Compile trained time and location spiking networks to a Loihi-like chip, and check what comes out.

>>> import locsnn_compile as lc
>>> network = lc.load("examples/models/objects-hybrid.pt")
>>> compiled = lc.compile(network, target="loihi-sim")
>>> compiled.report["match"]["prediction_agreement"]
1.0
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from locsnn_compile.api import CompiledModel, compile, verify
    from locsnn_compile.errors import InputError, LocsnnError, TargetError
    from locsnn_compile.frontends import load
    from locsnn_compile.matching import Match
    from locsnn_compile.network import Network

_HOMES = {
    "CompiledModel": "locsnn_compile.api",
    "compile": "locsnn_compile.api",
    "verify": "locsnn_compile.api",
    "InputError": "locsnn_compile.errors",
    "LocsnnError": "locsnn_compile.errors",
    "TargetError": "locsnn_compile.errors",
    "load": "locsnn_compile.frontends",
    "Network": "locsnn_compile.network",
    "Match": "locsnn_compile.matching",
}

__all__ = [
    "CompiledModel",
    "InputError",
    "LocsnnError",
    "Match",
    "Network",
    "TargetError",
    "compile",
    "load",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Import on first use: the command line's help must not wait for numpy."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
