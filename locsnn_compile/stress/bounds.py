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
    all_spikes = {**lines, **spikes}
    batch, steps = all_spikes[population].shape[:2]
    states = {pair.exact.name: _Compartments(pair, batch, steps) for pair in numbers.groups}
    _deliver_all(numbers, states, all_spikes, steps)
    bounds = np.zeros((len(SOURCES), *spikes[population].shape))
    for step in range(steps):
        # Children come before their parents, so that a join reaches the parent in the same step.
        for state in states.values():
            state.update(step)
            parent = state.pair.exact.joined_to
            if parent is not None:
                states[parent].join(state)
        # Before the reset: the potential is what the threshold sees.
        bounds[:, :, step] = states[population].f
        for name, spikes_of_population in spikes.items():
            if name in states:
                states[name].reset(spikes_of_population[:, step].astype(np.bool_))
    return dict(zip(SOURCES, bounds, strict=True))


def _deliver_all(
    numbers: Numbers,
    states: Mapping[str, "_Compartments"],
    all_spikes: Mapping[str, ByteArray],
    steps: int,
) -> None:
    """Add the charges of all steps, and what their weights are off, to the compartments they reach.

    This can be done before the first step, because all spikes are given.
    """
    for pair in numbers.synapses:
        state = states[pair.exact.target]
        delay = pair.exact.delay
        # Later spikes arrive after the last step.
        arriving = all_spikes[pair.exact.source][:, : max(0, steps - 1 - delay)].astype(np.float64)
        weights_of_sums = (
            (state.charge, pair.exact.weights),
            # Weights are rounded, and before that scaled to make up for what decays gain or lose.
            (state.rounding[0], _apart(pair.chip, pair.exact_fitted)),
            (state.rounding[1], _apart(pair.exact_fitted, pair.exact.weights)),
        )
        for sums, weights in weights_of_sums:
            if weights.ndim == 1:  # weights (n,) connect neurons of the same number
                delivered = arriving * weights
            else:
                delivered = np.stack([recording @ weights.T for recording in arriving])
            sums[:, loihi.acts_at(0, delay) :] += delivered


class _Uncertain(Frozen, eq=False):
    """Float values (batch, n), and at most how far the chip is from them, (sources, batch, n)."""

    value: FloatArray
    error: FloatArray

    def __add__(self, other: "_Uncertain") -> "_Uncertain":
        return _Uncertain(self.value + other.value, self.error + other.error)

    def __gt__(self, threshold: FloatArray) -> BoolArray:
        return np.asarray(self.value > threshold)


class _Keep(Frozen, eq=False):
    """The share of a register that a decay keeps, in float (``exact``) and on the chip.

    ``cut`` is the most that the chip then cuts off toward zero.
    """

    exact: FloatArray
    chip: FloatArray
    cut: FloatArray


class _OnUncertain:
    """The operations of a step over float values that carry the bound of their error.

    ``hw_model.arithmetic.loihi`` writes the step of a compartment in terms of these operations, so that
    the bound follows the very step that the chip takes. Here no register wraps or clips.
    """

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
        """Return what a decay leaves of x: A e + |A - a| |x| + 1, as in the docstring of the module."""
        error = keep.chip * x.error
        error[SOURCES.index("decays")] += np.abs(keep.chip - keep.exact) * np.abs(x.value)
        # A register that is 0 on both sides has nothing to cut.
        may_be_nonzero = (x.value != 0) | x.error.any(axis=0)
        error[SOURCES.index("states")] += keep.cut * may_be_nonzero
        return _Uncertain(keep.exact * x.value, error)

    def clip(self, v: _Uncertain, low: float, high: float) -> _Uncertain:
        """Return v itself."""
        return v

    def select(self, condition: BoolArray, chosen: Any, otherwise: Any) -> Any:
        """Return ``chosen`` where the condition holds, ``otherwise`` elsewhere; a plain number has no error.

        At most one of both carries an error.
        """
        if isinstance(chosen, _Uncertain):
            # Swap them, so that only the other case is left below.
            return self.select(~condition, otherwise, chosen)
        if isinstance(otherwise, _Uncertain):
            value = np.where(condition, chosen, otherwise.value)
            return _Uncertain(value, np.where(condition, 0.0, otherwise.error))
        return np.where(condition, chosen, otherwise)


_OPERATIONS = _OnUncertain()


class _Compartments:
    """The registers of a group of compartments in floats, (batch, n), and the bounds of their errors.

    ``pair`` has the numbers of the group in float (``exact``) and on the chip.
    """

    def __init__(self, pair: GroupNumbers, batch: int, steps: int) -> None:
        self.pair = pair
        size = pair.exact.size
        self.charge = np.zeros((batch, steps, size))
        self.rounding = np.zeros((2, batch, steps, size))
        """By how much charges are off, because weights are rounded, and because of decays (see SOURCES)."""
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
        """Take a step up to the threshold: the spikes are given, so nothing is compared with it."""
        parameters = self._parameters
        error = np.zeros_like(self._at_rest.error)
        error[:2] = self.rounding[:, :, step]  # the sources "weights" and "decays"
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
    """Return the parameters of a group on both sides.

    Spikes are given and no register clips, so that the threshold and the limits are infinite.
    """
    exact = pair.exact
    chip = pair.chip
    # The bias is scaled like the weights to make up for what decays gain or lose, and then rounded.
    fitted_bias = exact.bias * pair.bias_ratio
    by_weights = np.abs(chip.bias - fitted_bias)
    by_decays = np.abs(fitted_bias - exact.bias)
    by_states = np.zeros(exact.size)
    bias_error = np.stack((by_weights, by_decays, by_states))  # in the order of SOURCES
    return Parameters(
        keep_u=_Keep(exact.keep_u, chip.keep_u, _cut(chip.keep_u)),
        keep_v=_Keep(exact.keep_v, chip.keep_v, _cut(chip.keep_v)),
        bias=_Uncertain(exact.bias, bias_error[:, None]),  # the same for the whole batch
        threshold=np.inf,
        refractory=exact.refractory,
        vmin=-np.inf,
        vmax=np.inf,
    )


def _cut(keep: FloatArray) -> FloatArray:
    """Return the most that a cut removes: 1, or 0 if all or nothing is kept."""
    cut: FloatArray = ((keep > 0) & (keep < 1)).astype(np.float64)
    return cut


def _apart(left: Matrix, right: Matrix) -> Matrix:
    """Return the absolute differences of two weight matrices with the same connections."""
    return with_values(left, np.abs(values_of(left) - values_of(right)))
