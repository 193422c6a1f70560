"""Strategy ``delay-line``: own spikes come back to the alpha dendrite through delayed self-synapses (*taps*).

This saves the refractory dendrite, at the price of synapses. The dendrite responds to a charge with ``k * b^(k-1)``,
k steps after the spike, where b is what its *rounded* decay keeps. To make it respond to an own spike with nu
instead, the charges are nu filtered by ``(1 - b z^-1)^2``:

    charge(k) = nu(k) - 2 b nu(k - 1) + b^2 nu(k - 2)

Each charge is rounded to a weight, a mantissa with an exponent; a charge that rounds badly gets a second synapse. The
next charge is computed from the voltage and current that the rounded charges left, so that rounding errors do not add
up in the dendrite's long memory.

Constants below that state no other reason were chosen by hand.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from hw_model.arithmetic.fixed_point import WeightGrid
from hw_model.arithmetic.loihi import in_registers, in_units
from hw_model.arithmetic.loihi_inverse import least_to_spike, share_kept
from hw_model.description.chip import Chip
from hw_model.targets import target_of
from hw_model.values import FloatArray, Frozen, IntArray
from locsnn_compile.errors import TargetError, counted
from locsnn_compile.network.chip_neurons import ChipSrm
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.passes.kernels import kernel, own_charges
from locsnn_compile.passes.rounding.task import Task, exponent_holding, own_grid

TAPS_MAX = 256
"""Largest number of taps that is tried, on chips whose delays would allow more."""
EXPONENTS_MAX = 3
"""Largest number of exponents of a population's taps, evenly spread: with both signs, six of a core's 16 formats."""
FINE = 2.0**-11
"""A charge with a rounding error above this share of the kernel's largest value gets a second synapse."""
EXACT = 2.0**-12
"""An error of the kernel that is good enough: the smallest number of taps is taken that reaches it, ..."""
ENOUGH = 1.25
"""... or that reaches this many times the least error of any number of taps, if that is larger."""
ERROR_MAX = 0.1
"""Largest relative root mean square error; above it, the kernel outlasts the delays or is lost in rounding."""
FAINT = 0.01
"""Least root of summed squares, in thresholds, that an error is divided by: smaller kernels hardly matter."""
HORIZON = 12
"""Time constants over which the error is summed: later values are below 2e-4 of the kernel's peak."""
STEPS_MAX = 4096
"""Largest number of steps over which the error is summed."""


class _Weights(Frozen, eq=False):
    """Mantissas and exponents, arrays of one shape, whose last axis is the candidate threshold mantissas."""

    mantissa: IntArray
    exponent: IntArray

    @property
    def units(self) -> FloatArray:
        """The charges, in units."""
        return self.mantissa * 2.0**self.exponent


class _RoundedTaps(Frozen, eq=False):
    """Weights (lags, 2, candidates), and the error of the kernel if taps end after each lag, (lags, candidates).

    A tap has two synapses, of which the second may be 0. Taps that end after lag k have the error ``error[k]``.
    """

    weights: _Weights
    error: FloatArray


def heaviest_charge(neuron: SrmAlpha, decay: int, task: Task) -> float:
    """Return the largest charge of a tap, in thresholds."""
    response = _response(neuron, 1.0, _taps(task.chip))
    return float(np.abs(own_charges(response, share_kept(decay))).max())


def lay_out(neuron: SrmAlpha, decay: int, thresholds: Iterable[int], task: Task) -> ChipSrm:
    """Return the neurons with the smallest number of taps, at the threshold mantissa with which these round best."""
    candidates = np.array(list(thresholds))
    # The least potential that spikes is what theta becomes in the registers.
    theta = least_to_spike(candidates.astype(np.float64))
    rounded = _round_taps(neuron, decay, theta, task.chip)
    least_errors = rounded.error.min(axis=1)
    small_enough = max(ENOUGH * least_errors.min(), EXACT)
    # Row k has a delay of k steps: it acts k + 1 steps after the spike.
    last_lag = int(np.flatnonzero(least_errors <= small_enough)[0])
    chosen = int(rounded.error[last_lag].argmin())
    error = float(rounded.error[last_lag, chosen])
    if error > ERROR_MAX:
        raise _cannot_hold(neuron, error, task)
    mantissa = rounded.weights.mantissa[: last_lag + 1, :, chosen]
    exponent = rounded.weights.exponent[: last_lag + 1, :, chosen]
    delay, synapse = np.nonzero(mantissa)
    return ChipSrm.with_taps(
        task.population.size,
        decay=decay,
        threshold=int(candidates[chosen]),
        mantissa=mantissa[delay, synapse],
        exponent=exponent[delay, synapse],
        delay=delay,
    )


def _cannot_hold(neuron: SrmAlpha, error: float, task: Task) -> TargetError:
    """Return the error for a kernel that delayed synapses cannot bring about."""
    chip = task.chip
    synapses = counted(_taps(chip), "delayed synapse")
    what = f"{synapses} cannot hold a kernel of tau_ref {neuron.tau_ref:g}"
    measured = (
        f"an error of {error:.2g} against {ERROR_MAX:g}; "
        f"{chip.name} has delay_max {chip.registers.delay_max}"
    )
    strategy = "dendrite" if target_of(chip).joins else "reset"
    return TargetError(task.where, what, measured=measured, fix=f"Use strategy {strategy}.")


def _taps(chip: Chip) -> int:
    """Return the number of taps that are tried: one per delay of the chip."""
    return min(chip.registers.delay_max + 1, TAPS_MAX)


def _round_taps(neuron: SrmAlpha, decay: int, theta: FloatArray, chip: Chip) -> _RoundedTaps:
    """Round the charges lag by lag, for thetas (candidates,) in counts of the registers."""
    keep = share_kept(decay)
    grid = own_grid(chip)
    taps = _taps(chip)
    steps = _steps(neuron, keep, taps)
    nu = _response(neuron, theta, steps)
    energy = np.maximum((nu**2).sum(axis=0), (FAINT * theta) ** 2)
    largest_charge = float(np.abs(own_charges(nu, keep)).max())
    exponents = _exponents(in_units(largest_charge), grid)
    fine = in_units(FINE * np.abs(nu).max(axis=0))
    current = np.zeros(len(theta))
    voltage = np.zeros(len(theta))
    square_error = np.zeros(len(theta))
    weights = []
    errors = []
    for lag in range(taps):
        # The charge that makes the voltage equal nu in this step: v = keep v + u, and u = keep u + charge.
        charge = in_units(nu[lag] - keep * voltage - keep * current)
        rounded = _round_twice(charge, exponents, fine, grid)
        current = keep * current + in_registers(rounded.units.sum(axis=0))
        voltage = keep * voltage + current
        square_error = square_error + (voltage - nu[lag]) ** 2
        # If this is the last tap, the dendrite decays freely from here: m steps later, v = keep^m (v + m u).
        m = np.arange(1, steps - lag)[:, None]
        tail_error = keep**m * (voltage + m * current) - nu[lag + 1 :]
        weights.append(rounded)
        errors.append(np.sqrt((square_error + (tail_error**2).sum(axis=0)) / energy))
    return _RoundedTaps(_stacked(weights), np.stack(errors))


def _steps(neuron: SrmAlpha, keep: float, taps: int) -> int:
    """Return the steps over which an error is summed: until kernel and dendrite have faded."""
    tau_of_dendrite = -1.0 / math.log(keep) if keep else 0.0
    tau = max(neuron.tau_ref, tau_of_dendrite)
    return min(taps + math.ceil(HORIZON * tau), STEPS_MAX)


def _round_twice(
    charge: FloatArray, exponents: IntArray, fine: FloatArray, grid: WeightGrid
) -> _Weights:
    """Return two weights (2, candidates) for charges in units, the second for the rounding error of the first.

    The second weight is 0 if the error is at most ``fine``.
    """
    first = _round(charge, exponents, grid)
    error = charge - first.units
    second = _round(np.where(np.abs(error) > fine, error, 0.0), exponents, grid)
    return _stacked([first, second])


def _round(charge: FloatArray, exponents: IntArray, grid: WeightGrid) -> _Weights:
    """Return mantissas and the smallest exponents that hold charges (candidates,), in units."""
    magnitude = np.abs(charge)
    # Half a step above the grid still rounds to its largest mantissa.
    largest_of_exponent = (grid.high + grid.step / 2) * 2.0**exponents
    smallest = np.searchsorted(largest_of_exponent, magnitude)
    exponent = exponents[np.minimum(smallest, len(exponents) - 1)]
    mantissa: IntArray = np.sign(charge).astype(np.int64) * grid.round(magnitude / 2.0**exponent)
    return _Weights(mantissa, exponent)


def _stacked(weights: Sequence[_Weights]) -> _Weights:
    """Return weights along a further first axis."""
    mantissa = np.stack([item.mantissa for item in weights])
    exponent = np.stack([item.exponent for item in weights])
    return _Weights(mantissa, exponent)


def _response(neuron: SrmAlpha, theta: FloatArray | float, steps: int) -> FloatArray:
    """Return nu, 1 to ``steps`` steps after the spike, (steps, candidates), in the unit of ``theta``."""
    k = np.arange(1, steps + 1, dtype=np.float64)[:, None]
    return -neuron.scale_ref * kernel(neuron.tau_ref, k) * theta


def _exponents(largest: float, grid: WeightGrid) -> IntArray:
    """Return the exponents in use, ascending: :data:`EXPONENTS_MAX` at most, down from the one of the largest charge.

    They are evenly spread, and as close together as reaching the finest exponent allows.
    """
    finest = exponent_holding(0.0, grid)
    highest = exponent_holding(largest, grid)
    step = max(1, math.ceil((highest - finest) / (EXPONENTS_MAX - 1)))
    evenly_spread = highest - step * np.arange(EXPONENTS_MAX)
    return np.unique(np.maximum(evenly_spread, finest)).astype(np.int64)
