"""Neurons whose every number is an integer that the chip holds.

``quantize`` makes them from float neurons. A network trained on the chip's own arithmetic has them from the start, and
keeps them as they are. Their compartments take the step of :mod:`hw_model.arithmetic.loihi`, with a current u, a
voltage v, and the charge q that arrives in a step. Weights, thresholds and biases count in *units* of 64 counts of a
register, which is the charge of a weight of 1. In the equations below,
``rz(x, d)`` is what a decay of d leaves of x: ``x (4096 - d) / 4096``, truncated toward zero. Every parameter of a
neuron is an int64 array (n,).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.values import ArrayLike, BoolArray, Frozen, IntArray, Shown
from locsnn_compile.network.neurons import Neuron, Parameter, spread
from locsnn_compile.network.projections import matrix

BIAS_PLACES = 4
"""Bits of magnitude of a bias mantissa (12, and a sign) beyond the 8 of a weight's mantissa."""


class ChipNeuron(Neuron, Frozen, eq=False):
    """Base of all neurons in the chip's integers.

    - ``decay_u``, ``decay_v``: the share of u and of v that is lost per step, in 4096ths
    - ``threshold``: the threshold's mantissa, as the chip stores it, in units
    """

    decay_u: IntArray
    decay_v: IntArray
    threshold: IntArray

    # Nothing is left to round: parameters and incoming weights are the chip's integers.
    on_grid = True

    @property
    def spikes_at(self) -> IntArray:
        """The value that v must exceed to spike, in counts of its register: 64 times the mantissa ``threshold``."""
        voltage: IntArray = loihi.threshold_of(self.threshold)
        return voltage

    @property
    def strategy(self) -> str:
        """The name of the layout in compartments; ``native`` for a single compartment."""
        return "native"

    @property
    def registers(self) -> dict[str, IntArray]:
        """Parameters of the soma other than decays and threshold, by the names of the fields of ``Compartments``."""
        return {}

    @property
    def has_floor(self) -> bool:
        """Whether the model has a lower limit of v, ``vmin``, other than the end of the register."""
        return self.limits != {}

    @property
    def limits(self) -> dict[str, IntArray]:
        """The limits of v that all compartments of a neuron have, by the names of the fields of ``Compartments``."""
        # A subclass may have no such field.
        vmin: IntArray | None = getattr(self, "vmin", None)
        return {} if vmin is None else {"vmin": vmin}

    @property
    def parts(self) -> dict[str, tuple[IntArray, IntArray]]:
        """The kinds of dendrites that a neuron has, each with its decays of u and v; inputs reach the first kind.

        Dendrites are compartments that pass their voltage to the soma. Without dendrites, inputs reach the soma.
        """
        return {}

    @property
    def own(self) -> "dict[str, Refractory]":
        """The self-synapses of a neuron, by the kind of dendrite that they reach."""
        return {}


class ChipCuba(Shown, ChipNeuron):
    """One compartment per neuron, with the chip's own reset: :func:`hw_model.arithmetic.loihi.step` says what it does.

    - ``bias_mantissa``, ``bias_exponent``: the bias is ``bias_mantissa * 2^bias_exponent`` counts of a register
    - ``refractory``: the least number of steps from a spike to the next
    - ``vmin``: the lower limit of v, of the form ``1 - 2^k``; None for the end of the register
    """

    bias_mantissa: IntArray
    bias_exponent: IntArray
    refractory: IntArray
    vmin: IntArray | None = None

    # Defaults of ``ChipCuba.of``.
    usual: ClassVar[Mapping[str, float]] = {"bias_mantissa": 0, "bias_exponent": 0, "refractory": 1}

    def with_biases(self, mantissas: IntArray, exponent: int) -> "ChipCuba":
        """Return these neurons with biases of ``mantissas * 2^exponent`` units.

        ``mantissas`` (n,) have 8 bits, as weights have. A bias counts in counts of a register, 64 of which are a unit,
        so a bias of ``mantissa * 2^exponent`` units is ``mantissa << (exponent + 6)``. As many of these places as fit
        go into the bias mantissa, which has :data:`BIAS_PLACES` more bits than a weight, and the others into the bias
        exponent, which cannot be negative.
        """
        places = loihi_inverse.bits_of_unit(exponent)
        mantissa_places = min(places, BIAS_PLACES)
        if mantissa_places >= 0:
            bias_mantissa = np.left_shift(mantissas, mantissa_places)
        else:
            # Below an exponent of -6, a mantissa has bits below one count of a register. They are cut off, rounding
            # toward minus infinity, as the charge of a weight is: 64 floor(mantissa 2^exponent).
            bias_mantissa = np.right_shift(mantissas, -mantissa_places)
        bias_exponent = integers(places - mantissa_places, len(mantissas))
        return replace(self, bias_mantissa=bias_mantissa, bias_exponent=bias_exponent)

    @property
    def biased(self) -> BoolArray:
        """Which neurons have a bias."""
        return np.asarray(self.bias_mantissa != 0)

    @property
    def registers(self) -> dict[str, IntArray]:
        """Bias and refractory steps."""
        return {
            "bias_mantissa": self.bias_mantissa,
            "bias_exponent": self.bias_exponent,
            "refractory": self.refractory,
        }


class HostCuba(ChipCuba):
    """Neurons of :class:`ChipCuba` that the host computes: their charge comes in float, in the unit of the registers.

    The charge is truncated toward zero, as lava-dl does before each step of integers. The weights onto them are floats,
    so they do not count as on the grid.
    """

    on_grid = False


class Refractory(Frozen, eq=False):
    """The self-synapses (*taps*) by which a neuron's own spikes inhibit it, as a refractory kernel does in float.

    Tap k has a ``delay[k]`` in steps and an ``exponent[k]``, both (taps,), and mantissas ``mantissa[k]``, (taps, n),
    -255..255, negative if a spike inhibits. Weights of equal delay add up. In step t, own spikes cause the charge

        q_own(t) = sum over taps k with a spike in step t - 1 - delay[k]:  64 floor(mantissa[k] 2^exponent[k])

    A *dendrite* is a compartment that never spikes and adds its voltage to the neuron's soma (:class:`ChipSrm`). With a
    ``decay`` (n,), the charge reaches a *refractory dendrite*, which has only these inputs; its current is s and its
    voltage r:

        s(t) = rz(s(t - 1), decay) + q_own(t)
        r(t) = rz(r(t - 1), decay) + s(t)

    Without a ``decay``, it reaches the *alpha dendrite*, next to the neuron's inputs.
    """

    delay: IntArray
    mantissa: IntArray
    exponent: IntArray
    decay: IntArray | None = None

    @classmethod
    def of(
        cls,
        size: int,
        mantissa: ArrayLike,
        exponent: ArrayLike,
        delay: ArrayLike = 0,
        refractory_decay: ArrayLike | None = None,
    ) -> "Refractory":
        """Make the taps of ``size`` neurons: one tap, or several (taps,), with mantissas (taps,) or (taps, size)."""
        delays = np.atleast_1d(delay)
        per_tap = np.atleast_1d(mantissa)
        if per_tap.ndim == 1:  # one mantissa for all neurons
            per_tap = per_tap[:, None]
        taps = len(delays)
        # A read-only int64 copy.
        mantissas = matrix(np.broadcast_to(per_tap, (taps, size)), np.int64)
        decay = None if refractory_decay is None else integers(refractory_decay, size)
        return cls(integers(delays, taps), mantissas, integers(exponent, taps), decay)

    def parameters(self, size: int) -> list[Parameter]:
        """Return the arrays whose shapes are checked, for ``size`` neurons.

        ``delay`` is not among them: its length says how many taps there are, which the other shapes must match.
        """
        taps = len(self.delay)
        of_taps = [
            Parameter("tap exponent", self.exponent, (taps,)),
            Parameter("tap mantissa", self.mantissa, (taps, size)),
        ]
        if self.decay is None:
            return of_taps
        return [Parameter("refractory decay", self.decay, (size,)), *of_taps]


class ChipSrm(Shown, ChipNeuron):
    """A spike response neuron, which is not reset: a soma without memory, to which dendrites add their voltages.

        u(t) = rz(u(t - 1), decay_u) + q(t)                  the alpha dendrite
        v(t) = rz(v(t - 1), decay_v) + u(t)
        potential(t) = v(t) + r(t)                           r of a refractory dendrite; without one, 0

    It spikes where its potential exceeds the threshold, as in :mod:`hw_model.arithmetic.loihi`; nothing is reset.
    Without a refractory dendrite, the charge of own spikes is part of ``q``. A ``vmin`` works as in :class:`ChipCuba`,
    in every compartment.

    If the voltage of one dendrite would be clipped too often, a neuron has several ``dendrites`` of each kind, all with
    the same decays. Every input weight is divided among the alpha dendrites, and own spikes reach every refractory
    dendrite with the same weight. The potential is the sum over all dendrites, so with d of each kind, the sum can be d
    times as large. The soma's register clips it, which changes no spike because the soma keeps nothing.
    """

    refractory: Refractory
    dendrites: int = 1
    vmin: IntArray | None = None

    @classmethod
    def with_taps(
        cls, size: int, *, decay: ArrayLike, threshold: ArrayLike, **taps: Any
    ) -> "ChipSrm":
        """Make ``size`` neurons with one decay, and taps as :meth:`Refractory.of` makes them."""
        return cls.of(
            size,
            decay_u=decay,
            decay_v=decay,
            threshold=threshold,
            refractory=Refractory.of(size, **taps),
        )

    @property
    def strategy(self) -> str:
        """The strategy that makes these compartments of a spike response neuron."""
        if self.refractory.decay is None:
            return "delay-line"
        return "dendrite" if self.dendrites == 1 else "paired-dendrite"

    @property
    def parts(self) -> dict[str, tuple[IntArray, IntArray]]:
        """The alpha dendrite, and the refractory dendrite if there is one."""
        kinds = {"dendrite": (self.decay_u, self.decay_v)}
        decay = self.refractory.decay
        if decay is not None:
            kinds["refractory"] = (decay, decay)
        return kinds

    @property
    def own(self) -> dict[str, Refractory]:
        """The self-synapses, onto the refractory dendrite if there is one, else onto the alpha dendrite."""
        kind = "dendrite" if self.refractory.decay is None else "refractory"
        return {kind: self.refractory}

    def parameters(self, size: int) -> list[Parameter]:
        """Return the arrays of the neuron and of its taps."""
        return super().parameters(size) + self.refractory.parameters(size)


def integers(value: ArrayLike, size: int) -> IntArray:
    """Return one integer, or ``size`` integers, as a read-only int64 array (size,)."""
    return spread(value, size, np.int64)
