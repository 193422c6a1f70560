"""The base of all neuron models, and the models in float, as their authors think of them.

A model is a frozen dataclass that derives from :class:`Neuron`; it may come from outside this package. The class has
the facts about the model. What the model does is registered with the function that needs it (``singledispatch``), each
in its own package: its steps with ``reference.evaluate.steps_of``, its integers with ``passes.quantize.integers_of``,
and its text with ``network.text.neuron_text``.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeVar, get_type_hints

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic.whole import whole_numbers
from hw_model.errors import InputError, check_known, check_range
from hw_model.io.arguments import as_array, checked
from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, Must, between
from hw_model.io.records import POSITIVE as POSITIVE
from hw_model.values import (
    AnyArray,
    ArrayLike,
    BoolArray,
    FloatArray,
    Frozen,
    IntArray,
    Shown,
    sealed,
)

Number = TypeVar("Number", np.float64, np.int64)
Rule = Literal[">", ">="]
"""How a potential is compared with the threshold."""

SMALLEST = 0.01
"""slayerPytorch ends a kernel at the first lag beyond tau whose magnitude is below this."""
MAX_TAPS = 100_000
"""Largest number of values of a kernel, chosen by hand to bound memory."""
MAX_NEURONS = 10_000_000
"""Largest size of a population, as for programs (``MAX_LINES``)."""
_ARRAYS: dict[Any, Any] = {
    FloatArray: np.float64,
    FloatArray | None: np.float64,
    IntArray: np.int64,
    IntArray | None: np.int64,
}
"""The type of the numbers of a parameter that is an array, by its annotation."""


Musts = Mapping[str, Must]
"""The rule that the numbers of a parameter must keep, by the name of the parameter."""
FRACTION = Must(lambda v: (v >= 0) & (v <= 1), "a fraction from 0 to 1")
TAPS = between(1, MAX_TAPS)
FINITE = Must(np.isfinite, "a finite number")
NOT_ABOVE_RESET = Must(lambda v: v <= 0, "0, to which a spike resets, or below")


class Parameter(NamedTuple):
    """A parameter of some neurons, for checks and text.

    ``values`` have the ``shape`` or are one number for all. ``must`` is the rule of each number, if it has one.
    """

    name: str
    values: AnyArray
    shape: tuple[int, ...]
    must: Must | None = None


class Neuron(ABC):
    """Neurons of one model, with all parameters."""

    on_grid: ClassVar[bool] = False
    """Whether its parameters and incoming weights are already the chip's integers."""
    by_strategy: ClassVar[bool] = False
    """Whether there are several ways to lay it out on a chip."""
    musts: ClassVar[Musts] = {}
    """The rules of its parameters; those of integers depend on the target chip, which is checked later."""
    needs: ClassVar[str] = ""
    """What a chip must have for this model, as words of an error; empty: neurons of the model's own name."""
    way_out: ClassVar[str] = "Use neurons that the chip has: SrmAlpha, Cuba or SoftCuba."
    """The advice of that error."""
    usual: ClassVar[Mapping[str, float]] = {}
    """Default values of parameters in :meth:`of`."""
    dendrites: int = 1
    """Dendrites of a kind that each neuron has; projections name the dendrite that they reach."""

    @classmethod
    @checked
    def of(cls, size: int, **given: Any) -> Self:
        """Make ``size`` neurons; each parameter is one number for all, or an array (size,).

        Raises ``InputError`` for an unknown parameter, and for a missing one.
        """
        check_range(size, 1, MAX_NEURONS, "size")
        hints = get_type_hints(cls)
        # The numpy type of each parameter, None if it is not an array.
        dtypes = {item.name: _ARRAYS.get(hints[item.name]) for item in fields(cls)}  # type: ignore[arg-type]
        optional = {item.name: None for item in fields(cls) if item.default is None}  # type: ignore[arg-type]
        values = {**optional, **cls.usual, **given}
        where = f"{cls.__name__}.of"
        missing = [name for name in dtypes if dtypes[name] and name not in values]
        # Unknown names come first: a misspelled parameter is also a missing one.
        for name in values:
            check_known(where, f"there is no parameter {name!r}", name, dtypes)
        if missing:
            raise InputError(
                where, f"parameter {missing[0]!r} is missing", fix="Give it by its name."
            )
        parameters: dict[str, Any] = {}
        for name, value in values.items():
            dtype = dtypes[name]
            is_left_out = value is None and name in optional
            if dtype is None or is_left_out:
                parameters[name] = value
            else:
                parameters[name] = spread(value, size, dtype)
        return cls(**parameters)

    def whole(self) -> "Neuron":
        """Return the neurons with whole kernels, if they have kernels."""
        return self

    def cut(self) -> "Neuron":
        """Return the neurons with kernels cut like slayerPytorch's, if they have kernels."""
        return self

    @property
    @abstractmethod
    def spikes_at(self) -> ArrayLike:
        """The threshold of a neuron at rest, in the unit of its potential: one for all, or (n,)."""

    @property
    def biased(self) -> BoolArray:
        """Which neurons have a bias: one value for all, or (n,)."""
        return np.array(False)

    @property
    def has_floor(self) -> bool:
        """Whether its potential stops falling at some value."""
        return False

    def parameters(self, size: int) -> list[Parameter]:
        """Return the parameters that are arrays, and the single numbers that have rules."""
        return [
            Parameter(name, np.asarray(values), (size,), self.musts.get(name))
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray) or (name in self.musts and values is not None)
        ]


class SrmAlpha(Neuron, Frozen):
    """A spike response neuron with alpha kernels; time constants in steps of its own axis.

        u(t) = sum over inputs j and their spikes s:  w_j * eps(t - s)   +   sum over own spikes f:  nu(t - f)
        eps(k) = (k / tau_sr) * exp(1 - k / tau_sr)
        nu(k) = -scale_ref * theta * (k / tau_ref) * exp(1 - k / tau_ref)            for k = 0, 1, 2, ...

    It spikes where ``u(t) >= theta``; there is no reset. Source: Kang et al., IJCNN 2022, after SLAYER's SRMALPHA. Only
    the first ``eps_taps`` values of eps and ``nu_taps`` values of nu exist, counting k = 0: slayerPytorch ends its
    kernels where they become small. The chip's filters cannot end a kernel, so lowering keeps the tails.
    """

    theta: float
    tau_sr: float
    tau_ref: float
    scale_ref: float
    eps_taps: float = math.inf
    nu_taps: float = math.inf

    by_strategy = True
    musts: ClassVar[Musts] = {
        **dict.fromkeys(("theta", "tau_sr", "tau_ref"), POSITIVE),
        "scale_ref": NOT_NEGATIVE,
        "eps_taps": TAPS,
        "nu_taps": TAPS,
    }

    @property
    def spikes_at(self) -> float:
        """``theta``."""
        return self.theta

    def whole(self) -> "SrmAlpha":
        """Return the neurons with whole kernels."""
        return replace(self, eps_taps=math.inf, nu_taps=math.inf)

    def cut(self) -> "SrmAlpha":
        """Return the neurons with kernels cut like slayerPytorch's."""
        eps = alpha_taps(self.tau_sr, 1.0)
        nu = alpha_taps(self.tau_ref, -self.scale_ref * self.theta)
        return replace(self, eps_taps=len(eps), nu_taps=len(nu))


class Leaky(Neuron, Frozen, eq=False):
    """Base of all leaky integrate-and-fire neurons."""

    decay_u: FloatArray
    decay_v: FloatArray
    threshold: FloatArray

    musts: ClassVar[Musts] = {"decay_u": FRACTION, "decay_v": FRACTION, "threshold": POSITIVE}

    @property
    def spikes_at(self) -> FloatArray:
        """``threshold``."""
        return self.threshold

    @property
    def has_floor(self) -> bool:
        """Whether there is a ``floor``; models outside this package need not have such a field."""
        return getattr(self, "floor", None) is not None


class Cuba(Shown, Leaky):
    """Leaky integrate-and-fire neurons with a current. Every parameter is an array (n,); decays are fractions lost.

        i(t) = (1 - decay_u) * i(t - 1) + sum over inputs j and their spikes s = t - 1 - delay_j:  w_j
        v(t) = (1 - decay_v) * v(t - 1) + i(t) + bias

    It spikes where ``v(t) > threshold``, or ``>=``, by its ``rule``. Then v = 0, and it stays 0 without a spike for
    ``refractory - 1`` steps, while the current continues. With ``decay_u`` 1, nothing of the current is kept: plain
    leaky integrate-and-fire (TLIF, LLIF). With ``decay_v`` 0 as well, it is integrate-and-fire.

    With a ``floor`` (n,), 0 or below, ``v(t)`` is the floor where it would be lower.
    """

    bias: FloatArray
    refractory: IntArray
    rule: Rule = ">"
    floor: FloatArray | None = None

    musts: ClassVar[Musts] = {
        **Leaky.musts,
        "bias": FINITE,
        "refractory": AT_LEAST_ONE,
        "floor": NOT_ABOVE_RESET,
    }
    usual: ClassVar[Mapping[str, float]] = {"decay_u": 1.0, "bias": 0.0, "refractory": 1}

    @property
    def biased(self) -> BoolArray:
        """Which neurons have a bias."""
        return np.asarray(self.bias != 0)


class SoftCuba(Shown, Leaky):
    """Like :class:`Cuba`, but a spike only takes ``drop`` from the voltage, one step later.

        i(t) = (1 - decay_u) * i(t - 1) + sum over inputs j and their spikes s = t - 1 - delay_j:  w_j
        v(t) = (1 - decay_v) * v(t - 1) + i(t) - drop * (1 where it spiked at t - 1)

    It spikes where ``v(t) > threshold``. Frameworks that subtract the threshold in the step of the spike itself let
    what they subtract decay once until the next step; that is a drop of ``(1 - decay_v) * threshold``. Every parameter
    is an array (n,). A ``floor`` works as in :class:`Cuba`.
    """

    drop: FloatArray
    floor: FloatArray | None = None

    musts: ClassVar[Musts] = {**Leaky.musts, "drop": NOT_NEGATIVE, "floor": NOT_ABOVE_RESET}


def alpha_recursion(tau: float, factor: float = 1.0) -> tuple[float, float]:
    """Return ``a`` and ``c`` of the kernel ``factor * (k / tau) * exp(1 - k / tau) = c * k * a^(k - 1)``.

    In this form, two first-order filters in a row compute the kernel.
    """
    a = math.exp(-1.0 / tau)
    return a, factor * math.e * a / tau


@lru_cache(maxsize=8)
def alpha_taps(tau: float, factor: float, steps: int = MAX_TAPS) -> FloatArray:
    """Return the taps that slayerPytorch keeps of ``factor * k / tau * exp(1 - k / tau)``, k from 0."""
    k = np.arange(min(steps, MAX_TAPS))
    values = np.asarray(factor * k / tau * np.exp(1 - k / tau), dtype=np.float64)
    small = np.flatnonzero((np.abs(values) < SMALLEST) & (k > tau))
    return sealed(values[: small[0]].copy() if small.size else values)


def spread(value: ArrayLike, size: int, dtype: type[Number]) -> npt.NDArray[Number]:
    """Return one number, or ``size`` numbers, as a read-only array (size,); integers must be whole."""
    array = as_array("neurons, a parameter", value)
    if array.dtype.kind not in "biuf":
        raise InputError(
            "neurons", "a parameter is not a number", measured=str(array.dtype), fix="Give numbers."
        )
    numbers = whole_numbers(array) if issubclass(dtype, np.integer) else array
    if numbers.shape not in ((), (1,), (size,)):
        measured, fix = f"{numbers.shape} against ({size},)", "Give one number per neuron."
        raise InputError("neurons", "a parameter has the wrong shape", measured=measured, fix=fix)
    return sealed(np.broadcast_to(numbers, (size,)).astype(dtype))
