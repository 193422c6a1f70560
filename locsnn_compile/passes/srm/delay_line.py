"""Strategy ``delay-line``: own spikes come back to the alpha dendrite through delayed self-synapses.

The dendrite responds to a charge with ``k * b^(k-1)``, k steps after the spike, where b is what its *rounded* decay
keeps. To make it respond to an own spike with nu instead, the charges are nu filtered by ``(1 - b z^-1)^2``:

    charge(k) = nu(k) - 2 b nu(k - 1) + b^2 nu(k - 2)

Each charge is rounded to a mantissa with an exponent, and a large one to two of them. The next charge is computed from
the voltage and current that the rounded charges left, so that rounding errors do not add up in the dendrite's long
memory.
"""

import math
from collections.abc import Iterable

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
ENOUGH, EXACT = 1.25, 2.0**-12
"""The smallest number of taps is taken whose error is at most ``EXACT``, or ``ENOUGH`` times the least error."""
ERROR_MAX = 0.1
"""Largest relative root mean square error; above it, the kernel outlasts the delays, or is lost in rounding."""
FAINT = 0.01
"""Least root of summed squares, in thresholds, that an error is divided by: smaller kernels hardly matter."""
HORIZON = 12
"""Time constants over which the error is summed, up to ``STEPS_MAX`` steps."""
STEPS_MAX = 4096


class _Rounded(Frozen, eq=False):
    """Mantissas and exponents (lags, 2, candidates); ``error[k]`` (candidates,) if there are only the lags 0..k."""

    mantissa: IntArray
    exponent: IntArray
    error: FloatArray


def heaviest_charge(neuron: SrmAlpha, decay: int, task: Task) -> float:
    """Return the largest own charge, in thresholds."""
    keep = share_kept(decay)
    return float(np.abs(own_charges(_response(neuron, 1.0, _taps(task.chip)), keep)).max())


def lay_out(neuron: SrmAlpha, decay: int, thresholds: Iterable[int], task: Task) -> ChipSrm:
    """Return the neurons at the threshold mantissa whose taps round best."""
    chip, candidates = task.chip, np.array(list(thresholds))
    theta = least_to_spike(candidates.astype(np.float64))
    found = _round_taps(neuron, decay, theta, _taps(chip), own_grid(chip))
    best = found.error.min(axis=1)
    last = int(np.flatnonzero(best <= max(ENOUGH * best.min(), EXACT))[0])
    chosen = int(found.error[last].argmin())
    if (error := float(found.error[last, chosen])) > ERROR_MAX:
        what = f"{counted(_taps(chip), 'delayed synapse')} cannot hold a kernel of tau_ref {neuron.tau_ref:g}"
        measured = f"an error of {error:.2g} against {ERROR_MAX:g}"
        measured += f"; {chip.name} has delay_max {chip.registers.delay_max}"
        strategy = "dendrite" if target_of(chip).joins else "reset"
        raise TargetError(task.where, what, measured=measured, fix=f"Use strategy {strategy}.")
    mantissa, exponent = (
        found.mantissa[: last + 1, :, chosen],
        found.exponent[: last + 1, :, chosen],
    )
    delay, part = np.nonzero(mantissa)
    taps = {"mantissa": mantissa[delay, part], "exponent": exponent[delay, part], "delay": delay}
    return ChipSrm.with_taps(
        task.population.size, decay=decay, threshold=int(candidates[chosen]), **taps
    )


def _taps(chip: Chip) -> int:
    """Return how many delays of a chip are tried."""
    return min(chip.registers.delay_max + 1, TAPS_MAX)


def _round_taps(
    neuron: SrmAlpha, decay: int, theta: FloatArray, taps: int, grid: WeightGrid
) -> _Rounded:
    """Round the charges lag by lag, for thetas (candidates,) in units of the registers."""
    keep = share_kept(decay)
    tau = max(neuron.tau_ref, -1.0 / math.log(keep) if keep else 0.0)
    steps = min(taps + math.ceil(HORIZON * tau), STEPS_MAX)
    wanted = _response(neuron, theta, steps)
    energy = np.maximum((wanted**2).sum(axis=0), (FAINT * theta) ** 2)
    exponents = _exponents(in_units(float(np.abs(own_charges(wanted, keep)).max())), grid)
    fine = in_units(FINE * np.abs(wanted).max(axis=0))
    current, voltage, passed = np.zeros((3, len(theta)))
    rows = []
    for lag in range(taps):
        charge = in_units(wanted[lag] - keep * voltage - keep * current)
        mantissa, exponent = _round(charge, exponents, fine, grid)
        current = keep * current + in_registers((mantissa * 2.0**exponent).sum(axis=0))
        voltage = keep * voltage + current
        passed = passed + (voltage - wanted[lag]) ** 2
        # If this is the last tap, the dendrite decays freely from here.
        m = np.arange(1, steps - lag)[:, None]
        left = keep**m * (voltage + m * current) - wanted[lag + 1 :]
        rows.append((mantissa, exponent, np.sqrt((passed + (left**2).sum(axis=0)) / energy)))
    return _Rounded(*(np.stack(column) for column in zip(*rows, strict=True)))


def _round(
    charge: FloatArray, exponents: IntArray, fine: FloatArray, grid: WeightGrid
) -> tuple[IntArray, IntArray]:
    """Return mantissas and exponents (2, candidates) of charges in units; the second row holds large rests."""
    first = _round_once(charge, exponents, grid)
    rest = charge - first[0] * 2.0 ** first[1]
    second = _round_once(np.where(np.abs(rest) > fine, rest, 0.0), exponents, grid)
    return np.stack((first[0], second[0])), np.stack((first[1], second[1]))


def _round_once(
    charge: FloatArray, exponents: IntArray, grid: WeightGrid
) -> tuple[IntArray, IntArray]:
    """Return mantissas and the smallest exponents that hold charges (candidates,), in units."""
    largest = (grid.high + grid.step / 2) * 2.0**exponents
    exponent = exponents[np.minimum(np.searchsorted(largest, np.abs(charge)), len(exponents) - 1)]
    mantissa: IntArray = np.sign(charge).astype(np.int64) * grid.round(
        np.abs(charge) / 2.0**exponent
    )
    return mantissa, exponent


def _response(neuron: SrmAlpha, theta: FloatArray | float, steps: int) -> FloatArray:
    """Return nu at the lags 1..steps, (steps, candidates), in the unit of ``theta``."""
    k = np.arange(1, steps + 1, dtype=np.float64)[:, None]
    return -neuron.scale_ref * kernel(neuron.tau_ref, k) * theta


def _exponents(largest: float, grid: WeightGrid) -> IntArray:
    """Return the exponents in use, ascending: from the finest to the one that holds the largest charge."""
    finest, highest = exponent_holding(0.0, grid), exponent_holding(largest, grid)
    step = max(1, math.ceil((highest - finest) / (EXPONENTS_MAX - 1)))
    return np.unique(np.maximum(highest - step * np.arange(EXPONENTS_MAX), finest)).astype(np.int64)
