"""What a network trained on the arithmetic of a Xylo is made of, and the ``chip`` entry of its checkpoint.

Nothing here imports torch, so that the compiler reads it too.
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
    """Weights of a group of synapses: a mantissa of 1 charges ``1 << shift``, and is ``unit`` thresholds."""

    shift: Annotated[int, between(0, 15)]
    unit: Annotated[float, POSITIVE]

    weight_bits = xylo.WEIGHT_BITS

    @property
    def largest(self) -> float:
        """The largest weight in thresholds."""
        return xylo.WEIGHT_MAX * self.unit

    def off_grid(self, mantissas: AnyArray) -> BoolArray:
        """Tell which mantissas do not fit 8 bits."""
        return np.asarray((mantissas < xylo.WEIGHT_MIN) | (mantissas > xylo.WEIGHT_MAX))


class XyloNumbers(Frozen):
    """The Xylo that a network was trained for, its thresholds, and its groups of synapses by weight name."""

    target: Annotated[
        str, Must(lambda name: name.isprintable() and len(name) <= 200, "that is a plain name")
    ]
    hidden_threshold: Threshold
    output_threshold: Threshold
    populations: Mapping[str, XyloSynapses]

    def floats(self, mantissas: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return mantissas by weight name in thresholds."""
        return {name: held * self.populations[name].unit for name, held in mantissas.items()}


def xylo_entry(numbers: XyloNumbers) -> dict[str, Any]:
    """Return the entry of a network's numbers."""
    return asdict(numbers)


def parse_xylo_entry(
    where: str, entry: object, shapes: Mapping[str, tuple[int, ...]]
) -> XyloNumbers:
    """Return the numbers that an entry holds for weights of these names; ``InputError`` for what no Xylo holds."""
    reader = RecordReader(where, WRITE_AGAIN, lacks=False)
    numbers = reader.record(XyloNumbers, entry, "chip")
    reader.entries(numbers.populations, "chip.populations", dict.fromkeys(shapes, True))
    return numbers
