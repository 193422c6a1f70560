"""The chip's numbers that a run keeps while its weights learn: scale, threshold, decays and synapse formats.

They are those that the compiler's ``quantize`` chooses for the network at the start, with room for its weights to grow.
"""

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

import hw_model as hw
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.frontends.checkpoint import network_of
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.chip_entry import TRAINED_BITS, ChipNumbers, ChipPopulation, RegisterWidths
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.network.chip_neurons import ChipCuba, integers
from locsnn_compile.passes.kernels import alpha_kernel
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.training.config import TrainingConfig

USUAL_LARGEST = 0.3
"""Largest weight of trained networks in thresholds, what a run from scratch expects: Objects and Containers have 0.12
to 0.37, population by population."""


def chip_numbers(
    config: TrainingConfig, description: NetworkDescription, start: Mapping[str, NDArray[np.float32]] | None
) -> ChipNumbers:
    """Return the numbers for a network that starts from weights [out, in] by population name, or from scratch.

    Raises ``InputError`` for a chip that is not known, ``TargetError`` for one of wider registers and for a network
    that no scale fits.
    """
    if description.window is not None:
        what, fix = "its windows are not trained on a chip's integers", "Train it in float."
        raise InputError(f"architecture {description.architecture!r}", what, fix=fix)
    chip = hw.chip(config.target)
    registers = _registers(chip)
    _check_limits(chip, config, description)
    largest = {}
    for name, shape in description.weight_shapes.items():
        most = USUAL_LARGEST * description.srm(name).theta if start is None else float(np.abs(start[name]).max())
        largest[name] = np.full(shape, config.weight_room * most, dtype=np.float32)
    network = network_of(Checkpoint(description, largest))
    weight_bits = min(config.weight_bits, chip.registers.weight_bits[-1])
    quantized = quantize(network, chip, weight_bits, config.strategy)
    populations = {}
    for projection in quantized.projections:
        found = quantized.population(projection.target)
        scale, own = float(found.scale[0]), found.neuron
        if isinstance(own, ChipCuba):
            own = replace(own, refractory=integers(config.refractory, len(found.scale)))
        gain = alpha_kernel(description.srm(projection.target).tau_sr, "neuron: tau_sr")[1]
        unit = 64 * 2**projection.exponent / (gain * scale)
        populations[projection.target] = ChipPopulation(own, projection.exponent, weight_bits, scale, unit)
    return ChipNumbers(config.target, config.strategy, populations, registers)


def _registers(chip: hw.Chip) -> RegisterWidths:
    widths = {field.name: getattr(chip.registers, field.name) for field in fields(RegisterWidths)}
    for name, bits in widths.items():
        if bits not in TRAINED_BITS:
            what = f"networks are not trained on registers of such {name}"
            measured = f"{bits} against {TRAINED_BITS[0]}..{TRAINED_BITS[-1]}"
            fix = "Train for a chip of narrower registers."
            raise TargetError(f"target {chip.name!r}", what, measured=measured, fix=fix)
    return RegisterWidths(**widths)


def _check_limits(chip: hw.Chip, config: TrainingConfig, description: NetworkDescription) -> None:
    """Refuse settings of the network that its chip does not hold."""
    for what, value, key in (
        ("a delay", max(description.delays + description.location_delays), "delay_max"),
        ("the refractory count", config.refractory, "refractory_max"),
    ):
        if value > (most := getattr(chip.registers, key)):
            what, measured = f"{what} is longer than the chip holds", f"{value} against {key} {most}"
            raise TargetError(f"target {chip.name!r}", what, measured=measured, fix="Shorten it.")
