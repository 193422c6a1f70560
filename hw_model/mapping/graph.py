"""The first level of the chip side: named groups of compartments and the synapses between them, not yet on cores.

CompartmentGraph -> PlacedGraph -> RoutedGraph -> ChipProgram
(this file)         placement      routing        program
"""

from collections.abc import Callable, Mapping
from dataclasses import field, fields
from typing import Any, Literal, get_args

import numpy as np

from hw_model.arithmetic.fixed_point import SignMode
from hw_model.errors import InputError
from hw_model.values import AnyArray, ArrayLike, FloatArray, Frozen, IntArray, sealed

Axis = Literal["time", "location"]
AXES: tuple[Axis, ...] = get_args(Axis)
MAX_STEPS = 10_000_000
"""Most steps of a phase, in programs of all families: far more than a chip is used for."""
MAX_LINES = 10_000_000
"""Most lines of an input, likewise."""


def read_only(array: object) -> IntArray:
    """Return an int64 copy that nobody can write to."""
    return sealed(np.array(array, dtype=np.int64))


def held(array: ArrayLike) -> AnyArray:
    """Return integers (n,), one for each synapse, that nobody can write to, in little memory.

    Equal ones, as delays mostly are, take that of one; others take 32 bits, or 64 where these do not hold them.
    """
    values = np.asarray(array)
    if len(values) and (values == values[0]).all():
        return np.broadcast_to(np.int64(values[0]), values.shape)
    narrow = values.astype(np.int32)
    return sealed(narrow if np.array_equal(narrow, values) else values.astype(np.int64))


def _keep(record: object, kept: Callable[[Any], AnyArray], *names: str) -> None:
    """Put what nobody can write to in the place of a record's arrays; what is None stays."""
    for name in names:
        if (value := getattr(record, name)) is not None:
            object.__setattr__(record, name, kept(value))


class Phase(Frozen):
    """One run over one step axis; ``steps`` is None where the recording, or the last visit of its channels, decides.

    With ``align_events`` a recording starts at the first step in which its streams have that many events together: what
    lies before is left out. Over time the phase begins there, and ends after its steps or with the recording; steps
    before and after are not run, and registers are 0 in them. A transposed phase takes that step for the first row.
    """

    name: str
    axis: Axis
    steps: int | None
    align_events: int | None = None


class Input(Frozen, eq=False):
    """``size`` input lines of a phase, fed from the recording ``stream`` (steps, channels).

    With ``positions`` None, line c spikes at step t where channel c does. Else through the transpose buffer: an event
    of channel c at step t becomes a spike of line ``first_lines[c] + t`` at step ``positions[c]``, both (channels,);
    ``first_lines`` None: 0 for all. Channels of one step have lines of their own.
    """

    name: str
    size: int
    phase: str
    stream: str
    positions: IntArray | None = None
    first_lines: IntArray | None = None

    def __post_init__(self) -> None:
        _keep(self, read_only, "positions", "first_lines")

    @property
    def channels(self) -> int:
        """Channels of the recording that feeds these lines."""
        return self.size if self.positions is None else len(self.positions)

    @property
    def visits(self) -> tuple[IntArray, IntArray]:
        """Step and first line of every channel that goes through the transpose buffer."""
        steps = np.empty(0, dtype=np.int64) if self.positions is None else self.positions
        return steps, np.zeros_like(steps) if self.first_lines is None else self.first_lines

    @property
    def rows(self) -> int:
        """Rows of a recording that the transpose buffer takes: one a line, from the highest of ``first_lines`` on."""
        return (
            self.size
            if self.first_lines is None
            else self.size - int(self.first_lines.max(initial=0))
        )

    @property
    def lines_are_shared(self) -> bool:
        """Whether two channels of one step have a line in common."""
        steps, first_lines = self.visits
        order = np.lexsort((first_lines, steps))
        one_step = np.diff(steps[order]) == 0
        return bool((one_step & (np.diff(first_lines[order]) < self.rows)).any())


class Compartments(Frozen, eq=False):
    """A group of ``size`` compartments; every parameter is an array (size,) of integers, or given as one for all.

    They take the step of :mod:`hw_model.arithmetic.loihi`, which says which values each parameter can have. With
    ``joined_to``, compartment i adds its v to compartment i of that group, and neither spikes nor is reset.
    """

    name: str
    phase: str
    size: int
    decay_u: IntArray
    decay_v: IntArray
    threshold: IntArray
    bias_mantissa: IntArray
    bias_exponent: IntArray
    refractory: IntArray
    vmin: IntArray
    vmax: IntArray
    joined_to: str | None = None

    def __post_init__(self) -> None:
        names = (item.name for item in fields(self) if item.type == IntArray)
        _keep(
            self,
            lambda given: read_only(given if np.ndim(given) else np.full(self.size, given)),
            *names,
        )

    @property
    def joined(self) -> IntArray:
        """1 for each compartment that adds its v to another, else 0."""
        return np.full(self.size, int(self.joined_to is not None))


class Synapses(Frozen, eq=False):
    """Synapses from ``source`` (input or compartments) to ``target``, one row each, ordered by source, then target.

    Their arrays may have 32 bits a number, see :func:`held`.
    """

    source: str
    target: str
    source_index: IntArray
    target_index: IntArray
    mantissa: IntArray
    delay: IntArray
    exponent: int
    weight_bits: int
    sign_mode: SignMode

    def __post_init__(self) -> None:
        _keep(self, held, "source_index", "target_index", "mantissa", "delay")

    @property
    def delay_bits(self) -> int:
        """Bits that the longest delay needs in a synapse format."""
        return int(self.delay.max(initial=0)).bit_length()


class Readout(Frozen):
    """Class scores: what populations of one size give, weighted and added.

    The highest score predicts, and the first of equal ones. Where all scores are equal, nothing is predicted, unless
    ``tie_class`` names a class for that.

    A population gives its spike counts; with ``potentials_from``, its largest potentials from that step on: v as the
    threshold sees it, of neurons that do not spike. One value is for all, None among several for a population that
    gives its spikes. Files hold a weight by name of a population, so a population that is named twice is an
    ``InputError``.
    """

    populations: tuple[str, ...]
    weights: tuple[float, ...]
    potentials_from: int | tuple[int | None, ...] | None = None
    tie_class: int | None = None

    def __post_init__(self) -> None:
        for name in self.populations:
            if self.populations.count(name) > 1:
                fix = "Name it once: it has one weight."
                raise InputError("readout", f"it names {name!r} twice", fix=fix)

    @property
    def from_step(self) -> dict[str, int]:
        """The populations that give potentials, each with its first step."""
        first_steps = self.potentials_from
        if not isinstance(first_steps, tuple):
            first_steps = (first_steps,) * len(self.populations)
        by_population: dict[str, int] = {}
        for name, first_step in zip(self.populations, first_steps, strict=True):
            if first_step is not None:
                by_population[name] = first_step
        return by_population

    @property
    def terms(self) -> list[tuple[str, float]]:
        """The populations with their weights."""
        return list(zip(self.populations, self.weights, strict=True))

    def scores(
        self, spikes: Mapping[str, AnyArray], potential: Mapping[str, AnyArray]
    ) -> FloatArray:
        """Return the scores (batch, classes) of spikes and potentials (batch, steps, classes) by population."""
        first_steps = self.from_step
        readings: dict[str, AnyArray] = {}
        for name in self.populations:
            if name in first_steps:
                readings[name] = largest(potential[name], first_steps[name])
            else:
                readings[name] = spikes[name].sum(axis=1, dtype=np.float64)
        return self.weighed(readings)

    def weighed(self, readings: Mapping[str, AnyArray]) -> FloatArray:
        """Return the scores (batch, classes) of what each population gives, added in the order of the readout.

        Sums of weights that are not whole depend on their order, and sessions add in this one.
        """
        total = np.zeros(np.shape(readings[self.populations[0]]))
        for name, weight in self.terms:
            total += weight * readings[name]
        return total

    def decided(self, scores: FloatArray) -> IntArray:
        """Return the class that scores (..., classes) predict, or -1 where they predict none."""
        return decided(scores, self.tie_class)


def decided(scores: FloatArray, tie_class: int | None = None) -> IntArray:
    """Return the class with the highest score, the first of equals; where all (..., classes) tie, ``tie_class`` or -1.

    An only class ties with nothing: it is not predicted where its score is 0.
    """
    tied = (scores == (scores[..., :1] if scores.shape[-1] > 1 else 0)).all(axis=-1)
    return np.where(tied, -1 if tie_class is None else tie_class, scores.argmax(axis=-1))


def winning(scores: FloatArray, tie_class: int | None = None) -> IntArray:
    """Return the class that scores (..., classes) predict as :func:`decided` does, but the first class, not -1."""
    return np.maximum(decided(scores, tie_class), 0)


def largest(potential: AnyArray, first: int) -> FloatArray:
    """Return the largest potentials (batch, n) of (batch, steps, n) from step ``first`` on; of no steps, 0."""
    rows = potential[:, first:]
    return np.asarray(
        rows.max(axis=1) if rows.shape[1] else np.zeros(rows.shape[::2]), dtype=np.float64
    )


class CompartmentGraph(Frozen, eq=False):
    """A whole network as compartments and synapses of integers."""

    name: str
    phases: tuple[Phase, ...]
    inputs: tuple[Input, ...]
    groups: tuple[Compartments, ...]
    synapses: tuple[Synapses, ...]
    readout: Readout | None = None
    synapses_pruned: int = 0
    provenance: dict[str, str] = field(default_factory=dict)
    """Texts that a saved program carries: where it came from and how it was made."""
    apart: tuple[str, ...] = ()
    """Parts whose groups, which begin with ``part/``, get cores of their own."""

    def part(self, name: str) -> str:
        """Return the part that a group belongs to."""
        return next((part for part in self.apart if name.startswith(f"{part}/")), "")

    @property
    def nodes(self) -> tuple[Input | Compartments, ...]:
        """Return all that can send spikes: inputs, then groups."""
        return (*self.inputs, *self.groups)

    def group(self, name: str) -> Compartments:
        """Return a group by name."""
        return next(group for group in self.groups if group.name == name)

    def joins(self, name: str) -> list[str]:
        """Return a group and those that it is joined to, one after the other."""
        way = [name]
        while (parent := self.group(way[-1]).joined_to) is not None:
            way.append(parent)
        return way

    def phase_of(self, name: str) -> str:
        """Return the phase of an input or group."""
        return next(node.phase for node in self.nodes if node.name == name)
