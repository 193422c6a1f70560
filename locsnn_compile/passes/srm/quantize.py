"""Choose integers for SRM neurons, strategy by strategy.

The threshold is exact, including its rule: ``u >= theta`` exactly if v exceeds the chip's. The gain of the alpha
kernel compensates for its rounded decay. Strategy ``delay-line`` has its own file.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic.fixed_point import WeightGrid
from hw_model.arithmetic.loihi import in_units
from hw_model.arithmetic.loihi_inverse import gain_at_rest, least_to_spike
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
"""A scale may be up to one percent below the largest one, if own weights round better there."""


class Layout(NamedTuple):
    """How SRM neurons are laid out; both functions get the decay of the alpha kernel.

    ``heaviest_charge`` returns the largest charge of a neuron's own spike, in thresholds. ``lay_out`` returns the
    neurons of a task at one of the given threshold mantissas, which come best first, within the limits of its chip.
    """

    heaviest_charge: Callable[[SrmAlpha, int, Task], float]
    lay_out: Callable[[SrmAlpha, int, Iterable[int], Task], ChipNeuron]


def quantize_srm(neuron: SrmAlpha, task: Task) -> Scaled:
    """Return neurons in integers.

    If decays are to be fitted, there are two of them instead of one, unless the strategy has taps, which need one.
    """
    size, strategy, where = task.population.size, task.strategy, task.where
    layout, dendrites = LAYOUTS[strategy], STRATEGIES[strategy].dendrites
    mantissa_max = task.chip.registers.threshold_mantissa_max
    decays = one_decay(neuron.tau_sr, f"{where}: tau_sr")
    heaviest = float(task.largest.max()) * decays.gain / neuron.theta / dendrites
    share = of_a_dendrite(neuron, dendrites)
    own = layout.heaviest_charge(share, decays.u, task)
    most_own = heaviest_weight(task.chip)
    if own > most_own / 2:
        measured = f"its own spike weighs {own:.3g} thresholds against {most_own / 2:.0f}"
        raise task.no_scale(
            "refractory kernel", measured, "Use a smaller scale_ref, or strategy reset."
        )
    cap = int(min(most_own / own - 1, mantissa_max)) if own else mantissa_max
    exponent, most = checked_scale(task, heaviest, cap, 1)
    candidates = range(most, max(1, math.ceil(SCALE_SLACK * most)) - 1, -1)
    made = layout.lay_out(share, decays.u, candidates, task)
    if isinstance(made, ChipSrm):
        made = replace(made, dendrites=dendrites)
    if task.rounding.fitted_decays and strategy != "delay-line":
        decays = two_decays(neuron.tau_sr, f"{where}: tau_sr")
        made = replace(made, decay_u=integers(decays.u, size), decay_v=integers(decays.v, size))
    scale = least_to_spike(made.threshold) / neuron.theta
    return Scaled(made, scale, np.full(size, decays.gain), exponent)


def of_a_dendrite(neuron: SrmAlpha, dendrites: int) -> SrmAlpha:
    """Return a neuron whose own spikes have the effect that they have in one of several refractory dendrites."""
    return replace(neuron, scale_ref=neuron.scale_ref / dendrites)


def dendrite_charge(neuron: SrmAlpha, where: str) -> float:
    """Return the charge that an own spike brings to a refractory dendrite, in thresholds."""
    return neuron.scale_ref * one_decay(neuron.tau_ref, f"{where}: tau_ref").gain


def _with_dendrites(neuron: SrmAlpha, decay: int, thresholds: Iterable[int], task: Task) -> ChipSrm:
    """Strategy ``dendrite``: own spikes drive a refractory dendrite with the kernel nu through one self-synapse.

    The chosen threshold mantissa is the one whose refractory weight rounds best.
    """
    refractory_decay = one_decay(neuron.tau_ref, f"{task.where}: tau_ref").u
    size, grid, charge = (
        task.population.size,
        own_grid(task.chip),
        dendrite_charge(neuron, task.where),
    )

    def rounded(threshold: int) -> tuple[float, int, int]:
        wanted = in_units(charge * least_to_spike(threshold))
        exponent = exponent_holding(wanted, grid)
        mantissa = int(grid.round(np.array([wanted / 2.0**exponent]))[0])
        error = abs(mantissa * 2.0**exponent - wanted) / wanted if wanted > 0 else 0.0
        return error, -mantissa, exponent

    threshold = min(thresholds, key=lambda t: rounded(t)[0])
    _, mantissa, exponent = rounded(threshold)
    own = {"mantissa": mantissa, "exponent": exponent, "refractory_decay": refractory_decay}
    return ChipSrm.with_taps(size, decay=decay, threshold=threshold, **own)


def whole_mantissas(
    charge: float, thresholds: FloatArray, grid: WeightGrid
) -> tuple[IntArray, IntArray, int]:
    """Return threshold mantissas (k,) near those wanted, their refractory mantissas (k,), and the exponent of all.

    ``charge`` is that of an own spike, in thresholds. The scale is free, so it is chosen for the refractory weight: its
    mantissa is the largest of the grid at which the threshold is not above the wanted one, and the threshold follows
    from it. If that mantissa would be 0, the threshold is the wanted one, and the refractory weight is rounded.
    """
    heaviest = charge * in_units(least_to_spike(float(thresholds.max())))
    if heaviest < 0.5:
        return (
            np.maximum(np.floor(thresholds), 1).astype(np.int64),
            np.zeros(len(thresholds), dtype=np.int64),
            0,
        )
    exponent = exponent_holding(heaviest, grid)
    step = grid.step * 2.0**exponent
    wanted = charge * in_units(least_to_spike(thresholds)) / step
    steps = np.where(wanted < 1, np.rint(wanted), np.floor(wanted))
    found = np.where(wanted < 1, np.floor(thresholds), np.rint(steps * step / charge - in_units(1)))
    return np.maximum(found, 1).astype(np.int64), -(steps * grid.step).astype(np.int64), exponent


def _with_resets(neuron: SrmAlpha, decay: int, thresholds: Iterable[int], task: Task) -> ChipCuba:
    """Strategy ``reset``: the chip's own reset and refractory count stand in for the refractory kernel.

    The threshold mantissa is the largest.
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
    """Return the smallest count with which a spike takes as much from the potential, summed over steps, as nu does.

    A reset takes one threshold, which would otherwise fade by ``decay``: its gain at rest over all steps.
    Each blocked step takes one more. At the published time constants, the reset by itself takes twice what nu takes,
    and more blocked steps only make it worse: on training recordings of both example networks, a count of 1 kept most
    predictions.
    """
    kept, lost = math.exp(-1.0 / neuron.tau_ref), -math.expm1(-1.0 / neuron.tau_ref)
    taken = neuron.scale_ref * math.e / neuron.tau_ref * kept / lost**2
    of_reset: float = gain_at_rest(decay)
    return 1 + max(0, math.ceil(taken - of_reset))


_DENDRITES = Layout(lambda neuron, _, task: dendrite_charge(neuron, task.where), _with_dendrites)
LAYOUTS = {
    "dendrite": _DENDRITES,
    "delay-line": Layout(delay_line.heaviest_charge, delay_line.lay_out),
    # This strategy has no self-synapses.
    "reset": Layout(lambda *_: 0.0, _with_resets),
    # Each dendrite takes its share of every weight, own ones included.
    "paired-dendrite": _DENDRITES,
}
