"""The compiled engine of Xylo: the page of its arithmetic on single numbers, row after row.

The formulas are those of :mod:`hw_model.arithmetic.xylo`, compiled. Here is only the order of turns, as in
:mod:`hw_model.xylo.reference`, which this engine equals in every register and every count.
"""

from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.engine.compiled import compiled
from hw_model.engine.formulas import CompiledPage
from hw_model.values import AnyArray, IntArray
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.reference import XyloResult, checked_rows, empty_result

CURRENT, CHANGE, POTENTIAL, LOST = range(len(xylo.EVENTS))
"""Where a count lies among those of :data:`xylo.EVENTS`."""


class Neurons(NamedTuple):
    """n neurons with k currents: ``dash_syn`` (n * k,), all others (n,). A bias that is off is 0.

    The aliases of neuron n are ``alias[first_alias[n] : first_alias[n + 1]]``.
    """

    dash_syn: IntArray
    dash_mem: IntArray
    threshold: IntArray
    bias: IntArray
    first_alias: IntArray
    alias: IntArray


class Charges(NamedTuple):
    """What a spike adds to currents, (sources, n * k)."""

    from_inputs: IntArray
    among_hidden: IntArray
    onto_outputs: IntArray


class Registers(NamedTuple):
    """Currents (n * k,), the k of a neuron side by side, potentials (n,), and the spikes (n,) of the last row."""

    i: IntArray
    v: IntArray
    spikes: IntArray


class Recorded(NamedTuple):
    """Where spikes (rows, n), currents (rows, n * k) and potentials (rows, n) are kept."""

    spikes: IntArray
    i: IntArray
    v: IntArray


# Each formula after those that it calls.
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
    """A network laid out for the compiled loops once, for any number of recordings."""

    def __init__(self, network: XyloNetwork) -> None:
        self._network = network
        self._hidden = _neurons(network.hidden, network.aliases)
        self._outputs = _neurons(network.outputs, None)
        self._charges = Charges(
            from_inputs=_charges(network.weights_in, network.shift_in),
            among_hidden=_charges(network.weights_hidden, network.shift_hidden),
            onto_outputs=_plain(xylo.charge_of(network.weights_out, network.shift_out)),
        )

    def play(self, events: AnyArray) -> XyloResult:
        """Play rows of input events, counts (T, inputs), to the network at rest."""
        network = self._network
        rows = checked_rows(network, events)
        counted = np.zeros(len(xylo.EVENTS), dtype=np.int64)
        result = empty_result(network, len(rows), {})
        at_rest = (_at_rest(network.hidden), _at_rest(network.outputs))
        recorded = (
            Recorded(result.spikes, _side_by_side(result.i), result.v),
            Recorded(result.output_spikes, result.output_i, result.output_v),
        )
        _play(rows, self._hidden, self._outputs, self._charges, at_rest, recorded, counted)
        result.events.update(zip(xylo.EVENTS, counted.tolist(), strict=True))
        return result


def _neurons(population: XyloPopulation, aliases: tuple[tuple[int, ...], ...] | None) -> Neurons:
    bias = np.zeros(population.size) if population.bias is None else population.bias
    each = aliases or ((),) * population.size
    counts = [len(of_neuron) for of_neuron in each]
    return Neurons(
        dash_syn=_plain(population.dash_syn.ravel()),
        dash_mem=_plain(population.dash_mem),
        threshold=_plain(population.threshold),
        bias=_plain(bias),
        first_alias=_plain(np.cumsum([0, *counts])),
        alias=_plain(np.array([alias for of_neuron in each for alias in of_neuron])),
    )


def _charges(weights: IntArray, shift: int) -> IntArray:
    return _plain(_side_by_side(xylo.charge_of(weights, shift)))


def _side_by_side(currents: IntArray) -> IntArray:
    """Return a view (rows, n * k) of currents (rows, n, k): one long loop runs in vectors, short ones do not."""
    rows, neurons, states = currents.shape
    return currents.reshape(rows, neurons * states)


def _plain(values: AnyArray) -> IntArray:
    """Return a copy of one kind of memory, for which the loops are compiled once."""
    return np.array(values, dtype=np.int64, order="C")


def _at_rest(population: XyloPopulation) -> Registers:
    size = population.size
    return Registers(
        i=np.zeros(size * population.states, dtype=np.int64),
        v=np.zeros(size, dtype=np.int64),
        spikes=np.zeros(size, dtype=np.int64),
    )


@compiled
def _collect(i, charges, spikes, counted):  # type: ignore[no-untyped-def]
    """Add the charges of a source to currents, spike by spike; both are (n * k,)."""
    saturated = 0
    for _ in range(spikes):
        for place in range(len(i)):
            exact = i[place] + charges[place]
            i[place] = _saturate(exact)
            saturated += exact != i[place]
    counted[CURRENT] += saturated


@compiled
def _respond(neurons, registers, counted):  # type: ignore[no-untyped-def]
    """Let currents and potentials decay, and add currents and biases to the potentials."""
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
        counted[CHANGE] += change != exact
        exact = change + neurons.bias[n]
        change = _saturate(exact)
        counted[CHANGE] += change != exact
        exact = v[n] + change
        v[n] = _saturate(exact)
        counted[POTENTIAL] += v[n] != exact


@compiled
def _fire_all(neurons, registers, room):  # type: ignore[no-untyped-def]
    """Let neurons fire in the order of their numbers, up to ``room`` times, and their aliases with them."""
    spikes = registers.spikes
    v = registers.v
    for n in range(len(v)):
        spikes[n] = 0
    for n in range(len(v)):
        # Below the threshold nothing changes; a division would take longer than all else.
        if v[n] >= neurons.threshold[n]:
            own, v[n] = _fire(v[n], neurons.threshold[n], room - spikes[n])
            spikes[n] += own
        for place in range(neurons.first_alias[n], neurons.first_alias[n + 1]):
            alias = neurons.alias[place]
            spikes[alias] = min(room, spikes[alias] + spikes[n])


@compiled
def _keep(registers, recorded, t):  # type: ignore[no-untyped-def]
    # A copy of slices would ask for memory, which compiled loops do not have.
    for n in range(len(registers.v)):
        recorded.spikes[t, n] = registers.spikes[n]
        recorded.v[t, n] = registers.v[n]
    for place in range(len(registers.i)):
        recorded.i[t, place] = registers.i[place]


@compiled
def _play(rows, hidden, outputs, charges, at_rest, recorded, counted):  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    """Play all rows; ``at_rest`` are the registers of hidden neurons and of outputs."""
    of_hidden, of_outputs = at_rest
    for t in range(len(rows)):
        for source in range(rows.shape[1]):
            heard = min(rows[t, source], _INPUT_EVENTS_MAX)
            counted[LOST] += rows[t, source] - heard
            if heard:
                _collect(of_hidden.i, charges.from_inputs[source], heard, counted)
        for source in range(len(of_hidden.spikes)):
            spikes = of_hidden.spikes[source]
            if spikes:
                _collect(of_hidden.i, charges.among_hidden[source], spikes, counted)
                _collect(of_outputs.i, charges.onto_outputs[source], spikes, counted)

        _respond(hidden, of_hidden, counted)
        _fire_all(hidden, of_hidden, _HIDDEN_SPIKES_MAX)
        _respond(outputs, of_outputs, counted)
        _fire_all(outputs, of_outputs, _OUTPUT_SPIKES_MAX)

        _keep(of_hidden, recorded[0], t)
        _keep(of_outputs, recorded[1], t)
