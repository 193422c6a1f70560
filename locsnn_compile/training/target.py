"""Choose the integers of a network that is trained on the arithmetic of a chip with cores, such as Loihi.

Scale, thresholds, decays and the formats of synapses stay fixed during the run, while the weights learn. They are those
that the compiler's ``quantize`` chooses for the network at the start of the run, with room for its weights to grow.
:mod:`.xylo_target` is the same for the chip Xylo.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

import hw_model as hw
from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.arithmetic.fixed_point import weight_grid
from hw_model.targets import target_of
from hw_model.values import Float32Array
from locsnn_compile.errors import TargetError
from locsnn_compile.frontends.checkpoint import network_of
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.chip_entry import (
    TRAINED_BITS,
    ChipNumbers,
    ChipPopulation,
    RegisterWidths,
)
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.network.chip_neurons import BIAS_PLACES, ChipNeuron
from locsnn_compile.network.projections import row_sums
from locsnn_compile.passes.kernels import one_decay
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding.task import exponent_holding, largest_charge
from locsnn_compile.training.config import TrainingConfig

Start = Mapping[str, Float32Array] | None
"""Weights by name that a run begins with; None: from scratch."""
_Numbers = dict[str, ChipPopulation]
"""The integers of each population, by its name."""

USUAL_LARGEST = 0.3
"""The largest weight, in thresholds, that a run from scratch expects to learn. Networks trained on Ev-Objects and
Ev-Containers have 0.12 to 0.37, depending on the population."""
USUAL_WINDOWS = (0.15, 7.0, 4.0)
"""What a run of windows from scratch expects to learn, from trained networks, each times ``count_scale``: the largest
weight; the largest sum of weights of one sign onto an output; the largest bias, per level of events. A bias beyond the
range of its format would be clipped, and the chip's scores would differ from those that are learned."""


_BIAS_BITS = 8
"""Bits of the magnitude of a bias, as of a weight."""


def chip_numbers(
    config: TrainingConfig, description: NetworkDescription, start: Start
) -> ChipNumbers:
    """Return the integers for a network that starts from weights [out, in] by population name, or from scratch.

    Raises ``InputError`` for an unknown chip, and ``TargetError`` for a chip whose registers are too wide for training
    and for a network that no scale fits.
    """
    chip = hw.chip(config.target)
    registers = _registers(chip)
    _check_limits(chip, config, description)
    populations: _Numbers = {}
    if description.structure.neurons != "windows":
        populations |= _of_spikes(config, description, start, chip)
    if description.structure.window_branch:
        populations |= _of_windows(config, description, start, chip)
    return ChipNumbers(config.target, config.strategy, registers, populations)


def _of_spikes(
    config: TrainingConfig, description: NetworkDescription, start: Start, chip: hw.Chip
) -> _Numbers:
    """Return the integers of populations that spike, as the compiler chooses them."""
    if description.window is not None:
        # Without its branch of windows, hybrid-window is hybrid.
        description = replace(description, architecture="hybrid", window=None)
    # The compiler is given a network whose weights are all as large as any may become: the formats that
    # it chooses hold whatever is learned.
    largest_weights = {}
    for name, shape in description.weight_shapes.items():
        if start is None:
            largest = USUAL_LARGEST * description.srm(name).theta
        else:
            largest = float(np.abs(start[name]).max())
        largest_weights[name] = np.full(shape, config.weight_room * largest, dtype=np.float32)
    network = network_of(Checkpoint(description, largest_weights))
    weight_bits = _weight_bits(config, chip)
    quantized = quantize(network, chip, weight_bits, config.strategy)
    populations = {}
    for projection in quantized.projections:
        population = quantized.population(projection.target)
        scale = float(population.scale[0])
        gain = one_decay(description.srm(projection.target).tau_sr, "neuron: tau_sr").gain
        # The charge of a mantissa of 1 raises the potential, through the gain of the response, by the
        # float weight that it stands for.
        unit = loihi.in_registers(2.0**projection.exponent) / (gain * scale)
        populations[projection.target] = ChipPopulation(
            **_integers(population.neuron, config.refractory),
            exponent=projection.exponent,
            weight_bits=weight_bits,
            scale=scale,
            unit=unit,
        )
    return populations


def _integers(neuron: ChipNeuron, refractory: int) -> dict[str, Any]:
    """Return the fields of :class:`ChipPopulation` that are those of its neurons.

    All neurons of a population are equal, so the first stands for all. ``refractory`` is the refractory steps of
    neurons with the chip's own reset.
    """
    own: list[tuple[int, ...]] = []
    for taps in neuron.own.values():
        synapses = np.stack([taps.mantissa[:, 0], taps.exponent, taps.delay], axis=1)
        own += map(tuple, synapses.tolist())
    refractory_decay = 0
    if "refractory" in neuron.parts:
        refractory_decay = int(neuron.parts["refractory"][0][0])
    return {
        "threshold": int(neuron.threshold[0]),
        "decay": int(neuron.decay_u[0]),
        "refractory_decay": refractory_decay,
        "refractory": refractory if "refractory" in neuron.registers else 1,
        "own": tuple(own),
    }


def _of_windows(
    config: TrainingConfig, description: NetworkDescription, start: Start, chip: hw.Chip
) -> _Numbers:
    """Return the integers of the outputs of a branch of windows: those of their weights, and those of their biases.

    A class has an output neuron in each of the output populations, whose potentials are added; each has an equal share
    of the bias. The scale is a whole number, so that sums of these potentials and of spike counts of other branches are
    exact. No charge wraps, unless weights outgrow their room.
    """
    weight_name, bias_name = description.window_names
    outputs = description.output_parts
    room = config.weight_room
    registers = chip.registers
    grid = weight_grid(_weight_bits(config, chip), "excitatory")
    # What the formats must hold, in float units: one weight, the sum of weights of one sign, and a bias.
    largest, largest_sum, largest_bias = (usual / config.count_scale for usual in USUAL_WINDOWS)
    largest_bias *= len(description.windows.levels)
    if start is not None and start[weight_name].any():
        largest = float(np.abs(start[weight_name]).max())
        largest_sum = max(float(row_sums(start[weight_name][:, part]).max()) for part in outputs)
        # Twice the largest bias of the start, as room for growth.
        largest_bias = 2.0 * float(np.abs(start[bias_name]).max())
    exponent = exponent_holding(0.0, grid)
    charge_of_one = loihi.in_registers(2.0**exponent)
    # The largest scale at which the largest weight is within the grid, and the largest sum within the charge register.
    by_weight = largest / grid.high
    by_sum = largest_sum * 2.0**exponent / largest_charge(chip)
    scale = max(1, int(charge_of_one / (room * max(by_weight, by_sum))))
    # Outputs never spike, because their potentials are read: the threshold is out of reach.
    threshold = min(loihi.whole_units(registers.voltage_max - 1), registers.threshold_mantissa_max)
    coarsest = min(
        loihi_inverse.exponent_of_bits(registers.bias_exponent_max + BIAS_PLACES),
        loihi.EXPONENTS.high,
    )
    bias_of_output = max(room, 1.0) * largest_bias * scale / len(outputs)
    bias_grid = weight_grid(_BIAS_BITS, "excitatory")
    finest = loihi_inverse.exponent_of_bits(exponent_holding(bias_of_output, bias_grid))
    bias_exponent = min(finest, coarsest)
    weights = ChipPopulation(
        threshold=threshold,
        decay=loihi.FORGETS,
        refractory_decay=0,
        refractory=1,
        own=(),
        exponent=exponent,
        weight_bits=grid.weight_bits,
        scale=float(scale),
        unit=charge_of_one / scale,
    )
    biases = replace(
        weights,
        exponent=bias_exponent,
        weight_bits=_BIAS_BITS,
        unit=len(outputs) * loihi.in_registers(2.0**bias_exponent) / scale,
    )
    return {weight_name: weights, bias_name: biases}


def _weight_bits(config: TrainingConfig, chip: hw.Chip) -> int:
    """Return the bits of a weight: those of the configuration, or the most that the chip has."""
    return min(config.weight_bits, chip.registers.weight_bits[-1])


def _registers(chip: hw.Chip) -> RegisterWidths:
    """Return the widths of the chip's registers; ``TargetError`` for widths that training does not support."""
    widths = {field.name: getattr(chip.registers, field.name) for field in fields(RegisterWidths)}
    fewest, most = TRAINED_BITS
    for name, bits in widths.items():
        if not fewest <= bits <= most:
            what = f"training does not support registers with such {name}"
            measured = f"{bits} against {fewest}..{most}"
            fix = "Train for a chip of narrower registers."
            raise TargetError(f"target {chip.name!r}", what, measured=measured, fix=fix)
    return RegisterWidths(**widths)


def _check_limits(chip: hw.Chip, config: TrainingConfig, description: NetworkDescription) -> None:
    """Refuse delays and refractory steps that the chip does not hold, and a strategy that it cannot build."""
    # These strategies build a neuron from several compartments, which the chip must be able to join.
    needs_joins = description.structure.neurons == "srm" and config.strategy != "reset"
    if needs_joins and not target_of(chip).joins:
        what = f"it joins no compartments, as strategy {config.strategy} does"
        raise TargetError(f"target {chip.name!r}", what, fix="Add strategy reset.")
    for what, value, key in (
        ("a delay", max(description.delays + description.location_delays), "delay_max"),
        ("the refractory count", config.refractory, "refractory_max"),
    ):
        most = getattr(chip.registers, key)
        if value > most:
            too_long = f"{what} is longer than the chip holds"
            measured = f"{value} against {key} {most}"
            raise TargetError(
                f"target {chip.name!r}", too_long, measured=measured, fix="Shorten it."
            )
