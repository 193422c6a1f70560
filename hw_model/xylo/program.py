"""A program for a Xylo: its network, the names of its neurons, and what its recordings are like."""

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated

from hw_model.errors import InputError, check_same
from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE, between
from hw_model.mapping.graph import MAX_STEPS, Readout
from hw_model.mapping.recorded import RecordedChannels
from hw_model.program.write import START, TIME_UNITS
from hw_model.values import Frozen, Shown
from hw_model.xylo.chips import XyloChip
from hw_model.xylo.network import XyloNetwork


class NamedPart(Frozen):
    """A name for ``size`` successive hidden neurons, such as a population of the trained network."""

    name: str
    size: Annotated[int, between(1, 65_536)]


class XyloProgram(Shown):
    """A network for a chip, with names for its neurons and the properties of its recordings.

    ``hidden`` names all hidden neurons, in their order; ``readout`` names the outputs. ``steps`` is the length of a
    recording, or None if any length will do. Other properties of recordings that are unknown are None.
    """

    name: str
    chip: XyloChip
    network: XyloNetwork
    hidden: tuple[NamedPart, ...]
    readout: Readout
    steps: Annotated[int | None, between(1, MAX_STEPS)] = None
    step_seconds: Annotated[float | None, POSITIVE] = None
    event_threshold: Annotated[int | None, NOT_NEGATIVE] = None
    polarities: Annotated[int | None, AT_LEAST_ONE] = None
    columns: Annotated[int | None, AT_LEAST_ONE] = None
    channel_order: str | None = None
    class_names: tuple[str, ...] | None = None
    start: Annotated[float | str | None, START] = None
    """The seconds of events at which step 0 begins, or ``first``: at the first event."""
    time_unit: Annotated[str | None, TIME_UNITS] = None
    recorded: RecordedChannels | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Texts that a saved program carries: where it came from and how it was made."""

    def __post_init__(self) -> None:
        self.network.check_fits(self.chip)
        where = f"program {self.name!r}"
        named = sum(part.size for part in self.hidden)
        what = "the names of its hidden neurons do not fit"
        check_same(named, self.network.hidden.size, where, what, fix="Name each of them once.")
        names = [part.name for part in self.hidden]
        # With the outputs, there must be one more different name than hidden parts.
        if len({*names, self.outputs}) <= len(names) or len(self.readout.populations) != 1:
            what = "names of neurons repeat, or its readout is not of the outputs"
            raise InputError(where, what, fix="Give each population a name of its own.")
        classes = self.network.outputs.size
        tie_class = self.readout.tie_class
        if tie_class is not None and not 0 <= tie_class < classes:
            what = "the class of its ties is not one of its outputs"
            measured = f"{tie_class} against 0..{classes - 1}"
            raise InputError(where, what, measured=measured, fix="Give one of them.")
        if self.class_names is not None:
            what = "its class names do not fit its outputs"
            fix = "Give one for each output."
            check_same(len(self.class_names), classes, where, what, fix=fix)

    @property
    def inputs(self) -> int:
        """The number of input lines."""
        return len(self.network.weights_in)

    @property
    def outputs(self) -> str:
        """The name of the outputs."""
        return self.readout.populations[0]

    @property
    def places(self) -> dict[str, slice]:
        """The place of each named part among all hidden neurons."""
        first = 0
        places = {}
        for part in self.hidden:
            places[part.name] = slice(first, first + part.size)
            first += part.size
        return places
