"""The limits of each Xylo chip, read from the YAML files next to this module or from a user's own file."""

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from hw_model.description.read import ChipName, is_yaml_path, parse, read_chip_file
from hw_model.errors import check_known, counted
from hw_model.io.records import Must, between
from hw_model.values import Shown

XyloName = Literal["xylo-audio2", "xylo-audio3", "xylo-imu"]
"""The names of the chips that ship."""


# The name is imported to simulate the chip, so it must be nothing but a dotted module name.
SIMULATOR = Must(
    lambda name: name.isascii() and all(part.isidentifier() for part in name.split(".")),
    "that is a module's name",
)


class XyloChip(Shown, eq=True):
    """The numbers of input lines, hidden neurons and outputs that a chip has.

    ``states`` is the number of synaptic currents of a hidden neuron; an output always has one. ``simulator`` is the
    module of rockpool (SynSense's toolchain) that simulates the chip.
    """

    name: ChipName
    inputs: Annotated[int, between(1, 1024)]
    hidden: Annotated[int, between(1, 65_536)]
    outputs: Annotated[int, between(1, 1024)]
    states: Annotated[int, between(1, 2)]
    simulator: Annotated[str, SIMULATOR]
    source: str
    notes: str = ""

    @property
    def description(self) -> str:
        """The limits in a line, for lists of chips."""
        return (
            f"{self.inputs} inputs, {counted(self.hidden, 'hidden neuron')} of "
            f"{counted(self.states, 'current')}, {self.outputs} outputs"
        )


def xylo_chip_names() -> tuple[str, ...]:
    """Return the names of the chips that ship."""
    entries = (entry.name for entry in (files("hw_model") / "xylo").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in entries if name.endswith(".yaml")))


def xylo_chip(name_or_path: str) -> XyloChip:
    """Return a chip by its name, or read it from the path of a YAML file; an unknown name is an ``InputError``."""
    if is_yaml_path(name_or_path):
        path = Path(name_or_path)
        return parse(XyloChip, read_chip_file(path), path.name)
    return _shipped(name_or_path)


@cache
def _shipped(name: str) -> XyloChip:
    return parse(XyloChip, xylo_chip_document(name), name)


def is_shipped_xylo(chip: XyloChip) -> bool:
    """Return whether a chip is one that ships, rather than a user's chip with the same name."""
    return chip.name in xylo_chip_names() and chip == _shipped(chip.name)


def xylo_chip_document(name: str) -> str:
    """Return the YAML text that describes a chip that ships; an unknown name is an ``InputError``."""
    check_known(f"target {name!r}", "no Xylo of this name ships", name, xylo_chip_names())
    return (files("hw_model") / "xylo" / f"{name}.yaml").read_text("utf-8")
