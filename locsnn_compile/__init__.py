"""Compile trained time and location spiking networks to a Loihi-like chip, and check what comes out.

>>> import locsnn_compile as lc
>>> network = lc.load("examples/models/objects-hybrid.pt")
>>> compiled = lc.compile(network, target="loihi-sim")
>>> compiled.report["match"]["prediction_agreement"]
1.0
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hw_model._lazy import lazy_names

if TYPE_CHECKING:
    from locsnn_compile.api import CompiledModel, compile, diagnose, verify
    from locsnn_compile.data.read import read_recordings
    from locsnn_compile.errors import InputError, LocsnnError, TargetError
    from locsnn_compile.frontends import load
    from locsnn_compile.network.network import Network
    from locsnn_compile.verification.diagnosis import Diagnosis
    from locsnn_compile.verification.matching import Match

__all__ = [
    "CompiledModel",
    "Diagnosis",
    "InputError",
    "LocsnnError",
    "Match",
    "Network",
    "TargetError",
    "compile",
    "diagnose",
    "load",
    "read_recordings",
    "verify",
]


__getattr__ = lazy_names(
    __name__,
    {
        "CompiledModel": "locsnn_compile.api",
        "compile": "locsnn_compile.api",
        "diagnose": "locsnn_compile.api",
        "Diagnosis": "locsnn_compile.verification.diagnosis",
        "verify": "locsnn_compile.api",
        "InputError": "locsnn_compile.errors",
        "LocsnnError": "locsnn_compile.errors",
        "TargetError": "locsnn_compile.errors",
        "load": "locsnn_compile.frontends",
        "read_recordings": "locsnn_compile.data.read",
        "Network": "locsnn_compile.network.network",
        "Match": "locsnn_compile.verification.matching",
    },
)


def __dir__() -> list[str]:
    """Return the names to complete, those that are not imported yet among them."""
    return sorted({*globals(), *__all__})
