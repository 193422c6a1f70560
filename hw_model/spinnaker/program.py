"""A program for a SpiNNaker: its network, the readout of its classes, and what its recordings are like."""

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import Annotated

from hw_model.errors import InputError, check_known, check_same
from hw_model.io.records import AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE
from hw_model.mapping.graph import Input, Readout
from hw_model.mapping.recorded import RecordedChannels
from hw_model.program.write import START, TIME_UNITS
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.spinnaker.network import SpinnakerNetwork
from hw_model.values import Shown


class SpinnakerProgram(Shown):
    """A network for a chip, with the readout of its classes and the properties of its recordings.

    Properties of recordings that are unknown are None. The readout takes potentials in units of each population's
    ``potential_unit``, in which the threshold of the trained network is expressed.
    """

    name: str
    chip: SpinnakerChip
    network: SpinnakerNetwork
    readout: Readout | None = None
    step_seconds: Annotated[float | None, POSITIVE] = None
    """Seconds of a recording per step. A core takes a millisecond for a step, whatever this is."""
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
        if self.readout is not None:
            self._check_readout(self.readout)

    def _check_readout(self, readout: Readout) -> None:
        """Raise InputError unless the populations exist, have one size, and fit the class names and the tie class."""
        where = f"program {self.name!r}"
        names = [population.name for population in self.network.populations]
        for name in readout.populations:
            check_known(where, f"its readout names {name!r}, which does not exist", name, names)
        sizes = {self.network.sizes[name] for name in readout.populations}
        if len(sizes) != 1:
            what = "the populations of its readout differ in size"
            raise InputError(where, what, fix="Give each a neuron for each class.")
        (classes,) = sizes
        tie_class = readout.tie_class
        if tie_class is not None and not 0 <= tie_class < classes:
            what = "the class of its ties is not one of its outputs"
            measured = f"{tie_class} against 0..{classes - 1}"
            raise InputError(where, what, measured=measured, fix="Give one of them.")
        if self.class_names is not None:
            what = "its class names do not fit its outputs"
            fix = "Give one for each output."
            check_same(len(self.class_names), classes, where, what, fix=fix)

    @cached_property
    def streams(self) -> dict[str, int]:
        """The recordings that the program expects, by name, with their number of channels."""
        return {item.stream: item.channels for item in self.network.inputs}

    def inputs_of(self, phase: str) -> tuple[Input, ...]:
        """Return the inputs of a phase."""
        return self.network.inputs_of(phase)
