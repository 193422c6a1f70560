"""The integers of a network that was trained on the arithmetic of a chip with cores, such as Loihi.

Such a network is trained with the chip's integer steps in its forward pass, so registers, decays, thresholds and the
formats of weights are fixed before training. They are :class:`ChipNumbers`, and a checkpoint stores them as its entry
``chip``, which is checked, value by value, against what the chip's registers and formats hold. The only floats are the
scales that relate integers to the potentials and weights of the float network. Nothing here imports torch, so that the
compiler reads them too. :mod:`.xylo_entry` is the same for the chip Xylo.
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
"""Longest delay, in steps, that any chip file may state (:class:`hw_model.description.chip.Registers`)."""
REFRACTORY_MAX = 65_535
"""Longest refractory count that any chip file may state."""
THRESHOLD_MAX = (1 << 24) - 1
"""Largest threshold mantissa. A threshold is 64 times its mantissa, here 2^30 units, and the widest registers
that networks are trained on (:data:`TRAINED_BITS`) do not hold as much.
"""
TRAINED_BITS = (9, 29)
"""Fewest and most bits of registers that networks are trained on: within these, no intermediate sum needs more
than 32 bits, in which training computes.
"""
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
"""Strategy -> most synapses of a neuron to itself; a delay line has at most two for each of 256 delays.

A strategy is a way to build the refractory response of a spike response neuron from compartments: by a compartment of
its own that is inhibited after a spike (``dendrite``), by delayed inhibitory synapses of the neuron to itself
(``delay-line``), or by the chip's own reset (``reset``).
"""


class ChipPopulation(Frozen):
    """A population on the chip, whose neurons all have the same integers, and the synapses onto it.

    - ``threshold``: its mantissa; ``decay``: that of current and voltage
    - ``refractory_decay``: the decay of the compartment that is inhibited after a spike; ``refractory``: the refractory
      steps of the chip's own reset; ``own``: the synapses of a neuron to itself. If the strategy does not use one of
      these, it has a value without effect.
    - ``exponent`` and ``weight_bits``: the format of the incoming weights. Positive and negative weights are separate
      synapses, so the bits are all magnitude.
    - ``scale``: register units of a potential of 1 in the float network; ``unit``: the float weight of a mantissa of 1

    The biases of a network that counts in windows are stored as a population as well: see
    :meth:`~locsnn_compile.network.chip_neurons.ChipCuba.with_biases`.
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
        """Return for each mantissa whether the format does not hold it."""
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
        """Return ``size`` neurons as the compartments of a strategy."""
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
    """All integers of a network on a chip.

    - ``target``: the name of the chip; ``registers``: the widths of its registers
    - ``strategy``: how spike response neurons become compartments, see :data:`MOST_OWN_SYNAPSES`
    - ``populations``: the integers of each population, by name
    """

    target: Annotated[
        str, Must(lambda name: name.isprintable() and len(name) <= 200, "that is a plain name")
    ]
    strategy: Annotated[str, TRAINABLE]
    registers: RegisterWidths
    populations: Mapping[str, ChipPopulation]

    def window_output(self, names: Sequence[str], mantissas: Mapping[str, IntArray]) -> ChipCuba:
        """Return the output neurons of a branch of windows, with their biases.

        ``names`` are the names of its weights and of its biases among the ``mantissas``.
        """
        weights, offsets = (self.populations[name] for name in names)
        biases = mantissas[names[1]]
        return weights.resetting(len(biases)).with_biases(biases, offsets.exponent)

    def floats(self, mantissas: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return the float weights of mantissas, by population name."""
        return {
            name: mantissa * self.populations[name].unit for name, mantissa in mantissas.items()
        }


def chip_entry(chip: ChipNumbers) -> dict[str, Any]:
    """Return the entry ``chip`` of a checkpoint, as plain values."""
    entry = asdict(chip)
    for population in entry["populations"].values():
        population["own"] = [list(synapse) for synapse in population["own"]]
    return entry


def parse_chip_entry(
    where: str, entry: object, shapes: Mapping[str, tuple[int, ...]], windows: Collection[str]
) -> ChipNumbers:
    """Return the numbers in the entry ``chip`` of a checkpoint.

    ``shapes`` are the shapes (out, in) of the network's weights by population. Neurons of the populations ``windows``
    have the chip's own reset, whatever the strategy. Raises ``InputError`` for values that no chip can hold.
    """
    # Checkpoints are written whole: an entry may lack no field, not even one with a default.
    reader = RecordReader(where, WRITE_AGAIN, may_omit_defaults=False)
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
