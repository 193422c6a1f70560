"""What each Xylo has room for, read from the YAML files next to this one."""

from functools import cache
from importlib.resources import files
from typing import Annotated, Literal

from hw_model.description.read import parse
from hw_model.errors import check_known, counted
from hw_model.io.records import between
from hw_model.values import Shown

XyloName = Literal["xylo-audio2", "xylo-audio3", "xylo-imu"]
"""The chips that ship, for type checkers."""


class XyloChip(Shown, eq=True):
    """Neurons and lines of a chip.

    ``states`` are the currents of a hidden neuron; ``simulator`` is the module of rockpool that simulates the chip.
    """

    name: str
    inputs: Annotated[int, between(1, 1024)]
    hidden: Annotated[int, between(1, 65_536)]
    outputs: Annotated[int, between(1, 1024)]
    states: Annotated[int, between(1, 2)]
    simulator: str
    source: str
    notes: str = ""

    @property
    def description(self) -> str:
        """What it has room for, in a line."""
        return (
            f"{self.inputs} inputs, {counted(self.hidden, 'hidden neuron')} of "
            f"{counted(self.states, 'current')}, {self.outputs} outputs"
        )


def xylo_chip_names() -> tuple[str, ...]:
    """Return the names of the chips that ship."""
    entries = (entry.name for entry in (files("hw_model") / "xylo").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in entries if name.endswith(".yaml")))


@cache
def xylo_chip(name: str) -> XyloChip:
    """Return a chip by its name; another name is an ``InputError``."""
    return parse(XyloChip, xylo_chip_document(name), name)


def xylo_chip_document(name: str) -> str:
    """Return the YAML text that describes a chip; ``InputError`` for a name that none has."""
    check_known(f"target {name!r}", "no Xylo of this name ships", name, xylo_chip_names())
    return (files("hw_model") / "xylo" / f"{name}.yaml").read_text("utf-8")
