"""The limits of a SpiNNaker board, read from the YAML file next to this module or from a user's own file."""

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from hw_model.description.read import ChipName, is_yaml_path, parse, read_chip_file
from hw_model.errors import check_known
from hw_model.io.records import AT_LEAST_ONE, between
from hw_model.values import Shown

SpinnakerName = Literal["spinnaker1"]
"""The names of the chips that ship."""
NEURONS_PER_CORE_MAX = 256
"""The most neurons per core that a chip file may state."""


class SpinnakerChip(Shown, eq=True):
    """The cores of a board, and the limits of a core.

    A core keeps the weights that are due in later steps in a ring buffer with an entry per neuron, receptor and step.
    The index of an entry has a bit field for each of the three, and all bits together are at most ``ring_bits``.
    ``synapses_per_row`` limits the synapses of one source on one core.
    """

    name: ChipName
    cores: Annotated[int, AT_LEAST_ONE]
    neurons_per_core: Annotated[int, between(1, NEURONS_PER_CORE_MAX)]
    ring_bits: Annotated[int, between(2, 14)]
    synapses_per_row: Annotated[int, between(1, 256)]
    source: str
    notes: str = ""

    @property
    def description(self) -> str:
        """The limits in a line, for lists of chips."""
        return (
            f"{self.cores} cores of {self.neurons_per_core} neurons, "
            f"{self.synapses_per_row} synapses of a source on a core"
        )


def spinnaker_chip_names() -> tuple[str, ...]:
    """Return the names of the chips that ship."""
    entries = (entry.name for entry in (files("hw_model") / "spinnaker").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in entries if name.endswith(".yaml")))


def spinnaker_chip(name_or_path: str) -> SpinnakerChip:
    """Return a chip by its name, or read it from the path of a YAML file; an unknown name is an ``InputError``."""
    if is_yaml_path(name_or_path):
        path = Path(name_or_path)
        return parse(SpinnakerChip, read_chip_file(path), path.name)
    return _shipped(name_or_path)


@cache
def _shipped(name: str) -> SpinnakerChip:
    return parse(SpinnakerChip, spinnaker_chip_document(name), name)


def is_shipped_spinnaker(chip: SpinnakerChip) -> bool:
    """Return whether a chip is one that ships, rather than a user's chip with the same name."""
    return chip.name in spinnaker_chip_names() and chip == _shipped(chip.name)


def spinnaker_chip_document(name: str) -> str:
    """Return the YAML text that describes a chip that ships; an unknown name is an ``InputError``."""
    what = "no SpiNNaker of this name ships"
    check_known(f"target {name!r}", what, name, spinnaker_chip_names())
    return (files("hw_model") / "spinnaker" / f"{name}.yaml").read_text("utf-8")
