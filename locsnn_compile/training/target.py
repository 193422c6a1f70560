"""The chip's numbers that a run keeps while its weights learn: scale, threshold, decays and synapse formats.

They are those that the compiler's ``quantize`` chooses for the network at the start, with room for its weights to grow.
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
    OwnSynapse,
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

USUAL_LARGEST = 0.3
"""Largest weight of trained networks in thresholds, what a run from scratch expects: Objects and Containers have 0.12
to 0.37, population by population."""
USUAL_WINDOWS = (0.15, 7.0, 4.0)
"""Of trained windows, times ``count_scale``: the largest weight, what weights of one sign onto an output add up to, and
the largest bias, by level. Beyond its range a bias would shift what is learned against what is played."""


def chip_numbers(
    config: TrainingConfig, description: NetworkDescription, start: Start
) -> ChipNumbers:
    """Return the numbers for a network that starts from weights [out, in] by population name, or from scratch.

    Raises ``InputError`` for a chip that is not known, ``TargetError`` for one of wider registers and for a network
    that no scale fits.
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
    """Return the numbers of populations that spike, as the compiler chooses them."""
    if description.window is not None:
        description = replace(description, architecture="hybrid", window=None)
    largest = {}
    for name, shape in description.weight_shapes.items():
        most = (
            USUAL_LARGEST * description.srm(name).theta
            if start is None
            else float(np.abs(start[name]).max())
        )
        largest[name] = np.full(shape, config.weight_room * most, dtype=np.float32)
    network, weight_bits = network_of(Checkpoint(description, largest)), _weight_bits(config, chip)
    quantized = quantize(network, chip, weight_bits, config.strategy)
    populations = {}
    for projection in quantized.projections:
        found = quantized.population(projection.target)
        scale = float(found.scale[0])
        gain = one_decay(description.srm(projection.target).tau_sr, "neuron: tau_sr").gain
        unit = loihi.in_registers(2.0**projection.exponent) / (gain * scale)
        form = {
            "exponent": projection.exponent,
            "weight_bits": weight_bits,
            "scale": scale,
            "unit": unit,
        }
        populations[projection.target] = ChipPopulation(
            **_integers(found.neuron, config.refractory), **form
        )
    return populations


def _integers(neuron: ChipNeuron, refractory: int) -> dict[str, Any]:
    """Return the integers that all neurons of a population have; ``refractory`` is the count of those with a reset."""
    own = [
        np.stack([taps.mantissa[:, 0], taps.exponent, taps.delay], axis=1)
        for taps in neuron.own.values()
    ]
    return {
        "threshold": int(neuron.threshold[0]),
        "decay": int(neuron.decay_u[0]),
        "refractory_decay": int(neuron.parts["refractory"][0][0])
        if "refractory" in neuron.parts
        else 0,
        "refractory": refractory if "refractory" in neuron.registers else 1,
        "own": tuple(tuple(synapse) for rows in own for synapse in rows.tolist()),
    }


def _of_windows(
    config: TrainingConfig, description: NetworkDescription, start: Start, chip: hw.Chip
) -> _Numbers:
    """Return the numbers of windows, and of their biases, of which each output population has an equal share.

    The scale is whole, so that sums of potentials and spikes are. No charge wraps, unless weights outgrow their room.
    """
    (weight, offset), outputs = description.window_names, description.output_parts
    largest, together, bias = (usual / config.count_scale for usual in USUAL_WINDOWS)
    bias *= len(description.windows.levels)
    if start is not None and start[weight].any():
        largest, bias = float(np.abs(start[weight]).max()), 2.0 * float(np.abs(start[offset]).max())
        together = max(float(row_sums(start[weight][:, part]).max()) for part in outputs)
    room, grid, registers = (
        config.weight_room,
        weight_grid(_weight_bits(config, chip), "excitatory"),
        chip.registers,
    )
    exponent = exponent_holding(0.0, grid)
    one = loihi.in_registers(2.0**exponent)
    scale = max(
        1,
        int(
            one / (room * max(largest / grid.high, together * 2.0**exponent / largest_charge(chip)))
        ),
    )
    threshold = min(loihi.whole_units(registers.voltage_max - 1), registers.threshold_mantissa_max)
    alone: tuple[int, int, int, int, tuple[OwnSynapse, ...]] = threshold, loihi.FORGETS, 0, 1, ()
    coarsest = min(
        loihi_inverse.exponent_of_bits(registers.bias_exponent_max + BIAS_PLACES),
        loihi.EXPONENTS.high,
    )
    share = max(room, 1.0) * bias * scale / len(outputs)
    finest = loihi_inverse.exponent_of_bits(exponent_holding(share, weight_grid(8, "excitatory")))
    of_bias = min(finest, coarsest)
    return {
        weight: ChipPopulation(*alone, exponent, grid.weight_bits, float(scale), one / scale),
        offset: ChipPopulation(
            *alone,
            of_bias,
            8,
            float(scale),
            len(outputs) * loihi.in_registers(2.0**of_bias) / scale,
        ),
    }


def _weight_bits(config: TrainingConfig, chip: hw.Chip) -> int:
    return min(config.weight_bits, chip.registers.weight_bits[-1])


def _registers(chip: hw.Chip) -> RegisterWidths:
    widths = {field.name: getattr(chip.registers, field.name) for field in fields(RegisterWidths)}
    for name, bits in widths.items():
        if not TRAINED_BITS[0] <= bits <= TRAINED_BITS[1]:
            what = f"training does not support registers with such {name}"
            measured = f"{bits} against {TRAINED_BITS[0]}..{TRAINED_BITS[1]}"
            fix = "Train for a chip of narrower registers."
            raise TargetError(f"target {chip.name!r}", what, measured=measured, fix=fix)
    return RegisterWidths(**widths)


def _check_limits(chip: hw.Chip, config: TrainingConfig, description: NetworkDescription) -> None:
    """Refuse settings of the network that its chip does not hold."""
    joined = description.structure.neurons == "srm" and config.strategy != "reset"
    if joined and not target_of(chip).joins:
        what, fix = (
            f"it joins no compartments, as strategy {config.strategy} does",
            "Add strategy reset.",
        )
        raise TargetError(f"target {chip.name!r}", what, fix=fix)
    for what, value, key in (
        ("a delay", max(description.delays + description.location_delays), "delay_max"),
        ("the refractory count", config.refractory, "refractory_max"),
    ):
        if value > (most := getattr(chip.registers, key)):
            what, measured = (
                f"{what} is longer than the chip holds",
                f"{value} against {key} {most}",
            )
            raise TargetError(f"target {chip.name!r}", what, measured=measured, fix="Shorten it.")
