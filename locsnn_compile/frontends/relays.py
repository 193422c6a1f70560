"""Relays: neurons that repeat a spike, so that it may take longer than the chip's longest delay.

A relay neuron spikes one step after a spike reaches it. Behind ``k`` relays, each reached with a delay
of ``DELAY_MAX``, a spike is ``k * (DELAY_MAX + 1)`` steps later than its source.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.arithmetic.fixed_point import DECAY_ONE
from hw_model.values import AnyArray, Frozen, IntArray, sealed
from locsnn_compile.errors import counted
from locsnn_compile.frontends.parts import Parts
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import (
    ChipProjection,
    Projection,
    connections,
    matrix,
    values_of,
)

DELAY_MAX = 62
"""Longest delay of a synapse of Loihi, in steps: 64 accumulator slots less two."""
STEPS_OF_A_RELAY = DELAY_MAX + 1
"""Steps by which a relay puts a spike off: the longest delay, and the step that every spike takes."""
RELAY_MANTISSA = 2
"""A weight that alone lifts a relay on the grid above a threshold of 1."""


class _Synapses(Frozen, eq=False):
    """The connections of a projection, row by row: arrays (connections,)."""

    target: IntArray
    source: IntArray
    weight: AnyArray
    delay: IntArray

    @classmethod
    def of(cls, projection: Projection | ChipProjection) -> "_Synapses":
        """List the connections of a projection."""
        values = values_of(projection.held)
        delays = np.broadcast_to(np.asarray(projection.delay, dtype=np.int64), values.shape)
        target, source, index = connections(projection.held)
        row_by_row = np.lexsort((source, target))
        at = index[row_by_row]
        return cls(target[row_by_row], source[row_by_row], values.ravel()[at], delays.ravel()[at])

    @property
    def relays(self) -> IntArray:
        """How many relays the spikes of each connection pass, (connections,)."""
        return np.maximum(-(-(self.delay - DELAY_MAX) // STEPS_OF_A_RELAY), 0)

    def chosen(self, which: AnyArray) -> "_Synapses":
        """Return some of the connections."""
        return _Synapses(
            self.target[which], self.source[which], self.weight[which], self.delay[which]
        )


def add_relays(parts: Parts) -> tuple[str, ...]:
    """Let relays carry the spikes of all connections whose delays are above :data:`DELAY_MAX`.

    Adds populations ``SOURCE/relay1``, ``SOURCE/relay2``, ... to the parts and replaces the projections
    that need them. Returns a sentence on what was added, if anything was.
    """
    synapses = {projection: _Synapses.of(projection) for projection in parts.projections}
    sources = dict.fromkeys(projection.source for projection in parts.projections)
    relayed: list[Projection | ChipProjection] = []
    sentences = []
    for source in sources:
        of_source = {p: held for p, held in synapses.items() if p.source == source}
        lines = _lines_by_relay(of_source)
        relayed += _relay_chain(parts, source, next(iter(of_source)), lines)
        for projection, held in of_source.items():
            relayed += _through_relays(projection, held, lines)
        if lines:
            relays = counted(sum(len(numbers) for numbers in lines), "relay neuron")
            longest = max(int(held.delay.max(initial=0)) for held in of_source.values())
            sentences.append(
                f"Delays of up to {longest} steps behind {source!r} use {relays} (--relay-delays): a "
                f"synapse delays by at most {DELAY_MAX}."
            )
    parts.projections = relayed
    return tuple(sentences)


def _lines_by_relay(synapses: dict[Any, _Synapses]) -> list[IntArray]:
    """Return for the first, second, ... relay of a source the numbers of the lines that it repeats."""
    most = max(int(held.relays.max(initial=0)) for held in synapses.values())
    return [
        np.unique(np.concatenate([held.source[held.relays > k] for held in synapses.values()]))
        for k in range(most)
    ]


def _relay_chain(
    parts: Parts, source: str, like: Projection | ChipProjection, lines: list[IntArray]
) -> list[Projection | ChipProjection]:
    """Add the relays of a source to the populations; return the projections from each to the next."""
    chain: list[Projection | ChipProjection] = []
    before = source
    numbers_before = np.arange(like.held.shape[1])
    for k, numbers in enumerate(lines):
        name = relay_name(source, k)
        size = len(numbers)
        columns = np.searchsorted(numbers_before, numbers)
        entries = np.arange(size), columns
        shape = (size, len(numbers_before))
        if isinstance(like, ChipProjection):
            neuron: Any = ChipCuba.of(size, decay_u=DECAY_ONE, decay_v=DECAY_ONE, threshold=1)
            mantissas = np.full(size, RELAY_MANTISSA, dtype=np.int64)
            held = matrix(sparse.csr_array((mantissas, entries), shape=shape), np.int64)
            chain.append(ChipProjection(before, name, held, 0, 8, "mixed", DELAY_MAX))
        else:
            neuron = Cuba.of(size, decay_u=1.0, decay_v=1.0, threshold=0.5)
            weights = sparse.csr_array((np.ones(size), entries), shape=shape)
            chain.append(Projection(before, name, matrix(weights, np.float64), DELAY_MAX))
        parts.populations.append(Population(name, "time", size, neuron, helper=True))
        before, numbers_before = name, numbers
    return chain


def _through_relays(
    projection: Projection | ChipProjection, synapses: _Synapses, lines: list[IntArray]
) -> list[Projection | ChipProjection]:
    """Return a projection as one for each number of relays that its spikes pass."""
    relays = synapses.relays
    if not relays.any():
        return [projection]
    projections: list[Projection | ChipProjection] = []
    for passed in np.unique(relays).tolist():
        part = synapses.chosen(relays == passed)
        source, numbers = projection.source, np.arange(projection.held.shape[1])
        if passed:
            source, numbers = relay_name(projection.source, passed - 1), lines[passed - 1]
        columns = np.searchsorted(numbers, part.source)
        shape = (projection.held.shape[0], len(numbers))
        held = sparse.csr_array((part.weight, (part.target, columns)), shape=shape)
        delay = sealed(part.delay - passed * STEPS_OF_A_RELAY)
        if isinstance(projection, ChipProjection):
            mantissa = matrix(held, np.int64)
            projections.append(replace(projection, source=source, mantissa=mantissa, delay=delay))
        else:
            weights = matrix(held, np.float64)
            projections.append(replace(projection, source=source, weights=weights, delay=delay))
    return projections


def relay_name(source: str, k: int) -> str:
    """Return the name of the relay ``k``, counted from 0, behind a source."""
    return f"{source}/relay{k + 1}"
