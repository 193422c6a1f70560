"""The ``chip`` entry of a checkpoint: integers that a network trained on a chip's arithmetic is loaded with.

Read with every value checked against what the chip's registers and formats hold; written in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, fields
from typing import Any

from hw_model.arithmetic.fixed_point import DECAY_ONE
from hw_model.arithmetic.weights import WEIGHT_BITS, WEIGHT_EXPONENTS
from locsnn_compile.errors import InputError
from locsnn_compile.models.chip_numbers import (
    TRAINED_BITS,
    ChipNumbers,
    ChipPopulation,
    OwnSynapse,
    RegisterWidths,
)
from locsnn_compile.strategies import TRAINABLE

_WRITE_AGAIN = "Write it again with 'locsnn train'."
#: field -> lowest and highest value of a whole number on any chip that networks are trained for.
_RANGES: dict[str, tuple[int, int]] = {
    "threshold": (0, (1 << 24) - 1),
    "decay": (1, DECAY_ONE),
    "refractory_decay": (0, DECAY_ONE),
    "refractory": (1, 65_535),
    "exponent": (WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1]),
    "weight_bits": (WEIGHT_BITS[0], WEIGHT_BITS[-1]),
}
_OWN_RANGES: dict[str, tuple[int, int]] = {
    "mantissa": (-255, 255),
    "exponent": (WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1]),
    "delay": (0, 65_534),
}
_OWN_MOST = 512
#: strategy -> fewest and most synapses of a neuron to itself.
_OWN_COUNT: dict[str, tuple[int, int]] = {"dendrite": (0, 1), "delay-line": (0, _OWN_MOST), "reset": (0, 0)}


def chip_entry(chip: ChipNumbers) -> dict[str, Any]:
    """Return the entry of a network's numbers."""
    return {
        "target": chip.target,
        "strategy": chip.strategy,
        "registers": asdict(chip.registers),
        "populations": {
            name: asdict(numbers) | {"own": [[s.mantissa, s.exponent, s.delay] for s in numbers.own]}
            for name, numbers in chip.populations.items()
        },
    }


def parse_chip_entry(where: str, entry: object, populations: Collection[str]) -> ChipNumbers:
    """Return the numbers that an entry holds for ``populations``; ``InputError`` for what no chip could be given."""
    whole = _mapping(where, "chip", entry, ("target", "strategy", "registers", "populations"))
    if not isinstance(whole["target"], str) or not whole["target"].isprintable() or len(whole["target"]) > 200:
        raise InputError(where, "entry 'chip.target' is no plain name", fix=_WRITE_AGAIN)
    if whole["strategy"] not in TRAINABLE:
        raise InputError(
            where, "entry 'chip.strategy' is not known", measured=_seen(whole["strategy"]), fix=_WRITE_AGAIN
        )
    registers = _registers(where, whole["registers"])
    parts = _mapping(where, "chip.populations", whole["populations"], populations)
    found = {name: _population(where, f"chip.populations.{name}", parts[name]) for name in populations}
    fewest, most = _OWN_COUNT[whole["strategy"]]
    for name, numbers in found.items():
        if not fewest <= len(numbers.own) <= most:
            raise InputError(
                where,
                f"entry 'chip.populations.{name}.own' does not fit strategy {whole['strategy']!r}",
                measured=f"{len(numbers.own)} synapses against {fewest}..{most}",
                fix=_WRITE_AGAIN,
            )
    return ChipNumbers(whole["target"], whole["strategy"], found, registers)


def _registers(where: str, entry: object) -> RegisterWidths:
    part = _mapping(where, "chip.registers", entry, [field.name for field in fields(RegisterWidths)])
    least, most = TRAINED_BITS[0], TRAINED_BITS[-1]
    return RegisterWidths(
        **{name: _whole(where, f"chip.registers.{name}", bits, least, most) for name, bits in part.items()}
    )


def _population(where: str, key: str, entry: object) -> ChipPopulation:
    part = _mapping(where, key, entry, (*_RANGES, "own", "scale", "unit"))
    numbers = {name: _whole(where, f"{key}.{name}", part[name], *limits) for name, limits in _RANGES.items()}
    if numbers["weight_bits"] not in WEIGHT_BITS:
        raise InputError(where, f"entry '{key}.weight_bits' is a width that no format has", fix=_WRITE_AGAIN)
    for name in ("scale", "unit"):
        value = part[name]
        if not isinstance(value, float) or not math.isfinite(value) or value <= 0:
            raise InputError(
                where, f"entry '{key}.{name}' must be a number above 0", measured=_seen(value), fix=_WRITE_AGAIN
            )
    own = part["own"]
    if not isinstance(own, list) or any(not isinstance(row, list) or len(row) != len(_OWN_RANGES) for row in own):
        raise InputError(where, f"entry '{key}.own' must be a list of synapses", measured=_seen(own), fix=_WRITE_AGAIN)
    synapses = tuple(
        OwnSynapse(
            *(
                _whole(where, f"{key}.own", value, *limits)
                for value, limits in zip(row, _OWN_RANGES.values(), strict=True)
            )
        )
        for row in own[: _OWN_MOST + 1]
    )
    return ChipPopulation(**numbers, own=synapses, scale=part["scale"], unit=part["unit"])


def _mapping(where: str, key: str, entry: object, wanted: Collection[str]) -> Mapping[str, Any]:
    if not isinstance(entry, dict) or set(entry) != set(wanted):
        names = ", ".join(wanted)
        raise InputError(where, f"entry '{key}' must hold {names}", measured=_seen(entry), fix=_WRITE_AGAIN)
    return entry


def _whole(where: str, key: str, value: object, low: int, high: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(
            where,
            f"entry '{key}' must be a whole number in range",
            measured=f"{_seen(value)} against {low}..{high}",
            fix=_WRITE_AGAIN,
        )
    return value


def _seen(value: object) -> str:
    return f"got {value!r}"[:80]
