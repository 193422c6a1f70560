"""How far the chip's potential can be from the float one if no register wraps or clips: derived, not measured.

Take a float compartment and the chip's, driven by the same spikes, in units of the registers, with capital letters for
the chip's; a and b (float) and A and B (chip) are the shares that a decay keeps. Both take the step of
:mod:`hw_model.arithmetic.loihi`, here over values of which each carries its error. A cut toward zero removes less than
1, and nothing if A is 0 or 1. For the differences e = |U - u| and f = |V - v|

    e(t)  <=  A e(t-1)  +  |A - a| |u(t-1)|  +  |Q(t) - q(t)|  +  1
    f(t)  <=  B f(t-1)  +  |B - b| |v(t-1)|  +  e(t)  +  |BIAS - bias|  +  1

The recursion is linear, so every source of error has a part of its own: **weights** (each arriving spike adds the
rounding error of its weight, at most half a step of the grid, and so does the bias), **decays** (``|A - a|`` is at most
1/8192, and gains that compensate for it shift the weights) and **states** (the cuts). The last has a bound for all
time, whatever the input: ``e < 1 / (1 - A)`` and ``f < (1 / (1 - A) + 1) / (1 - B)``.
"""

from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.loihi import Parameters
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.projections import Matrix, values_of, with_values
from locsnn_compile.verification.error_budget.numbers import GroupNumbers, Numbers

Source = Literal["weights", "decays", "states"]
SOURCES: tuple[Source, ...] = get_args(Source)


def error_bound(
    numbers: Numbers,
    population: str,
    lines: Mapping[str, ByteArray],
    spikes: Mapping[str, ByteArray],
) -> dict[Source, FloatArray]:
    """Bound the error of a population's potential if ``lines`` and ``spikes`` (batch, steps, n), by name, are sent.

    The bound is the most that each source moves the potential, (batch, steps, n), in register units; they add up.
    ``numbers`` are those of both sides, with the same groups; a group that one side lacks is not bounded here.
    """
    spiking = {**lines, **spikes}
    batch, steps = spiking[population].shape[:2]
    states = {pair.exact.name: _Compartments(pair, batch, steps) for pair in numbers.groups}
    for pair in numbers.synapses:
        state, played, delay = (
            states[pair.exact.target],
            spiking[pair.exact.source],
            pair.exact.delay,
        )
        due = played[:, : max(0, steps - 1 - delay)].astype(np.float64)
        for into, matrix in (
            (state.charge, pair.exact.weights),
            (state.rounding[0], _apart(pair.chip, pair.exact_fitted)),
            (state.rounding[1], _apart(pair.exact_fitted, pair.exact.weights)),
        ):
            # Weights (n,) connect neurons of the same number.
            into[:, loihi.acts_at(0, delay) :] += (
                due * matrix if matrix.ndim == 1 else [sent @ matrix.T for sent in due]
            )
    found = np.zeros((len(SOURCES), *spikes[population].shape))
    for step in range(steps):
        for state in states.values():
            state.update(step)
            parent = state.pair.exact.joined_to
            if parent is not None:
                states[parent].join(state)
        found[:, :, step] = states[population].f
        for name, played in spikes.items():
            if name in states:
                states[name].reset(played[:, step].astype(np.bool_))
    return dict(zip(SOURCES, found, strict=True))


class _Uncertain(Frozen, eq=False):
    """Float values (batch, n), and at most how far the chip is from them, (sources, batch, n)."""

    value: FloatArray
    error: FloatArray

    def __add__(self, other: "_Uncertain") -> "_Uncertain":
        return _Uncertain(self.value + other.value, self.error + other.error)

    def __gt__(self, threshold: FloatArray) -> BoolArray:
        return np.asarray(self.value > threshold)


class _Keep(Frozen, eq=False):
    """The share that a decay keeps on both sides, and the most that the chip cuts off."""

    exact: FloatArray
    chip: FloatArray
    cut: FloatArray


class _OnUncertain:
    """The operations of a step where no register wraps or clips."""

    def wrap_charge(self, q: _Uncertain) -> _Uncertain:
        """Return q itself."""
        return q

    def wrap_current(self, u: _Uncertain) -> _Uncertain:
        """Return u itself."""
        return u

    def charged(self, q: _Uncertain) -> _Uncertain:
        """Return q itself: charges are in the unit of u."""
        return q

    def kept(self, x: _Uncertain, keep: _Keep) -> _Uncertain:
        """Return what is left of x; a register at rest on both sides has nothing to cut."""
        error = keep.chip * x.error
        error[SOURCES.index("decays")] += np.abs(keep.chip - keep.exact) * np.abs(x.value)
        moves = (x.value != 0) | x.error.any(axis=0)
        error[SOURCES.index("states")] += keep.cut * moves
        return _Uncertain(keep.exact * x.value, error)

    def clip(self, v: _Uncertain, low: float, high: float) -> _Uncertain:
        """Return v itself."""
        return v

    def select(self, condition: BoolArray, chosen: Any, otherwise: Any) -> Any:
        """Return one where the condition holds, and the other where not; a number has no error."""
        if isinstance(chosen, _Uncertain):
            return self.select(~condition, otherwise, chosen)
        if isinstance(otherwise, _Uncertain):
            value = np.where(condition, chosen, otherwise.value)
            return _Uncertain(value, np.where(condition, 0.0, otherwise.error))
        return np.where(condition, chosen, otherwise)


_OPERATIONS = _OnUncertain()


class _Compartments:
    """The registers of a group in floats, (batch, n), and the bounds of their errors."""

    def __init__(self, pair: GroupNumbers, batch: int, steps: int) -> None:
        self.pair = pair
        size = pair.exact.size
        self.charge = np.zeros((batch, steps, size))
        self.rounding = np.zeros((2, batch, steps, size))
        """Of charges: what their weights are off, by rounding and by decays."""
        self._at_rest = _Uncertain(np.zeros((batch, size)), np.zeros((len(SOURCES), batch, size)))
        self._u = self._at_rest
        self._v = self._at_rest
        self._joined = self._at_rest
        self._blocked: IntArray = np.zeros((batch, size), dtype=np.int64)
        self._parameters = _parameters(pair)

    @property
    def f(self) -> FloatArray:
        """The errors of v, (sources, batch, n)."""
        return self._v.error

    def update(self, step: int) -> None:
        """Take a step up to the threshold."""
        parameters = self._parameters
        error = np.zeros_like(self._at_rest.error)
        error[:2] = self.rounding[:, :, step]
        charge = _Uncertain(self.charge[:, step], error)
        response = loihi.respond(_OPERATIONS, parameters, self._u, self._v, charge, self._joined)
        self._u = response.u
        _, self._v, _ = loihi.threshold(_OPERATIONS, parameters, self._blocked, response.v)
        self._joined = self._at_rest

    def join(self, child: "_Compartments") -> None:
        """Add the voltage of a joined child, and its error, to the next step."""
        self._joined = self._joined + child._v

    def reset(self, fired: BoolArray) -> None:
        """Reset what spiked, equally on both sides, and count refractory steps."""
        self._v = loihi.reset(_OPERATIONS, self._v, fired)
        self._blocked = loihi.count_down(_OPERATIONS, self._parameters, self._blocked, fired)


def _parameters(pair: GroupNumbers) -> Parameters:
    """Return the parameters of a group on both sides; spikes are given, so that it needs no threshold."""
    exact, chip = pair.exact, pair.chip
    fitted = exact.bias * pair.bias_ratio
    bias_error = np.stack(
        (np.abs(chip.bias - fitted), np.abs(fitted - exact.bias), np.zeros(exact.size))
    )
    return Parameters(
        keep_u=_Keep(exact.keep_u, chip.keep_u, _cut(chip.keep_u)),
        keep_v=_Keep(exact.keep_v, chip.keep_v, _cut(chip.keep_v)),
        bias=_Uncertain(exact.bias, bias_error[:, None]),
        threshold=np.inf,
        refractory=exact.refractory,
        vmin=-np.inf,
        vmax=np.inf,
    )


def _cut(keep: FloatArray) -> FloatArray:
    """Return the most that a cut removes: 1, or 0 if all or nothing is kept."""
    cut: FloatArray = ((keep > 0) & (keep < 1)).astype(np.float64)
    return cut


def _apart(one: Matrix, other: Matrix) -> Matrix:
    """Return the absolute differences of two matrices with the same connections."""
    return with_values(one, np.abs(values_of(one) - values_of(other)))
