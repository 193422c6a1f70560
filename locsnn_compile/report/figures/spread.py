"""Spread of a cost over recordings, classes, steps and cores, the same for energy (pJ) and latency (ns).

``figures/energy.py`` and ``figures/latency.py`` derive their entries from the classes of this module, and
pass these entries' types to its functions.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np

from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import FloatArray, IntArray
from locsnn_compile.report.figures.entries import Entry

BINS = 64
"""Most bins of a cost over the steps of a phase, chosen by hand: enough for a chart as wide as a page."""
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
    def least_mean_largest(self) -> tuple[float, float, float]:
        """The least, the mean and the largest cost, whatever their unit."""
        raise NotImplementedError


class Course(Entry):
    """A cost over the steps of a phase, added up in bins of ``bin_steps`` steps; the last bin may have fewer."""

    bin_steps: int
    bins: tuple[float, ...]


class Place(Entry):
    """Where a core lies.

    ``core`` is its number in the program, ``slot`` its place among all cores of the chips, and ``tile``
    the (column, row) of its tile in the mesh. It runs in one phase of a recording.
    """

    core: int
    phase: str
    slot: int
    tile: tuple[int, int]


def quantiles(costs: FloatArray) -> Quantiles:
    """Return how the costs, an array (recordings,), spread."""
    return Quantiles(
        min=float(costs.min()),
        p50=float(np.median(costs)),
        p99=float(np.quantile(costs, 0.99)),
        max=float(costs.max()),
    )


def worst_recording(
    costs: FloatArray, labels: IntArray | None, entry: Callable[[int, int | None, float], T]
) -> T:
    """Return the entry of the costliest recording: its number, its class if it has one, and its cost.

    ``entry`` is the type of the entry, a subclass of :class:`RecordingCost`.
    """
    costliest = int(costs.argmax())
    label = None if labels is None else int(labels[costliest])
    return entry(costliest, label, float(costs[costliest]))


def by_class(
    costs: FloatArray,
    labels: IntArray | None,
    entry: Callable[[int, int, float, float, float], T],
) -> tuple[T, ...] | None:
    """Return an entry for each class: its recordings, and their least, mean and largest cost. None without labels.

    ``entry`` is the type of the entries, a subclass of :class:`ClassCost`.
    """
    if labels is None:
        return None
    entries = []
    for label in np.unique(labels):
        class_costs = costs[labels == label]
        least = float(class_costs.min())
        mean = float(class_costs.mean())
        largest = float(class_costs.max())
        entries.append(entry(int(label), len(class_costs), least, mean, largest))
    return tuple(entries)


def course(by_step: FloatArray) -> Course:
    """Add up values (steps,) in at most :data:`BINS` bins, all but the last of equal length."""
    bin_steps = max(1, math.ceil(len(by_step) / BINS))
    bins = np.add.reduceat(by_step, np.arange(0, len(by_step), bin_steps))
    return Course(bin_steps, tuple(bins.tolist()))


def place(program: ChipProgram, core: Core) -> Place:
    """Return where a core of a program lies."""
    column, row = program.chip.tile_of(core.slot)
    return Place(core.number, core.phase, core.slot, (column, row))


def by_core(
    program: ChipProgram,
    figures: Mapping[str, Iterable[tuple[Any, ...]]],
    entry: Callable[..., T],
) -> tuple[T, ...]:
    """Return an entry for each core of all phases, in the order of the cores' numbers.

    ``figures`` has, for each phase, a tuple of figures for each of its cores. ``entry`` is the type of the
    entries, made from the place of a core and its figures.
    """
    entries = []
    for phase, phase_figures in figures.items():
        for core, core_figures in zip(program.cores_of(phase), phase_figures, strict=True):
            entries.append((core.number, entry(place(program, core), *core_figures)))
    by_number = sorted(entries, key=lambda numbered: numbered[0])
    return tuple(figure for _, figure in by_number)
