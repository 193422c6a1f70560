"""The oracle of Xylo: an independent simulator in plain Python integers, one addition at a time.

It shares no arithmetic with ``hw_model/arithmetic/xylo.py``, whose engines are tested against it; limits are written as
in the data sheet. It also counts saturations.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from hw_model.xylo.network import XyloNetwork, XyloPopulation

LARGEST = 32_767
SMALLEST = -32_768
"""Registers have 16 bits with a sign."""
MOST_INPUT_EVENTS = 15
"""Events of an input line in one row; more are lost."""
MOST_HIDDEN_SPIKES = 31
"""Spikes of a hidden neuron in one row; an output spikes once."""


class Neuron:
    """One neuron of a population, with its registers: a current per synapse, and a potential."""

    def __init__(self, population: XyloPopulation, number: int, counted: Counter[str]) -> None:
        self.dash_syn = [int(dash) for dash in population.dash_syn[number]]
        self.dash_mem = int(population.dash_mem[number])
        self.threshold = int(population.threshold[number])
        self.bias = None if population.bias is None else int(population.bias[number])
        self.currents = [0] * len(self.dash_syn)
        self.potential = 0
        self.counted = counted

    def receive(self, synapse: int, weight: int, shift: int) -> None:
        """Add the charge of a spike, of which the chip keeps 16 bits, to a current."""
        charge = weight * 2**shift % 2**16
        if charge > LARGEST:
            charge -= 2**16
        current = self.currents[synapse] + charge
        self.currents[synapse] = self._saturate(current, "current_saturations")

    def respond(self) -> None:
        """Let currents and potential decay, then add currents and bias to the potential."""
        for synapse, dash in enumerate(self.dash_syn):
            self.currents[synapse] -= self._lost(self.currents[synapse], dash)
        lost = self._lost(self.potential, self.dash_mem)
        # A potential of -32768 with dash 0 loses itself; its negative does not fit into 16 bits and wraps to -32768.
        decay = SMALLEST if lost == SMALLEST else -lost
        change = self._saturate(decay + sum(self.currents), "change_saturations")
        if self.bias is not None:
            change = self._saturate(change + self.bias, "change_saturations")
        self.potential = self._saturate(self.potential + change, "potential_saturations")

    def fire(self, most: int) -> int:
        """Spike while the potential reaches the threshold, at most ``most`` times; return the number of spikes."""
        spikes = 0
        while spikes < most and self.potential >= self.threshold:
            self.potential -= self.threshold
            spikes += 1
        return spikes

    def _saturate(self, value: int, event: str) -> int:
        """Return what 16 bits hold of a value, and count if it saturates."""
        if value > LARGEST:
            self.counted[event] += 1
            return LARGEST
        if value < SMALLEST:
            self.counted[event] += 1
            return SMALLEST
        return value

    @staticmethod
    def _lost(value: int, dash: int) -> int:
        """Return what decays in a step: value / 2^dash, rounded down, but at least 1 of a positive value."""
        lost = value // 2**dash
        if lost == 0 and value > 0:
            return 1
        return lost


def play(network: XyloNetwork, events: np.ndarray) -> tuple[dict[str, np.ndarray], Counter[str]]:
    """Return the registers and spikes of every row, by the engine's names, and the counts of saturations and lost events.

    ``events`` (rows, inputs) are counts. Spikes of hidden neurons act in the next row.
    """
    counted: Counter[str] = Counter()
    hidden = [Neuron(network.hidden, n, counted) for n in range(network.hidden.size)]
    outputs = [Neuron(network.outputs, n, counted) for n in range(network.outputs.size)]
    rows: dict[str, list[list[object]]] = {
        name: [] for name in ("spikes", "output_spikes", "i", "v", "output_i", "output_v")
    }
    sent = [0] * len(hidden)
    for row in events.tolist():
        for line, count in enumerate(row):
            counted["lost_input_events"] += max(0, count - MOST_INPUT_EVENTS)
            for _ in range(min(count, MOST_INPUT_EVENTS)):
                for neuron, weights in zip(hidden, network.weights_in[line], strict=True):
                    for synapse, weight in enumerate(weights.tolist()):
                        neuron.receive(synapse, weight, network.shift_in)
        for source, count in enumerate(sent):
            for _ in range(count):
                for neuron, weights in zip(hidden, network.weights_hidden[source], strict=True):
                    for synapse, weight in enumerate(weights.tolist()):
                        neuron.receive(synapse, weight, network.shift_hidden)
                for neuron, weight in zip(
                    outputs, network.weights_out[source].tolist(), strict=True
                ):
                    neuron.receive(0, weight, network.shift_out)
        sent = _fire_hidden(hidden, network)
        for neuron in outputs:
            neuron.respond()
        rows["spikes"].append(list(sent))
        rows["output_spikes"].append([neuron.fire(1) for neuron in outputs])
        rows["i"].append([list(neuron.currents) for neuron in hidden])
        rows["v"].append([neuron.potential for neuron in hidden])
        rows["output_i"].append([neuron.currents[0] for neuron in outputs])
        rows["output_v"].append([neuron.potential for neuron in outputs])
    return {name: np.array(values, dtype=np.int64) for name, values in rows.items()}, counted


def _fire_hidden(hidden: list[Neuron], network: XyloNetwork) -> list[int]:
    """Return the spikes of hidden neurons in a row; spikes of a neuron count for its aliases as well.

    Neurons fire in the order of their numbers, so an alias that comes later has less room for its own spikes.
    """
    spikes = [0] * len(hidden)
    for number, neuron in enumerate(hidden):
        neuron.respond()
        spikes[number] += neuron.fire(MOST_HIDDEN_SPIKES - spikes[number])
        aliases = network.aliases[number] if network.aliases else ()
        for alias in aliases:
            spikes[alias] = min(MOST_HIDDEN_SPIKES, spikes[alias] + spikes[number])
    return spikes
