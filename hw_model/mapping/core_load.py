"""What a core holds, and how many more neurons fit: every limit of a core in one table.

Use grows with each neuron: more and more of them are tried, then the number that fits is found by halving.
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
"""Parameters of a compartment that its profile holds."""
STRIDE = 8
"""Factor by which the number of neurons tried grows until they are too many: what is counted in vain is small."""


class Piece(Frozen, eq=False):
    """Neurons ``start..stop`` of groups joined to each other, and all projections that end on one of these groups."""

    groups: Sequence[Compartments]
    projections: Sequence[FanIn]
    start: int
    stop: int

    @property
    def root(self) -> str:
        """Name of the last group, to which the others are joined: the population."""
        return self.groups[-1].name

    @property
    def compartments(self) -> int:
        """Compartments of these neurons."""
        return len(self.groups) * (self.stop - self.start)


class Limit(Frozen):
    """A limit of a core, how much of it is used, and a way out in which both may be named."""

    what: str
    use: int
    limit: int
    way_out: str

    @property
    def fix(self) -> str:
        """The way out."""
        return self.way_out.format(limit=self.limit, use=self.use, over=self.use - self.limit)


def fitting(held: Sequence[Piece], piece: Piece, chip: Chip) -> int:
    """Return how many of a piece's neurons, from its first on, fit a core that holds others."""

    def is_full(neurons: int) -> bool:
        return first_broken([*held, replace(piece, stop=piece.start + neurons)], chip) is not None

    room = chip.limits.compartments_per_core - sum(part.compartments for part in held)
    neurons = min(piece.stop - piece.start, room // len(piece.groups))
    tried = min(1, neurons)
    while not is_full(tried):
        if tried == neurons:
            return neurons
        tried = min(STRIDE * tried, neurons)
    return bisect_left(range(1, tried), True, lo=tried // STRIDE, key=is_full)


def first_broken(pieces: Sequence[Piece], chip: Chip) -> Limit | None:
    """Return a limit that pieces on one core exceed, with what would fit."""
    return next((limit for limit in _limits(pieces, chip) if limit.use > limit.limit), None)


def synapses(pieces: Sequence[Piece], chip: Chip) -> tuple[IntArray, int]:
    """Return the sources that have an input axon on a core, ascending, and the words that their synapse lists take."""
    lists: dict[tuple[object, int], list[IntArray]] = {}
    for piece in pieces:
        for p in piece.projections:
            rows = p.source[p.rows(piece.start, piece.stop)]
            lists.setdefault((p.lists, p.format.bits_per_synapse), []).append(rows)
    lengths = {key: np.bincount(np.concatenate(parts)) for key, parts in lists.items()}
    words = 0
    for (_, bits), length in lengths.items():
        lists_of_length = np.bincount(length)  # few lists differ in length
        words += int(
            lists_of_length @ chip.synapse_memory.words(np.arange(len(lists_of_length)), bits)
        )
    reached = np.zeros(max(map(len, lengths.values()), default=0), dtype=np.bool_)
    for length in lengths.values():
        reached[: len(length)] |= length > 0
    return np.flatnonzero(reached), words


def _limits(pieces: Sequence[Piece], chip: Chip) -> Iterator[Limit]:
    """Yield every limit, those first that take no time to count."""
    limits = chip.limits
    formats = {projection.format for piece in pieces for projection in piece.projections}
    fix = "Use fewer weight exponents for this population: formats of one exponent and sign share one already."
    yield Limit("synapse formats", len(formats), limits.synapse_formats_per_core, fix)
    compartments = sum(piece.compartments for piece in pieces)
    fix = "Join at most {limit} compartments to a neuron."
    yield Limit("compartments", compartments, limits.compartments_per_core, fix)
    sources, words = synapses(pieces, chip)
    fix = "Prune {over} of its sources, or gather them in a population in between; a location branch has one per step."
    yield Limit("input axons", len(sources), limits.input_axons_per_core, fix)
    # One neuron alone has lists of one synapse, a word each: fewer bits would not help.
    yield Limit(
        "synapse memory words",
        words,
        limits.synapse_words_per_core,
        "Prune {over} of its {use} synapses.",
    )
    for what, parameters, limit, shared in (
        ("compartment profiles", PROFILE, limits.compartment_profiles_per_core, "decays"),
        ("threshold profiles", ("threshold",), limits.threshold_profiles_per_core, "threshold"),
        ("pairs of voltage limits", ("vmin", "vmax"), 1, "vmin and vmax"),
    ):
        fix = f"Give its joined compartments the same {shared}."
        yield Limit(what, _combinations(pieces, parameters), limit, fix)


def _combinations(pieces: Sequence[Piece], parameters: Sequence[str]) -> int:
    """Count the combinations of some parameters that compartments have."""
    combinations: set[tuple[int, ...]] = set()
    for piece in pieces:
        for group in piece.groups:
            values = (getattr(group, name)[piece.start : piece.stop] for name in parameters)
            combinations.update(zip(*(array.tolist() for array in values), strict=True))
    return len(combinations)
