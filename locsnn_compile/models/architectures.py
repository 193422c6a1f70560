"""The structures of the networks that ``locsnn train`` knows, as rows of one table.

A spiking network has one or more branches, which are chains of layers over the same recording; their class scores are
added. What the neurons of a branch step through is its axis: a *time* branch steps through time steps, with the
channels as inputs, and a *location* branch steps through the channels in a fixed order, with the time steps as inputs.
A *window* branch has neurons that count the events of a channel during some consecutive steps.
"""

from dataclasses import dataclass
from typing import Literal


# Not Frozen: that imports numpy, and the help of the commands, which names the networks, must not.
@dataclass(frozen=True)
class Architecture:
    """The structure of a kind of network.

    - ``branches``: the names of its branches, in the order of their populations; none for an artificial network
    - ``neurons``: ``srm`` (spike response), ``lif`` (leaky integrate-and-fire), ``windows`` (counting in windows),
      ``xylo`` (those of the chip Xylo, which exist in its integers only), or ``none`` (an artificial network)
    - ``graph``: whether the first layer of each branch is a graph convolution
    - ``window_branch``: the branch whose neurons count in windows, if there is one. Its class scores are the potentials
      of its output neurons, and not, as in other branches, their numbers of spikes.
    """

    branches: tuple[str, ...]
    neurons: Literal["srm", "lif", "windows", "xylo", "none"]
    graph: bool = False
    window_branch: str = ""

    @property
    def spiking(self) -> bool:
        """Whether its neurons spike, so that it can be compiled."""
        return self.neurons != "none"

    @property
    def learns_integers(self) -> bool:
        """Whether its neurons can be trained on a chip's integers."""
        return self.neurons in ("srm", "windows", "xylo")


ARCHITECTURES: dict[str, Architecture] = {
    "tactile-snn": Architecture(("time",), "srm"),
    "location-tactile-snn": Architecture(("location",), "srm"),
    "hybrid": Architecture(("time", "location"), "srm"),
    "tactile-snn-lif": Architecture(("time",), "lif"),
    "location-tactile-snn-lif": Architecture(("location",), "lif"),
    "hybrid-lif": Architecture(("time", "location"), "lif"),
    "tactile-sgnet": Architecture(("time",), "lif", graph=True),
    "hybrid-graph": Architecture(("time", "location"), "lif", graph=True),
    "window-snn": Architecture(("location",), "windows", window_branch="location"),
    "hybrid-window": Architecture(("time", "location", "window"), "srm", window_branch="window"),
    "xylo-snn": Architecture(("time",), "xylo"),
    "gru-mlp": Architecture((), "none"),
    "cnn-3d": Architecture((), "none"),
}
"""Name of a network -> its structure. Sources: Kang et al., IJCNN 2022; TactileSGNet: Gu et al., IROS 2020.

``window-snn`` is our own; ``hybrid-window`` is ``hybrid`` with the windows as a third branch. ``xylo-snn`` is the
network that a Xylo chip has room for: one recurrent hidden population, and outputs.
"""
