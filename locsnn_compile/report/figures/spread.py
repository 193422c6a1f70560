"""How energy and latency spread: over recordings and classes, over the steps of a phase, and over cores."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np

from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import FloatArray, IntArray
from locsnn_compile.report.figures.entries import Entry

BINS = 64
"""Most bins of steps in a course over time."""
Ends = tuple[float | None, float | None]
"""Least and largest possible value; None is an unknown end."""
T = TypeVar("T")


class Quantiles(Entry):
    """How a cost spreads over the recordings."""

    min: float
    p50: float
    p99: float
    max: float


class RecordingCost(Entry):
    """The costliest recording; its class is None without labels. Subclasses add the cost, with its unit."""

    recording: int
    class_: int | None

    @property
    def cost(self) -> float:
        """The cost, whatever its unit."""
        raise NotImplementedError


class ClassCost(Entry):
    """The recordings of a class. Subclasses add what they cost, with its unit."""

    class_: int
    recordings: int

    @property
    def ends(self) -> tuple[float, float, float]:
        """The least, the mean and the largest cost, whatever their unit."""
        raise NotImplementedError


class Course(Entry):
    """A cost over the steps of a phase, added up in bins of ``bin_steps`` steps; the last may have fewer."""

    bin_steps: int
    bins: tuple[float, ...]


class Place(Entry):
    """The number, phase and place of a core."""

    core: int
    phase: str
    slot: int
    tile: tuple[int, int]


def quantiles(costs: FloatArray) -> Quantiles:
    """Return how the costs (recordings,) spread."""
    return Quantiles(
        min=float(costs.min()),
        p50=float(np.median(costs)),
        p99=float(np.quantile(costs, 0.99)),
        max=float(costs.max()),
    )


def worst_recording(
    costs: FloatArray, labels: IntArray | None, entry: Callable[[int, int | None, float], T]
) -> T:
    """Return the entry of the costliest recording: its number, its class if it has one, and its cost."""
    costliest = int(costs.argmax())
    label = None if labels is None else int(labels[costliest])
    return entry(costliest, label, float(costs[costliest]))


def by_class(
    costs: FloatArray,
    labels: IntArray | None,
    entry: Callable[[int, int, float, float, float], T],
) -> tuple[T, ...] | None:
    """Return an entry for each class: its recordings, and their least, mean and largest cost. None without labels."""
    if labels is None:
        return None
    entries = []
    for label in np.unique(labels):
        of_class = costs[labels == label]
        ends = float(of_class.min()), float(of_class.mean()), float(of_class.max())
        entries.append(entry(int(label), len(of_class), *ends))
    return tuple(entries)


def course(by_step: FloatArray) -> Course:
    """Add up values (steps,) in at most :data:`BINS` bins, all but the last of equal length."""
    length = max(1, -(-len(by_step) // BINS))
    bins = np.add.reduceat(by_step, np.arange(0, len(by_step), length))
    return Course(length, tuple(bins.tolist()))


def place(program: ChipProgram, core: Core) -> Place:
    """Return the number, phase and place of a core."""
    column, row = program.chip.tile_of(core.slot)
    return Place(core.number, core.phase, core.slot, (column, row))


def by_core(
    program: ChipProgram,
    figures: Mapping[str, Iterable[tuple[Any, ...]]],
    entry: Callable[..., T],
) -> tuple[T, ...]:
    """Return the figures of all phases, given core by core, in the order of the cores' numbers.

    ``entry`` makes one of the place of a core and its figures.
    """
    entries = []
    for phase, of_phase in figures.items():
        for core, of_core in zip(program.cores_of(phase), of_phase, strict=True):
            entries.append((core.number, entry(place(program, core), *of_core)))
    return tuple(figure for _, figure in sorted(entries, key=lambda numbered: numbered[0]))
