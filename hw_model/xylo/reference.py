"""The plain engine of Xylo: in which order inputs, hidden neurons and outputs take their turns in a row.

What a neuron does in its turn is said in :mod:`hw_model.arithmetic.xylo`. Spikes are counts.
"""

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.arithmetic.xylo import State
from hw_model.errors import InputError
from hw_model.values import AnyArray, IntArray, Shown
from hw_model.xylo.network import XyloNetwork, XyloPopulation


class XyloResult(Shown):
    """What a recording of T rows does: registers after each row, and spikes in it.

    ``spikes`` (T, hidden) are counts 0..31, ``output_spikes`` (T, outputs) 0 or 1; ``i`` (T, hidden, k) and ``v`` (T,
    hidden), ``output_i`` and ``output_v`` (T, outputs). ``events`` counts what saturated or was lost, by name.
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
    """Return rows of input events as integers; ``InputError`` for others than counts (T, inputs)."""
    counts = np.asarray(events)
    inputs = len(network.weights_in)
    if counts.ndim != 2 or counts.shape[1] != inputs or counts.min(initial=0) < 0:
        measured = f"{counts.shape} against (rows, {inputs})"
        fix = "Give a row of counts, 0 or more, for each step."
        raise InputError("input events", "they do not fit the inputs", measured=measured, fix=fix)
    return counts.astype(np.int64)


def empty_result(network: XyloNetwork, rows: int, events: dict[str, int]) -> XyloResult:
    """Return room for so many rows."""
    hidden, outputs = network.hidden, network.outputs

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
    """Registers of a network between two rows, and the spikes that its hidden neurons sent in the last one."""

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
        heard = np.minimum(row, xylo.INPUT_EVENTS_MAX)
        self.events["lost_input_events"] += int((row - heard).sum())
        self.hidden = self._collect(self.hidden, heard, self.charges_in)
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
        i, saturated = xylo.collect(state.i, spikes, charges)
        self.events["current_saturations"] += saturated
        return State(i, state.v)

    def _respond(self, population: XyloPopulation, state: State) -> State:
        counted = xylo.respond(population.parameters, state)
        for name, count in counted.saturations.items():
            self.events[name] += count
        return counted.state

    def _fire_hidden(self) -> tuple[IntArray, IntArray]:
        aliases = self.network.aliases
        threshold = self.network.hidden.threshold
        if aliases is None:
            return xylo.fire(self.hidden.v, threshold, xylo.HIDDEN_SPIKES_MAX)
        return xylo.fire_with_aliases(self.hidden.v, threshold, aliases)


def _at_rest(population: XyloPopulation) -> State:
    currents = np.zeros((population.size, population.states), dtype=np.int64)
    return State(currents, np.zeros(population.size, dtype=np.int64))
