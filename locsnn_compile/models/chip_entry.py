"""What a network trained on the chip's arithmetic is made of: registers and synapse formats, no float but its scale.

And the ``chip`` entry of a checkpoint that holds these integers: read with every value checked against what the chip's
registers and formats hold; written in the same order. Nothing here imports torch, so that the compiler reads them too.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_BITS, WeightGrid, half_range, weight_grid
from hw_model.arithmetic.loihi import DECAYS, EXPONENTS
from hw_model.io.records import POSITIVE, Must, RecordReader, between
from hw_model.values import AnyArray, BoolArray, Frozen, IntArray
from locsnn_compile.errors import InputError, counted
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm
from locsnn_compile.settings import TRAINABLE

MANTISSA_MAX = 255
"""Largest weight mantissa of 8 bits."""
DELAY_MAX = 65_534
"""Longest delay, in steps, and"""
REFRACTORY_MAX = 65_535
"""longest refractory count that any chip file may state (:class:`hw_model.description.chip.Registers`)."""
THRESHOLD_MAX = (1 << 24) - 1
"""Largest threshold mantissa: 64 times it, 2^30 units, is more than the widest registers that are trained on hold."""
TRAINED_BITS = (9, 29)
"""Least and most bits of registers that networks are trained on: no sum on the way needs more than 32 bits."""
WRITE_AGAIN = "Write it again with 'locsnn train'."


def file_fault(where: str, what: str, measured: str = "") -> InputError:
    """Return the error for a checkpoint that ``locsnn train`` would not have written."""
    return InputError(where, what, measured=measured, fix=WRITE_AGAIN)


class RegisterWidths(Frozen):
    """Widths of registers in bits, the sign not counted; by default those of ``loihi-sim``."""

    charge_bits: Annotated[int, between(*TRAINED_BITS)] = 21
    current_bits: Annotated[int, between(*TRAINED_BITS)] = 23
    voltage_bits: Annotated[int, between(*TRAINED_BITS)] = 23

    @property
    def voltage_max(self) -> int:
        """Largest voltage; the smallest is its negative."""
        return half_range(self.voltage_bits) - 1


Exponent = Annotated[int, between(*EXPONENTS)]
OwnMantissa = Annotated[int, between(-MANTISSA_MAX, MANTISSA_MAX)]
OwnSynapse = tuple[OwnMantissa, Exponent, Annotated[int, between(0, DELAY_MAX)]]
"""Mantissa, exponent and delay of a synapse of a neuron to itself."""
MOST_OWN_SYNAPSES = {"dendrite": 1, "delay-line": 512, "reset": 0}
"""Strategy -> most synapses of a neuron to itself; a delay line has two at most for each of 256 delays."""


class ChipPopulation(Frozen):
    """A population on the chip, whose neurons all have the same integers, and the synapses onto it.

    - ``threshold``: a mantissa; ``decay``: that of current and voltage. The next three are as if they did nothing where
      the strategy does not have them: ``refractory_decay`` of a refractory dendrite, the ``refractory`` count of the
      chip's own reset, and ``own``, the synapses of a neuron to itself.
    - ``exponent`` and ``weight_bits``: format of the incoming weights, positive and negative ones apart.
    - ``scale``: register units of a potential of 1 in the float network; ``unit``: the float weight of a mantissa of 1.

    The biases of windows are one more: see :meth:`~locsnn_compile.network.chip_neurons.ChipCuba.with_biases`.
    """

    threshold: Annotated[int, between(0, THRESHOLD_MAX)]
    decay: Annotated[int, between(1, DECAYS.high)]
    refractory_decay: Annotated[int, between(*DECAYS)]
    refractory: Annotated[int, between(1, REFRACTORY_MAX)]
    own: tuple[OwnSynapse, ...]
    exponent: Exponent
    weight_bits: Annotated[int, WEIGHT_BITS]
    scale: Annotated[float, POSITIVE]
    unit: Annotated[float, POSITIVE]

    @property
    def grid(self) -> WeightGrid:
        """The magnitudes that a mantissa may have."""
        return weight_grid(self.weight_bits, "excitatory")

    def off_grid(self, mantissas: AnyArray) -> BoolArray:
        """Tell which mantissas the format does not hold."""
        return self.grid.off_grid(np.abs(mantissas))

    @property
    def largest(self) -> float:
        """The largest float weight that the format holds."""
        return self.grid.high * self.unit

    def resetting(self, size: int) -> ChipCuba:
        """Return ``size`` neurons with the chip's own reset."""
        filters = {"decay_u": self.decay, "decay_v": self.decay, "threshold": self.threshold}
        return ChipCuba.of(size, **filters, refractory=self.refractory)

    def neurons(self, strategy: str, size: int) -> ChipNeuron:
        """Return ``size`` neurons laid out by a strategy."""
        if strategy == "reset":
            return self.resetting(size)
        has_refractory_dendrite = strategy == "dendrite"
        own_synapses: Sequence[Sequence[int]] = self.own
        if has_refractory_dendrite and not own_synapses:
            # A refractory dendrite has one synapse, if only of weight 0.
            own_synapses = [[0, 0, 0]]
        mantissa, exponent, delay = np.array(own_synapses, dtype=np.int64).reshape(-1, 3).T
        return ChipSrm.with_taps(
            size,
            decay=self.decay,
            threshold=self.threshold,
            mantissa=mantissa,
            exponent=exponent,
            delay=delay,
            refractory_decay=self.refractory_decay if has_refractory_dendrite else None,
        )


class ChipNumbers(Frozen):
    """The chip whose arithmetic a network follows, the strategy that lays it out, and the network's populations."""

    target: Annotated[
        str, Must(lambda name: name.isprintable() and len(name) <= 200, "that is a plain name")
    ]
    strategy: Annotated[str, TRAINABLE]
    registers: RegisterWidths
    populations: Mapping[str, ChipPopulation]

    def window_output(self, names: Sequence[str], mantissas: Mapping[str, IntArray]) -> ChipCuba:
        """Return the output neurons of windows, with their biases; ``names`` of weights and biases."""
        weights, offsets = (self.populations[name] for name in names)
        biases = mantissas[names[1]]
        return weights.resetting(len(biases)).with_biases(biases, offsets.exponent)

    def floats(self, mantissas: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return mantissas by population name in the float network's units."""
        return {
            name: mantissa * self.populations[name].unit for name, mantissa in mantissas.items()
        }


def chip_entry(chip: ChipNumbers) -> dict[str, Any]:
    """Return the entry of a network's numbers."""
    entry = asdict(chip)
    for population in entry["populations"].values():
        population["own"] = [list(synapse) for synapse in population["own"]]
    return entry


def parse_chip_entry(
    where: str, entry: object, shapes: Mapping[str, tuple[int, ...]], windows: Collection[str]
) -> ChipNumbers:
    """Return the numbers that an entry holds for populations of weights ``shapes`` (out, in).

    Neurons of ``windows`` are single compartments, whatever the strategy. Raises ``InputError`` for what no chip could
    be given.
    """
    reader = RecordReader(where, WRITE_AGAIN, lacks=False)
    chip = reader.record(ChipNumbers, entry, "chip")
    reader.entries(chip.populations, "chip.populations", dict.fromkeys(shapes, True))
    for name, population in chip.populations.items():
        strategy = "reset" if name in windows else chip.strategy
        most = MOST_OWN_SYNAPSES[strategy]
        if len(population.own) > most:
            place = reader.place(f"chip.populations.{name}.own")
            measured = f"{counted(len(population.own), 'synapse')} against 0..{most}"
            raise file_fault(place, f"it does not fit strategy {strategy!r}", measured)
    return chip
