"""The three networks of Kang et al. 2022: time branch, location branch, and the hybrid of both.

Every branch is two fully connected spike response layers; all networks take x (batch, steps, channels),
floats 0 or 1, and return their spikes by population name: ``time_*`` (batch, steps, n), ``location_*``
(batch, locations, n) with locations in walk order.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from locsnn_compile.data.sensor import channel_walk
from locsnn_compile.errors import InputError
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.srm import INITIAL_SCALE, LSRM, TSRM, SRMLayer, transpose_recording

#: Longest step axis of a torch network: a matrix of this size squared takes 128 MB in double precision.
MAX_MATRIX_STEPS = 4_000


class TouchNetwork(nn.Module):
    """A network by its description; layers are named as the populations and start from ``seed``."""

    def __init__(self, description: NetworkDescription, *, seed: int = 0, initial_scale: float = INITIAL_SCALE) -> None:
        super().__init__()
        self.description = description
        generator = torch.Generator().manual_seed(seed)
        layout = description.input
        longest = max(layout.steps, layout.channels)
        if longest > MAX_MATRIX_STEPS:
            raise InputError(
                f"network {description.name!r}",
                "it has too many steps for torch layers, whose kernel is a matrix of steps by steps",
                measured=f"{longest} against {MAX_MATRIX_STEPS}",
                fix="Bin the recordings wider.",
            )
        walk = np.zeros(0, dtype=np.int64)
        if description.location_taxels is not None:
            walk = channel_walk(
                description.location_taxels,
                layout.fingertips,
                taxels=layout.taxels,
                polarities=layout.polarities,
            )
        self.register_buffer("walk", torch.from_numpy(walk.copy()), persistent=False)
        for name, (outputs, inputs) in description.weight_shapes.items():
            kind, steps = (TSRM, layout.steps) if name.startswith("time") else (LSRM, layout.channels)
            self.add_module(
                name, kind(inputs, outputs, steps, description.neuron, generator=generator, initial_scale=initial_scale)
            )

    def _layer(self, name: str) -> SRMLayer:
        layer = self.get_submodule(name)
        assert isinstance(layer, SRMLayer)
        return layer

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the output spikes of every population for ``x`` (batch, steps, channels)."""
        layout = self.description.input
        if x.ndim != 3 or tuple(x.shape[1:]) != (layout.steps, layout.channels):
            raise InputError(
                "recordings",
                "their shape is not the network's",
                measured=f"got {tuple(x.shape[1:])} against {(layout.steps, layout.channels)} steps x channels",
                fix="Give recordings of the network's sensor and duration.",
            )
        spikes: dict[str, Tensor] = {}
        for branch in self.description.branches:
            walk = self.get_buffer("walk")
            stream = x if branch == "time" else transpose_recording(x, walk)
            for name in (f"{branch}_hidden", f"{branch}_output"):
                stream = self._layer(name)(stream)
                spikes[name] = stream
        return spikes

    def branch_counts(self, x: Tensor) -> dict[str, Tensor]:
        """Return spikes a class, (batch, classes), of the output of every branch."""
        spikes = self.forward(x)
        return {branch: spikes[f"{branch}_output"].sum(dim=1) for branch in self.description.branches}

    def counts(self, x: Tensor) -> Tensor:
        """Return spikes a class, (batch, classes), over all steps of all branches; the largest is the
        prediction.
        """
        return torch.stack(list(self.branch_counts(x).values())).sum(dim=0)

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """Return copies of the weights [out, in] by population name."""
        return {
            name: self._layer(name).weight.detach().to(torch.float32).numpy().copy()
            for name in self.description.weight_shapes
        }

    def load_weights(self, weights: Mapping[str, NDArray[np.floating]]) -> None:
        """Take weights [out, in] by population name; ``InputError`` where a name or shape does not fit."""
        for name, shape in self.description.weight_shapes.items():
            if name not in weights or tuple(weights[name].shape) != shape:
                got = tuple(weights[name].shape) if name in weights else "none"
                raise InputError(
                    f"population {name!r}",
                    "its weights do not fit the network",
                    measured=f"got {got} against {shape}",
                    fix="Give the weights of a network of this description.",
                )
            layer = self._layer(name)
            with torch.no_grad():
                layer.weight.copy_(torch.from_numpy(np.array(weights[name])))


class TactileSNN(TouchNetwork):
    """``tactile-snn``: channels -> hidden TSRM -> classes TSRM over the time steps."""


class LocationTactileSNN(TouchNetwork):
    """``location-tactile-snn``: time steps -> hidden LSRM -> classes LSRM over the locations of the walk."""


class Hybrid(TouchNetwork):
    """``hybrid``: both branches; its output is the two outputs, concatenated along their steps."""


NETWORKS: dict[str, type[TouchNetwork]] = {
    "tactile-snn": TactileSNN,
    "location-tactile-snn": LocationTactileSNN,
    "hybrid": Hybrid,
}


def build_network(
    description: NetworkDescription, *, seed: int = 0, initial_scale: float = INITIAL_SCALE
) -> TouchNetwork:
    """Return the network of ``description.architecture`` with initial weights of ``seed``.

    They are uniform within +-``initial_scale`` / sqrt(inputs of the layer).
    """
    return NETWORKS[description.architecture](description, seed=seed, initial_scale=initial_scale)
