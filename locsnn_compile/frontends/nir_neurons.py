"""NIR's neurons, which are differential equations, as neurons that step.

With a step of dt, an input spike is a current of 1 for that step. Two discretisations:

``euler`` (the usual one, which snnTorch, norse and NIR's own papers take): a time constant tau loses ``dt / tau``.

    I(t) = I(t - 1) + dt / tau_syn * (w_in * x(t) - I(t - 1))
    v(t) = v(t - 1) + dt / tau_mem * (v_leak - v(t - 1) + r * I(t))

``exact``: a time constant loses ``1 - exp(-dt / tau)``, and a spike's charge, ``dt``, arrives at once; then v is the
equation's own solution at every step between two spikes of the neuron, and one step later with a synaptic current.

Potentials are counted from v_reset, so that the chip's reset to 0 is NIR's reset to v_reset; they start there, too.
A constant that arrives beside the spikes (a bias) is brought by a neuron that spikes in every step, so that it begins,
as in a framework, with the first step of the input that its layer sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir_flat import READOUTS
from locsnn_compile.frontends.nir_graph import NirNode
from locsnn_compile.frontends.signals import Signal
from locsnn_compile.matrices import matrix
from locsnn_compile.neurons import Cuba, FloatArray

Discretisation = Literal["euler", "exact"]
DISCRETISATIONS = ("euler", "exact")

_UNREACHED = 1.001
"""The threshold of a neuron that never spikes, as a multiple of what its inputs can reach."""


@dataclass(frozen=True, eq=False)
class Stepping:
    """Decays, what a spike of weight 1 adds, and what a constant input of 1 adds in every step; all (n,)."""

    decay_u: FloatArray
    decay_v: FloatArray
    spike: FloatArray
    constant: FloatArray


def neurons_of(
    node: NirNode, signal: Signal, size: int, dt: float, how: Discretisation, where: str
) -> tuple[Cuba, Signal]:
    """Return the neurons of a node, and the signal that drives them in units of their potential."""
    values = {name: _spread(node, name, size, where) for name in node.parameters}
    stepping = _STEPPING[node.kind](values, dt, how, where)
    leak, reset = (values.get(name, np.zeros(size)) for name in ("v_leak", "v_reset"))
    bias = stepping.decay_v * (leak - reset)
    # A current that takes up decay_u of this in every step settles at what the constant gives.
    constant = stepping.constant * stepping.decay_u * signal.constant
    scaled = Signal(signal.scaled(stepping.spike).terms, constant)
    if node.kind in READOUTS:
        threshold = _unreached(scaled, bias, stepping)
    else:
        threshold = values["threshold" if node.kind == "Threshold" else "v_threshold"] - reset
        low = threshold[threshold <= 0]
        if low.size:
            raise InputError(
                where,
                "the threshold is not above the reset",
                measured=f"by {low[0]:g}",
                fix="Train with a threshold above v_reset, and above 0.",
            )
    made = Cuba.of(size, decay_u=stepping.decay_u, decay_v=stepping.decay_v, threshold=threshold, bias=bias)
    return made, scaled


def _spread(node: NirNode, name: str, size: int, where: str) -> FloatArray:
    values = node.array(name)
    if values.size == size:
        return np.asarray(values.reshape(-1), dtype=np.float64)
    if values.size == 1:
        return np.full(size, float(values.reshape(-1)[0]))
    raise InputError(
        where, f"{name} is not one number a neuron", measured=f"{values.shape} against {size}", fix="Give as many."
    )


def _lost(tau: FloatArray, dt: float, how: Discretisation, name: str, where: str) -> FloatArray:
    """Return the share that a time constant loses in a step."""
    if (tau <= 0).any():
        raise InputError(where, f"{name} must be above 0", measured=f"{tau.min():g}", fix="Correct it.")
    if how == "exact":
        return np.asarray(-np.expm1(-dt / tau))
    if (dt > tau * (1 + 1e-6)).any():
        raise InputError(
            where,
            f"{name} is shorter than a step",
            measured=f"{tau.min():g} s against {dt:g} s",
            fix="Give a smaller --dt, or --discretisation exact.",
        )
    return np.minimum(dt / tau, 1.0)


def _leaky(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    lost = _lost(p["tau"], dt, how, "tau", where)
    spike = p["r"] * (lost if how == "euler" else dt / p["tau"])
    return Stepping(np.ones_like(lost), lost, spike, p["r"] * lost)


def _integrating(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    return Stepping(np.ones_like(p["r"]), np.zeros_like(p["r"]), p["r"] * dt, p["r"] * dt)


def _current_based(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    tau_syn, tau_mem = p["tau_syn"], p["tau_mem"]
    u, v = (_lost(tau, dt, how, name, where) for tau, name in ((tau_syn, "tau_syn"), (tau_mem, "tau_mem")))
    gain = p["r"] * p.get("w_in", np.ones_like(u))
    return Stepping(u, v, gain * (u * v if how == "euler" else dt * _alpha(tau_syn, tau_mem, dt)), gain * v)


def _alpha(tau_syn: FloatArray, tau_mem: FloatArray, dt: float) -> FloatArray:
    """Return (exp(-dt / tau_mem) - exp(-dt / tau_syn)) / (tau_mem - tau_syn), and its limit for equal ones."""
    apart = tau_mem - tau_syn
    equal = np.abs(apart) < 1e-6 * tau_mem
    quotient = (np.exp(-dt / tau_mem) - np.exp(-dt / tau_syn)) / np.where(equal, 1.0, apart)
    return np.where(equal, dt / tau_mem**2 * np.exp(-dt / tau_mem), quotient)


def _comparing(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    one = np.ones_like(p["threshold"])
    return Stepping(one, one, one, one)


_STEPPING: dict[str, Callable[[dict[str, FloatArray], float, Discretisation, str], Stepping]] = {
    "LIF": _leaky,
    "LI": _leaky,
    "IF": _integrating,
    "CubaLIF": _current_based,
    "CubaLI": _current_based,
    "Threshold": _comparing,
}


def _unreached(signal: Signal, bias: FloatArray, stepping: Stepping) -> FloatArray:
    """Return thresholds that no input reaches: all excitation in every step, for ever, and the bias."""
    most = np.zeros(len(bias))
    for term in signal.terms:
        positive = matrix(term.weights, np.float64)
        most += np.asarray(positive.maximum(0).sum(axis=1)).reshape(-1)
    most += np.maximum(signal.constant, 0)
    reached = most / (stepping.decay_u * stepping.decay_v) + np.maximum(bias, 0) / stepping.decay_v
    return np.where(reached > 0, reached, 1.0) * _UNREACHED
