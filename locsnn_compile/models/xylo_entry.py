"""The integers of a network that was trained on the arithmetic of the chip Xylo.

They are the entry ``chip`` of its checkpoint, as :mod:`.chip_entry` is for chips with cores. Weights
are stored as mantissas, the 8-bit integers of the chip. The float network counts the same weights in
thresholds: a weight of 1 alone makes a neuron spike. Nothing here imports torch, so that the compiler
reads it too.
"""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.io.records import POSITIVE, Must, RecordReader, between
from hw_model.values import AnyArray, BoolArray, Frozen
from locsnn_compile.models.chip_entry import WRITE_AGAIN

Threshold = Annotated[int, between(1, xylo.STATE_MAX)]


class XyloSynapses(Frozen):
    """The format of a group of synapses: those from inputs, those among hidden neurons, or those onto outputs.

    A mantissa of 1 adds ``1 << shift`` to the synaptic current, and is ``unit`` thresholds in the
    float network.
    """

    shift: Annotated[int, between(0, 15)]
    unit: Annotated[float, POSITIVE]

    weight_bits = xylo.WEIGHT_BITS

    @property
    def largest(self) -> float:
        """The largest weight in thresholds."""
        return xylo.WEIGHT_MAX * self.unit

    def off_grid(self, mantissas: AnyArray) -> BoolArray:
        """Return for each mantissa whether it does not fit 8 bits."""
        return np.asarray((mantissas < xylo.WEIGHT_MIN) | (mantissas > xylo.WEIGHT_MAX))


class XyloNumbers(Frozen):
    """The Xylo that a network was trained for, its thresholds, and its groups of synapses.

    Thresholds are in units of the potential. ``populations`` has a group of synapses for each name of
    weights.
    """

    target: Annotated[
        str, Must(lambda name: name.isprintable() and len(name) <= 200, "that is a plain name")
    ]
    hidden_threshold: Threshold
    output_threshold: Threshold
    populations: Mapping[str, XyloSynapses]

    def floats(self, mantissas: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return the float weights of mantissas, in thresholds, by name."""
        return {
            name: mantissa * self.populations[name].unit for name, mantissa in mantissas.items()
        }


def xylo_entry(numbers: XyloNumbers) -> dict[str, Any]:
    """Return the ``chip`` entry of a checkpoint that holds these numbers."""
    return asdict(numbers)


def parse_xylo_entry(
    where: str, entry: object, shapes: Mapping[str, tuple[int, ...]]
) -> XyloNumbers:
    """Return the numbers that an entry holds for the weights that ``shapes`` names.

    Raises ``InputError`` for what no Xylo holds, and unless there is one group for each name.
    """
    # Checkpoints are written whole: an entry may lack no field, not even one with a default.
    reader = RecordReader(where, WRITE_AGAIN, may_omit_defaults=False)
    numbers = reader.record(XyloNumbers, entry, "chip")
    required_names = dict.fromkeys(shapes, True)
    reader.entries(numbers.populations, "chip.populations", required_names)
    return numbers
