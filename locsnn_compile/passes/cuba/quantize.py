"""Choose integers for leaky integrate-and-fire neurons: one threshold for all, and a scale for each.

The *scale* of a neuron is how many counts of the chip's voltage register a float potential of 1 becomes.

With a soft reset (:class:`SoftCuba`), a spike takes a *drop* from the voltage. The chip's own reset would set the
voltage to 0 and forget what is left above the threshold. So a memoryless soma reads a dendrite that is never reset, and
own spikes reach the dendrite through two self-synapses: one brings the drop, and the other, one step later, removes
from the current the share of the drop that the decay left there.
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

NO_WEIGHT = 1e-9
"""Smallest weight, in thresholds, that something is divided by: populations without weights have one of 0."""


def quantize_cuba(neuron: Cuba, task: Task) -> Scaled:
    """Return the neurons in integers.

    All get the threshold mantissa T and the scale ``threshold_of(T) / threshold``, or with ``threshold_of(T) + 1`` for
    the rule ``>=``, because the chip spikes above its threshold. The comparison is then exact for every neuron, and a
    core needs one threshold profile for all. T is limited so that no register wraps, unless weights would lose bits by
    that. If potentials are bounded by the threshold, as those of readouts, the voltage register only has to hold one
    threshold, and the limit holds whatever it costs in bits. A floor lowers T to a value with which it lies at
    ``1 - 2^k``, or nearly so.
    """
    chip = task.chip
    size = len(neuron.threshold)
    decay_u, decay_v, gain = rounded_decays(neuron, task.where)
    # The input per step, in thresholds, that keeps a potential at the threshold. If potentials stay below the
    # threshold, no charge of a step is larger.
    holding = (1 - share_kept(decay_u)) * (1 - share_kept(decay_v)) / gain
    bounded = _stays_below(neuron, task.incoming, holding)
    if bounded:
        mantissa_without_wraps = loihi.charge_span(chip.registers.charge_bits) / holding.max()
    else:
        mantissa_without_wraps = _mantissa_without_wraps(neuron, task.incoming, chip)
    over = 1 if neuron.rule == ">=" else 0
    heaviest = float((task.largest * gain / neuron.threshold).max())
    # The mantissa at which the heaviest weight uses all bits of a format with exponent 0. To keep these bits, wraps for
    # some inputs are accepted, except where potentials are bounded.
    mantissa_of_all_bits = 0.0
    if not bounded:
        mantissa_of_all_bits = task.grid.high / max(heaviest, NO_WEIGHT)
    mantissa_max = int(
        min(
            chip.registers.threshold_mantissa_max,
            max(mantissa_without_wraps, mantissa_of_all_bits, 1.0),
        )
    )
    bias = _steady_bias(neuron, decay_v)
    mantissa_max = _mantissa_max_for_bias(bias / neuron.threshold, mantissa_max, task)
    exponent, mantissa = checked_scale(task, heaviest, mantissa_max, over, bounded=bounded)
    threshold = integers(mantissa, size)
    vmin = None
    if neuron.floor is not None:
        floors = floor_scale(task, -neuron.floor / neuron.threshold, mantissa, over)
        threshold = floors.threshold
        vmin = floors.vmin
        # Neurons now have thresholds of their own, so the heaviest weight is another one.
        exponent = _exponent(task, gain, threshold, neuron.threshold, over)
    scale = (loihi.threshold_of(threshold) + over) / neuron.threshold
    bias_mantissa, bias_exponent = _bias(bias * scale, chip)
    quantized = ChipCuba(
        decay_u, decay_v, threshold, bias_mantissa, bias_exponent, neuron.refractory, vmin
    )
    return Scaled(quantized, scale, gain, exponent)


def _steady_bias(neuron: Cuba, decay_v: IntArray) -> FloatArray:
    """Return biases (n,) with which the voltage settles at the same value despite the rounded decay.

    A bias is added to the voltage only, so the decay of the current does not matter, and neither does the gain.
    """
    lost = 1 - share_kept(decay_v)
    # A voltage that does not leak never settles, and its decay of 0 is exact.
    leaks = neuron.decay_v > 0
    factor = np.divide(lost, neuron.decay_v, out=np.ones(len(lost)), where=leaks)
    bias: FloatArray = neuron.bias * factor
    return bias


def _mantissa_max_for_bias(biases: FloatArray, mantissa_max: int, task: Task) -> int:
    """Return the largest threshold mantissa, at most ``mantissa_max``, with which biases fit their register.

    ``biases`` (n,) are in thresholds. Raises ``TargetError`` for biases that fit with no threshold.
    """
    strongest = float(np.abs(biases).max())
    if not strongest:
        return mantissa_max
    largest_bias = loihi_inverse.largest_bias(task.chip.registers)
    # A threshold is less than the mantissa + 1, in units, and so less than 2 for the least mantissa of 1.
    thresholds_max = loihi.in_units(largest_bias) / 2
    if strongest > thresholds_max:
        measured = f"one bias reaches {strongest:.6g} thresholds against {thresholds_max:.0f}"
        fix = "Train with smaller biases, or a higher threshold."
        raise task.no_scale("largest bias", measured, fix)
    return int(min(loihi.in_units(largest_bias / strongest) - 1, mantissa_max))


def _exponent(
    task: Task, gain: FloatArray, mantissas: IntArray, thresholds: FloatArray, over: int
) -> int:
    """Return the weight exponent for float ``thresholds`` (n,) whose ``mantissas`` (n,) floors have lowered."""
    heaviest = float((task.largest * gain * (mantissas + loihi.in_units(over)) / thresholds).max())
    return exponent_holding(heaviest / WHOLE, task.grid)


def _stays_below(neuron: Cuba, incoming: Sequence[Projection], holding: FloatArray) -> bool:
    """Return whether no input can move a potential past the threshold in either direction, as for most readouts.

    ``holding`` (n,): the share of a potential that an input has to bring per step to keep it constant. Even if all
    inputs of one sign spike in every step, the potential then settles below the threshold.
    """
    largest_input = np.sum([row_sums(p.weights) for p in incoming], axis=0)
    # A bias does not pass the current, which would amplify it by 1 / decay_u.
    largest_drive = np.abs(neuron.bias) * neuron.decay_u + largest_input
    stays_below = (holding > 0) & (largest_drive <= holding * neuron.threshold)
    return bool(stays_below.all())


def _mantissa_without_wraps(neuron: Cuba, incoming: Sequence[Projection], chip: Chip) -> float:
    """Return the threshold mantissa up to which charge and current never wrap, whatever the input.

    The charge is largest if all inputs of one sign come in one step. The current matters for neurons whose voltage is
    their current (``decay_v`` 1), a potential that no spike resets. (The voltage is clipped, so it cannot wrap.)
    """
    registers = chip.registers
    no_input = np.zeros(len(neuron.threshold))  # so that a population without projections has a sum
    of_one_sign = np.sum([no_input, *(row_sums(p.weights) for p in incoming)], axis=0)
    charge = of_one_sign / neuron.threshold
    of_both_signs = np.sum([no_input, *(abs(p.weights).sum(axis=1) for p in incoming)], axis=0)
    # Steady input adds up to 1 / decay_u times itself; no decay of the chip is smaller than 1, except 0.
    lost = np.maximum(neuron.decay_u, loihi_inverse.share_lost(1))
    voltage_is_current = neuron.decay_v == 1
    current = np.where(voltage_is_current, of_both_signs / lost / neuron.threshold, 0.0)
    # Largest values below one threshold count as one threshold.
    mantissa_by_charge = loihi.in_units(registers.half_charge) / max(float(charge.max()), 1.0)
    mantissa_by_current = loihi.in_units(registers.half_current) / max(float(current.max()), 1.0)
    return float(min(mantissa_by_charge, mantissa_by_current))


def _bias(values: FloatArray, chip: Chip) -> tuple[IntArray, IntArray]:
    """Return mantissas and exponents (n,) of biases in counts of the register, each with the smallest exponent."""
    largest_mantissa = chip.registers.bias_mantissa_max
    times_too_large = np.maximum(np.abs(values) / largest_mantissa, 1.0)
    exponent = np.array([math.ceil(math.log2(times)) for times in times_too_large], dtype=np.int64)
    rounded = np.rint(values / 2.0**exponent)
    mantissa = np.clip(rounded, -largest_mantissa, largest_mantissa).astype(np.int64)
    return mantissa, exponent


def quantize_soft(neuron: SoftCuba, task: Task) -> Scaled:
    """Return the neurons in integers, one threshold mantissa for all unless floors differ in thresholds."""
    chip = task.chip
    decay_u, decay_v, gain = rounded_decays(neuron, task.where)
    heaviest = float((task.largest * gain / neuron.threshold).max())
    largest_drop = float((neuron.drop / neuron.threshold).max())  # in thresholds
    grid = own_grid(chip)
    # In units, so also the largest drop in thresholds of the least mantissa, 1.
    largest_own_charge = min(_largest_own_charge(grid), largest_charge(chip))
    if largest_drop > largest_own_charge:
        measured = f"a spike takes {largest_drop:.3g} thresholds against {largest_own_charge}"
        fix = "Train with a smaller drop, or a higher threshold."
        raise task.no_scale("drop of a spike", measured, fix)
    cap = int(largest_own_charge / max(largest_drop, 1.0))
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
    """Return the self-synapses that take drops (n,), in units, from the voltage and keep the current as it was.

    Each charge is split into a coarse and a fine synapse. Synapses that no neuron needs are left out.
    """
    delays: list[int] = []
    mantissas: list[IntArray] = []
    exponents: list[int] = []
    # A charge acts on the voltage through the current, which keeps a share of it for the next step. One step later, a
    # charge of the other sign cancels that share, so the voltage is lowered once.
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
    """Return the largest charge, in units, that a coarse and a fine self-synapse hold exactly."""
    shift = _coarse_shift(grid)
    largest_coarse = grid.high // grid.step << shift
    largest_rest = (1 << shift) - 1
    return largest_coarse + largest_rest


def _coarse_shift(grid: WeightGrid) -> int:
    """Return how much larger the coarse exponent is than the finest.

    It is the bits of a weight, so that the fine synapse holds any remainder, or less if exponents do not go that far.
    """
    return min(grid.weight_bits, WEIGHT_EXPONENTS[-1] - exponent_holding(0.0, grid))


def _coarse_and_fine(
    charge: IntArray, grid: WeightGrid
) -> tuple[tuple[IntArray, int], tuple[IntArray, int]]:
    """Return (mantissas, exponent) of two synapses, coarse and finest, which add up to ``charge`` (n,) in units."""
    finest = exponent_holding(0.0, grid)
    shift = _coarse_shift(grid)
    needs_coarse = charge > grid.high // grid.step
    coarse = np.where(needs_coarse, charge >> shift, 0)
    fine = charge - (coarse << shift)
    return (coarse * grid.step, finest + shift), (fine * grid.step, finest)
