"""Relays: helper neurons that repeat a spike, for delays longer than the chip's longest synaptic delay.

A synapse with the longest delay leads from a source to a relay neuron, which spikes once for each spike that reaches
it. Behind ``k`` relays in a row, a spike is ``k * (DELAY_MAX + 1)`` steps later than its source. The relays of a
source form one chain of populations, from which each target takes its spikes as late as it needs them.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi
from hw_model.values import AnyArray, BoolArray, Frozen, IntArray, sealed
from locsnn_compile.errors import counted
from locsnn_compile.frontends.parts import Parts
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.network.network import Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import (
    ChipProjection,
    Matrix,
    Projection,
    connections,
    matrix,
    values_of,
)

AnyProjection = Projection | ChipProjection
"""A projection in float or in the chip's integers; all projections of a source are of the same kind."""
DELAY_MAX = 62
"""Longest delay of a synapse of Loihi, in steps: 64 accumulator slots less two."""
STEPS_OF_A_RELAY = DELAY_MAX + 1
"""Steps by which a relay delays a spike: the longest delay, and the one step that every spike takes."""
RELAY_THRESHOLD = 1
"""The threshold mantissa of a relay on the grid: 64 counts of the register."""
RELAY_MANTISSA = 2
"""The weight mantissa onto a relay on the grid: 128 counts of the register, which alone exceed its threshold."""


class _Synapses(Frozen, eq=False):
    """The connections of a projection, row by row: arrays (connections,)."""

    target: IntArray
    source: IntArray
    weight: AnyArray
    delay: IntArray

    @classmethod
    def of(cls, projection: AnyProjection) -> "_Synapses":
        """List the connections of a projection."""
        weights = values_of(projection.held)
        delays = np.broadcast_to(np.asarray(projection.delay, dtype=np.int64), weights.shape)
        target, source, index = connections(projection.held)
        # The values of a CSR matrix are row by row; delays that are arrays must be in the same order.
        row_by_row = np.lexsort((source, target))
        index = index[row_by_row]
        return cls(
            target=target[row_by_row],
            source=source[row_by_row],
            weight=weights.ravel()[index],
            delay=delays.ravel()[index],
        )

    @property
    def relays_passed(self) -> IntArray:
        """The number of relays that the spikes of each connection pass, (connections,)."""
        steps_beyond = self.delay - DELAY_MAX
        # Rounded up; delays that a synapse has itself give 0 or less.
        return np.maximum(-(-steps_beyond // STEPS_OF_A_RELAY), 0)

    def chosen(self, which: BoolArray) -> "_Synapses":
        """Return some of the connections."""
        return _Synapses(
            self.target[which], self.source[which], self.weight[which], self.delay[which]
        )


class _Relay(Frozen, eq=False):
    """A population of relays: ``lines`` are the numbers of its source's lines that it repeats, in order."""

    name: str
    lines: IntArray

    @property
    def size(self) -> int:
        """Number of neurons."""
        return len(self.lines)


def add_relays(parts: Parts) -> tuple[str, ...]:
    """Add relays for all connections whose delays are above :data:`DELAY_MAX`.

    Adds populations ``SOURCE/relay1``, ``SOURCE/relay2``, ... to the parts and replaces the projections
    that need them. Returns a sentence per source about the relays that were added.
    """
    synapses = {projection: _Synapses.of(projection) for projection in parts.projections}
    projections: list[AnyProjection] = []
    sentences: list[str] = []
    for source in dict.fromkeys(projection.source for projection in parts.projections):
        of_source = {p: table for p, table in synapses.items() if p.source == source}
        relays = _relays_behind(source, of_source.values())
        if relays:
            sentences.append(_sentence(source, relays, of_source.values()))
        # All projections of a source have the same lines and kind of numbers, so look at the first.
        first = next(iter(of_source))
        sender = _Relay(source, np.arange(first.held.shape[1]))
        for relay in relays:
            parts.populations.append(_neurons(relay, on_grid=first.on_grid))
            projections.append(_onto_relay(sender, relay, on_grid=first.on_grid))
            sender = relay
        for projection, table in of_source.items():
            projections += _through_relays(projection, table, relays)
    parts.projections = projections
    return tuple(sentences)


def _relays_behind(source: str, synapses: Collection[_Synapses]) -> list[_Relay]:
    """Return the relays of a source, the nearest first; each repeats the lines that pass it or more relays."""
    count = max(int(table.relays_passed.max(initial=0)) for table in synapses)
    relays = []
    for number in range(1, count + 1):
        lines = [table.source[table.relays_passed >= number] for table in synapses]
        relays.append(_Relay(f"{source}/relay{number}", np.unique(np.concatenate(lines))))
    return relays


def _sentence(source: str, relays: list[_Relay], synapses: Collection[_Synapses]) -> str:
    """Return the sentence about the delays behind a source, for the assumptions of a report."""
    neurons = counted(sum(relay.size for relay in relays), "relay neuron")
    longest = max(int(table.delay.max(initial=0)) for table in synapses)
    return (
        f"Delays of up to {longest} steps behind {source!r} use {neurons} (--relay-delays): a "
        f"synapse delays by at most {DELAY_MAX}."
    )


def _neurons(relay: _Relay, *, on_grid: bool) -> Population:
    """Return the population of a relay: neurons without memory, whose threshold every spike exceeds."""
    if on_grid:
        chip_neuron = ChipCuba.of(
            relay.size, decay_u=loihi.FORGETS, decay_v=loihi.FORGETS, threshold=RELAY_THRESHOLD
        )
        return Population(relay.name, "time", relay.size, chip_neuron, helper=True)
    # Half of the weight of 1 with which spikes reach relays.
    neuron = Cuba.of(relay.size, decay_u=1.0, decay_v=1.0, threshold=0.5)
    return Population(relay.name, "time", relay.size, neuron, helper=True)


def _onto_relay(sender: _Relay, relay: _Relay, *, on_grid: bool) -> AnyProjection:
    """Return the projection that brings each relay neuron the spikes of its line, with the longest delay."""
    # The lines of a relay are among those of its sender, and both are sorted.
    columns = np.searchsorted(sender.lines, relay.lines)
    entries = (np.arange(relay.size), columns)
    shape = (relay.size, sender.size)
    if on_grid:
        mantissas = np.full(relay.size, RELAY_MANTISSA, dtype=np.int64)
        on_lines = matrix(sparse.csr_array((mantissas, entries), shape=shape), np.int64)
        return ChipProjection(
            sender.name,
            relay.name,
            on_lines,
            exponent=0,
            weight_bits=8,
            signs="mixed",
            delay=DELAY_MAX,
        )
    weights = matrix(sparse.csr_array((np.ones(relay.size), entries), shape=shape), np.float64)
    return Projection(sender.name, relay.name, weights, DELAY_MAX)


def _through_relays(
    projection: AnyProjection, synapses: _Synapses, relays: list[_Relay]
) -> list[AnyProjection]:
    """Return the projections that replace one: one for each number of relays that its spikes pass."""
    passed = synapses.relays_passed
    if not passed.any():
        return [projection]
    senders = [_Relay(projection.source, np.arange(projection.held.shape[1])), *relays]
    projections: list[AnyProjection] = []
    for number in np.unique(passed).tolist():
        part = synapses.chosen(passed == number)
        sender = senders[number]
        columns = np.searchsorted(sender.lines, part.source)
        shape = (projection.held.shape[0], sender.size)
        weights = sparse.csr_array((part.weight, (part.target, columns)), shape=shape)
        delay = sealed(part.delay - number * STEPS_OF_A_RELAY)
        projections.append(_with_sender(projection, sender.name, weights, delay))
    return projections


def _with_sender(
    projection: AnyProjection, source: str, weights: Matrix, delay: IntArray
) -> AnyProjection:
    """Return a projection from another source, with the weights and delays onto its targets."""
    if isinstance(projection, ChipProjection):
        mantissa = matrix(weights, np.int64)
        return replace(projection, source=source, mantissa=mantissa, delay=delay)
    in_float = matrix(weights, np.float64)
    return replace(projection, source=source, weights=in_float, delay=delay)
