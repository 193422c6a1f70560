"""The compiled engine of Xylo, which plays a network with numba, row after row.

The formulas are those of :mod:`hw_model.arithmetic.xylo`, compiled. This module says only in which order they are
applied. The plain engine, :mod:`hw_model.xylo.reference`, does the same in the same order; both give equal registers
and counts. A row is the input of one step.
"""

import itertools
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.engine.compiled import compiled
from hw_model.engine.formulas import CompiledPage
from hw_model.values import AnyArray, IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.reference import XyloResult, checked_rows, empty_result

# The arithmetic's EVENTS are the names of what is counted, such as saturations; they are not input events. The loops
# count in an array, by these indices, since numba has no fast dictionary.
CURRENT_SATURATIONS = xylo.EVENTS.index("current_saturations")
CHANGE_SATURATIONS = xylo.EVENTS.index("change_saturations")
POTENTIAL_SATURATIONS = xylo.EVENTS.index("potential_saturations")
LOST_INPUT_EVENTS = xylo.EVENTS.index("lost_input_events")


class Neurons(NamedTuple):
    """The parameters of n neurons with k currents each: ``dash_syn`` (n * k,), all others (n,).

    Where biases are off, they are 0. Neurons ``alias[first_alias[n] : first_alias[n + 1]]`` repeat the spikes of
    neuron n.
    """

    dash_syn: IntArray
    dash_mem: IntArray
    threshold: IntArray
    bias: IntArray
    first_alias: IntArray
    alias: IntArray


class Charges(NamedTuple):
    """What a spike of each source adds to the currents of its targets, each (sources, n * k)."""

    from_inputs: IntArray
    among_hidden: IntArray
    onto_outputs: IntArray


class Registers(NamedTuple):
    """Currents (n * k,), the k of a neuron next to each other, potentials (n,), and the spikes (n,) of the last row."""

    i: IntArray
    v: IntArray
    spikes: IntArray


class Recorded(NamedTuple):
    """The history that the loops write: spikes (rows, n), currents (rows, n * k) and potentials (rows, n)."""

    spikes: IntArray
    i: IntArray
    v: IntArray


# In an order in which each formula comes after the formulas that it calls.
_PAGE = CompiledPage(xylo, __name__)
_saturate = _PAGE.compiled(xylo.saturate)
_wrap = _PAGE.compiled(xylo.wrap)
_taken = _PAGE.compiled(xylo.taken)
_decayed = _PAGE.compiled(xylo.decayed)
_change_of = _PAGE.compiled(xylo.change_of)
_fire = _PAGE.compiled(xylo.fire)
_INPUT_EVENTS_MAX = xylo.INPUT_EVENTS_MAX
_HIDDEN_SPIKES_MAX = xylo.HIDDEN_SPIKES_MAX
_OUTPUT_SPIKES_MAX = xylo.OUTPUT_SPIKES_MAX


def play_fast(network: XyloNetwork, events: AnyArray) -> XyloResult:
    """Play rows of input events, counts (T, inputs), to a network at rest."""
    return FastXylo(network).play(events)


class FastXylo:
    """A network laid out for the compiled loops once, to play any number of recordings with it."""

    def __init__(self, network: XyloNetwork) -> None:
        self._network = network
        self._hidden = _neurons(network.hidden, network.aliases)
        self._outputs = _neurons(network.outputs, aliases=None)
        self._charges = Charges(
            from_inputs=_charges(network.weights_in, network.shift_in),
            among_hidden=_charges(network.weights_hidden, network.shift_hidden),
            onto_outputs=_plain(xylo.charge_of(network.weights_out, network.shift_out)),
        )

    def play(self, events: AnyArray) -> XyloResult:
        """Play rows of input events, counts (T, inputs), to the network at rest."""
        network = self._network
        rows = checked_rows(network, events)
        event_counts = np.zeros(len(xylo.EVENTS), dtype=np.int64)
        result = empty_result(network, len(rows), {})
        at_rest = (_at_rest(network.hidden), _at_rest(network.outputs))
        recorded = (
            Recorded(result.spikes, _side_by_side(result.i), result.v),
            Recorded(result.output_spikes, result.output_i, result.output_v),
        )
        _play(rows, self._hidden, self._outputs, self._charges, at_rest, recorded, event_counts)
        result.events.update(zip(xylo.EVENTS, event_counts.tolist(), strict=True))
        return result


def _neurons(population: XyloPopulation, aliases: tuple[tuple[int, ...], ...] | None) -> Neurons:
    """Return the parameters of a population for the loops; ``aliases`` has the aliases of each neuron."""
    bias = np.zeros(population.size) if population.bias is None else population.bias
    if aliases is None:
        aliases = ((),) * population.size
    counts = [len(aliases_of_neuron) for aliases_of_neuron in aliases]
    flat_aliases = list(itertools.chain.from_iterable(aliases))
    return Neurons(
        dash_syn=_plain(population.dash_syn.ravel()),
        dash_mem=_plain(population.dash_mem),
        threshold=_plain(population.threshold),
        bias=_plain(bias),
        first_alias=_plain(np.cumsum([0, *counts])),
        alias=_plain(np.array(flat_aliases)),
    )


def _charges(weights: IntArray, shift: int) -> IntArray:
    """Return the charges of weights (sources, n, k) as (sources, n * k)."""
    return _plain(_side_by_side(xylo.charge_of(weights, shift)))


def _side_by_side(currents: IntArray) -> IntArray:
    """Return a view (rows, n * k) of currents (rows, n, k).

    Compilers turn one long loop over n * k into vector instructions, but not many short loops over k.
    """
    rows, neurons, states = currents.shape
    return currents.reshape(rows, neurons * states)


def _plain(values: AnyArray) -> IntArray:
    """Return a contiguous, writeable copy as int64: the kind of array that the loops are compiled for."""
    return np.array(values, dtype=np.int64, order="C")


def _at_rest(population: XyloPopulation) -> Registers:
    """Return the registers of a population before the first row."""
    size = population.size
    return Registers(
        i=np.zeros(size * population.states, dtype=np.int64),
        v=np.zeros(size, dtype=np.int64),
        spikes=np.zeros(size, dtype=np.int64),
    )


@compiled
def _collect(i, charges, spikes, event_counts):  # type: ignore[no-untyped-def]
    """Add the charges of a source to the currents, once per spike; both are (n * k,).

    One after the other, because a current saturates at every single addition.
    """
    saturated = 0
    for _ in range(spikes):
        for place in range(len(i)):
            exact = i[place] + charges[place]
            i[place] = _saturate(exact)
            saturated += exact != i[place]
    event_counts[CURRENT_SATURATIONS] += saturated


@compiled
def _respond(neurons, registers, event_counts):  # type: ignore[no-untyped-def]
    """Let currents and potentials decay, and add the currents and the bias to each potential.

    The change of a potential saturates twice: after the currents are added, and after the bias is added.
    """
    i = registers.i
    v = registers.v
    states = len(i) // len(v)
    for place in range(len(i)):
        i[place] = _decayed(i[place], neurons.dash_syn[place])
    for n in range(len(v)):
        currents = 0
        for place in range(n * states, (n + 1) * states):
            currents += i[place]
        exact = _change_of(v[n], neurons.dash_mem[n], currents)
        change = _saturate(exact)
        event_counts[CHANGE_SATURATIONS] += change != exact
        exact = change + neurons.bias[n]
        change = _saturate(exact)
        event_counts[CHANGE_SATURATIONS] += change != exact
        exact = v[n] + change
        v[n] = _saturate(exact)
        event_counts[POTENTIAL_SATURATIONS] += v[n] != exact


@compiled
def _fire_all(neurons, registers, most_spikes):  # type: ignore[no-untyped-def]
    """Let neurons fire in the order of their numbers, up to ``most_spikes`` times each, and their aliases with them."""
    spikes = registers.spikes
    v = registers.v
    for n in range(len(v)):
        spikes[n] = 0
    for n in range(len(v)):
        # Below the threshold nothing changes. `_fire` divides, which would take longer than all the rest.
        if v[n] >= neurons.threshold[n]:
            # Spikes that the neuron repeats as an alias of earlier neurons leave less room for its own.
            own_spikes, v[n] = _fire(v[n], neurons.threshold[n], most_spikes - spikes[n])
            spikes[n] += own_spikes
        for place in range(neurons.first_alias[n], neurons.first_alias[n + 1]):
            alias = neurons.alias[place]
            spikes[alias] = min(most_spikes, spikes[alias] + spikes[n])


@compiled
def _record(registers, recorded, t):  # type: ignore[no-untyped-def]
    """Copy the registers after row t into the history."""
    # Loops, not slices: slices would allocate memory, for which the loops are not compiled.
    for n in range(len(registers.v)):
        recorded.spikes[t, n] = registers.spikes[n]
        recorded.v[t, n] = registers.v[n]
    for place in range(len(registers.i)):
        recorded.i[t, place] = registers.i[place]


@compiled
def _play(rows, hidden, outputs, charges, at_rest, recorded, event_counts):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Play all rows; ``at_rest`` is the registers of the hidden neurons and of the outputs, which the loops update."""
    of_hidden, of_outputs = at_rest
    for t in range(len(rows)):
        for source in range(rows.shape[1]):
            events = min(rows[t, source], _INPUT_EVENTS_MAX)
            event_counts[LOST_INPUT_EVENTS] += rows[t, source] - events
            if events:
                _collect(of_hidden.i, charges.from_inputs[source], events, event_counts)
        # Spikes that hidden neurons sent in the row before act now, on hidden neurons and outputs.
        for source in range(len(of_hidden.spikes)):
            spikes = of_hidden.spikes[source]
            if spikes:
                _collect(of_hidden.i, charges.among_hidden[source], spikes, event_counts)
                _collect(of_outputs.i, charges.onto_outputs[source], spikes, event_counts)

        _respond(hidden, of_hidden, event_counts)
        _fire_all(hidden, of_hidden, _HIDDEN_SPIKES_MAX)
        _respond(outputs, of_outputs, event_counts)
        _fire_all(outputs, of_outputs, _OUTPUT_SPIKES_MAX)

        _record(of_hidden, recorded[0], t)
        _record(of_outputs, recorded[1], t)
