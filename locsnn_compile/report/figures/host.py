"""The entry ``host`` of report.json: the first layers of a network whose input is numbers rather than spikes.

The host computer evaluates these layers and sends their spikes to the chip. Their operations are counted
apart from those of the chip, and their energy is not estimated.
"""

from collections.abc import Mapping

from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import Entry


class HostLayerFigures(Entry):
    """The neurons of a layer on the host, and its operations per recording."""

    neurons: int
    multiplications: int
    neuron_updates: int


class HostFigures(Entry):
    """The layers on the host by name, and the number of input lines over which they send spikes to the chip."""

    layers: Mapping[str, HostLayerFigures]
    lines: int


def host_figures(network: Network) -> HostFigures | None:
    """Return what the host computes per recording; None without layers on the host."""
    if network.host is None:
        return None
    layers = {}
    for name, multiplications_per_step in network.host.multiplications.items():
        neurons = network.host.network.population(name).size
        layers[name] = HostLayerFigures(
            neurons=neurons,
            multiplications=multiplications_per_step * network.steps,
            neuron_updates=neurons * network.steps,
        )
    return HostFigures(layers, network.host.lines)
