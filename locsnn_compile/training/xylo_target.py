"""The numbers of a Xylo that a run keeps while its weights learn: thresholds, shifts, and what a weight is worth.

Charges of 8 bits are shifted by :data:`SHIFT`, so that a register of 16 bits is much finer than they are: a decay
rounds down, and takes whole units. The largest weight charges a current with ``weight_room`` thresholds of its neuron.
"""

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.xylo.chips import XyloChip, xylo_chip
from locsnn_compile.errors import InputError, TargetError, check_same
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.xylo_entry import XyloNumbers, XyloSynapses
from locsnn_compile.training.config import TrainingConfig

SHIFT = 3
"""With it, a current holds 32 of the largest charges, and a threshold of 0.8 of them is 1270 units."""


def xylo_numbers(config: TrainingConfig, description: NetworkDescription) -> XyloNumbers:
    """Return the numbers for a network; ``TargetError`` for one that the chip does not hold."""
    chip = xylo_chip(config.target)
    check_same(
        config.weight_bits,
        xylo.WEIGHT_BITS,
        "training option 'weight_bits'",
        f"weights of {chip.name} have one width",
        fix="Leave it out.",
    )
    if description.align_events is not None:
        what = f"{chip.name} starts with the recording"
        raise InputError("training option 'align_events'", what, fix="Leave it out.")
    _check_sizes(chip, description)
    largest_charge = xylo.WEIGHT_MAX << SHIFT
    threshold = int(np.clip(round(largest_charge / config.weight_room), 1, xylo.STATE_MAX))
    synapses = XyloSynapses(SHIFT, (1 << SHIFT) / threshold)
    populations = dict.fromkeys(description.weight_shapes, synapses)
    return XyloNumbers(chip.name, threshold, threshold, populations)


def _check_sizes(chip: XyloChip, description: NetworkDescription) -> None:
    """Refuse a network that is larger than its chip, before it learns."""
    merge = (
        f"Merge polarities (--merge-polarities), or neighbours (--merge-channels {chip.inputs})."
    )
    for what, count, limit, fix in (
        ("inputs", description.input.channels, chip.inputs, merge),
        ("hidden neurons", description.hidden, chip.hidden, "Give fewer (--hidden)."),
        ("outputs", description.classes, chip.outputs, "Give fewer classes."),
    ):
        if count > limit:
            measured = f"{count} against {limit}"
            raise TargetError(
                f"target {chip.name!r}", f"too many {what}", measured=measured, fix=fix
            )
