"""What a network trained on the chip's arithmetic is made of: registers and synapse formats, no float but its scale.

And the ``chip`` entry of a checkpoint that holds these integers: read with every value checked against what the chip's
registers and formats hold; written in the same order. Nothing here imports torch, so that the compiler reads them too.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_BITS, WEIGHT_EXPONENTS, WeightGrid, weight_grid
from hw_model.io.records import POSITIVE, Must, RecordReader, between
from hw_model.values import AnyArray, Frozen, IntArray, picked
from locsnn_compile.errors import counted
from locsnn_compile.models.plain_checks import WRITE_AGAIN, file_fault
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, Refractory
from locsnn_compile.settings import TRAINABLE

TRAINED_BITS = (9, 29)
"""Least and most bits of registers that networks are trained on: no sum on the way needs more than 32 bits."""


class RegisterWidths(Frozen):
    """Widths of registers in bits, the sign not counted."""

    charge_bits: Annotated[int, between(*TRAINED_BITS)] = 21
    current_bits: Annotated[int, between(*TRAINED_BITS)] = 23
    voltage_bits: Annotated[int, between(*TRAINED_BITS)] = 23


USUAL_REGISTERS = RegisterWidths()
"""Those of the chips that ship."""


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


Exponent = Annotated[int, between(WEIGHT_EXPONENTS[0], WEIGHT_EXPONENTS[-1])]
OwnSynapse = tuple[Annotated[int, between(-255, 255)], Exponent, Annotated[int, between(0, 65_534)]]
"""Mantissa, exponent and delay of a synapse of a neuron to itself."""
_OWN_MOST = {"dendrite": 1, "delay-line": 512, "reset": 0}
"""Strategy -> most synapses of a neuron to itself."""


class _PopulationEntry(Frozen):
    """A population in the file; integers that its strategy does not have are as if they did nothing."""

    threshold: Annotated[int, between(0, (1 << 24) - 1)]
    decay: Annotated[int, between(1, DECAY_ONE)]
    refractory_decay: Annotated[int, between(0, DECAY_ONE)]
    refractory: Annotated[int, between(1, 65_535)]
    own: tuple[OwnSynapse, ...]
    exponent: Exponent
    weight_bits: Annotated[int, WEIGHT_BITS]
    scale: Annotated[float, POSITIVE]
    unit: Annotated[float, POSITIVE]

    @classmethod
    def of(cls, part: ChipPopulation) -> "_PopulationEntry":
        """Return the entry of a population."""
        neuron = part.neuron
        pull, count = neuron.parts.get("refractory"), neuron.registers.get("refractory")
        own = [np.stack([taps.mantissa[:, 0], taps.exponent, taps.delay], axis=1) for taps in neuron.own.values()]
        return cls(
            threshold=int(neuron.threshold[0]),
            decay=int(neuron.decay_u[0]),
            refractory_decay=0 if pull is None else int(pull[0][0]),
            refractory=1 if count is None else int(count[0]),
            own=tuple(synapse for rows in own for synapse in rows.tolist()),
            **picked(part, "exponent", "weight_bits", "scale", "unit"),
        )

    def neuron(self, strategy: str, size: int) -> ChipNeuron:
        """Return ``size`` neurons laid out by a strategy."""
        same: dict[str, int] = {"decay_u": self.decay, "decay_v": self.decay, "threshold": self.threshold}
        if strategy == "reset":
            return ChipCuba.of(size, **same, refractory=self.refractory)
        # A refractory dendrite has one synapse, if only of weight 0.
        dendrite = strategy == "dendrite"
        own = self.own or ([[0, 0, 0]] if dendrite else [])
        mantissa, exponent, delay = np.array(own, dtype=np.int64).reshape(-1, 3).T
        taps = Refractory.of(size, mantissa, exponent, delay, self.refractory_decay if dendrite else None)
        return ChipSrm.of(size, **same, refractory=taps)


class _ChipEntry(Frozen):
    """The ``chip`` entry of a checkpoint."""

    target: Annotated[str, Must(lambda name: name.isprintable() and len(name) <= 200, "that is a plain name")]
    strategy: Annotated[str, TRAINABLE]
    registers: RegisterWidths
    populations: Mapping[str, _PopulationEntry]


def chip_entry(chip: ChipNumbers) -> dict[str, Any]:
    """Return the entry of a network's numbers."""
    entries = {name: _PopulationEntry.of(part) for name, part in chip.populations.items()}
    populations = {name: asdict(entry) | {"own": list(entry.own)} for name, entry in entries.items()}
    return picked(chip, "target", "strategy") | {"registers": asdict(chip.registers), "populations": populations}


def parse_chip_entry(
    where: str, entry: object, shapes: Mapping[str, tuple[int, ...]], windows: Collection[str]
) -> ChipNumbers:
    """Return the numbers that an entry holds for populations of weights ``shapes`` (out, in).

    Neurons of ``windows`` are single compartments, whatever the strategy. Raises ``InputError`` for what no chip could
    be given.
    """
    reader = RecordReader(where, WRITE_AGAIN, lacks=False)
    chip = reader.record(_ChipEntry, entry, "chip")
    parts = reader.entries(chip.populations, "chip.populations", dict.fromkeys(shapes, True))
    found = {}
    for name, shape in shapes.items():
        part, strategy = parts[name], "reset" if name in windows else chip.strategy
        if len(part.own) > (most := _OWN_MOST[strategy]):
            where, measured = f"chip.populations.{name}.own", f"{counted(len(part.own), 'synapse')} against 0..{most}"
            raise file_fault(reader.place(where), f"it does not fit strategy {strategy!r}", measured)
        numbers = picked(part, "exponent", "weight_bits", "scale", "unit")
        found[name] = ChipPopulation(part.neuron(strategy, shape[0]), **numbers)
    return ChipNumbers(chip.target, chip.strategy, found, chip.registers)
