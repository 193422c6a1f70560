"""The last level of the chip side: everything that a chip is loaded with, core by core, and how a recording is played.

The engines simulate a :class:`ChipProgram`, and the files of a compiled network hold it. Results of a simulation are
arrays over the compartments of a phase, called *columns*: groups follow one another in the order of the cores.
"""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.description.chip import Chip
from hw_model.io.arguments import checked
from hw_model.mapping.graph import Input, Phase, Readout
from hw_model.mapping.placement import Slice
from hw_model.mapping.recorded import RecordedChannels
from hw_model.mapping.routing import AxonTables, InputRoute
from hw_model.values import BoolArray, Frozen, IntArray, Shown


class CompartmentProfile(Frozen, order=True):
    """Parameters that compartments of a core share.

    ``joined`` is 1 for compartments that add their v to their parent and do not spike, else 0.
    """

    decay_u: int
    decay_v: int
    refractory: int
    joined: int


class Core(Frozen, eq=False):
    """One core and the tables that it is loaded with.

    Compartment i has the parameters ``profiles[profile[i]]``, the threshold mantissa ``thresholds[threshold[i]]``, the
    bias ``bias_mantissa[i] * 2^bias_exponent[i]``, and the parent ``parent[i]`` (-1: none). Children come before their
    parents. ``number`` counts the cores of the program. ``slot`` is the core's position on the board: core
    ``slot % cores_per_chip`` of chip ``slot // cores_per_chip``.
    """

    number: int
    slot: int
    phase: str
    slices: tuple[Slice, ...]
    profiles: tuple[CompartmentProfile, ...]
    thresholds: tuple[int, ...]
    vmin: int
    vmax: int
    profile: IntArray
    threshold: IntArray
    bias_mantissa: IntArray
    bias_exponent: IntArray
    parent: IntArray
    axons: AxonTables

    @property
    def compartments(self) -> int:
        """Compartments on the core."""
        return len(self.profile)

    def setting(self, name: str) -> IntArray:
        """Return a profile setting for every compartment, shape (compartments,)."""
        of_profile = np.array([getattr(profile, name) for profile in self.profiles], dtype=np.int64)
        return of_profile[self.profile]

    @property
    def slice_of_compartment(self) -> IntArray:
        """The number of the slice to which each compartment belongs, shape (compartments,)."""
        return np.repeat(np.arange(len(self.slices)), [part.size for part in self.slices])

    @property
    def turns(self) -> list[IntArray]:
        """The compartments in turns, which can be updated one after the other.

        The first turn is compartments without children; each further one, those whose children all had their turn.
        """
        turn = np.zeros(self.compartments, dtype=np.int64)
        # Children come before their parents, so a child's turn is final when it is read.
        for child in np.flatnonzero(self.parent >= 0):
            parent = self.parent[child]
            turn[parent] = max(turn[parent], turn[child] + 1)
        return [np.flatnonzero(turn == number) for number in np.unique(turn)]

    @property
    def threshold_voltage(self) -> IntArray:
        """Voltage that v must exceed, shape (compartments,)."""
        mantissas: IntArray = np.array(self.thresholds, dtype=np.int64)[self.threshold]
        voltage: IntArray = loihi.threshold_of(mantissas)
        return voltage

    @property
    def effective_weights(self) -> IntArray:
        """Weights as they are added to a compartment's charge q, shape (synapses,)."""
        exponent_of_format = np.array(
            [synapse_format.exponent for synapse_format in self.axons.formats], dtype=np.int64
        )
        exponent = exponent_of_format[self.axons.format_index]
        return loihi.charge_of(self.axons.mantissa, exponent)

    @property
    def bias(self) -> IntArray:
        """Bias values, ``mantissa * 2^exponent``, shape (compartments,)."""
        return loihi.bias_of(self.bias_mantissa, self.bias_exponent)

    @property
    def step_parameters(self) -> loihi.Parameters:
        """The parameters with which a step updates each compartment, each (compartments,)."""
        size = self.compartments
        vmax = np.full(size, self.vmax, dtype=np.int64)
        return loihi.Parameters(
            keep_u=loihi.keep_of(self.setting("decay_u")),
            keep_v=loihi.keep_of(self.setting("decay_v")),
            bias=self.bias,
            # Joined compartments never spike: v is clipped to vmax, so it cannot exceed a threshold of vmax.
            threshold=np.where(self.setting("joined") == 1, vmax, self.threshold_voltage),
            refractory=self.setting("refractory"),
            vmin=np.full(size, self.vmin, dtype=np.int64),
            vmax=vmax,
        )


class ChipProgram(Shown):
    """A program for a chip.

    Its phases run one after the other, each over its own step axis. The fields with a default say how recordings
    become steps and predictions; programs of earlier versions, and programs built by hand, lack them.
    """

    name: str
    chip: Chip
    phases: tuple[Phase, ...]
    inputs: tuple[Input, ...]
    input_routes: tuple[InputRoute, ...]
    cores: tuple[Core, ...]
    readout: Readout | None
    synapses_pruned: int
    provenance: dict[str, str]
    step_seconds: float | None = None
    """Seconds per time step; None if unknown."""
    event_threshold: int | None = None
    """The number of events that a bin of a recording has to exceed to become 1; None if unknown."""
    psi: float | None = None
    """How steeply a time-weighted prediction turns from the time branch to the location branch
    (:mod:`hw_model.streaming.psi`); None if unknown."""
    polarities: int | None = None
    """Polarities of channels, for events with x and y; None if unknown."""
    columns: int | None = None
    """Columns of the grid, for events with x and y; None if unknown."""
    class_names: tuple[str, ...] | None = None
    """The names of the readout's classes, if they have names."""
    channel_order: str | None = None
    """How channels are numbered: ``yxp``, by pixel and then polarity, or ``pyx``; None if unknown."""
    start: float | str | None = None
    """The seconds of events at which step 0 begins, or ``first``: at the first event; None if unknown."""
    time_unit: str | None = None
    """The unit of times of events whose format has none: ns, us, ms or s; None if unknown."""
    recorded: RecordedChannels | None = None
    """The sensor of the training, where only some of its channels, or merged ones, are inputs."""

    def cores_of(self, phase: str) -> tuple[Core, ...]:
        """Return the cores that run in a phase."""
        return tuple(core for core in self.cores if core.phase == phase)

    def inputs_of(self, phase: str) -> tuple[Input, ...]:
        """Return the inputs of a phase."""
        return tuple(line_input for line_input in self.inputs if line_input.phase == phase)

    def route_of(self, name: str) -> InputRoute:
        """Return where the lines of an input go."""
        return next(route for route in self.input_routes if route.input == name)

    def columns_of(self, phase: str) -> dict[str, slice]:
        """Return the columns that each group has in arrays over the compartments of a phase."""
        return self._columns_of.get(phase, {})

    @cached_property
    def _columns_of(self) -> dict[str, dict[str, slice]]:
        """By phase, the columns of each group; a group whose slices are on several cores has one range."""
        columns_by_phase: dict[str, dict[str, slice]] = {}
        for phase in self.phases:
            first_column = 0
            columns: dict[str, slice] = {}
            for core in self.cores_of(phase.name):
                for part in core.slices:
                    if part.group not in columns:
                        stop = first_column + self.populations[part.group]
                        columns[part.group] = slice(first_column, stop)
                        first_column = stop
            columns_by_phase[phase.name] = columns
        return columns_by_phase

    def columns_of_core(self, core: Core) -> IntArray:
        """Return the column of every compartment of a core, (compartments,)."""
        columns = self.columns_of(core.phase)
        columns_by_slice = [
            columns[part.group].start + np.arange(part.start, part.stop) for part in core.slices
        ]
        return np.concatenate(columns_by_slice)

    def by_column(
        self, phase: str, values: Callable[[Core], IntArray | BoolArray | int]
    ) -> IntArray:
        """Return an array over the columns of a phase, filled core by core with ``values(core)``."""
        size = sum(core.compartments for core in self.cores_of(phase))
        by_column = np.empty(size, dtype=np.int64)
        for core in self.cores_of(phase):
            by_column[self.columns_of_core(core)] = values(core)
        return by_column

    def lines_of(self, phase: str) -> dict[str, slice]:
        """Return the lines that each input has in arrays over all input lines of a phase, one input after the other."""
        lines: dict[str, slice] = {}
        first_line = 0
        for line_input in self.inputs_of(phase):
            stop = first_line + line_input.size
            lines[line_input.name] = slice(first_line, stop)
            first_line = stop
        return lines

    @cached_property
    def senders(self) -> tuple[IntArray, ...]:
        """For every core, the source of each of its input axons, numbered within the phase: lines, then columns."""
        # Routes lead from sources to axons. Invert them: number the input axons of all cores one core after the other,
        # and write each source to the axons that it reaches.
        first_axon = np.cumsum([0, *(core.axons.input_axons for core in self.cores)])
        source_of_axon = np.full(first_axon[-1], -1, dtype=np.int64)
        for phase in self.phases:
            lines = self.lines_of(phase.name)
            for name, lines_of_input in lines.items():
                route = self.route_of(name)
                axon = first_axon[route.core] + route.axon
                source_of_axon[axon] = lines_of_input.start + route.line
            line_count = max((lines_of_input.stop for lines_of_input in lines.values()), default=0)
            for core in self.cores_of(phase.name):
                axons = core.axons
                column = self.columns_of_core(core)[axons.out_compartment]
                source_of_axon[first_axon[axons.out_core] + axons.out_axon] = line_count + column
        return tuple(np.split(source_of_axon, first_axon[1:-1]))

    @cached_property
    def streams(self) -> dict[str, int]:
        """The recordings that the program expects, by name, with their number of channels."""
        return {line_input.stream: line_input.channels for line_input in self.inputs}

    @cached_property
    def spiking(self) -> frozenset[str]:
        """The names of the groups that can spike."""
        groups: set[str] = set()
        for core in self.cores:
            for part in core.slices:
                # Either all compartments of a group are joined or none, so the first stands for all.
                profile = core.profiles[core.profile[part.offset]]
                if not profile.joined:
                    groups.add(part.group)
        return frozenset(groups)

    @cached_property
    def joined_to(self) -> dict[str, str]:
        """For each joined group, the name of the group that it adds its voltage to."""
        parent_groups: dict[str, str] = {}
        for core in self.cores:
            group_by_offset = {part.offset: part.group for part in core.slices}
            for part in core.slices:
                # Slices are joined compartment by compartment, so the parent of the first begins the parent slice.
                parent = int(core.parent[part.offset])
                if parent >= 0:
                    parent_groups[part.group] = group_by_offset[parent]
        return parent_groups

    @cached_property
    def populations(self) -> dict[str, int]:
        """The names and sizes of all compartment groups, in the order of their cores."""
        sizes: dict[str, int] = {}
        for core in self.cores:
            for part in core.slices:
                sizes[part.group] = max(sizes.get(part.group, 0), part.stop)
        return sizes

    @checked
    def save(self, folder: str | Path) -> None:
        """Write ``program.yaml`` and ``program.npz`` into a folder; see :mod:`hw_model.program.write`."""
        # Imported here, because the module imports this one.
        from hw_model.program.write import save_program

        save_program(self, folder)
