"""What a core holds while it is being filled, and how many more neurons fit: every limit of a core in one table.

Use grows with each neuron, so one pass over a window of neurons gives the use after each of them, limit by limit; the
number that fits is read off. A window is twice what the last core took, so that little is computed in vain.
"""

from collections.abc import Sequence

import numpy as np

from hw_model.arithmetic.arrays import IntArray
from hw_model.description.chip import Chip
from hw_model.mapping.fan_in import FanIn, SynapseFormat
from hw_model.mapping.graph import Compartments
from hw_model.values import Frozen

FIRST_WINDOW = 64


class Limit(Frozen):
    """A limit of a core that is exceeded, and a way out."""

    what: str
    measured: int
    limit: int
    fix: str


class CoreLoad:
    """The load of one core; ``like`` is the core before, full: its window and its arrays are taken over, emptied.

    So a core takes time for the sources that it has, not for all that there are.
    """

    def __init__(self, chip: Chip, sources: int, like: "CoreLoad | None" = None) -> None:
        self._chip = chip
        self._window: int = like._window if like else FIRST_WINDOW
        self._empty = like._emptied() if like else []
        self._on_core = self._empty.pop() if like else np.zeros(sources, dtype=np.int64)
        self._found = [np.empty(0, dtype=np.int64)]
        self._profiles: set[tuple[int, ...]] = set()
        self._thresholds: set[tuple[int, ...]] = set()
        self._voltage_limits: set[tuple[int, ...]] = set()
        self._formats: set[SynapseFormat] = set()
        self._lengths: dict[SynapseFormat | str, IntArray] = {}
        self.words = 0
        self.compartments = 0

    def sources_on_core(self) -> IntArray:
        """Return the sources with an input axon here, ascending."""
        found: IntArray = np.sort(np.concatenate(self._found))
        return found

    def _emptied(self) -> list[IntArray]:
        """Give up the arrays over all sources, with zeros again."""
        used, here = [*self._lengths.values(), self._on_core], self.sources_on_core()
        for array in used:
            array[here] = 0
        return self._empty + used

    def take(self, groups: Sequence[Compartments], projections: Sequence[FanIn], start: int, stop: int) -> int:
        """Take as many of the neurons ``start..stop`` as fit, in order; return how many.

        ``groups`` are joined to each other, ``projections`` all that end on one of them.
        """
        taken = 0
        while start + taken < stop:
            end = min(stop, start + taken + self._window)
            count = self._take_window(groups, projections, start + taken, end)
            taken += count
            if start + taken < end:
                break
            self._window *= 2
        if taken:
            self._window = max(FIRST_WINDOW, min(self._window, 2 * taken))
        return taken

    def _take_window(self, groups: Sequence[Compartments], projections: Sequence[FanIn], start: int, stop: int) -> int:
        if len(self._formats | _formats(projections)) > self._chip.limits.synapse_formats_per_core:
            return 0
        uses = self._uses(groups, projections, start, stop)
        count = min(int(np.searchsorted(use, limit, side="right")) for _, use, limit in uses)
        if count:
            by_name = {what: int(use[count - 1]) for what, use, _ in uses}
            self.compartments = by_name["compartments"]
            self.words = by_name["synapse memory words"]
            self._formats |= _formats(projections)
            for projection in projections:
                source, many = np.unique(projection.source[projection.rows(start, start + count)], return_counts=True)
                self._found.append(source[self._on_core[source] == 0])
                self._on_core[source] = 1
                self._length(projection.lists)[source] += many
            for known, values in self._distinct(groups, start, start + count):
                known |= {tuple(row) for row in np.unique(values, axis=0).tolist()}
        return count

    def _uses(
        self, groups: Sequence[Compartments], projections: Sequence[FanIn], start: int, stop: int
    ) -> list[tuple[str, IntArray, int]]:
        """Return rows of (what, use after each neuron of the window, limit)."""
        limits = self._chip.limits
        neurons = np.arange(1, stop - start + 1)
        axons, words = self._synapse_uses(projections, start, stop)
        profiles, thresholds, voltage_limits = (
            len(known) + _new_distinct(known, values, len(groups), stop - start)
            for known, values in self._distinct(groups, start, stop)
        )
        return [
            ("compartments", self.compartments + len(groups) * neurons, limits.compartments_per_core),
            ("input axons", axons, limits.input_axons_per_core),
            ("synapse memory words", words, limits.synapse_words_per_core),
            ("compartment profiles", profiles, limits.compartment_profiles_per_core),
            ("threshold profiles", thresholds, limits.threshold_profiles_per_core),
            ("pairs of voltage limits", voltage_limits, 1),
        ]

    def _distinct(
        self, groups: Sequence[Compartments], start: int, stop: int
    ) -> list[tuple[set[tuple[int, ...]], IntArray]]:
        """Return what must be shared on a core: known settings, and those of the window's compartments, by group."""
        here = slice(start, stop)

        def rows(*names: str) -> IntArray:
            columns = [[getattr(g, name)[here] for g in groups] for name in names]
            return np.array(columns, dtype=np.int64).reshape(len(names), -1).T

        joined = np.repeat([not g.spiking for g in groups], stop - start)[:, None].astype(np.int64)
        return [
            (self._profiles, np.hstack((rows("decay_u", "decay_v", "refractory"), joined))),
            (self._thresholds, rows("threshold")),
            (self._voltage_limits, rows("vmin", "vmax")),
        ]

    def _length(self, lists: SynapseFormat | str) -> IntArray:
        """Return how long each source's list is on this core, to be added to."""
        if lists not in self._lengths:
            self._lengths[lists] = self._empty.pop() if self._empty else np.zeros_like(self._on_core)
        return self._lengths[lists]

    def _synapse_uses(self, projections: Sequence[FanIn], start: int, stop: int) -> tuple[IntArray, IntArray]:
        """Return input axons and synapse memory words after each neuron of the window."""
        size = stop - start
        new_axons, new_words = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64)
        found_sources, found_neurons = [], []
        for together in _by_lists(projections):
            rows = [(p.source[p.rows(start, stop)], p.targets(start, stop) - start) for p in together]
            source, neuron = (np.concatenate(column) for column in zip(*rows, strict=True))
            order = np.lexsort((neuron, source))
            ranked = source[order]
            begins = np.flatnonzero(np.r_[True, ranked[1:] != ranked[:-1]]) if len(ranked) else np.empty(0, np.int64)
            lengths = np.diff(np.append(begins, len(ranked)))
            rank = np.arange(len(ranked)) - np.repeat(begins, lengths) + self._length(together[0].lists)[ranked]
            longest = np.arange(int(rank.max(initial=0)) + 2)
            added = np.diff(self._chip.synapse_memory.words(longest, together[0].format.bits_per_synapse))
            new_words += np.bincount(neuron[order], added[rank], minlength=size).astype(np.int64)
            found_sources.append(ranked[begins])
            found_neurons.append(neuron[order][begins])
        if found_sources:
            source, neuron = np.concatenate(found_sources), np.concatenate(found_neurons)
            fresh = self._on_core[source] == 0
            source, neuron = source[fresh], neuron[fresh]
            order = np.lexsort((neuron, source))
            source, neuron = source[order], neuron[order]
            earliest = np.r_[True, source[1:] != source[:-1]] if len(source) else np.empty(0, np.bool_)
            new_axons += np.bincount(neuron[earliest], minlength=size)
        return sum(map(len, self._found)) + np.cumsum(new_axons), self.words + np.cumsum(new_words)


def first_broken(groups: Sequence[Compartments], projections: Sequence[FanIn], neuron: int, chip: Chip) -> Limit:
    """Return the limit that one neuron alone exceeds on an empty core, with what would fit."""
    sources = 1 + max((int(p.source.max(initial=0)) for p in projections), default=0)
    formats = _formats(projections)
    if len(formats) > chip.limits.synapse_formats_per_core:
        return Limit(
            "synapse formats",
            len(formats),
            chip.limits.synapse_formats_per_core,
            "Use fewer weight exponents for this population: formats of one exponent and sign share one already.",
        )
    uses = CoreLoad(chip, sources)._uses(groups, projections, neuron, neuron + 1)
    what, use, limit = next(row for row in uses if row[1][0] > row[2])
    measured = int(use[0])
    fixes = {
        "compartments": f"Join at most {limit} compartments to a neuron.",
        "input axons": f"Prune {measured - limit} of its sources, or gather them in a population in between.",
        # One neuron alone has lists of one synapse, a word each: fewer bits would not help.
        "synapse memory words": f"Prune {measured - limit} of its {measured} synapses.",
        "compartment profiles": "Give its joined compartments the same decays.",
        "threshold profiles": "Give its joined compartments the same threshold.",
        "pairs of voltage limits": "Give its joined compartments the same vmin and vmax.",
    }
    return Limit(what, measured, limit, fixes[what])


def _formats(projections: Sequence[FanIn]) -> set[SynapseFormat]:
    return {projection.format for projection in projections}


def _by_lists(projections: Sequence[FanIn]) -> list[list[FanIn]]:
    """Return the projections whose synapses are in the same lists together."""
    found: dict[SynapseFormat | str, list[FanIn]] = {}
    for projection in projections:
        found.setdefault(projection.lists, []).append(projection)
    return list(found.values())


def _new_distinct(known: set[tuple[int, ...]], values: IntArray, members: int, neurons: int) -> IntArray:
    """Count settings not yet known, after each neuron; ``values`` lists the neurons of one group after the other."""
    rows, first = np.unique(values, axis=0, return_inverse=True)
    earliest = np.full(len(rows), neurons, dtype=np.int64)
    np.minimum.at(earliest, first.reshape(-1), np.tile(np.arange(neurons), members))
    fresh = np.array([tuple(row) not in known for row in rows.tolist()], dtype=np.bool_)
    counted: IntArray = np.cumsum(np.bincount(earliest[fresh], minlength=neurons))
    return counted
