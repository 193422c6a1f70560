"""Xylo by another hand: single integers of Python, one addition after the other, and what saturates is counted.

It reads nothing of the page that it is held against; limits are written as the data sheet has them.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from hw_model.xylo.network import XyloNetwork, XyloPopulation

LARGEST = 32_767
SMALLEST = -32_768


class Neuron:
    """One neuron of a population, with its registers."""

    def __init__(self, population: XyloPopulation, number: int, counted: Counter[str]) -> None:
        self.dash_syn = [int(dash) for dash in population.dash_syn[number]]
        self.dash_mem = int(population.dash_mem[number])
        self.threshold = int(population.threshold[number])
        self.bias = None if population.bias is None else int(population.bias[number])
        self.currents = [0] * len(self.dash_syn)
        self.potential = 0
        self.counted = counted

    def receive(self, synapse: int, weight: int, shift: int) -> None:
        """Add a charge, of which the chip keeps 16 bits, to a current."""
        charge = weight * 2**shift % 65_536
        if charge > LARGEST:
            charge -= 65_536
        current = self.currents[synapse] + charge
        self.currents[synapse] = self._held(current, "current_saturations")

    def respond(self) -> None:
        """Let everything decay, then take up currents and bias."""
        for synapse, dash in enumerate(self.dash_syn):
            self.currents[synapse] -= self._lost(self.currents[synapse], dash)
        lost = self._lost(self.potential, self.dash_mem)
        # Only -32768 with dash 0 has a negative that 16 bits do not hold: it stays what it is.
        taken_up = SMALLEST if lost == SMALLEST else -lost
        change = self._held(taken_up + sum(self.currents), "change_saturations")
        if self.bias is not None:
            change = self._held(change + self.bias, "change_saturations")
        self.potential = self._held(self.potential + change, "potential_saturations")

    def fire(self, most: int) -> int:
        """Spike while a threshold fits, at most so often."""
        spikes = 0
        while spikes < most and self.potential >= self.threshold:
            self.potential -= self.threshold
            spikes += 1
        return spikes

    def _held(self, value: int, event: str) -> int:
        if value > LARGEST:
            self.counted[event] += 1
            return LARGEST
        if value < SMALLEST:
            self.counted[event] += 1
            return SMALLEST
        return value

    @staticmethod
    def _lost(value: int, dash: int) -> int:
        lost = value // 2**dash
        if lost == 0 and value > 0:
            return 1
        return lost


def play(network: XyloNetwork, events: np.ndarray) -> tuple[dict[str, np.ndarray], Counter[str]]:
    """Return registers and spikes of every row, as the engine names them, and the counts of events."""
    counted: Counter[str] = Counter()
    hidden = [Neuron(network.hidden, n, counted) for n in range(network.hidden.size)]
    outputs = [Neuron(network.outputs, n, counted) for n in range(network.outputs.size)]
    rows: dict[str, list[list[object]]] = {
        name: [] for name in ("spikes", "output_spikes", "i", "v", "output_i", "output_v")
    }
    sent = [0] * len(hidden)
    for row in events.tolist():
        for line, count in enumerate(row):
            counted["lost_input_events"] += max(0, count - 15)
            for _ in range(min(count, 15)):
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
    """Return the spikes of a row; those of a neuron count for its aliases as well."""
    spikes = [0] * len(hidden)
    for number, neuron in enumerate(hidden):
        neuron.respond()
        spikes[number] += neuron.fire(31 - spikes[number])
        for alias in network.aliases[number] if network.aliases else ():
            spikes[alias] = min(31, spikes[alias] + spikes[number])
    return spikes
