"""Choose integers for leaky integrate-and-fire neurons: one threshold for all, and a scale for each.

For a soft reset, a spike takes the drop from the voltage. The chip's own reset would also forget what is left above the
threshold. So a memoryless soma reads a dendrite that is never reset, and own spikes reach the dendrite through two
self-synapses: one brings the drop, and the other, one step later, removes from the current what its decay left of it.
"""

import math
from collections.abc import Sequence

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.arithmetic.fixed_point import WEIGHT_EXPONENTS, WeightGrid
from hw_model.arithmetic.loihi_inverse import share_kept
from hw_model.description.chip import Chip
from hw_model.values import FloatArray, IntArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm, Refractory, integers
from locsnn_compile.network.neurons import Cuba, SoftCuba
from locsnn_compile.network.projections import Projection, row_sums
from locsnn_compile.passes.kernels import rounded_decays
from locsnn_compile.passes.rounding.floor import floor_scale
from locsnn_compile.passes.rounding.task import (
    WHOLE,
    Scaled,
    Task,
    checked_scale,
    exponent_holding,
    largest_charge,
    own_grid,
)


def quantize_cuba(neuron: Cuba, task: Task) -> Scaled:
    """Return the neurons in integers.

    All get the threshold mantissa T and the scale ``threshold_of(T) / threshold``, or 1 more for the rule ``>=``.
    The comparison is then exact for every neuron, and a core needs one threshold profile for all. T is limited
    so that no register wraps, unless weights would lose bits by that. If potentials are bounded by the
    threshold, as those of readouts, the voltage register only has to hold one threshold, and the limit holds
    whatever it costs in bits. A floor lowers T to a value with which it lies at ``1 - 2^k``, or nearly so.
    """
    chip = task.chip
    size = len(neuron.threshold)
    decay_u, decay_v, gain = rounded_decays(neuron, task.where)
    # What holds a steady input at the threshold: no charge of a step is larger if potentials stay below it.
    holding = (1 - share_kept(decay_u)) * (1 - share_kept(decay_v)) / gain
    bounded = _stays_below(neuron, task.incoming, holding)
    if bounded:
        charge_room = loihi.charge_span(chip.registers.charge_bits) / holding.max()
    else:
        charge_room = _room(neuron, task.incoming, chip)
    over = 1 if neuron.rule == ">=" else 0
    heaviest = float((task.largest * gain / neuron.threshold).max())
    lossless = 0.0 if bounded else task.grid.high / max(heaviest, 1e-9)
    most_of_register = chip.registers.threshold_mantissa_max
    mantissa_max = int(min(most_of_register, max(charge_room, lossless, 1.0)))
    bias = _steady_bias(neuron, decay_v)
    mantissa_max = _most_for_bias(bias / neuron.threshold, mantissa_max, task)
    exponent, mantissa = checked_scale(task, heaviest, mantissa_max, over, bounded=bounded)
    threshold = integers(mantissa, size)
    vmin = None
    if neuron.floor is not None:
        floors = floor_scale(task, -neuron.floor / neuron.threshold, mantissa, over)
        threshold = floors.threshold
        vmin = floors.vmin
        exponent = _exponent(task, gain, threshold, neuron.threshold, over)
    scale = (loihi.threshold_of(threshold) + over) / neuron.threshold
    bias_mantissa, bias_exponent = _bias(bias * scale, chip)
    quantized = ChipCuba(
        decay_u, decay_v, threshold, bias_mantissa, bias_exponent, neuron.refractory, vmin
    )
    return Scaled(quantized, scale, gain, exponent)


def _steady_bias(neuron: Cuba, decay_v: IntArray) -> FloatArray:
    """Return the biases (n,) that settle at the same voltage with the rounded decay; they act on the voltage only."""
    lost = 1 - share_kept(decay_v)
    leaks = neuron.decay_v > 0
    factor = np.divide(lost, neuron.decay_v, out=np.ones(len(lost)), where=leaks)
    bias: FloatArray = neuron.bias * factor
    return bias


def _most_for_bias(thresholds: FloatArray, mantissa_max: int, task: Task) -> int:
    """Return the largest threshold mantissa, at most ``mantissa_max``, with which biases fit.

    ``thresholds`` (n,): the biases in thresholds. Refuses those that fit no threshold.
    """
    strongest = float(np.abs(thresholds).max())
    if not strongest:
        return mantissa_max
    largest_bias = loihi_inverse.largest_bias(task.chip.registers)
    most_thresholds = loihi.in_units(largest_bias) / 2
    if strongest > most_thresholds:
        measured = f"one bias reaches {strongest:.6g} thresholds against {most_thresholds:.0f}"
        fix = "Train with smaller biases, or a higher threshold."
        raise task.no_scale("largest bias", measured, fix)
    return int(min(loihi.in_units(largest_bias / strongest) - 1, mantissa_max))


def _exponent(
    task: Task, gain: FloatArray, mantissas: IntArray, thresholds: FloatArray, over: int
) -> int:
    """Return the weight exponent for threshold mantissas (n,) that differ from the largest that fits."""
    heaviest = float((task.largest * gain * (mantissas + loihi.in_units(over)) / thresholds).max())
    return exponent_holding(heaviest / WHOLE, task.grid)


def _stays_below(neuron: Cuba, incoming: Sequence[Projection], holding: FloatArray) -> bool:
    """Tell whether no input moves a potential past the threshold in either direction, as in neurons that are read out.

    ``holding`` (n,): the share of a potential that an input has to bring in every step to hold it there.
    """
    of_inputs = np.sum([row_sums(p.weights) for p in incoming], axis=0)
    driven = np.abs(neuron.bias) * neuron.decay_u + of_inputs
    stays_below = (holding > 0) & (driven <= holding * neuron.threshold)
    return bool(stays_below.all())


def _room(neuron: Cuba, incoming: Sequence[Projection], chip: Chip) -> float:
    """Return the threshold mantissa up to which charge and current never wrap, whatever the input.

    The charge is largest if all inputs of one sign come in one step. The current matters for neurons whose voltage is
    their current, a potential that no spike resets. (The voltage is clipped, so it cannot wrap.)
    """
    registers = chip.registers
    none = np.zeros(len(neuron.threshold))
    of_one_sign = np.sum([none, *(row_sums(p.weights) for p in incoming)], axis=0)
    charge = of_one_sign / neuron.threshold
    of_both_signs = np.sum([none, *(abs(p.weights).sum(axis=1) for p in incoming)], axis=0)
    lost = np.maximum(neuron.decay_u, loihi_inverse.share_lost(1))
    voltage_is_current = (neuron.decay_v == 1) & (neuron.decay_u < 1)
    current = np.where(voltage_is_current, of_both_signs / lost / neuron.threshold, 0.0)
    charge_room = loihi.in_units(registers.half_charge) / max(float(charge.max()), 1.0)
    current_room = loihi.in_units(registers.half_current) / max(float(current.max()), 1.0)
    return float(min(charge_room, current_room))


def _bias(values: FloatArray, chip: Chip) -> tuple[IntArray, IntArray]:
    """Round to mantissas (n,) times the smallest powers of two that hold them."""
    largest_mantissa = chip.registers.bias_mantissa_max
    times_too_large = np.maximum(np.abs(values) / largest_mantissa, 1.0)
    exponent = np.array([math.ceil(math.log2(times)) for times in times_too_large], dtype=np.int64)
    mantissa = np.clip(np.rint(values / 2.0**exponent), -largest_mantissa, largest_mantissa).astype(
        np.int64
    )
    return mantissa, exponent


def quantize_soft(neuron: SoftCuba, task: Task) -> Scaled:
    """Return the neurons in integers, one threshold mantissa for all unless floors differ in thresholds."""
    chip = task.chip
    decay_u, decay_v, gain = rounded_decays(neuron, task.where)
    heaviest = float((task.largest * gain / neuron.threshold).max())
    deepest = float((neuron.drop / neuron.threshold).max())
    grid = own_grid(chip)
    largest_charge_in_thresholds = min(_largest_own_charge(grid), largest_charge(chip))
    if deepest > largest_charge_in_thresholds:
        measured = f"a spike takes {deepest:.3g} thresholds against {largest_charge_in_thresholds}"
        fix = "Train with a smaller drop, or a higher threshold."
        raise task.no_scale("drop of a spike", measured, fix)
    cap = int(largest_charge_in_thresholds / max(deepest, 1.0))
    exponent, mantissa = checked_scale(task, heaviest, cap, 0)
    threshold = integers(mantissa, len(neuron.drop))
    vmin = None
    if neuron.floor is not None:
        floors = floor_scale(task, -neuron.floor / neuron.threshold, mantissa, 0)
        threshold = floors.threshold
        vmin = floors.vmin
        exponent = _exponent(task, gain, threshold, neuron.threshold, 0)
    drop = np.rint(threshold * neuron.drop / neuron.threshold).astype(np.int64)
    quantized = ChipSrm(decay_u, decay_v, threshold, _taps(drop, decay_u, grid), vmin=vmin)
    scale = loihi.threshold_of(threshold) / neuron.threshold
    return Scaled(quantized, scale, gain, exponent)


def _taps(drop: IntArray, decay_u: IntArray, grid: WeightGrid) -> Refractory:
    """Return the self-synapses, coarse and fine, at once and one step later, without those that no neuron needs."""
    delays: list[int] = []
    mantissas: list[IntArray] = []
    exponents: list[int] = []
    # One step later the current has kept a share of what the spike took: that is given back.
    given_back = np.rint(drop * share_kept(decay_u)).astype(np.int64)
    for delay, sign, charge in ((0, -1, drop), (1, 1, given_back)):
        for mantissa, exponent in _coarse_and_fine(charge, grid):
            if mantissa.any():
                delays.append(delay)
                mantissas.append(sign * mantissa)
                exponents.append(exponent)
    none = np.zeros((0, len(drop)))
    return Refractory.of(len(drop), mantissas or none, exponents, delays)


def _largest_own_charge(grid: WeightGrid) -> int:
    """Return the largest charge that a coarse and a fine self-synapse hold exactly, in threshold units."""
    shift = _coarse(grid)
    largest_coarse = grid.high // grid.step << shift
    largest_rest = (1 << shift) - 1
    return largest_coarse + largest_rest


def _coarse(grid: WeightGrid) -> int:
    """Return the distance of the coarse exponent from the finest: all bits of a weight, if exponents go that far."""
    return min(grid.weight_bits, WEIGHT_EXPONENTS[-1] - exponent_holding(0.0, grid))


def _coarse_and_fine(
    charge: IntArray, grid: WeightGrid
) -> tuple[tuple[IntArray, int], tuple[IntArray, int]]:
    """Return (mantissas, exponent) for a coarse and the finest exponent, which add up to charges in threshold units."""
    finest = exponent_holding(0.0, grid)
    shift = _coarse(grid)
    needs_coarse = charge > grid.high // grid.step
    coarse = np.where(needs_coarse, charge >> shift, 0)
    fine = charge - (coarse << shift)
    return (coarse * grid.step, finest + shift), (fine * grid.step, finest)
