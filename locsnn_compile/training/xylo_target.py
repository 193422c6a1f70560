"""Choose the integers of a network that is trained on the arithmetic of the chip Xylo.

Thresholds, and the format of weights, stay fixed during the run, while the weights learn. A mantissa of 8 bits is
shifted left by :data:`SHIFT` before it is added to a current, a register of 16 bits. So a unit of the register is much
smaller than the smallest weight, and the decays, which round to whole units, lose little. The threshold is chosen so
that the largest weight is ``weight_room`` thresholds.
"""

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.xylo.chips import XyloChip, xylo_chip
from locsnn_compile.errors import InputError, TargetError, check_same
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.xylo_entry import XyloNumbers, XyloSynapses
from locsnn_compile.training.config import TrainingConfig

SHIFT = 3
"""With this shift, a current holds 32 of the largest charges, each 127 << 3 = 1016 units; and the threshold, 0.8 of
such a charge with the usual ``weight_room`` of 1.25, is 813 units."""


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
