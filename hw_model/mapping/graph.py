"""The first level of the chip side: named groups of compartments and the synapses between them, not yet on cores.

CompartmentGraph -> PlacedGraph -> RoutedGraph -> ChipProgram
(this file)         placement      routing        program

The compiler lowers a network to this level, in the chip's integers; :class:`hw_model.ProgramBuilder` builds it by
hand. A *compartment* is the chip's unit with a current u and a voltage v; a neuron takes one or more of them. A
:class:`Phase` is a part of the run with its own step axis: over time steps, or over the channels of a recording, which
a *transpose buffer* keeps and plays channel by channel.
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
"""The most steps of a phase, in programs for all chips. Chosen by hand, far above real recordings, to refuse absurd
files before they use up memory."""
MAX_LINES = 10_000_000
"""The most lines of an input, likewise."""


def read_only(array: object) -> IntArray:
    """Return an int64 copy that nobody can write to."""
    return sealed(np.array(array, dtype=np.int64))


def compact(array: ArrayLike) -> AnyArray:
    """Return integers (n,), one for each synapse, as a read-only array that takes little memory.

    If all values are equal, as delays mostly are, the array is one value with stride 0. Otherwise it has 32 bits per
    value, or 64 bits if a value does not fit 32.
    """
    values = np.asarray(array)
    if len(values) and (values == values[0]).all():
        # A broadcast array is read-only already.
        return np.broadcast_to(np.int64(values[0]), values.shape)
    narrow = values.astype(np.int32)
    return sealed(narrow if np.array_equal(narrow, values) else values.astype(np.int64))


def _convert_arrays(record: object, convert: Callable[[Any], AnyArray], *names: str) -> None:
    """Replace the named arrays of a frozen record by ``convert`` of each; None stays None."""
    for name in names:
        value = getattr(record, name)
        if value is not None:
            # The record is frozen, so an ordinary assignment would be refused.
            object.__setattr__(record, name, convert(value))


class Phase(Frozen):
    """A part of a recording's time on the chip, with its own step axis: time steps, or channels.

    ``steps`` is None if the recording, or the last visit of its channels, decides the number of steps.

    With ``align_events``, what lies before the first step with that many events, over all streams together, is left
    out. A time phase begins at that step, and ends after ``steps`` steps or with the recording; the chip does not run
    in the steps before and after, in which registers count as 0. A location phase takes that step as the first row of
    its transpose buffer.
    """

    name: str
    axis: Axis
    steps: int | None
    align_events: int | None = None


class Input(Frozen, eq=False):
    """``size`` input lines of a phase, fed from the recording ``stream`` (steps, channels).

    If ``positions`` is None, line c spikes at step t whenever channel c does.

    Otherwise the recording goes through the transpose buffer, which exchanges steps and channels: an event of channel c
    at step t becomes a spike of line ``first_lines[c] + t`` at step ``positions[c]`` of the phase. Both arrays are
    (channels,); ``first_lines`` None means 0 for all. Channels that are played in the same step must not share lines.
    """

    name: str
    size: int
    phase: str
    stream: str
    positions: IntArray | None = None
    first_lines: IntArray | None = None

    def __post_init__(self) -> None:
        _convert_arrays(self, read_only, "positions", "first_lines")

    @property
    def channels(self) -> int:
        """Channels of the recording that feeds these lines."""
        return self.size if self.positions is None else len(self.positions)

    @property
    def visits(self) -> tuple[IntArray, IntArray]:
        """Step and first line of every channel, each (channels,); both empty if the recording is not transposed."""
        steps = np.empty(0, dtype=np.int64) if self.positions is None else self.positions
        return steps, np.zeros_like(steps) if self.first_lines is None else self.first_lines

    @property
    def rows(self) -> int:
        """The most steps of a recording that fit the transpose buffer.

        Channel c takes one line per step of the recording, from ``first_lines[c]`` on. The channel that begins on the
        highest line has the fewest lines left.
        """
        if self.first_lines is None:
            return self.size
        return self.size - int(self.first_lines.max(initial=0))

    @property
    def lines_are_shared(self) -> bool:
        """Whether two channels that are played in the same step have a line in common."""
        steps, first_lines = self.visits
        # Sorted by step, then line: it is enough to compare neighbours, which must be ``rows`` lines apart.
        order = np.lexsort((first_lines, steps))
        is_same_step = np.diff(steps[order]) == 0
        is_too_close = np.diff(first_lines[order]) < self.rows
        return bool((is_same_step & is_too_close).any())


class Compartments(Frozen, eq=False):
    """A group of ``size`` compartments with their parameters, each an array (size,) of integers.

    A parameter can also be given as one integer for all. :mod:`hw_model.arithmetic.loihi` says what a compartment does
    in a step, and which values each parameter can have. With ``joined_to``, compartment i adds its v to compartment i
    of that group, and neither spikes nor is reset.
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
        def full(value: ArrayLike) -> IntArray:
            is_for_all = np.ndim(value) == 0
            return read_only(np.full(self.size, value) if is_for_all else value)

        names = [item.name for item in fields(self) if item.type == IntArray]
        _convert_arrays(self, full, *names)

    @property
    def joined(self) -> IntArray:
        """1 for each compartment that adds its v to another, else 0."""
        return np.full(self.size, int(self.joined_to is not None))


class Synapses(Frozen, eq=False):
    """Synapses from ``source``, an input or group, to the group ``target``.

    There is one row per synapse, ordered by source, then target. ``weight = mantissa * 2^exponent``, where all
    synapses share the exponent; a spike of step t arrives in step t + 1 + ``delay``. Arrays may have 32 bits per
    value, see :func:`compact`.
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
        _convert_arrays(self, compact, "source_index", "target_index", "mantissa", "delay")

    @property
    def delay_bits(self) -> int:
        """Bits that the longest delay needs in a synapse format."""
        return int(self.delay.max(initial=0)).bit_length()


class Readout(Frozen):
    """How class scores follow from populations of equal size: ``score[i] = sum(weight * reading[i])`` over populations.

    The class with the highest score is predicted, the first one of equal scores. If all scores are equal, nothing is
    predicted, unless ``tie_class`` names a class for this case.

    The reading of a population is its spike counts. With ``potentials_from``, it is the largest potentials of its
    neurons from that step on, where a potential is v just before it is compared with the threshold; such neurons do not
    spike. ``potentials_from`` is one step for all populations, or a tuple with one entry per population, None for a
    population that is read by its spikes.

    Files hold the weights by population name, so a name that occurs twice is an ``InputError``.
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
        """The populations that are read by their potentials, each with the first step that counts."""
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
        """Return the scores (batch, classes), given each population's spikes and potentials (batch, steps, classes)."""
        first_steps = self.from_step
        readings: dict[str, AnyArray] = {}
        for name in self.populations:
            if name in first_steps:
                readings[name] = largest(potential[name], first_steps[name])
            else:
                readings[name] = spikes[name].sum(axis=1, dtype=np.float64)
        return self.weighed(readings)

    def weighed(self, readings: Mapping[str, AnyArray]) -> FloatArray:
        """Return the weighted sum (batch, classes) of the populations' readings, added in the order of the readout.

        The order matters: with weights that are not whole numbers, floating-point sums depend on it in the last bits.
        Streaming sessions add in the same order, so they predict the same.
        """
        total = np.zeros(np.shape(readings[self.populations[0]]))
        for name, weight in self.terms:
            total += weight * readings[name]
        return total

    def decided(self, scores: FloatArray) -> IntArray:
        """Return the class that scores (..., classes) predict, or -1 if they predict none."""
        return decided(scores, self.tie_class)


def decided(scores: FloatArray, tie_class: int | None = None) -> IntArray:
    """Return the class with the highest of the scores (..., classes), the first one of equal scores.

    If all scores are equal, return ``tie_class``, or -1 if it is None. A single class has no other to tie with: it
    counts as tied if its score is 0.
    """
    rival = scores[..., :1] if scores.shape[-1] > 1 else 0
    is_tied = (scores == rival).all(axis=-1)
    class_of_tie = -1 if tie_class is None else tie_class
    return np.where(is_tied, class_of_tie, scores.argmax(axis=-1))


def winning(scores: FloatArray, tie_class: int | None = None) -> IntArray:
    """Return the class that scores (..., classes) predict, as :func:`decided` does, but class 0 instead of -1."""
    return np.maximum(decided(scores, tie_class), 0)


def largest(potential: AnyArray, first: int) -> FloatArray:
    """Return the largest potentials (batch, n) of (batch, steps, n) from step ``first`` on; 0 if there is no step."""
    rows = potential[:, first:]
    if rows.shape[1] == 0:
        batch, _, neurons = rows.shape
        return np.zeros((batch, neurons))
    return np.asarray(rows.max(axis=1), dtype=np.float64)


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
    """Names of parts of the network that share no core with the rest: a group of part P is named ``P/...``."""

    def part(self, name: str) -> str:
        """Return the part that a group belongs to, or an empty text for the rest of the network."""
        return next((part for part in self.apart if name.startswith(f"{part}/")), "")

    @property
    def nodes(self) -> tuple[Input | Compartments, ...]:
        """Return all that can send spikes: inputs, then groups."""
        return (*self.inputs, *self.groups)

    def group(self, name: str) -> Compartments:
        """Return a group by name."""
        return next(group for group in self.groups if group.name == name)

    def joins(self, name: str) -> list[str]:
        """Return the path from a group along ``joined_to`` to its root: the group, its parent, its grandparent, ..."""
        path = [name]
        while (parent := self.group(path[-1]).joined_to) is not None:
            path.append(parent)
        return path

    def phase_of(self, name: str) -> str:
        """Return the phase of an input or group."""
        return next(node.phase for node in self.nodes if node.name == name)
