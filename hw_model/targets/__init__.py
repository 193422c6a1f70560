"""Chips as targets of the compiler: one class for each kind of chip, listed in :data:`TARGETS`.

A :class:`Target` answers what the compiler and the report ask about a chip: whether a program fits,
how long it takes, how full its memories are. The kinds differ in how they know that.

To add a kind, write a module with its class next to this one, and add the class to the table.
"""

from hw_model.description.chip import Chip
from hw_model.targets.mesh import MeshTarget
from hw_model.targets.open_core import OpenCoreTarget
from hw_model.targets.target import Target

TARGETS: tuple[type[Target], ...] = (OpenCoreTarget, MeshTarget)
"""The kinds of targets. A chip is of the first kind that describes it; a mesh describes all chips.
"""


def target_of(chip: Chip) -> Target:
    """Return the target for a chip, of the chip's kind."""
    kind = next(kind for kind in TARGETS if kind.describes(chip))
    return kind(chip)
