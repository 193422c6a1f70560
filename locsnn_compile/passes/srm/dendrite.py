"""Strategy ``dendrite``: own spikes drive a refractory dendrite, the kernel nu by one self-synapse."""

from collections.abc import Iterable

import numpy as np

from hw_model.arithmetic.fixed_point import WeightGrid
from hw_model.description.chip import Chip
from hw_model.values import FloatArray, IntArray
from locsnn_compile.network.chip_neurons import ChipSrm, Refractory
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.passes.kernels import alpha_kernel
from locsnn_compile.passes.rounding.task import exponent_holding, own_grid


def heaviest_charge(neuron: SrmAlpha, decay: int, chip: Chip, where: str) -> float:
    """Return the largest own charge, in thresholds."""
    return neuron.scale_ref * alpha_kernel(neuron.tau_ref, f"{where}: tau_ref")[1]


def lay_out(neuron: SrmAlpha, size: int, decay: int, thresholds: Iterable[int], chip: Chip, where: str) -> ChipSrm:
    """Return the neurons at that of the threshold mantissas, best first, whose refractory weight rounds best."""
    refractory_decay, gain, _ = alpha_kernel(neuron.tau_ref, f"{where}: tau_ref")
    grid = own_grid(chip)

    def rounded(threshold: int) -> tuple[float, int, int]:
        # v > 64 * threshold is v >= 64 * threshold + 1 for integers: this value stands for theta.
        wanted = neuron.scale_ref * gain * (64 * threshold + 1) / 64
        exponent = exponent_holding(wanted, grid)
        mantissa = int(grid.round(np.array([wanted / 2.0**exponent]))[0])
        error = abs(mantissa * 2.0**exponent - wanted) / wanted if wanted > 0 else 0.0
        return error, -mantissa, exponent

    threshold = min(thresholds, key=lambda t: rounded(t)[0])
    _, mantissa, exponent = rounded(threshold)
    own = Refractory.of(size, mantissa, exponent, refractory_decay=refractory_decay)
    return ChipSrm.of(size, decay_u=decay, decay_v=decay, threshold=threshold, refractory=own)


def whole_mantissas(neuron: SrmAlpha, thresholds: FloatArray, grid: WeightGrid) -> tuple[IntArray, IntArray, int]:
    """Return threshold mantissas (k,) near those wanted, their refractory mantissas (k,), and the exponent of all.

    A scale is free, so it is chosen for the refractory weight: its mantissa is the largest of the grid at which the
    threshold is not above the one wanted, and the threshold follows from it. Where that would be 0, the threshold is
    the one wanted, and the refractory weight is rounded.
    """
    _, gain, _ = alpha_kernel(neuron.tau_ref, "tau_ref")
    charge = neuron.scale_ref * gain
    heaviest = charge * (float(thresholds.max()) + 1 / 64)
    if heaviest < 0.5:
        return np.maximum(np.floor(thresholds), 1).astype(np.int64), np.zeros(len(thresholds), dtype=np.int64), 0
    exponent = exponent_holding(heaviest, grid)
    step = grid.step * 2.0**exponent
    wanted = charge * (thresholds + 1 / 64) / step
    steps = np.where(wanted < 1, np.rint(wanted), np.floor(wanted))
    found = np.where(wanted < 1, np.floor(thresholds), np.rint(steps * step / charge - 1 / 64))
    return np.maximum(found, 1).astype(np.int64), -(steps * grid.step).astype(np.int64), exponent
