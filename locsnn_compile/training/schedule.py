"""How fast a run learns, which of its epochs it keeps, and the running average of its weights."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor, nn

from locsnn_compile.training.config import EpochRecord, TrainingConfig


def learning_rate(config: TrainingConfig, epoch: int, epochs: int) -> float:
    """Return the rate of epoch 1..``epochs``: constant, or half a cosine, lr * (1 + cos(pi (epoch - 1) / epochs)) / 2.

    A refit has as many ``epochs`` as were chosen, so that it also ends with settled weights.
    """
    if config.schedule == "constant":
        return config.learning_rate
    return config.learning_rate * 0.5 * (1.0 + math.cos(math.pi * (epoch - 1) / epochs))


def choose_epoch(history: list[EpochRecord], smoothing_epochs: int, held: int) -> int:
    """Return the epoch that validation on ``held`` recordings chooses; the last one without validation.

    Accuracies are averaged over the last ``smoothing_epochs`` epochs. The rule takes the latest epoch whose average is
    within one standard error, sqrt(p (1 - p) / held), of the best average p: a smaller difference is chance, and a
    later epoch has the more settled weights of a lower learning rate (Breiman et al. 1984, sec. 3.4.3).
    """
    rows = [row for row in history if row.phase == "select"]
    accuracy = np.array([row.validation_accuracy for row in rows if row.validation_accuracy is not None])
    if not len(accuracy):
        return rows[-1].epoch
    sums = np.concatenate([[0.0], np.cumsum(accuracy)])
    ends = np.arange(1, len(accuracy) + 1)
    starts = np.maximum(ends - smoothing_epochs, 0)
    averages = (sums[ends] - sums[starts]) / (ends - starts)
    best = min(float(averages.max()), 1.0)
    # The slack keeps equal averages equal, in whatever order their sums were rounded.
    near = averages >= best - math.sqrt(best * (1 - best) / held) - 1e-9
    return rows[int(np.flatnonzero(near)[-1])].epoch


class WeightAverage:
    """average = decay * average + (1 - decay) * weights after every step; with decay 0, the weights themselves.

    ``values`` by parameter name are the averages to continue; without them, it begins with the network's weights.
    """

    def __init__(self, network: nn.Module, decay: float, values: Mapping[str, Tensor]) -> None:
        self._weights = dict(network.named_parameters())
        self._decay = decay
        self.values: dict[str, Tensor] = {}
        if decay:
            begin = values or {name: weight.detach() for name, weight in self._weights.items()}
            self.values = {name: value.to(self._weights[name].device, copy=True) for name, value in begin.items()}

    def update(self) -> None:
        """Include the weights after a step."""
        if self.values:
            with torch.no_grad():
                weights: list[Tensor] = [self._weights[name] for name in self.values]
                torch._foreach_lerp_(list(self.values.values()), weights, 1.0 - self._decay)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Put the averages into the network while the context lasts."""
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
