"""What a network trained on the chip's arithmetic is made of: registers and synapse formats, no float but its scale.

And the ``chip`` entry of a checkpoint that holds these integers: read with every value checked against what the chip's
registers and formats hold; written in the same order. Nothing here imports torch, so that the compiler reads them too.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_BITS, WEIGHT_EXPONENTS, WeightGrid, weight_grid
from hw_model.values import AnyArray, Frozen, IntArray, picked
from locsnn_compile.models.plain_checks import file_fault, is_whole
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, Refractory
from locsnn_compile.settings import TRAINABLE


class RegisterWidths(Frozen):
    """Widths of registers in bits, the sign not counted."""

    charge_bits: int = 21
    current_bits: int = 23
    voltage_bits: int = 23


USUAL_REGISTERS = RegisterWidths()
"""Those of the chips that ship."""
TRAINED_BITS = range(9, 30)
"""Widths that networks are trained on: no sum on the way needs more than 32 bits."""


class ChipPopulation(Frozen, eq=False):
    """A population on the chip, and the synapses onto it.

    - ``neuron``: all neurons of it have the same integers, and one decay of current and voltage.
    - ``exponent`` and ``weight_bits``: format of the incoming weights, positive and negative ones apart.
    - ``scale``: register units of a potential of 1 in the float network; ``unit``: the float weight of a mantissa of 1.

    The biases of windows are one more: see :meth:`~locsnn_compile.network.chip_neurons.ChipCuba.with_biases`.
    """

    neuron: ChipNeuron
    exponent: int
    weight_bits: int
    scale: float
    unit: float

    @property
    def grid(self) -> WeightGrid:
        """The magnitudes that a mantissa may have."""
        return weight_grid(self.weight_bits, "excitatory")


class ChipNumbers(Frozen):
    """A network's populations, the strategy they are laid out by, and the chip whose arithmetic they follow."""

    target: str
    strategy: str
    populations: Mapping[str, ChipPopulation]
    registers: RegisterWidths = USUAL_REGISTERS

    def window_output(self, names: Sequence[str], mantissas: Mapping[str, IntArray]) -> ChipCuba:
        """Return the output neurons of windows, with their biases; ``names`` of weights and biases."""
        neuron = self.populations[names[0]].neuron
        assert isinstance(neuron, ChipCuba)
        return neuron.with_biases(mantissas[names[1]], self.populations[names[1]].exponent)

    def floats(self, mantissas: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return mantissas by population name in the float network's units."""
        return {name: held * self.populations[name].unit for name, held in mantissas.items()}


#: field -> lowest and highest value of a whole number on any chip that networks are trained for.
_RANGES: dict[str, tuple[int, int]] = {
    "threshold": (0, (1 << 24) - 1),
    "decay": (1, DECAY_ONE),
    "refractory_decay": (0, DECAY_ONE),
    "refractory": (1, 65_535),
    "exponent": (WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1]),
    "weight_bits": (WEIGHT_BITS[0], WEIGHT_BITS[-1]),
}
_OWN_RANGES = ((-255, 255), (WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1]), (0, 65_534))
"""Of the mantissa, the exponent and the delay of a synapse of a neuron to itself."""
_OWN_MOST = {"dendrite": 1, "delay-line": 512, "reset": 0}
"""Strategy -> most synapses of a neuron to itself."""


def chip_entry(chip: ChipNumbers) -> dict[str, Any]:
    """Return the entry of a network's numbers."""
    populations = {
        name: _own_entry(part.neuron) | picked(part, "exponent", "weight_bits", "scale", "unit")
        for name, part in chip.populations.items()
    }
    return picked(chip, "target", "strategy") | {"registers": asdict(chip.registers), "populations": populations}


def _own_entry(neuron: ChipNeuron) -> dict[str, Any]:
    """Return the integers of a neuron; those that its strategy has not are as if they did nothing."""
    pull, count = neuron.parts.get("refractory"), neuron.registers.get("refractory")
    own = [np.stack([taps.mantissa[:, 0], taps.exponent, taps.delay], axis=1) for taps in neuron.own.values()]
    return {
        "threshold": int(neuron.threshold[0]),
        "decay": int(neuron.decay_u[0]),
        "refractory_decay": 0 if pull is None else int(pull[0][0]),
        "refractory": 1 if count is None else int(count[0]),
        "own": [synapse for rows in own for synapse in rows.tolist()],
    }


def parse_chip_entry(
    where: str, entry: object, shapes: Mapping[str, tuple[int, ...]], windows: Collection[str]
) -> ChipNumbers:
    """Return the numbers that an entry holds for populations of weights ``shapes`` (out, in).

    Neurons of ``windows`` are single compartments, whatever the strategy. Raises ``InputError`` for what no chip could
    be given.
    """
    whole = _mapping(where, "chip", entry, ("target", "strategy", "registers", "populations"))
    strategy, target = whole["strategy"], whole["target"]
    if not isinstance(target, str) or not target.isprintable() or len(target) > 200:
        raise file_fault(where, "entry 'chip.target' is not a plain name")
    if strategy not in TRAINABLE:
        raise file_fault(where, "entry 'chip.strategy' is not known", _seen(strategy))
    bits = _mapping(where, "chip.registers", whole["registers"], [field.name for field in fields(RegisterWidths)])
    ends = TRAINED_BITS[0], TRAINED_BITS[-1]
    registers = {name: _whole(where, f"chip.registers.{name}", width, *ends) for name, width in bits.items()}
    parts = _mapping(where, "chip.populations", whole["populations"], shapes)
    found = {
        name: _population(
            where, f"chip.populations.{name}", parts[name], "reset" if name in windows else strategy, shape[0]
        )
        for name, shape in shapes.items()
    }
    return ChipNumbers(target, strategy, found, RegisterWidths(**registers))


def _population(where: str, key: str, entry: object, strategy: str, size: int) -> ChipPopulation:
    part = _mapping(where, key, entry, (*_RANGES, "own", "scale", "unit"))
    numbers = {name: _whole(where, f"{key}.{name}", part[name], *limits) for name, limits in _RANGES.items()}
    if numbers["weight_bits"] not in WEIGHT_BITS:
        raise file_fault(where, f"entry '{key}.weight_bits' is a width that no format has")
    for name in ("scale", "unit"):
        value = part[name]
        if not isinstance(value, float) or not math.isfinite(value) or value <= 0:
            raise file_fault(where, f"entry '{key}.{name}' must be a number above 0", _seen(value))
    own = _own(where, f"{key}.own", part["own"], strategy)
    neuron = _neuron(strategy, size, numbers, own)
    return ChipPopulation(neuron, numbers["exponent"], numbers["weight_bits"], part["scale"], part["unit"])


def _own(where: str, key: str, rows: object, strategy: str) -> list[list[int]]:
    """Return the mantissa, exponent and delay of each synapse of a neuron to itself."""
    if not isinstance(rows, list) or any(not isinstance(row, list) or len(row) != len(_OWN_RANGES) for row in rows):
        raise file_fault(where, f"entry '{key}' must be a list of synapses", _seen(rows))
    most = _OWN_MOST[strategy]
    if len(rows) > most:
        raise file_fault(
            where, f"entry '{key}' does not fit strategy {strategy!r}", f"{len(rows)} synapses against 0..{most}"
        )
    for row in rows:
        for value, limits in zip(row, _OWN_RANGES, strict=True):
            _whole(where, key, value, *limits)
    return rows


def _neuron(strategy: str, size: int, numbers: Mapping[str, int], own: list[list[int]]) -> ChipNeuron:
    decay, threshold = numbers["decay"], numbers["threshold"]
    if strategy == "reset":
        refractory = numbers["refractory"]
        return ChipCuba.of(size, decay_u=decay, decay_v=decay, threshold=threshold, refractory=refractory)
    # A refractory dendrite has one synapse, if only of weight 0.
    dendrite = strategy == "dendrite"
    mantissa, exponent, delay = np.array(own or ([[0, 0, 0]] if dendrite else []), dtype=np.int64).reshape(-1, 3).T
    taps = Refractory.of(size, mantissa, exponent, delay, numbers["refractory_decay"] if dendrite else None)
    return ChipSrm.of(size, decay_u=decay, decay_v=decay, threshold=threshold, refractory=taps)


def _mapping(where: str, key: str, entry: object, wanted: Collection[str]) -> Mapping[str, Any]:
    if not isinstance(entry, dict) or set(entry) != set(wanted):
        names = ", ".join(wanted)
        raise file_fault(where, f"entry '{key}' must hold {names}", _seen(entry))
    return entry


def _whole(where: str, key: str, value: object, low: int, high: int) -> int:
    if not is_whole(value) or not low <= value <= high:
        raise file_fault(
            where, f"entry '{key}' must be a whole number in range", f"{_seen(value)} against {low}..{high}"
        )
    return value


def _seen(value: object) -> str:
    return f"got {value!r}"[:80]
