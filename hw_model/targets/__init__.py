"""What one can compile for: one class for each kind of target, listed in :data:`TARGETS`.

To add a kind, write a module with its class next to this one, and add the class to the table.
"""

from hw_model.description.chip import Chip
from hw_model.targets.mesh import MeshTarget
from hw_model.targets.open_core import OpenCoreTarget
from hw_model.targets.target import Target

TARGETS: tuple[type[Target], ...] = (OpenCoreTarget, MeshTarget)
"""The first kind that describes a chip is the chip's."""


def target_of(chip: Chip) -> Target:
    """Return a chip as a target of its kind."""
    kind = next(kind for kind in TARGETS if kind.describes(chip))
    return kind(chip)
