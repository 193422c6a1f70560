"""The YAML beside a slayerPytorch checkpoint: neuron, step, and the location order where a network walks one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locsnn_compile.data.torch_file import read_bytes
from locsnn_compile.errors import InputError, did_you_mean
from locsnn_compile.neurons import SrmAlpha

MAX_CONFIG_BYTES = 200_000
DEFAULT_ORDER = "loop"
"""Taxels by their numbers: what transposing a recording gives when nothing is said."""


@dataclass(frozen=True)
class LoihiNeuron:
    """slayerPytorch's LOIHI neuron: integers of the chip; weights act as ``w * 2^(6 + weight_exponent)``."""

    decay_u: int
    decay_v: int
    threshold: int
    refractory: int
    weight_exponent: int


@dataclass(frozen=True)
class SlayerConfig:
    """What the description says: the neuron, the step, steps of a recording, and a location order.

    ``ts`` is in milliseconds; SRM time constants are in steps already. ``order`` is a name or taxel numbers.
    """

    neuron: SrmAlpha | LoihiNeuron
    ts: float
    steps: int | None
    order: str


def read_config(path: Path) -> SlayerConfig:
    """Read a description; ``InputError`` for what is none."""
    import yaml

    where = f"config {path.name!r}"
    data = read_bytes(path, where)
    if len(data) > MAX_CONFIG_BYTES:
        raise InputError(
            where,
            "it is too large",
            measured=f"{len(data)} bytes against {MAX_CONFIG_BYTES}",
            fix="Give the YAML alone.",
        )
    try:
        values = yaml.safe_load(data)
    # The parser meets hostile text with more kinds of exception than its own.
    except (yaml.YAMLError, ValueError, RecursionError, TypeError):
        raise InputError(where, "it is no YAML", fix="Give slayerPytorch's network description.") from None
    if not isinstance(values, dict):
        raise InputError(where, "it is no description", fix="Give slayerPytorch's network description.")
    return parse_config(values, where)


def parse_config(values: Mapping[Any, Any], where: str) -> SlayerConfig:
    """Return the description that plain values hold, every entry checked."""
    simulation = _section(values, "simulation", where)
    ts = _number(simulation, "Ts", where, least=1e-6)
    samples = _number(simulation, "tSample", where, least=0) if "tSample" in simulation else math.nan
    steps = int(samples / ts) if samples >= ts and samples / ts <= 1_000_000 else None
    section = _section(values, "neuron", where)
    kind = section.get("type")
    if kind == "SRMALPHA":
        theta, tau_sr, tau_ref = (_number(section, key, where, least=1e-6) for key in ("theta", "tauSr", "tauRef"))
        scale_ref = _number(section, "scaleRef", where, least=0)
        neuron: SrmAlpha | LoihiNeuron = SrmAlpha(theta, tau_sr / ts, tau_ref / ts, scale_ref)
    elif kind == "LOIHI":
        threshold, decay_v, decay_u = (_whole(section, key, where) for key in ("vThMant", "vDecay", "iDecay"))
        refractory = max(_whole(section, "refDelay", where), 1) if "refDelay" in section else 1
        exponent = _whole(section, "wgtExp", where) if "wgtExp" in section else 0
        neuron = LoihiNeuron(decay_u, decay_v, threshold, refractory, exponent)
    else:
        raise InputError(
            f"{where}, neuron.type",
            f"{str(kind)[:40]!r} is not known",
            fix=did_you_mean(str(kind), ("SRMALPHA", "LOIHI")),
        )
    return SlayerConfig(neuron, ts, steps, _order(values, where))


def _order(values: Mapping[Any, Any], where: str) -> str:
    """Return the location order: ``location_order`` or ``locationOrder``, a name or a list of taxels."""
    for key in ("location_order", "locationOrder"):
        if key in values:
            order = values[key]
            if isinstance(order, list) and all(isinstance(n, int) and not isinstance(n, bool) for n in order):
                return ",".join(str(n) for n in order[:1000])
            if isinstance(order, str):
                return order[:4000]
            raise InputError(f"{where}, {key}", "it is no order", fix="Give arch, whorl, loop or a list of taxels.")
    return DEFAULT_ORDER


def _section(values: Mapping[Any, Any], name: str, where: str) -> Mapping[Any, Any]:
    section = values.get(name)
    if not isinstance(section, dict):
        raise InputError(where, f"section {name!r} is missing", fix="Give slayerPytorch's network description.")
    return section


def _number(section: Mapping[Any, Any], key: str, where: str, *, least: float) -> float:
    value = section.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        raise InputError(
            where, f"{key} must be a number from {least:g} on", measured=f"{value!r}"[:40], fix="Correct it."
        )
    return float(value)


def _whole(section: Mapping[Any, Any], key: str, where: str) -> int:
    value = section.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value // 1 or abs(value) > 2**31:
        raise InputError(where, f"{key} must be a whole number", measured=f"{value!r}"[:40], fix="Correct it.")
    return int(value)
