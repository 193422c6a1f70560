"""Neuron models of the first level, in float, as their authors think of them; on-grid ones are in ``on_grid``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic.fixed_point import IntArray
from hw_model.arithmetic.whole import whole_numbers

FloatArray = npt.NDArray[np.float64]
Number = TypeVar("Number", np.float64, np.int64)
Rule = Literal[">", ">="]


@dataclass(frozen=True)
class SrmAlpha:
    """A spike response neuron with alpha kernels; time constants in steps of its own axis.

        u(t) = sum over inputs j and their spikes s:  w_j * eps(t - s)   +   sum over own spikes f:  nu(t - f)
        eps(k) = (k / tau_sr) * exp(1 - k / tau_sr)
        nu(k) = -scale_ref * theta * (k / tau_ref) * exp(1 - k / tau_ref)            for k = 0, 1, 2, ...

    It spikes where ``u(t) >= theta``; there is no reset. Source: Kang et al., IJCNN 2022, after SLAYER's SRMALPHA. Of
    eps and nu only the first ``eps_taps`` and ``nu_taps`` values are there, that of k = 0 included: slayerPytorch ends
    its kernels where they become small. Lowering keeps the tails.
    """

    theta: float
    tau_sr: float
    tau_ref: float
    scale_ref: float
    eps_taps: float = math.inf
    nu_taps: float = math.inf


@dataclass(frozen=True, eq=False)
class Cuba:
    """Leaky integrate-and-fire neurons with a current; every parameter an array (n,), decays as fractions lost.

        i(t) = (1 - decay_u) * i(t - 1) + sum over inputs j and their spikes s = t - 1 - delay_j:  w_j
        v(t) = (1 - decay_v) * v(t - 1) + i(t) + bias

    It spikes where ``v(t)`` is above ``threshold`` (``rule`` ``>``), or at least that (``>=``); then v = 0, and stays
    so without a spike for ``refractory - 1`` steps; the current goes on. With ``decay_u`` 1 nothing of the current is
    kept: plain leaky integrate-and-fire (TLIF, LLIF); with ``decay_v`` 0 as well, integrate-and-fire.
    """

    decay_u: FloatArray
    decay_v: FloatArray
    threshold: FloatArray
    bias: FloatArray
    refractory: IntArray
    rule: Rule = ">"

    @classmethod
    def of(
        cls,
        size: int,
        *,
        decay_u: npt.ArrayLike = 1.0,
        decay_v: npt.ArrayLike,
        threshold: npt.ArrayLike,
        bias: npt.ArrayLike = 0.0,
        refractory: npt.ArrayLike = 1,
        rule: Rule = ">",
    ) -> Cuba:
        """Make ``size`` neurons; each parameter is one number for all, or an array (size,)."""
        u, v, theta, drive = (spread(value, size, np.float64) for value in (decay_u, decay_v, threshold, bias))
        return cls(u, v, theta, drive, spread(refractory, size, np.int64), rule)


@dataclass(frozen=True, eq=False)
class SoftCuba:
    """Like :class:`Cuba`, but a spike takes ``drop`` from the voltage, a step later, and leaves the rest.

        i(t) = (1 - decay_u) * i(t - 1) + sum over inputs j and their spikes s = t - 1 - delay_j:  w_j
        v(t) = (1 - decay_v) * v(t - 1) + i(t) - drop * (1 where it spiked at t - 1)

    It spikes where ``v(t) > threshold``. A reset by subtraction of the threshold, at once, is a drop of
    ``(1 - decay_v) * threshold``. Every parameter is an array (n,).
    """

    decay_u: FloatArray
    decay_v: FloatArray
    threshold: FloatArray
    drop: FloatArray


def spread(value: npt.ArrayLike, size: int, dtype: type[Number]) -> npt.NDArray[Number]:
    """Return a read-only array (size,) of a number or of as many numbers; integers must be whole."""
    given = whole_numbers(value) if issubclass(dtype, np.integer) else np.asarray(value, dtype=dtype)
    array = np.broadcast_to(given, (size,)).astype(dtype)
    array.setflags(write=False)
    return array
