"""Turn NIR's neurons, which are differential equations, into neurons that step, and the input that drives them.

With a step of dt, an input spike is a current of 1 for that step. There are three discretisations:

``euler`` (the default, as in snnTorch, norse and NIR's own papers): a time constant tau loses ``dt / tau`` per step.

    I(t) = I(t - 1) + dt / tau_syn * (w_in * x(t) - I(t - 1))
    v(t) = v(t - 1) + dt / tau_mem * (v_leak - v(t - 1) + r * I(t))

``exact``: a time constant loses ``1 - exp(-dt / tau)``, and the charge of a spike, ``dt``, arrives at
the start of its step. Between two spikes of the neuron, v is then the solution of the equation at the
end of every step, with and without a synaptic current.

``hold``: the same, except that input is held for its step, so the share that is lost of the state is replaced by the
same share of the input.

    I(t) = exp(-dt / tau_syn) * I(t - 1) + (1 - exp(-dt / tau_syn)) * w_in * x(t)         and v(t) in the same way

Neurons start at rest, at v_leak, and an IF at v_reset. With a reset to a value, potentials are counted from v_reset, so
that the chip's reset to 0 is NIR's; with a reset by subtraction, from v_leak. A constant input (a bias) comes from a
neuron that spikes in every step, so that it begins with the first step of input that its layer sees, as in a framework.
If the rest potential is not the reset value, a neuron that spikes once, in the first step, adds the difference. Neurons
whose rest is at their threshold or above spike without input: their rest then becomes a constant input.

A reset by subtraction takes the threshold from the potential at once (``subtract``), or in the next step, after the
decay (``late-subtract``). A membrane without synaptic current then becomes the chip's current, which no spike resets,
and a synapse from each neuron to itself takes the threshold; a membrane with a current becomes a :class:`SoftCuba`.
``late-zero`` holds the potential at the reset value for the step after a spike. Neurons without a reset (``none``)
are like those with a reset by subtraction, except that a spike takes nothing.

With a floor, the potential of neurons that have a memory and spike is raised to the floor at the end of every step in
which it would be lower, as with ``min_v_mem`` of sinabs. A current has no floor, so a membrane from which a spike
subtracts is then a :class:`SoftCuba` even without a synaptic current.
"""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import InputError, counted
from locsnn_compile.frontends.nir.flat import READOUTS, FlatGraph
from locsnn_compile.frontends.nir.graph import NirNode
from locsnn_compile.frontends.nir.signals import Signal
from locsnn_compile.network.neurons import Cuba, Rule, SoftCuba
from locsnn_compile.network.projections import matrix, row_sums

Discretisation = Literal["euler", "exact", "hold"]
Reset = Literal["zero", "subtract", "late-zero", "late-subtract", "none"]

_UNREACHED = 1.1
"""The threshold of a neuron that never spikes, as a multiple of the potential that its inputs can reach.

A tenth more leaves room for the rounding of weights, which may enlarge their sum.
"""
_ROUNDED_DT = 1e-6
"""A step and a time constant that differ by this share are equal: both are decimal fractions, rounded to floats."""
_EQUAL_TAUS = 1e-6
"""Time constants that differ by this share count as equal: the difference of their exponentials would be rounding."""
DT_SECONDS = 1e-4
"""The conventional step: NIR files do not contain one."""
# Which kinds of nodes depend on what a file does not state:
_IN_SECONDS = ("IF", "LIF", "CubaLIF", "LI", "CubaLI", "Delay")
_WITH_TAU = ("LIF", "CubaLIF", "LI", "CubaLI")
_WITH_RESET = ("IF", "LIF", "CubaLIF")
WITH_FLOOR = _WITH_RESET
"""The kinds of nodes whose neurons get a floor: all others do not spike, or have no memory."""


class _Assumption(Frozen):
    """A fact that graphs do not state: the kinds of nodes that depend on it, and a sentence about the assumption.

    The sentence goes on after "The NIR graph does not say".
    """

    kinds: tuple[str, ...]
    sentence: str


_STEP = _Assumption(
    _IN_SECONDS,
    f"how long a step is: its constants were read in steps of {DT_SECONDS:g} s, the convention (--dt).",
)
_RESET = _Assumption(
    _WITH_RESET, "how a spike resets: its potential goes to v_reset at once (--reset zero)."
)
_DISCRETISATION = _Assumption(
    _WITH_TAU, "how its equations become steps: by Euler's method (--discretisation euler)."
)


class Stepping(Frozen, eq=False):
    """The equation of a node as steps: all (n,).

    - ``decay_u`` and ``decay_v``: the shares that current and potential lose per step
    - ``spike``: what a spike of weight 1 adds to the current
    - ``constant``: what a constant input of 1 adds per step, once the current has settled
    """

    decay_u: FloatArray
    decay_v: FloatArray
    spike: FloatArray
    constant: FloatArray


class Reading(Frozen):
    """How the neurons of a graph are read: the seconds per step ``dt``, and facts that the file does not state.

    ``floor`` is the lowest potential, in the unit of ``v_threshold``; None: there is no floor. With ``rule`` ">", a
    neuron spikes above its threshold, with ">=" also at it; a :class:`SoftCuba` always spikes above it.
    """

    dt: float
    discretisation: Discretisation
    reset: Reset
    floor: float | None = None
    rule: Rule = ">"


class NirNeurons(Frozen, eq=False):
    """The neurons of a node, and the signal that drives them, in units of their potential.

    - ``reset_charge`` (n,): the charge that a spike takes in the next step, by a synapse of the neuron onto itself
    - ``start_potential`` (n,): the potential before any input
    - ``driven_rest`` (n,): the rest of neurons that spike without input, at which the constant of the signal holds
      them; 0 for all other neurons
    """

    neuron: Cuba | SoftCuba
    signal: Signal
    reset_charge: FloatArray
    start_potential: FloatArray
    driven_rest: FloatArray


def neurons_of(
    node: NirNode, signal: Signal, size: int, reading: Reading, where: str
) -> NirNeurons:
    """Return the neurons of a node, driven by a signal."""
    values = {name: node.each(name, size, of="neuron", where=where) for name in node.parameters}
    stepping = _STEPPING[node.kind](values, reading.dt, reading.discretisation, where)
    reset_to = values.get("v_reset", np.zeros(size))
    leak = values.get("v_leak", reset_to)
    # A current that receives decay_u of this in every step settles at the value of the constant.
    scaled = signal.scaled(stepping.spike, stepping.constant * stepping.decay_u)
    if node.kind in READOUTS:
        return _read_out(scaled, stepping, leak, where)
    reset = reading.reset
    lowest = None
    if node.kind == "Threshold":
        # It has no memory, so any reset is the same.
        reset = "zero"
        limit = values["threshold"]
    else:
        limit = values["v_threshold"]
        lowest = _floor_above(reading.floor, {"v_reset": reset_to, "v_leak": leak}, where)
    subtracts = reset in ("subtract", "late-subtract", "none")
    # The potential of the file that is 0 on the chip.
    zero = leak if subtracts else reset_to
    floor = None if lowest is None else lowest - zero
    _check_threshold(limit, zero, "v_leak, where it starts" if subtracts else "the reset", where)
    zeros = np.zeros(size)
    if not subtracts:
        rest = leak - zero
        spikes_without_input = leak >= limit
        # These neurons would spike before their layer's first step of input, if a bias held them at rest.
        driven_rest = np.where(spikes_without_input, rest, 0.0)
        bias = stepping.decay_v * (rest - driven_rest)
        neurons = Cuba.of(
            size,
            decay_u=stepping.decay_u,
            decay_v=stepping.decay_v,
            threshold=limit - zero,
            bias=bias,
            # late-zero: the step of the spike, and one more at the reset value.
            refractory=2 if reset == "late-zero" else 1,
            rule=reading.rule,
            floor=floor,
        )
        return NirNeurons(
            neurons,
            scaled.plus(stepping.decay_u * stepping.decay_v * driven_rest),
            reset_charge=zeros,
            start_potential=rest - driven_rest,
            driven_rest=driven_rest,
        )
    drop = _drop(reset, limit - reset_to, stepping.decay_v)
    has_current = (stepping.decay_u < 1).any()
    if floor is None and not has_current:
        # The chip's current takes the place of the membrane, because no spike resets it. The chip's voltage keeps
        # nothing (decay_v 1), so it equals the current, and is compared with the threshold.
        membrane = Cuba.of(
            size,
            decay_u=stepping.decay_v,
            decay_v=1.0,
            threshold=limit - zero,
            rule=reading.rule,
        )
        return NirNeurons(
            membrane, scaled, reset_charge=drop, start_potential=zeros, driven_rest=zeros
        )
    soft_neurons = SoftCuba(
        decay_u=stepping.decay_u,
        decay_v=stepping.decay_v,
        threshold=limit - zero,
        drop=drop,
        floor=floor,
    )
    return NirNeurons(
        soft_neurons, scaled, reset_charge=zeros, start_potential=zeros, driven_rest=zeros
    )


def _floor_above(
    floor: float | None, starts: Mapping[str, FloatArray], where: str
) -> FloatArray | None:
    """Return the floor of every neuron, (n,).

    ``starts`` are the values (n,) at which potentials start, by the name of their parameter. Raises ``InputError``
    for a floor above one of them.
    """
    if floor is None:
        return None
    for name, values in starts.items():
        if floor > values.min():
            measured = f"{floor:g} against {values.min():g}"
            fix = f"Give a --floor of {values.min():g} or below."
            raise InputError(where, f"the floor is above {name}", measured=measured, fix=fix)
    return np.full(len(starts["v_reset"]), floor)


def _drop(reset: Reset, height: FloatArray, decay_v: FloatArray) -> FloatArray:
    """Return what a spike takes from the potential of the next step, (n,).

    ``height`` (n,) is the threshold above the reset value. ``late-subtract`` takes it after the decay
    of the next step, ``subtract`` at once, so that it decays until then.
    """
    if reset == "none":
        return np.zeros_like(height)
    if reset == "late-subtract":
        return height
    return height * (1 - decay_v)


def _read_out(signal: Signal, stepping: Stepping, leak: FloatArray, where: str) -> NirNeurons:
    """Return neurons that never spike, and whose potentials are read out.

    All have the same threshold, and so the same scale on the chip, because their potentials are compared. Potentials
    are counted from v_leak if all neurons have the same, which does not change the comparison, and else from 0.
    """
    if (stepping.decay_v == 0).any():
        raise InputError(
            where, "a readout without leak overflows every register", fix="Give it a tau."
        )
    size = len(leak)
    # The rest potential, as it is counted.
    rest = leak
    if (leak == leak[0]).all():
        rest = np.zeros(size)
    bias = stepping.decay_v * rest
    threshold = np.full(size, _unreached(signal, bias, stepping).max())
    neurons = Cuba.of(
        size, decay_u=stepping.decay_u, decay_v=stepping.decay_v, threshold=threshold, bias=bias
    )
    zeros = np.zeros(size)
    return NirNeurons(neurons, signal, reset_charge=zeros, start_potential=rest, driven_rest=zeros)


def _check_threshold(limit: FloatArray, zero: FloatArray, name: str, where: str) -> None:
    """Raise ``InputError`` for a threshold that is not above the potential ``zero``, called ``name`` in the error."""
    above = limit - zero
    if (above <= 0).any():
        fix = "Train with a threshold above v_reset and v_leak, and above 0."
        raise InputError(
            where,
            f"the threshold is not above {name}",
            measured=f"by {above[above <= 0][0]:g}",
            fix=fix,
        )


def _lost(tau: FloatArray, dt: float, how: Discretisation, name: str, where: str) -> FloatArray:
    """Return the share that a time constant loses per step, (n,).

    Raises ``InputError`` for one that is not above 0 or, with Euler's method, is shorter than a step.
    """
    if (tau <= 0).any():
        raise InputError(
            where, f"{name} must be above 0", measured=f"{tau.min():g}", fix="Correct it."
        )
    if how != "euler":
        return np.asarray(-np.expm1(-dt / tau))
    if (dt > tau * (1 + _ROUNDED_DT)).any():
        fix = "Give a smaller --dt, or --discretisation exact or hold."
        raise InputError(
            where,
            f"{name} is shorter than a step",
            measured=f"{tau.min():g} s against {dt:g} s",
            fix=fix,
        )
    # A step that equals the time constant may be larger by a rounding error.
    return np.minimum(dt / tau, 1.0)


def _leaky(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    """Return the steps of a LIF or LI node, which has no synaptic current."""
    lost = _lost(p["tau"], dt, how, "tau", where)
    settled = _gain(p["r"], lost, where)
    spike = settled
    if how == "exact":
        # The charge arrives at the start of the step and decays until its end.
        charge = dt / p["tau"] * np.exp(-dt / p["tau"])
        spike = _gain(p["r"], charge, where)
    return Stepping(decay_u=np.ones_like(lost), decay_v=lost, spike=spike, constant=settled)


def _integrating(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    """Return the steps of an IF node; in frameworks, r = 1 means that a spike adds its weight, whatever the step is."""
    gain = np.where(p["r"] == 1, 1.0, p["r"] * dt)
    no_current = np.ones_like(gain)
    no_leak = np.zeros_like(gain)
    return Stepping(decay_u=no_current, decay_v=no_leak, spike=gain, constant=gain)


def integration_assumptions(flat: FlatGraph, known_dt: float | None, where: str) -> tuple[str, ...]:
    """Return a sentence about what a spike adds, for each IF node where that is open to question.

    It is clear with r = 1, by which frameworks mean that a spike adds its weight, and with r = 1 / dt, by which the
    equation has the same result. Any other r needs the step in which the constants of the file are counted. Raises
    ``InputError`` if the step is unknown.
    """
    sentences = []
    for name in flat.named("IF"):
        size = flat.size(name)
        place = f"{where}, node {name!r}"
        resistance = flat.nodes[name].each("r", size, of="neuron", where=place)
        dt = DT_SECONDS if known_dt is None else known_dt
        # The tolerance is for values that files hold as float32.
        adds_weight = (resistance == 1) | np.isclose(resistance * dt, 1.0, rtol=1e-6)
        if adds_weight.all():
            continue
        if known_dt is None:
            measured = f"r {resistance[~adds_weight][0]:g}"
            what = "r is neither 1 nor 1 / dt, so what a spike adds is not known"
            fix = "Give --dt: a spike then adds r * dt times its weight."
            raise InputError(place, what, measured=measured, fix=fix)
        sentences.append(_what_spikes_add(name, resistance, dt))
    return tuple(sentences)


_RESISTANCES_LISTED = 4
"""Largest number of values of r that a sentence lists."""


def _what_spikes_add(name: str, resistance: FloatArray, dt: float) -> str:
    """Return a sentence about what a spike adds to the neurons of an IF node, by their ``resistance`` (n,)."""
    parts = []
    values = np.unique(resistance)
    for r in values[:_RESISTANCES_LISTED].tolist():
        neurons = np.flatnonzero(resistance == r)
        which = f"neuron {neurons[0]}" if len(neurons) == 1 else counted(len(neurons), "neuron")
        adds = "its whole weight" if r == 1 else f"{r * dt:g} of its weight (r * dt)"
        parts.append(f"{adds} where r is {r:g} ({which})")
    if len(values) > _RESISTANCES_LISTED:
        parts.append("r * dt of its weight in the others")
    return f"In IF node {name!r}, a spike adds {', '.join(parts)}."


def _current_based(
    p: dict[str, FloatArray], dt: float, how: Discretisation, where: str
) -> Stepping:
    """Return the steps of a CubaLIF or CubaLI node, which has a synaptic current."""
    tau_syn = p["tau_syn"]
    tau_mem = p["tau_mem"]
    decay_u = _lost(tau_syn, dt, how, "tau_syn", where)
    decay_v = _lost(tau_mem, dt, how, "tau_mem", where)
    w_in = p.get("w_in", np.ones_like(decay_u))
    settled = _gain(p["r"], decay_v, where) * w_in
    if how == "exact":
        spike = p["r"] * w_in * dt * _alpha(tau_syn, tau_mem, dt)
    else:
        spike = settled * decay_u
    return Stepping(decay_u, decay_v, spike=spike, constant=settled)


def _gain(r: FloatArray, share: FloatArray, where: str) -> FloatArray:
    """Return ``r * share``, what a membrane takes of its input, (n,).

    An infinite r comes with an infinite tau, and so with a share of 0, for neurons that do not leak. Their product
    stands for 1: a spike adds its weight, as with r = tau (:mod:`locsnn_compile.frontends.torch_layers.neurons`).
    """
    infinite = np.isinf(r)
    if (infinite & (share > 0)).any() or (r == -np.inf).any():
        raise InputError(where, "r is infinite, and its tau is not", fix="Give both as numbers.")
    finite_r = np.where(infinite, 1.0, r)
    return np.where(infinite, 1.0, finite_r * share)


def _alpha(tau_syn: FloatArray, tau_mem: FloatArray, dt: float) -> FloatArray:
    """Return (exp(-dt / tau_mem) - exp(-dt / tau_syn)) / (tau_mem - tau_syn), and its limit for equal ones."""
    difference = tau_mem - tau_syn
    equal = np.abs(difference) < _EQUAL_TAUS * tau_mem
    divisor = np.where(equal, 1.0, difference)
    quotient = (np.exp(-dt / tau_mem) - np.exp(-dt / tau_syn)) / divisor
    return np.where(equal, dt / tau_mem**2 * np.exp(-dt / tau_mem), quotient)


def _comparing(p: dict[str, FloatArray], dt: float, how: Discretisation, where: str) -> Stepping:
    """Return the steps of a Threshold node, which compares the input of a step with a threshold and keeps nothing."""
    one = np.ones_like(p["threshold"])
    return Stepping(decay_u=one, decay_v=one, spike=one, constant=one)


_STEPPING: dict[str, Callable[[dict[str, FloatArray], float, Discretisation, str], Stepping]] = {
    "LIF": _leaky,
    "LI": _leaky,
    "IF": _integrating,
    "CubaLIF": _current_based,
    "CubaLI": _current_based,
    "Threshold": _comparing,
}


def _unreached(signal: Signal, bias: FloatArray, stepping: Stepping) -> FloatArray:
    """Return thresholds (n,) that no potential reaches, up or down.

    They are above the potential at which a neuron settles if all inputs of one sign spike in every step.
    """
    largest_input = np.zeros(signal.size)
    for onset in signal.constants:
        largest_input = largest_input + np.abs(onset.values)
    largest_input = largest_input + np.sum(
        [row_sums(matrix(term.weights, np.float64)) for term in signal.terms], axis=0
    )
    # A constant input of 1 settles at 1 / (decay_u * decay_v), and a bias of 1 at 1 / decay_v. The start at
    # rest is another bias / decay_v, which fades.
    from_input = largest_input / (stepping.decay_u * stepping.decay_v)
    from_bias_and_start = 2 * np.abs(bias) / stepping.decay_v
    reached = from_input + from_bias_and_start
    # Neurons without any input get a threshold above 0 as well.
    return np.where(reached > 0, reached, 1.0) * _UNREACHED


def nir_assumptions(
    flat: FlatGraph, *, dt: float | None, reset: str | None, discretisation: str | None
) -> tuple[str, ...]:
    """Return a sentence for each of step, reset and discretisation that is None although nodes depend on it."""
    sentences = []
    for option, assumption in ((dt, _STEP), (reset, _RESET), (discretisation, _DISCRETISATION)):
        if option is None and flat.named(*assumption.kinds):
            sentences.append(f"The NIR graph does not say {assumption.sentence}")
    return tuple(sentences)
