"""Choose integers for SRM neurons, strategy by strategy.

The threshold is exact, rule included: ``u >= theta`` holds where ``v > 64 * threshold``. The gain of the alpha kernel
makes up for its rounded decay.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from hw_model.description.chip import Chip
from locsnn_compile.network.chip_neurons import ChipNeuron, ChipSrm, integers
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.passes.kernels import alpha_kernel, fitted_decays
from locsnn_compile.passes.rounding.task import Scaled, Task, checked_scale, heaviest_weight
from locsnn_compile.passes.srm import delay_line, dendrite, reset
from locsnn_compile.strategies import STRATEGIES

SCALE_SLACK = 0.99
"""A scale may be up to one percent below the largest, if own weights round better there."""


class Layout(Protocol):
    """How SRM neurons are laid out: both functions are told the decay of the alpha kernel, and where they are."""

    def heaviest_charge(self, neuron: SrmAlpha, decay: int, chip: Chip, where: str, /) -> float:
        """Return the heaviest charge of a neuron's own spike, in thresholds."""

    def lay_out(
        self, neuron: SrmAlpha, size: int, decay: int, candidates: Iterable[int], chip: Chip, where: str, /
    ) -> ChipNeuron:
        """Return so many neurons, at one of the threshold mantissas, within the limits of a chip."""


LAYOUTS: dict[str, Layout] = {
    "dendrite": dendrite,
    "delay-line": delay_line,
    "reset": reset,
    # Each dendrite takes its share of every weight, own ones included.
    "paired-dendrite": dendrite,
}


def quantize_srm(neuron: SrmAlpha, task: Task) -> Scaled:
    """Return neurons in integers.

    Where decays are to be fitted, two instead of one, where the strategy can have them: taps are made for one.
    """
    size, chip, strategy, where = task.population.size, task.chip, task.strategy, task.where
    layout, dendrites = LAYOUTS[strategy], STRATEGIES[strategy].dendrites
    mantissa_max = chip.registers.threshold_mantissa_max
    decay, gain, _ = alpha_kernel(neuron.tau_sr, f"{where}: tau_sr")
    heaviest = float(task.largest.max()) * gain / neuron.theta / dendrites
    share = of_a_dendrite(neuron, dendrites)
    own = layout.heaviest_charge(share, decay, chip, where)
    most_own = heaviest_weight(chip)
    if own > most_own / 2:
        measured = f"an own spike weighs {own:.3g} thresholds against {most_own / 2:.0f}"
        raise task.no_scale("refractory kernel", measured, "Use a smaller scale_ref, or strategy reset.")
    cap = int(min(most_own / own - 1, mantissa_max)) if own else mantissa_max
    exponent, most = checked_scale(task, heaviest, cap, 1)
    candidates = range(most, max(1, math.ceil(SCALE_SLACK * most)) - 1, -1)
    made = layout.lay_out(share, size, decay, candidates, chip, where)
    if isinstance(made, ChipSrm):
        made = replace(made, dendrites=dendrites)
    if task.rounding.fitted_decays and strategy != "delay-line":
        decay_u, decay_v, gain, _ = fitted_decays(neuron.tau_sr, f"{where}: tau_sr")
        made = replace(made, decay_u=integers(decay_u, size), decay_v=integers(decay_v, size))
    scale = (64 * made.threshold + 1) / neuron.theta
    return Scaled(made, scale, np.full(size, gain), exponent)


def of_a_dendrite(neuron: SrmAlpha, dendrites: int) -> SrmAlpha:
    """Return a neuron whose own spikes do what they do in each of so many refractory dendrites."""
    return replace(neuron, scale_ref=neuron.scale_ref / dendrites)
