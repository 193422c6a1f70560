"""The three networks of Kang et al. 2022: time branch, location branch, and the hybrid of both.

Every branch is two fully connected spike response layers; all networks take x (batch, steps, channels),
floats 0 or 1, and return their spikes by population name: ``time_*`` (batch, steps, n), ``location_*``
(batch, locations, n) with locations in walk order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from locsnn_compile.data.sensor import channel_walk
from locsnn_compile.errors import InputError
from locsnn_compile.models.chip_layers import ChipLayer
from locsnn_compile.models.chip_numbers import ChipNumbers
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.srm import INITIAL_SCALE, LSRM, TSRM, SRMLayer, transpose_recording

#: Longest step axis of a torch network in float: a matrix of this size squared takes 128 MB in double precision.
MAX_MATRIX_STEPS = 4_000


class TouchNetwork(nn.Module):
    """A network by its description; layers are named as the populations and start from ``seed``.

    With ``chip`` every population runs on the chip's integers, and its weights live on their grid.
    """

    def __init__(
        self,
        description: NetworkDescription,
        *,
        seed: int = 0,
        initial_scale: float = INITIAL_SCALE,
        chip: ChipNumbers | None = None,
    ) -> None:
        super().__init__()
        self.description, self.chip = description, chip
        self._kept: dict[str, Tensor] = {}
        generator = torch.Generator().manual_seed(seed)
        layout = description.input
        longest = max(layout.steps, layout.channels)
        if chip is None and longest > MAX_MATRIX_STEPS:
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
            make: Callable[..., SRMLayer | ChipLayer]
            if chip is not None:
                make = partial(ChipLayer, numbers=chip.populations[name], strategy=chip.strategy)
            elif name.startswith("time"):
                make = partial(TSRM, steps=layout.steps)
            else:
                make = partial(LSRM, steps=layout.channels)
            layer = make(inputs, outputs, neuron=description.neuron, generator=generator, initial_scale=initial_scale)
            self.add_module(name, layer)

    def layer(self, name: str) -> SRMLayer | ChipLayer:
        """Return the layer of a population."""
        layer = self.get_submodule(name)
        assert isinstance(layer, SRMLayer | ChipLayer)
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
                stream = self.layer(name)(stream)
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

    def prune(self, share: float) -> None:
        """Set a ``share`` 0..1 of each population's weights, the smallest, to 0; :meth:`hold` keeps them there."""
        for name in self.description.weight_shapes:
            weight = self.layer(name).weight.detach()
            order = weight.abs().flatten().argsort(stable=True)
            kept = torch.ones(weight.numel(), dtype=torch.bool)
            kept[order[: int(share * len(order))]] = False
            self._kept[name] = kept.reshape(weight.shape)
        self.hold()

    def hold(self) -> None:
        """Bring weights back where they must be after a step: pruned ones to 0, a chip's into their format's range."""
        for name in self.description.weight_shapes:
            layer = self.layer(name)
            if isinstance(layer, ChipLayer):
                layer.hold()
            if name in self._kept:
                with torch.no_grad():
                    layer.weight.mul_(self._kept[name])

    def snap(self) -> None:
        """Put a chip network's latent weights where they round to, so that no later rounding can differ."""
        if self.chip is not None:
            units = {name: numbers.unit for name, numbers in self.chip.populations.items()}
            self.load_weights({name: mantissa * units[name] for name, mantissa in self.mantissas().items()})

    def mantissas(self) -> dict[str, NDArray[np.int64]]:
        """Return the mantissas [out, in] by population name, of a network on the chip's integers."""
        layers = {name: self.layer(name) for name in self.description.weight_shapes}
        return {name: layer.mantissas() for name, layer in layers.items() if isinstance(layer, ChipLayer)}

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """Return copies of the weights [out, in] by population name."""
        return {
            name: self.layer(name).weight.detach().to(torch.float32).numpy().copy()
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
            layer = self.layer(name)
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
    description: NetworkDescription,
    *,
    seed: int = 0,
    initial_scale: float = INITIAL_SCALE,
    chip: ChipNumbers | None = None,
) -> TouchNetwork:
    """Return the network of ``description.architecture`` with initial weights of ``seed``.

    They are uniform within +-``initial_scale`` / sqrt(inputs of the layer). With ``chip`` it runs on its integers.
    """
    return NETWORKS[description.architecture](description, seed=seed, initial_scale=initial_scale, chip=chip)
