"""The plain engine of Xylo: slow, obvious, and the standard that the compiled engine has to equal.

:mod:`hw_model.arithmetic.xylo` says what a neuron computes. This module says in which order inputs, hidden neurons and
outputs take their turns in a row, which is one step. A neuron can spike several times in a row, so spikes are counts.
"""

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.arithmetic.xylo import State
from hw_model.errors import InputError
from hw_model.values import AnyArray, IntArray, Shown
from hw_model.xylo.network import XyloNetwork, XyloPopulation


class XyloResult(Shown):
    """What a network did in T rows.

    - ``spikes`` (T, hidden): 0..31 per row; ``output_spikes`` (T, outputs): 0 or 1
    - ``i`` (T, hidden, k) and ``v`` (T, hidden): currents and potentials of hidden neurons after each row
    - ``output_i``, ``output_v`` (T, outputs): the same of outputs
    - ``events``: how often each of :data:`hw_model.arithmetic.xylo.EVENTS`, such as a saturation, happened
    """

    spikes: IntArray
    output_spikes: IntArray
    i: IntArray
    v: IntArray
    output_i: IntArray
    output_v: IntArray
    events: dict[str, int]


def play_xylo(network: XyloNetwork, events: AnyArray) -> XyloResult:
    """Play rows of input events, counts (T, inputs), to a network at rest."""
    rows = checked_rows(network, events)
    run = _Run(network)
    result = empty_result(network, len(rows), run.events)
    for t, row in enumerate(rows):
        result.spikes[t], result.output_spikes[t] = run.step(row)
        result.i[t], result.v[t] = run.hidden
        result.output_i[t] = run.outputs.i[:, 0]
        result.output_v[t] = run.outputs.v
    return result


def checked_rows(network: XyloNetwork, events: AnyArray) -> IntArray:
    """Return rows of input events as integers; raise ``InputError`` unless they are counts (T, inputs)."""
    counts = np.asarray(events)
    inputs = len(network.weights_in)
    if counts.ndim != 2 or counts.shape[1] != inputs or counts.min(initial=0) < 0:
        measured = f"{counts.shape} against (rows, {inputs})"
        fix = "Give a row of counts, 0 or more, for each step."
        raise InputError("input events", "they do not fit the inputs", measured=measured, fix=fix)
    return counts.astype(np.int64)


def empty_result(network: XyloNetwork, rows: int, events: dict[str, int]) -> XyloResult:
    """Return a result with arrays of zeros for this number of rows."""
    hidden = network.hidden
    outputs = network.outputs

    def zeros(*shape: int) -> IntArray:
        return np.zeros((rows, *shape), dtype=np.int64)

    return XyloResult(
        spikes=zeros(hidden.size),
        output_spikes=zeros(outputs.size),
        i=zeros(hidden.size, hidden.states),
        v=zeros(hidden.size),
        output_i=zeros(outputs.size),
        output_v=zeros(outputs.size),
        events=events,
    )


class _Run:
    """The state of a network between two rows: its registers, and the spikes of hidden neurons in the last row."""

    def __init__(self, network: XyloNetwork) -> None:
        self.network = network
        self.charges_in = xylo.charge_of(network.weights_in, network.shift_in)
        self.charges_hidden = xylo.charge_of(network.weights_hidden, network.shift_hidden)
        self.charges_out = xylo.charge_of(network.weights_out[:, :, None], network.shift_out)
        self.hidden = _at_rest(network.hidden)
        self.outputs = _at_rest(network.outputs)
        self.sent = np.zeros(network.hidden.size, dtype=np.int64)
        self.events = dict.fromkeys(xylo.EVENTS, 0)

    def step(self, row: IntArray) -> tuple[IntArray, IntArray]:
        """Play a row; return the spikes of hidden neurons and of outputs."""
        # Currents collect charges: inputs of this row, then spikes of the row before.
        events = np.minimum(row, xylo.INPUT_EVENTS_MAX)
        self.events["lost_input_events"] += int((row - events).sum())
        self.hidden = self._collect(self.hidden, events, self.charges_in)
        self.hidden = self._collect(self.hidden, self.sent, self.charges_hidden)
        self.outputs = self._collect(self.outputs, self.sent, self.charges_out)

        self.hidden = self._respond(self.network.hidden, self.hidden)
        spikes, v = self._fire_hidden()
        self.hidden = State(self.hidden.i, v)
        self.sent = spikes

        self.outputs = self._respond(self.network.outputs, self.outputs)
        threshold = self.network.outputs.threshold
        output_spikes, v = xylo.fire(self.outputs.v, threshold, xylo.OUTPUT_SPIKES_MAX)
        self.outputs = State(self.outputs.i, v)
        return spikes, output_spikes

    def _collect(self, state: State, spikes: IntArray, charges: IntArray) -> State:
        """Add the charges of spikes to the currents, and count what saturated."""
        i, saturated = xylo.collect(state.i, spikes, charges)
        self.events["current_saturations"] += saturated
        return State(i, state.v)

    def _respond(self, population: XyloPopulation, state: State) -> State:
        """Let currents and potentials decay, add the currents to the potentials, and count what saturated."""
        counted = xylo.respond(population.parameters, state)
        for name, count in counted.saturations.items():
            self.events[name] += count
        return counted.state

    def _fire_hidden(self) -> tuple[IntArray, IntArray]:
        """Return the spikes of hidden neurons, and their potentials afterwards."""
        aliases = self.network.aliases
        threshold = self.network.hidden.threshold
        if aliases is None:
            return xylo.fire(self.hidden.v, threshold, xylo.HIDDEN_SPIKES_MAX)
        return xylo.fire_with_aliases(self.hidden.v, threshold, aliases)


def _at_rest(population: XyloPopulation) -> State:
    currents = np.zeros((population.size, population.states), dtype=np.int64)
    return State(currents, np.zeros(population.size, dtype=np.int64))
