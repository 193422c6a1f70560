"""Choose a scale for every population and round: weights, decays and thresholds.

Before: a Network in float64, except for populations that are already on the grid.
After:  a QuantizedNetwork. Thresholds are exact, including their rule. Weights and decays are rounded, and the gain of
        each kernel compensates for its rounded decays. Populations on the grid stay as they were.

Weights that round to 0 are counted, and a population can lose most of them. A population that loses all of them is
silent on the chip. If a single input could have made it spike, the chip would run a different network, so it is
refused.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial, singledispatch

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import WeightGrid, weight_grid
from hw_model.description.chip import Chip
from hw_model.values import FloatArray
from locsnn_compile.errors import TargetError
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.neurons import Cuba, Leaky, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import (
    ChipProjection,
    Projection,
    of_target,
    values_of,
    with_values,
)
from locsnn_compile.network.quantized import QuantizedNetwork, QuantizedPopulation
from locsnn_compile.passes.cuba.quantize import quantize_cuba, quantize_soft
from locsnn_compile.passes.kernel_fit import kernel_fit
from locsnn_compile.passes.kernels import kernel
from locsnn_compile.passes.rounding.grades import GRADES, round_apart
from locsnn_compile.passes.rounding.task import NEAREST, Rounded, Rounding, Scaled, Task
from locsnn_compile.passes.srm.fine import fine_srm
from locsnn_compile.passes.srm.quantize import quantize_srm
from locsnn_compile.reference.evaluate import Calibration
from locsnn_compile.settings import Setting, weight_bits_of


def quantize(
    network: Network,
    chip: Chip,
    weight_bits: int | None = None,
    strategy: str = "dendrite",
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> QuantizedNetwork:
    """Quantise with these arguments, and all other settings of the compiler at their defaults.

    See :func:`quantize_by`.
    """
    setting = Setting(strategy, weight_bits_of(chip, weight_bits), rounding.split)
    return quantize_by(network, chip, setting, rounding, calibration)


def quantize_by(
    network: Network,
    chip: Chip,
    setting: Setting,
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> QuantizedNetwork:
    """Quantise every population by itself.

    Steps of ``rounding`` that need ``calibration`` recordings are left out without them. Raises ``TargetError`` for a
    network that does not fit the chip at any scale.
    """
    grid = weight_grid(weight_bits_of(chip, setting.weight_bits), "excitatory")
    populations: list[QuantizedPopulation] = []
    projections: list[ChipProjection] = []
    pruned = 0
    for population in network.populations:
        neuron = population.neuron
        incoming = network.into(population.name)
        if isinstance(neuron, ChipNeuron):
            # Neurons whose potentials are read out need not spike.
            if population.name not in network.readout.from_step:
                _check_voltage(population, neuron, chip)
            populations.append(
                QuantizedPopulation(population, neuron, np.ones(population.size), measure_fit=None)
            )
            rounded = [[p] for p in incoming if isinstance(p, ChipProjection)]
        else:
            floats = tuple(p for p in incoming if isinstance(p, Projection))
            rounding_onto = rounding
            if not _has_room_for_grades(floats, chip):
                rounding_onto = replace(rounding, graded=False)
            task = Task(population, floats, chip, grid, setting, rounding_onto, calibration)
            scaled, rounded = round_onto(neuron, task, integers_of(neuron, task))
            fit = partial(kernel_fit, neuron, scaled, chip.registers)
            populations.append(QuantizedPopulation(population, scaled.neuron, scaled.scale, fit))
            check_heard(task, rounded, network.steps_of(population.phase))
        for parts in rounded:
            pruned += _count_lost_weights(parts)
            projections += parts
    return QuantizedNetwork(network, tuple(populations), tuple(projections), pruned)


def _count_lost_weights(parts: Sequence[ChipProjection]) -> int:
    """Return how many weights of a projection are 0 in all the parts that it became."""
    magnitude = np.sum([np.abs(values_of(part.mantissa)) for part in parts], axis=0)
    return int((magnitude == 0).sum())


@singledispatch
def integers_of(neuron: Neuron, task: Task) -> Scaled:
    """Return the neurons of a task in integers, and how their weights are scaled, as registered for the model.

    Raises ``TargetError`` for a model without a registration.
    """
    what = f"{task.chip.name} does not have {neuron.needs or type(neuron).__name__ + ' neurons'}"
    raise TargetError(task.where, what, fix=neuron.way_out)


integers_of.register(SrmAlpha, quantize_srm)
integers_of.register(Cuba, quantize_cuba)
integers_of.register(SoftCuba, quantize_soft)


@singledispatch
def round_onto(neuron: Neuron, task: Task, scaled: Scaled) -> Rounded:
    """Return the neurons, and the projections that each incoming one becomes; each weight is rounded by itself."""
    if task.rounding.graded or task.rounding.split or scaled.neuron.dendrites > 1:
        return scaled, round_apart(task, scaled)
    return scaled, [[_nearest(p, scaled, task.grid)] for p in task.incoming]


@round_onto.register
def _(neuron: SrmAlpha, task: Task, scaled: Scaled) -> Rounded:
    """Round weights together if there are recordings to round them for."""
    return fine_srm(neuron, task, scaled) or round_onto.dispatch(Neuron)(neuron, task, scaled)


def _has_room_for_grades(incoming: Sequence[Projection], chip: Chip) -> bool:
    """Return whether a core has room for weights in several formats.

    A source has a list of synapses per format, which takes at least one word of memory, and formats are separate for
    both signs. These words may take half of a core's synapse memory; the share is chosen by hand.
    """
    sources = sum(int(p.weights.shape[1]) for p in incoming)
    signs = 2
    return sources * signs * GRADES <= chip.limits.synapse_words_per_core // 2


def _check_voltage(population: Population, neuron: ChipNeuron, chip: Chip) -> None:
    """Refuse integers that came with a network if no voltage of this chip can pass their threshold.

    Thresholds beyond the threshold register itself are left to a later check.
    """
    registers = chip.registers
    threshold = loihi.threshold_of(int(neuron.threshold.max()))
    largest = loihi.threshold_of(registers.threshold_mantissa_max)
    if registers.voltage_max <= threshold <= largest:
        what = "its threshold is beyond every voltage, so it could never spike"
        measured = f"{threshold} against {registers.voltage_max}; {chip.name} has voltage_bits {registers.voltage_bits}"
        raise TargetError(population.where, what, measured=measured, fix="Train it for this chip.")


def _nearest(p: Projection, scaled: Scaled, grid: WeightGrid) -> ChipProjection:
    """Round every weight of a projection to the nearest mantissa; the grid has magnitudes, signs are put back."""
    values = values_of(p.weights)
    mantissa_per_weight = loihi.in_units(scaled.gain * scaled.scale) / 2**scaled.exponent
    magnitude = grid.round(np.abs(values) * of_target(p.weights, mantissa_per_weight))
    mantissa = with_values(p.weights, np.sign(values).astype(np.int64) * magnitude)
    return ChipProjection(
        p.source, p.target, mantissa, scaled.exponent, grid.weight_bits, delay=p.delay
    )


def check_heard(task: Task, rounded: Iterable[Iterable[ChipProjection]], steps: int) -> None:
    """Refuse a population whose weights all round to 0 although one input could make it spike within ``steps``."""
    if any(values_of(part.mantissa).any() for parts in rounded for part in parts):
        return
    thresholds_per_weight, fix = _thresholds_per_weight(task.population.neuron, steps)
    reached = float((task.largest * thresholds_per_weight).max())
    if reached >= 1:
        measured = f"one input that spikes in every step could reach {reached:.3g} thresholds"
        raise TargetError(
            task.where,
            "every weight rounds to 0, so no input reaches it",
            measured=measured,
            fix=fix,
        )


@singledispatch
def _thresholds_per_weight(neuron: Neuron, steps: int) -> tuple[FloatArray, str]:
    """Return how many thresholds a weight of 1 reaches if its source spikes in every step, (n,) or (), and advice.

    For models without a registration, it is what a single spike adds at once.
    """
    return 1.0 / np.asarray(neuron.spikes_at, dtype=np.float64), "Use larger weights."


@_thresholds_per_weight.register
def _(neuron: SrmAlpha, steps: int) -> tuple[FloatArray, str]:
    kernel_sum = kernel(neuron.tau_sr, np.arange(1.0, steps)).sum()
    return np.array(
        kernel_sum / neuron.theta
    ), "Use larger weights, a shorter tau_sr, or a smaller scale_ref."


@_thresholds_per_weight.register
def _(neuron: Leaky, steps: int) -> tuple[FloatArray, str]:
    """Return a bound: in each register, steady input adds up to at most 1 / decay, and to at most ``steps``."""
    with np.errstate(divide="ignore"):  # a decay of 0 leaves the bound of the steps
        current = np.minimum(1.0 / neuron.decay_u, steps)
        voltage = np.minimum(1.0 / neuron.decay_v, steps)
    return current * voltage / neuron.threshold, "Use larger weights, or smaller biases."
