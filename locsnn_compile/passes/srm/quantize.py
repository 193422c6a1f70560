"""Choose integers for SRM (spike response model) neurons, strategy by strategy.

A strategy is a way to build the refractory kernel nu from compartments: :data:`LAYOUTS` has one entry for each, and
:mod:`locsnn_compile.passes.lower_neurons` describes them. The threshold is exact, including its rule: the scale is such
that ``u >= theta`` exactly if v exceeds the chip's threshold. The gain of the alpha kernel compensates for its rounded
decay. Strategy ``delay-line`` has its own file.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic.fixed_point import WeightGrid
from hw_model.arithmetic.loihi import in_units
from hw_model.arithmetic.loihi_inverse import least_to_spike, settled_gain
from hw_model.values import FloatArray, IntArray
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, integers
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.passes.kernels import one_decay, two_decays
from locsnn_compile.passes.rounding.task import (
    Scaled,
    Task,
    checked_scale,
    exponent_holding,
    heaviest_weight,
    own_grid,
)
from locsnn_compile.passes.srm import delay_line
from locsnn_compile.settings import STRATEGIES

SCALE_SLACK = 0.99
"""A scale may be up to one percent below the largest one, if own weights round better there; chosen by hand."""


class Layout(NamedTuple):
    """The functions of a strategy; both get the decay of the alpha kernel, in parts of 4096.

    ``heaviest_charge`` returns the largest charge of a neuron's own spike, in thresholds. ``lay_out`` chooses one of
    the given threshold mantissas, which come largest first, and returns the neurons of a task with it.
    """

    heaviest_charge: Callable[[SrmAlpha, int, Task], float]
    lay_out: Callable[[SrmAlpha, int, Iterable[int], Task], ChipNeuron]


def quantize_srm(neuron: SrmAlpha, task: Task) -> Scaled:
    """Return neurons in integers.

    With ``fitted_decays``, the alpha dendrite gets two decays instead of one. The taps of strategy ``delay-line`` are
    computed for one decay. Raises ``TargetError`` if no threshold mantissa fits, or if a kernel does not fade on the
    chip.
    """
    size = task.population.size
    dendrites = STRATEGIES[task.strategy].dendrites
    layout = LAYOUTS[task.strategy]
    decays = one_decay(neuron.tau_sr, f"{task.where}: tau_sr")
    # Weights and own spikes are divided among the dendrites of a neuron.
    heaviest = float(task.largest.max()) * decays.gain / neuron.theta / dendrites
    of_dendrite = of_a_dendrite(neuron, dendrites)
    own_charge = layout.heaviest_charge(of_dendrite, decays.u, task)
    mantissa_limit = _mantissa_limit(own_charge, task)
    exponent, largest = checked_scale(task, heaviest, mantissa_limit, 1)
    smallest = max(1, math.ceil(SCALE_SLACK * largest))
    # A few mantissas to choose from, so that the weights of own spikes round well.
    mantissas = range(largest, smallest - 1, -1)
    chip_neuron = layout.lay_out(of_dendrite, decays.u, mantissas, task)
    if isinstance(chip_neuron, ChipSrm):
        chip_neuron = replace(chip_neuron, dendrites=dendrites)
    if task.rounding.fitted_decays and task.strategy != "delay-line":
        decays = two_decays(neuron.tau_sr, f"{task.where}: tau_sr")
        decay_u = integers(decays.u, size)
        decay_v = integers(decays.v, size)
        chip_neuron = replace(chip_neuron, decay_u=decay_u, decay_v=decay_v)
    scale = least_to_spike(chip_neuron.threshold) / neuron.theta
    return Scaled(chip_neuron, scale, np.full(size, decays.gain), exponent)


def _mantissa_limit(own_charge: float, task: Task) -> int:
    """Return the largest threshold mantissa at which an own spike is a weight that the chip can hold.

    ``own_charge`` is in thresholds, each of which is less than the mantissa + 1. Raises ``TargetError`` if not even a
    mantissa of 1 fits.
    """
    mantissa_max = task.chip.registers.threshold_mantissa_max
    if not own_charge:
        return mantissa_max
    heaviest = heaviest_weight(task.chip)
    # With a mantissa of 1, a threshold is less than 2 units.
    if own_charge > heaviest / 2:
        measured = f"its own spike weighs {own_charge:.3g} thresholds against {heaviest / 2:.0f}"
        raise task.no_scale(
            "refractory kernel", measured, "Use a smaller scale_ref, or strategy reset."
        )
    return int(min(heaviest / own_charge - 1, mantissa_max))


def of_a_dendrite(neuron: SrmAlpha, dendrites: int) -> SrmAlpha:
    """Return the neuron with the share of its refractory kernel that one of its ``dendrites`` has to bring."""
    return replace(neuron, scale_ref=neuron.scale_ref / dendrites)


def dendrite_charge(neuron: SrmAlpha, where: str) -> float:
    """Return the charge of an own spike onto a refractory dendrite, in thresholds: it responds with nu.

    The gain is the charge for a kernel whose peak is 1, and nu has its peak at ``scale_ref`` thresholds.
    """
    return neuron.scale_ref * one_decay(neuron.tau_ref, f"{where}: tau_ref").gain


class _RefractoryWeight(NamedTuple):
    """The weight of a self-synapse, negative, and its relative rounding error."""

    mantissa: int
    exponent: int
    error: float


def _with_dendrites(neuron: SrmAlpha, decay: int, thresholds: Iterable[int], task: Task) -> ChipSrm:
    """Strategy ``dendrite``: own spikes drive a refractory dendrite with the kernel nu through one self-synapse.

    The chosen threshold mantissa is the one whose refractory weight rounds best.
    """
    charge = dendrite_charge(neuron, task.where)
    grid = own_grid(task.chip)
    threshold = min(thresholds, key=lambda t: _refractory_weight(charge, t, grid).error)
    weight = _refractory_weight(charge, threshold, grid)
    return ChipSrm.with_taps(
        task.population.size,
        decay=decay,
        threshold=threshold,
        mantissa=weight.mantissa,
        exponent=weight.exponent,
        refractory_decay=one_decay(neuron.tau_ref, f"{task.where}: tau_ref").u,
    )


def _refractory_weight(charge: float, threshold: int, grid: WeightGrid) -> _RefractoryWeight:
    """Round the weight that brings a charge, in thresholds of this mantissa, to a refractory dendrite."""
    exact = in_units(charge * least_to_spike(threshold))
    exponent = exponent_holding(exact, grid)
    mantissa = int(grid.round(np.array([exact / 2.0**exponent]))[0])
    # An own spike of no charge is held exactly.
    error = abs(mantissa * 2.0**exponent - exact) / exact if exact > 0 else 0.0
    return _RefractoryWeight(-mantissa, exponent, error)


def whole_mantissas(
    charge: float, thresholds: FloatArray, grid: WeightGrid
) -> tuple[IntArray, IntArray, int]:
    """Return threshold mantissas (k,) for which the refractory weight is on the grid, or nearly so.

    Also returns the refractory mantissas (k,), and their common exponent.

    ``charge`` is that of an own spike, in thresholds. ``thresholds`` (k,) are the exact mantissas to stay near, which
    may be fractions. The scale is free, so it is chosen for the refractory weight: its mantissa is the largest of the
    grid with which the threshold is not above the exact one, and the threshold follows from it:

        weight = charge * (threshold + in_units(1)),    threshold = weight / charge - in_units(1)

    If that mantissa would be 0, the threshold is the exact one rounded down, and the refractory weight is rounded.
    """
    whole_thresholds = np.maximum(np.floor(thresholds), 1).astype(np.int64)
    heaviest = charge * in_units(least_to_spike(float(thresholds.max())))
    if heaviest < 0.5:
        # Every refractory weight rounds to 0.
        return whole_thresholds, np.zeros_like(whole_thresholds), 0
    exponent = exponent_holding(heaviest, grid)
    step = grid.step * 2.0**exponent
    exact_steps = charge * in_units(least_to_spike(thresholds)) / step
    below_a_step = exact_steps < 1
    steps = np.where(below_a_step, np.rint(exact_steps), np.floor(exact_steps))
    of_weight = np.maximum(np.rint(steps * step / charge - in_units(1)), 1).astype(np.int64)
    mantissas = -(steps * grid.step).astype(np.int64)
    return np.where(below_a_step, whole_thresholds, of_weight), mantissas, exponent


def _with_resets(neuron: SrmAlpha, decay: int, thresholds: Iterable[int], task: Task) -> ChipCuba:
    """Strategy ``reset``: the chip's own reset and refractory count stand in for the refractory kernel.

    The threshold mantissa is the largest, since there are no own weights that would round better at another one.
    """
    count = min(task.chip.registers.refractory_max, refractory_count(neuron, decay))
    return ChipCuba.of(
        task.population.size,
        decay_u=decay,
        decay_v=decay,
        threshold=max(thresholds),
        refractory=count,
    )


def refractory_count(neuron: SrmAlpha, decay: int) -> int:
    """Return the smallest refractory count with which a spike lowers the potential, summed over steps, as much as nu.

    The sums after one spike, in thresholds, with ``a = exp(-1 / tau_ref)``:

        nu takes       sum over k >= 1 of scale_ref * (k / tau_ref) * exp(1 - k / tau_ref)
                       = scale_ref * e / tau_ref * a / (1 - a)^2
        a reset takes  settled_gain(decay): one threshold, which would otherwise fade by ``decay``

    Each blocked step takes one more threshold. At the published time constants, the reset by itself takes twice what nu
    takes, and more blocked steps only make it worse: on training recordings of both example networks, a count of 1 kept
    the most predictions.
    """
    a = math.exp(-1.0 / neuron.tau_ref)
    one_minus_a = -math.expm1(-1.0 / neuron.tau_ref)
    taken_by_nu = neuron.scale_ref * math.e / neuron.tau_ref * a / one_minus_a**2
    taken_by_reset: float = settled_gain(decay)
    blocked_steps = max(0, math.ceil(taken_by_nu - taken_by_reset))
    # A count of 1 blocks no step.
    return 1 + blocked_steps


_DENDRITES = Layout(lambda neuron, _, task: dendrite_charge(neuron, task.where), _with_dendrites)
LAYOUTS = {
    "dendrite": _DENDRITES,
    "delay-line": Layout(delay_line.heaviest_charge, delay_line.lay_out),
    # This strategy has no self-synapses, so own spikes bring no charge.
    "reset": Layout(lambda *_: 0.0, _with_resets),
    # Two dendrites of each kind: each takes its share of every weight, own ones included.
    "paired-dendrite": _DENDRITES,
}
"""The layout of each strategy, by its name in ``settings.STRATEGIES``."""
