"""Count what neurons use of a core, compare it with every limit, and find how many more neurons fit.

Placement fills cores with this. Use grows with every neuron, so the number that fits can be searched: ever larger
numbers are tried until one is too large, then binary search finds the largest that fits.
"""

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from hw_model.description.chip import Chip
from hw_model.mapping.fan_in import FanIn
from hw_model.mapping.graph import Compartments
from hw_model.values import Frozen, IntArray

PROFILE = ("decay_u", "decay_v", "refractory", "joined")
"""Parameters of a compartment that are stored in a profile, which compartments of a core share."""
GROWTH = 8
"""Factor by which the number of neurons tried grows until it is too large. Chosen by hand: to count the use of a large
number takes long, so the first numbers are small, and few are tried."""


class PopulationPart(Frozen, eq=False):
    """Neurons ``start..stop`` of a population, and all projections onto the population.

    A neuron is one compartment of each of ``groups``, which are joined to each other, children before their parents.
    """

    groups: Sequence[Compartments]
    projections: Sequence[FanIn]
    start: int
    stop: int

    @property
    def root(self) -> str:
        """Name of the last group, to which the others are joined. It is the name of the population."""
        return self.groups[-1].name

    @property
    def compartments(self) -> int:
        """Compartments of these neurons."""
        return len(self.groups) * (self.stop - self.start)


class Limit(Frozen):
    """A limit of a core and how much of it is used.

    ``way_out`` tells the user what to do. Its fields ``{limit}``, ``{use}`` and ``{over}`` (the excess) are filled in.
    """

    what: str
    use: int
    limit: int
    way_out: str

    @property
    def fix(self) -> str:
        """The way out with the numbers filled in."""
        return self.way_out.format(limit=self.limit, use=self.use, over=self.use - self.limit)


def count_fitting_neurons(
    on_core: Sequence[PopulationPart], candidate: PopulationPart, chip: Chip
) -> int:
    """Return how many neurons of ``candidate``, from its first on, fit a core next to the parts ``on_core``."""

    def exceeds(neurons: int) -> bool:
        shortened = replace(candidate, stop=candidate.start + neurons)
        return first_exceeded_limit([*on_core, shortened], chip) is not None

    # The limit of compartments is known without counting synapses, so it bounds the search.
    free_compartments = chip.limits.compartments_per_core - sum(
        part.compartments for part in on_core
    )
    most_neurons = min(candidate.stop - candidate.start, free_compartments // len(candidate.groups))
    tried = min(1, most_neurons)
    while not exceeds(tried):
        if tried == most_neurons:
            return most_neurons
        tried = min(GROWTH * tried, most_neurons)
    # `tried` neurons are too many, and tried // GROWTH still fit. The index i in the range stands for i + 1
    # neurons, so the first index that exceeds a limit is the largest number of neurons that fits.
    return bisect_left(range(1, tried), True, lo=tried // GROWTH, key=exceeds)


def first_exceeded_limit(parts: Sequence[PopulationPart], chip: Chip) -> Limit | None:
    """Return the first limit that the parts together exceed on one core, or None if they fit."""
    return next((limit for limit in _limits(parts, chip) if limit.use > limit.limit), None)


def axons_and_words(parts: Sequence[PopulationPart], chip: Chip) -> tuple[IntArray, int]:
    """Return the sources that need an input axon on the core, ascending, and the words of all synapse lists there."""
    # Synapses in one format share a list per source, except dense ones, see `FanIn.lists`.
    sources_by_list: dict[tuple[object, int], list[IntArray]] = {}
    for part in parts:
        for projection in part.projections:
            sources = projection.source[projection.rows(part.start, part.stop)]
            key = (projection.lists, projection.format.bits_per_synapse)
            sources_by_list.setdefault(key, []).append(sources)
    # lengths[key][source] is the number of synapses in the source's list.
    lengths = {
        key: np.bincount(np.concatenate(sources)) for key, sources in sources_by_list.items()
    }
    words = 0
    for (_, bits), length in lengths.items():
        # Lists of equal length take equal words, and there are few lengths: count per length, not per list.
        lists_of_length = np.bincount(length)
        words_of_length = chip.synapse_memory.words(np.arange(len(lists_of_length)), bits)
        words += int(lists_of_length @ words_of_length)
    is_reached_by = np.zeros(max(map(len, lengths.values()), default=0), dtype=np.bool_)
    for length in lengths.values():
        is_reached_by[: len(length)] |= length > 0
    return np.flatnonzero(is_reached_by), words


def _limits(parts: Sequence[PopulationPart], chip: Chip) -> Iterator[Limit]:
    """Yield every limit, the quickest to count first: a caller stops at the first that is exceeded."""
    limits = chip.limits
    formats = {projection.format for part in parts for projection in part.projections}
    fix = "Use fewer weight exponents for this population: formats of one exponent and sign share one already."
    yield Limit("synapse formats", len(formats), limits.synapse_formats_per_core, fix)
    compartments = sum(part.compartments for part in parts)
    fix = "Join at most {limit} compartments to a neuron."
    yield Limit("compartments", compartments, limits.compartments_per_core, fix)
    sources, words = axons_and_words(parts, chip)
    fix = "Prune {over} of its sources, or gather them in a population in between; a location branch has one per step."
    yield Limit("input axons", len(sources), limits.input_axons_per_core, fix)
    # The way out is read where not even one neuron fits. Such a neuron has lists of one synapse, each of which takes a
    # whole word: narrower synapses would not help.
    yield Limit(
        "synapse memory words",
        words,
        limits.synapse_words_per_core,
        "Prune {over} of its {use} synapses.",
    )
    for what, parameters, limit, shared in (
        ("compartment profiles", PROFILE, limits.compartment_profiles_per_core, "decays"),
        ("threshold profiles", ("threshold",), limits.threshold_profiles_per_core, "threshold"),
        # A core has one register for vmin and one for vmax.
        ("pairs of voltage limits", ("vmin", "vmax"), 1, "vmin and vmax"),
    ):
        fix = f"Give its joined compartments the same {shared}."
        yield Limit(what, _count_combinations(parts, parameters), limit, fix)


def _count_combinations(parts: Sequence[PopulationPart], parameters: Sequence[str]) -> int:
    """Return how many different combinations of values the compartments have in these parameters."""
    combinations: set[tuple[int, ...]] = set()
    for part in parts:
        for group in part.groups:
            values = [getattr(group, name)[part.start : part.stop].tolist() for name in parameters]
            combinations.update(zip(*values, strict=True))
    return len(combinations)
