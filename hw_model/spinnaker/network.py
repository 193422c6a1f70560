"""A network as SpiNNaker stores it, checked against the number formats and the limits of its cores.

Every core of a SpiNNaker is an ARM processor. It runs neurons of one population, and holds their parameters, a row of
synapses per source, and a *ring buffer*: the weights that are due in each of the next steps, per neuron and receptor.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.errors import InputError, TargetError, check_known
from hw_model.mapping.graph import Input, Phase
from hw_model.spinnaker.chips import NEURONS_PER_CORE_MAX, SpinnakerChip
from hw_model.values import AnyArray, Frozen, IntArray, Shown

Receptor = Literal["excitatory", "inhibitory"]
RECEPTORS: tuple[Receptor, ...] = get_args(Receptor)
"""The receptors in the order of their axis in the arrays of :mod:`hw_model.arithmetic.spinnaker`."""
_S16_15_MAX = spinnaker.HALF_SPAN - 1
_NOT_NEGATIVE = (0, _S16_15_MAX)
_POSITIVE = (1, _S16_15_MAX)
_ANY = (-spinnaker.HALF_SPAN, _S16_15_MAX)
RANGES: dict[str, tuple[int, int]] = {
    "tau_m": _POSITIVE,
    "c_m": _POSITIVE,
    "tau_syn": _POSITIVE,
    "v_rest": _ANY,
    "v_reset": _ANY,
    "v_thresh": _ANY,
    "v_init": _ANY,
    "i_offset": _ANY,
    "tau_refrac": _NOT_NEGATIVE,
}
"""The lowest and highest s16.15 integer that each parameter of a neuron can have."""


class SpinnakerPopulation(Frozen, eq=False):
    """n neurons of a phase, on cores of ``neurons_per_core`` neurons each; the last core may have fewer.

    - ``shifts``: by how many bits the weights of each receptor are shifted to become a current (P_r in
      :mod:`hw_model.arithmetic.spinnaker`)
    - ``slots``: the length of a core's ring buffer in steps, which is the longest possible delay
    - ``weight_unit``, ``potential_unit``: a weight of 1 in the trained network is ``weight_unit`` nA, and a potential
      of 1 is ``potential_unit`` mV. No register depends on these two
    """

    name: str
    phase: str
    parameters: spinnaker.Parameters
    shifts: tuple[int, int]
    slots: int
    neurons_per_core: int
    weight_unit: float = 1.0
    potential_unit: float = 1.0

    def __post_init__(self) -> None:
        where = f"population {self.name!r}"
        for name, (low, high) in RANGES.items():
            array = getattr(self.parameters, name)
            shape: tuple[int, ...] = (self.size,)
            if name == "tau_syn":
                shape = (self.size, spinnaker.RECEPTOR_COUNT)
            _check_shape(f"{where}, {name}", array, shape)
            _check_range(f"{where}, {name}", array, low, high)
        _check_range(f"{where}, shifts", np.array(self.shifts), low=0, high=spinnaker.SHIFT_MAX)
        neurons_per_core = np.array(self.neurons_per_core)
        _check_range(
            f"{where}, neurons_per_core", neurons_per_core, low=1, high=NEURONS_PER_CORE_MAX
        )
        # The chip finds a slot by the lowest bits of the step.
        is_power_of_two = self.slots & (self.slots - 1) == 0
        if self.slots < 2 or not is_power_of_two:
            what = "its ring buffer has another number of slots than a power of two"
            fix = "Give 2 or a higher power of two."
            raise InputError(where, what, measured=str(self.slots), fix=fix)

    @property
    def size(self) -> int:
        """The number of neurons."""
        return len(self.parameters.tau_m)

    @property
    def cores(self) -> int:
        """The number of cores that the population takes."""
        # Division rounded up.
        return -(-self.size // self.neurons_per_core)

    @property
    def ring_bits(self) -> int:
        """The bits of an index into a core's ring buffer: those for the neuron, the receptor and the slot."""
        neurons = min(self.size, self.neurons_per_core)
        neuron_bits = (neurons - 1).bit_length()
        receptor_bits = (spinnaker.RECEPTOR_COUNT - 1).bit_length()
        slot_bits = (self.slots - 1).bit_length()
        return neuron_bits + receptor_bits + slot_bits

    @cached_property
    def constants(self) -> spinnaker.Constants:
        """The constants that the cores compute from the parameters when they start."""
        return spinnaker.constants(self.parameters)

    def check_fits(self, chip: SpinnakerChip) -> None:
        """Raise ``TargetError`` if the population's cores need more than a core of the chip has."""
        where = f"population {self.name!r}"
        fix = "Lower its neurons a core, or its delays."
        what = "too many neurons a core"
        _check_room(where, what, self.neurons_per_core, chip.neurons_per_core, fix)
        _check_room(where, "its ring buffer is too large", self.ring_bits, chip.ring_bits, fix)


class SpinnakerProjection(Frozen, eq=False):
    """Synapses of one receptor from a source, which is an input or a population, to a population.

    Arrays are (synapses,), ordered by source; the synapses of one source act in their order here. ``weight`` is the
    stored integer, 0..65535. ``delay`` is 1..slots of the target, in steps.
    """

    source: str
    target: str
    receptor: Receptor
    source_index: IntArray
    target_index: IntArray
    weight: IntArray
    delay: IntArray

    @property
    def called(self) -> str:
        """The name of the projection in error messages."""
        return f"projection {self.source!r} -> {self.target!r}, {self.receptor}"


class SpinnakerNetwork(Shown):
    """The phases of a program with their inputs, populations and projections.

    Phases run one after the other, each from rest. :class:`hw_model.mapping.graph.Input` says when input lines spike. A
    core processes the spikes of a step in the order of sources: inputs first, then populations. It processes the
    synapses of one source in the order of projections.
    """

    phases: tuple[Phase, ...]
    inputs: tuple[Input, ...]
    populations: tuple[SpinnakerPopulation, ...]
    projections: tuple[SpinnakerProjection, ...]

    def __post_init__(self) -> None:
        phases = [phase.name for phase in self.phases]
        _check_names_differ("phase", phases)
        _check_names_differ("input or population", [node.name for node in self.nodes])
        for node in self.nodes:
            check_known(f"{node.name!r}", "its phase does not exist", node.phase, phases)
        for projection in self.projections:
            self._check_projection(projection)

    def _check_projection(self, projection: SpinnakerProjection) -> None:
        """Raise InputError unless the projection's ends exist in one phase, and its arrays fit them."""
        where = projection.called
        sizes = self.sizes
        check_known(where, "its source does not exist", projection.source, sizes)
        targets = [population.name for population in self.populations]
        check_known(where, "its target is not a population", projection.target, targets)
        check_known(where, "there is no such receptor", projection.receptor, RECEPTORS)
        target = self.population(projection.target)
        if self.phase_of(projection.source) != target.phase:
            what = "its ends are in different phases"
            raise InputError(where, what, fix="Connect what runs together.")
        synapses = projection.source_index.shape[:1]
        last_source = sizes[projection.source] - 1
        for name, low, high in (
            ("source_index", 0, last_source),
            ("target_index", 0, target.size - 1),
            ("weight", 0, spinnaker.WEIGHT_MAX),
            ("delay", spinnaker.DELAY_MIN, target.slots),
        ):
            array = getattr(projection, name)
            _check_shape(f"{where}, {name}", array, synapses)
            _check_range(f"{where}, {name}", array, low, high)
        if np.any(np.diff(projection.source_index) < 0):
            what = "its synapses are not ordered by source"
            raise InputError(where, what, fix="Sort them by source_index.")

    @property
    def nodes(self) -> tuple[Input | SpinnakerPopulation, ...]:
        """Everything that can send spikes: inputs, then populations."""
        return (*self.inputs, *self.populations)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """The number of lines of each input, and of neurons of each population, by name."""
        return {node.name: node.size for node in self.nodes}

    def population(self, name: str) -> SpinnakerPopulation:
        """Return a population by its name."""
        return next(population for population in self.populations if population.name == name)

    def phase_of(self, name: str) -> str:
        """Return the phase of an input or a population."""
        return next(node.phase for node in self.nodes if node.name == name)

    def populations_of(self, phase: str) -> tuple[SpinnakerPopulation, ...]:
        """Return the populations of a phase."""
        return tuple(item for item in self.populations if item.phase == phase)

    def inputs_of(self, phase: str) -> tuple[Input, ...]:
        """Return the inputs of a phase."""
        return tuple(item for item in self.inputs if item.phase == phase)

    def sources_of(self, phase: str) -> dict[str, int]:
        """Return the first source number of every input and population of a phase: lines first, then neurons."""
        first_source = {}
        sources = 0
        for node in self.nodes:
            if node.phase == phase:
                first_source[node.name] = sources
                sources += node.size
        return first_source

    def projections_of(self, phase: str) -> tuple[SpinnakerProjection, ...]:
        """Return the projections of a phase."""
        return tuple(item for item in self.projections if self.phase_of(item.target) == phase)

    def columns_of(self, phase: str) -> dict[str, slice]:
        """Return the columns of each population in arrays over all neurons of a phase."""
        columns = {}
        first = 0
        for population in self.populations_of(phase):
            columns[population.name] = slice(first, first + population.size)
            first += population.size
        return columns

    def lines_of(self, phase: str) -> int:
        """Return how many lines the inputs of a phase have together."""
        return sum(item.size for item in self.inputs_of(phase))

    def neurons_of(self, phase: str) -> int:
        """Return how many neurons the populations of a phase have together."""
        return sum(population.size for population in self.populations_of(phase))

    def cores_of(self, phase: str) -> int:
        """Return how many cores the populations of a phase take."""
        return sum(population.cores for population in self.populations_of(phase))

    def check_fits(self, chip: SpinnakerChip) -> None:
        """Raise ``TargetError``, which names the limit, if the network does not fit the chip."""
        for population in self.populations:
            population.check_fits(chip)
        for phase in self.phases:
            where = f"phase {phase.name!r}"
            cores = self.cores_of(phase.name)
            fix = "Train a network with fewer neurons."
            _check_room(where, "too many cores", cores, chip.cores, fix)
        for (source, target), synapses in self.longest_rows().items():
            where = f"synapses {source!r} -> {target!r}"
            what = "too many synapses of a source on a core"
            fix = "Lower the neurons a core of the target, or prune synapses."
            _check_room(where, what, synapses, chip.synapses_per_row, fix)

    def longest_rows(self) -> dict[tuple[str, str], int]:
        """Return the length of the longest row of synapses, by the names of source and target.

        A row is the synapses of one source on one core.
        """
        # Excitatory and inhibitory synapses of a source share a row, so count both projections together.
        ends_by_names: dict[tuple[str, str], list[IntArray]] = {}
        for projection in self.projections:
            names = (projection.source, projection.target)
            core = projection.target_index // self.population(projection.target).neurons_per_core
            source_and_core = np.stack([projection.source_index, core])
            ends_by_names.setdefault(names, []).append(source_and_core)
        longest = {}
        for names, parts in ends_by_names.items():
            ends = np.concatenate(parts, axis=1)
            _, row_lengths = np.unique(ends, axis=1, return_counts=True)
            longest[names] = int(row_lengths.max(initial=0))
        return longest


def _check_names_differ(what: str, names: Sequence[str]) -> None:
    """Raise InputError if a name occurs twice; ``what`` says in the error what has this name."""
    for name in names:
        if names.count(name) > 1:
            fix = "Give each a name of its own."
            raise InputError("network", f"it has more than one {what} {name!r}", fix=fix)


def _check_shape(where: str, array: AnyArray, shape: tuple[int, ...]) -> None:
    if array.shape != shape or array.dtype != np.int64:
        measured = f"{array.dtype} {array.shape} against int64 {shape}"
        raise InputError(where, "the shape does not fit", measured=measured, fix="Give this shape.")


def _check_range(where: str, array: AnyArray, low: int, high: int) -> None:
    """Raise InputError if a value is not within ``low..high``, both included."""
    out_of_range = array[(array < low) | (array > high)]
    if out_of_range.size:
        measured = f"{out_of_range.flat[0]} against {low}..{high}"
        raise InputError(where, "a core cannot hold it", measured=measured, fix="Correct it.")


def _check_room(where: str, what: str, count: int, limit: int, fix: str) -> None:
    if count > limit:
        raise TargetError(where, what, measured=f"{count} against {limit}", fix=fix)
