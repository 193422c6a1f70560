"""What a chip description must keep beside its types: widths that the arithmetic here has, and cores that fit tiles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hw_model.errors import InputError

if TYPE_CHECKING:
    from hw_model.description.chip import Chip

_BOUNDS = (
    ("registers", "charge_bits", 9, 40),
    ("registers", "current_bits", 9, 40),
    ("registers", "voltage_bits", 9, 40),
    ("registers", "threshold_mantissa_bits", 1, 34),
    ("registers", "bias_mantissa_bits", 1, 24),
    ("registers", "bias_exponent_max", 0, 24),
    ("registers", "refractory_max", 1, 65_535),
    ("registers", "delay_max", 0, 65_534),
    ("registers", "weight_bits_max", 1, 8),
    ("limits", "cores_per_chip", 1, 65_536),
    ("limits", "compartments_per_core", 1, 1 << 20),
    ("limits", "input_axons_per_core", 1, 1 << 20),
    ("limits", "output_axons_per_core", 1, 1 << 20),
    ("limits", "synapse_words_per_core", 1, 1 << 24),
    ("limits", "synapse_formats_per_core", 1, 65_536),
    ("limits", "compartment_profiles_per_core", 1, 65_536),
    ("limits", "threshold_profiles_per_core", 1, 65_536),
    ("synapse_memory", "word_bits", 1, 4_096),
    ("synapse_memory", "run_length", 1, 65_536),
    ("synapse_memory", "run_header_bits", 0, 1_024),
)
"""Section, key, least and most. In 64 bits products with decays, 2^40 * 2^12, and sums of joined voltages, 2^40 * 2^20,
are exact; slots for delays are memory."""
MAX_CORES = 1 << 20


def check_chip(chip: Chip, where: str) -> None:
    """Refuse a description that contradicts itself, or that no simulation here could follow."""
    for section, key, least, most in _BOUNDS:
        value = getattr(getattr(chip, section), key)
        if not least <= value <= most:
            allowed = f"{least}" if least == most else f"{least} to {most}"
            raise InputError(
                f"{where}: {key}",
                "the model has no such chip",
                measured=f"{value} against {allowed}",
                fix="Correct it.",
            )
    if chip.clock_ghz == 0:
        raise InputError(
            f"{where}: clock_ghz", "a clock that stands has no cycles", fix="Give more than 0, such as 1.0."
        )
    if chip.cores > MAX_CORES:
        raise InputError(
            f"{where}: chips",
            "the board is too large",
            measured=f"{chip.cores} cores against {MAX_CORES}",
            fix="Correct it.",
        )
    mesh = chip.mesh
    if mesh.tiles * mesh.cores_per_tile != chip.limits.cores_per_chip:
        raise InputError(
            f"{where}: mesh",
            "its tiles and the cores of a chip disagree",
            measured=f"{mesh.columns} x {mesh.rows} tiles of {mesh.cores_per_tile} against cores_per_chip "
            f"{chip.limits.cores_per_chip}",
            fix="Make them equal.",
        )
