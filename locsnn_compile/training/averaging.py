"""A running average of the weights (Polyak and Juditsky 1992): what a run measures and keeps, where it is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import torch
from torch import Tensor, nn


class WeightAverage:
    """average = decay * average + (1 - decay) * weights after every step; with decay 0 it is the weights themselves.

    ``values`` are by parameter name, to go on from; without them it begins at the network's weights.
    """

    def __init__(self, network: nn.Module, decay: float, values: Mapping[str, Tensor]) -> None:
        self._weights = dict(network.named_parameters())
        self._decay = decay
        self.values: dict[str, Tensor] = {}
        if decay:
            begin = values or {name: weight.detach() for name, weight in self._weights.items()}
            self.values = {name: value.to(self._weights[name].device, copy=True) for name, value in begin.items()}

    def update(self) -> None:
        """Take the weights of a step in."""
        if self.values:
            with torch.no_grad():
                weights: list[Tensor] = [self._weights[name] for name in self.values]
                torch._foreach_lerp_(list(self.values.values()), weights, 1.0 - self._decay)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Let the network hold the averages for a while."""
        own = {name: self._weights[name].detach().clone() for name in self.values}
        self._put(self.values)
        try:
            yield
        finally:
            self._put(own)

    def _put(self, values: Mapping[str, Tensor]) -> None:
        with torch.no_grad():
            for name, value in values.items():
                self._weights[name].copy_(value)
