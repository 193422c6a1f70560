"""Families of chips, one for each type of chip description.

Chips whose arithmetic differs need descriptions with other keys: a mesh or open core is a ``Chip``,
a Xylo a ``XyloChip``, a SpiNNaker a ``SpinnakerChip``. Given the name of a chip or the path of a
chip file, this module finds the family, and so reads the right kind of description. ``locsnn
targets`` lists all families.

To add a family, describe its chips in a package of its own, and add its row here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from hw_model.description.chip import Chip, chip, chip_names
from hw_model.description.read import is_yaml_path, plain_values, read_chip_file
from hw_model.io.arguments import checked
from hw_model.spinnaker.chips import (
    SpinnakerChip,
    spinnaker_chip,
    spinnaker_chip_document,
    spinnaker_chip_names,
)
from hw_model.targets import target_of
from hw_model.xylo.chips import XyloChip, xylo_chip, xylo_chip_document, xylo_chip_names

AnyChip = Chip | XyloChip | SpinnakerChip
"""A chip of any family."""
ChipT = TypeVar("ChipT", bound=AnyChip)


@dataclass(frozen=True)
class ChipFamily(Generic[ChipT]):
    """Chips whose descriptions have the same keys.

    - ``prefix``: how the names of its chips begin, such as ``xylo-``; empty for the family of all
      other names
    - ``description``: the class of its chips, whose fields are the keys of their files
    - ``names``: returns the names of its chips that ship
    - ``chip``: returns a chip, by its name or the path of its file
    - ``document``: returns the YAML text that describes a chip that ships, by its name
    - ``in_words``: returns what ``locsnn targets`` says about a chip
    """

    prefix: str
    description: type[ChipT]
    names: Callable[[], tuple[str, ...]]
    chip: Callable[[str], ChipT]
    document: Callable[[str], str]
    in_words: Callable[[ChipT], str]

    def keys_in(self, document: Mapping[Any, Any]) -> int:
        """Return how many of the family's keys a chip file has."""
        return sum(key in document for key in self.description.__dataclass_fields__)

    def lines(self, name: str) -> str:
        """Return the lines of ``locsnn targets`` about a chip that ships."""
        named_chip = self.chip(name)
        return f"{name}: {named_chip.description}\n  {self.in_words(named_chip)}"


def _mesh_document(name: str) -> str:
    return chip(name).document


def _mesh_in_words(described: Chip) -> str:
    return target_of(described).in_words


def _xylo_in_words(described: XyloChip) -> str:
    return "a Xylo: leaky neurons with decays by shifts, weights of 8 bits; energy is not known"


def _spinnaker_in_words(described: SpinnakerChip) -> str:
    return "a SpiNNaker with IF_curr_exp: single compartments, 1 ms a step; energy is not known"


MESHES = ChipFamily(
    prefix="",
    description=Chip,
    names=chip_names,
    chip=chip,
    document=_mesh_document,
    in_words=_mesh_in_words,
)
"""Meshes and open cores, which :data:`hw_model.targets.TARGETS` tells apart."""
XYLOS = ChipFamily(
    prefix="xylo-",
    description=XyloChip,
    names=xylo_chip_names,
    chip=xylo_chip,
    document=xylo_chip_document,
    in_words=_xylo_in_words,
)
SPINNAKERS = ChipFamily(
    prefix="spinnaker",
    description=SpinnakerChip,
    names=spinnaker_chip_names,
    chip=spinnaker_chip,
    document=spinnaker_chip_document,
    in_words=_spinnaker_in_words,
)
AnyFamily = ChipFamily[Chip] | ChipFamily[XyloChip] | ChipFamily[SpinnakerChip]
FAMILIES: tuple[AnyFamily, ...] = (MESHES, XYLOS, SPINNAKERS)
"""All families, in the order in which ``locsnn targets`` lists them."""


def family_of(name: str) -> AnyFamily:
    """Return the family of a chip, given its name or the path of its file."""
    if is_yaml_path(name):
        # The name of a file may be anything, so its keys decide.
        return _family_of_file(Path(name))
    for family in FAMILIES:
        if family.prefix and name.startswith(family.prefix):
            return family
    return MESHES


@checked
def _family_of_file(path: Path) -> AnyFamily:
    """Return the family that a chip file shares most keys with, the first of several."""
    document = plain_values(read_chip_file(path), path.name)
    if not isinstance(document, Mapping):
        return MESHES  # not a description at all, which the reader of meshes refuses
    keys: Mapping[Any, Any] = document
    return max(FAMILIES, key=lambda family: family.keys_in(keys))


def chip_named(target: str | Path | AnyChip) -> AnyChip:
    """Return a chip by its name or the path of its file; a chip is returned as it is."""
    if isinstance(target, AnyChip):
        return target
    return family_of(str(target)).chip(str(target))
