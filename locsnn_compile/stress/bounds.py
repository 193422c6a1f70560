"""How far the chip's potential can be from the float one if no register wraps or clips: derived, not measured.

Take a float compartment and the chip's, driven by the same spikes, in units of the registers. Capital letters are the
chip's; a and b (float) and A and B (chip) are what a decay keeps:

    u(t) = a u(t-1) + q(t)                     U(t) = cut(A U(t-1)) + Q(t)
    v(t) = b v(t-1) + u(t) + bias              V(t) = cut(B V(t-1)) + U(t) + BIAS

A cut toward zero removes less than 1, and nothing if A is 0 or 1. For the differences e = |U - u| and f = |V - v|

    e(t)  <=  A e(t-1)  +  |A - a| |u(t-1)|  +  |Q(t) - q(t)|  +  1
    f(t)  <=  B f(t-1)  +  |B - b| |v(t-1)|  +  e(t)  +  |BIAS - bias|  +  1

The recursion is linear, so every source of error has a part of its own: **weights** (each arriving spike adds the
rounding error of its weight, at most half a step of the grid, and so does the bias), **decays** (``|A - a|`` is at most
1/8192, and gains that compensate for it shift the weights) and **states** (the cuts). The last has a bound for all
time, whatever the input: ``e < 1 / (1 - A)`` and ``f < (1 / (1 - A) + 1) / (1 - B)``.
"""

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np

from hw_model.values import ByteArray, FloatArray
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
            into[:, 1 + delay :] += (
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


class _Compartments:
    """The float registers of a group, (batch, n), and the bounds e and f of its errors, (sources, batch, n)."""

    def __init__(self, pair: GroupNumbers, batch: int, steps: int) -> None:
        self.pair, n = pair, pair.exact.size
        self.charge = np.zeros((batch, steps, n))
        self.rounding = np.zeros((2, batch, steps, n))
        self._u, self._v, self._joined = np.zeros((3, batch, n))
        self._e, self.f, self._joined_f = np.zeros((3, len(SOURCES), batch, n))
        self._blocked = np.zeros((batch, n), dtype=np.int64)
        exact, chip = pair.exact, pair.chip
        fitted = exact.bias * pair.bias_ratio
        self._bias_error = np.stack(
            (np.abs(chip.bias - fitted), np.abs(fitted - exact.bias), np.zeros(n))
        )[:, None]
        self._cut_u, self._cut_v = (_cut(keep) for keep in (chip.keep_u, chip.keep_v))

    def update(self, step: int) -> None:
        exact, chip = self.pair.exact, self.pair.chip
        self._e = self._after(self._e, self._u, chip.keep_u, exact.keep_u, self._cut_u)
        self._e[:2] += self.rounding[:, :, step]
        self._u = exact.keep_u * self._u + self.charge[:, step]
        self.f = (
            self._after(self.f, self._v, chip.keep_v, exact.keep_v, self._cut_v)
            + self._e
            + self._bias_error
        )
        self.f += self._joined_f
        self._v = exact.keep_v * self._v + self._u + exact.bias + self._joined
        held = self._blocked > 0
        self._v[held] = 0.0
        self.f[:, held] = 0.0
        self._joined[:], self._joined_f[:] = 0.0, 0.0

    def join(self, child: "_Compartments") -> None:
        """Add the voltage of a joined child, and its error, to the next step."""
        self._joined += child._v
        self._joined_f += child.f

    def reset(self, fired: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> None:
        """Reset what spiked, equally on both sides, and count refractory steps."""
        self._v[fired] = 0.0
        self.f[:, fired] = 0.0
        self._blocked = np.where(
            fired, self.pair.exact.refractory - 1, np.maximum(self._blocked - 1, 0)
        )

    @staticmethod
    def _after(
        error: FloatArray, x: FloatArray, chip: FloatArray, exact: FloatArray, cut: FloatArray
    ) -> FloatArray:
        """Return the error of a register after a decay; a register at rest on both sides has nothing to cut."""
        found = chip * error
        found[1] += np.abs(chip - exact) * np.abs(x)
        found[2] += cut * ((x != 0) | error.any(axis=0))
        return found


def _cut(keep: FloatArray) -> FloatArray:
    """Return the most that a cut removes: 1, or 0 if all or nothing is kept."""
    cut: FloatArray = ((keep > 0) & (keep < 1)).astype(np.float64)
    return cut


def _apart(one: Matrix, other: Matrix) -> Matrix:
    """Return the absolute differences of two matrices with the same connections."""
    return with_values(one, np.abs(values_of(one) - values_of(other)))
