"""Choose a scale for every population and round: weights, decays and thresholds.

Before: a Network in float64, except for populations that are already on the grid.
After:  a QuantizedNetwork. Thresholds are exact, including their rule. Weights and decays are rounded, and the gain of
        each kernel compensates for its rounded decays. Populations on the grid stay as they were.

Weights that round to 0 are counted, and a population can lose most of them. A population that loses all of them is
silent on the chip. If a single input could have made it spike, this would be another network, so it is refused.
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
    """Quantise by these values of the first dials, all others usual; see :func:`quantize_by`."""
    setting = Setting(strategy, weight_bits_of(chip, weight_bits), rounding.split)
    return quantize_by(network, chip, setting, rounding, calibration)


def quantize_by(
    network: Network,
    chip: Chip,
    setting: Setting,
    rounding: Rounding = NEAREST,
    calibration: Calibration | None = None,
) -> QuantizedNetwork:
    """Quantise every population by itself; ``TargetError`` for a network that no scale fits.

    Steps of ``rounding`` that need ``calibration`` recordings are left out without them.
    """
    grid = weight_grid(weight_bits_of(chip, setting.weight_bits), "excitatory")
    populations: list[QuantizedPopulation] = []
    projections: list[ChipProjection] = []
    pruned = 0
    for population in network.populations:
        neuron, incoming = population.neuron, network.into(population.name)
        if isinstance(neuron, ChipNeuron):
            if population.name not in network.readout.from_step:
                _check_voltage(population, neuron, chip)
            populations.append(
                QuantizedPopulation(population, neuron, np.ones(population.size), None)
            )
            rounded = [[p] for p in incoming if isinstance(p, ChipProjection)]
        else:
            floats = tuple(p for p in incoming if isinstance(p, Projection))
            rounding_here = (
                rounding if _holds_grades(floats, chip) else replace(rounding, graded=False)
            )
            task = Task(population, floats, chip, grid, setting, rounding_here, calibration)
            scaled, rounded = round_onto(neuron, task, integers_of(neuron, task))
            fit = partial(kernel_fit, neuron, scaled, chip.registers)
            populations.append(QuantizedPopulation(population, scaled.neuron, scaled.scale, fit))
            check_heard(task, rounded, network.steps_of(population.phase))
        # Count the weights of which no part is left.
        whole = [
            np.sum([np.abs(values_of(p.mantissa)) for p in parts], axis=0) for parts in rounded
        ]
        pruned += sum(int((left == 0).sum()) for left in whole)
        projections += [part for of_one in rounded for part in of_one]
    return QuantizedNetwork(network, tuple(populations), tuple(projections), pruned)


@singledispatch
def integers_of(neuron: Neuron, task: Task) -> Scaled:
    """Return the neurons of a task in integers, and how their weights are rounded, as registered for the model."""
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


def _holds_grades(incoming: Sequence[Projection], chip: Chip) -> bool:
    """Tell whether a core has room for weights in several formats: in each, the list of a source takes a word or more.

    With both signs apart, these words may take half of a core's synapse memory.
    """
    sources = sum(int(p.weights.shape[1]) for p in incoming)
    return sources * 2 * GRADES <= chip.limits.synapse_words_per_core // 2


def _check_voltage(population: Population, neuron: ChipNeuron, chip: Chip) -> None:
    """Refuse integers that came with a network if no voltage of this chip can pass their threshold."""
    registers = chip.registers
    threshold = loihi.threshold_of(int(neuron.threshold.max()))
    largest = loihi.threshold_of(registers.threshold_mantissa_max)
    if registers.voltage_max <= threshold <= largest:
        what = "its threshold is beyond every voltage, so it could never spike"
        measured = f"{threshold} against {registers.voltage_max}; {chip.name} has voltage_bits {registers.voltage_bits}"
        raise TargetError(population.where, what, measured=measured, fix="Train it for this chip.")


def _nearest(p: Projection, scaled: Scaled, grid: WeightGrid) -> ChipProjection:
    """Round a projection onto the grid of its format, magnitudes and signs separately."""
    values = values_of(p.weights)
    factor = of_target(p.weights, loihi.in_units(scaled.gain * scaled.scale) / 2**scaled.exponent)
    mantissa = with_values(
        p.weights, np.sign(values).astype(np.int64) * grid.round(np.abs(values) * factor)
    )
    return ChipProjection(
        p.source, p.target, mantissa, scaled.exponent, grid.weight_bits, delay=p.delay
    )


def check_heard(task: Task, rounded: Iterable[Iterable[ChipProjection]], steps: int) -> None:
    """Refuse a population whose weights all round to 0 although one input could make it spike within ``steps``."""
    if any(values_of(p.mantissa).any() for of_one in rounded for p in of_one):
        return
    answer, fix = _answer(task.population.neuron, steps)
    reached = float((task.largest * answer).max())
    if reached >= 1:
        measured = f"one input that spikes in every step could reach {reached:.3g} thresholds"
        raise TargetError(
            task.where,
            "every weight rounds to 0, so no input reaches it",
            measured=measured,
            fix=fix,
        )


@singledispatch
def _answer(neuron: Neuron, steps: int) -> tuple[FloatArray, str]:
    """Return how many thresholds a weight of 1 reaches if its source spikes in every step, (n,) or (); and a way out.

    For models that are not known, it is what one step adds.
    """
    return 1.0 / np.asarray(neuron.spikes_at, dtype=np.float64), "Use larger weights."


@_answer.register
def _(neuron: SrmAlpha, steps: int) -> tuple[FloatArray, str]:
    answer = np.array(kernel(neuron.tau_sr, np.arange(1.0, steps)).sum() / neuron.theta)
    return answer, "Use larger weights, a shorter tau_sr, or a smaller scale_ref."


@_answer.register
def _(neuron: Leaky, steps: int) -> tuple[FloatArray, str]:
    """Return a bound: steady input adds up to less than 1 / decay, and to at most ``steps``, in each register."""
    with np.errstate(divide="ignore"):
        u, v = (np.minimum(1.0 / lost, steps) for lost in (neuron.decay_u, neuron.decay_v))
    return u * v / neuron.threshold, "Use larger weights, or smaller biases."
