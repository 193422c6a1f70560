"""What the layers on the host compute, counted apart from the chip."""

from collections.abc import Mapping

from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import Entry


class HostLayerFigures(Entry):
    """A layer on the host: its neurons, and its operations for a recording."""

    neurons: int
    multiplications: int
    neuron_updates: int


class HostFigures(Entry):
    """The layers on the host by name, and the lines over which they send spikes to the chip."""

    layers: Mapping[str, HostLayerFigures]
    lines: int


def host_figures(network: Network) -> HostFigures | None:
    """Return what the host computes for a recording; None without layers on the host."""
    if network.host is None:
        return None
    layers = {}
    for name, products in network.host.multiplications.items():
        neurons = network.host.network.population(name).size
        layers[name] = HostLayerFigures(neurons, products * network.steps, neurons * network.steps)
    return HostFigures(layers, network.host.lines)
