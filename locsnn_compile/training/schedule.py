"""How fast a run learns, which of its epochs it keeps, and the running average of its weights."""

import math

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
    accuracy = np.array(
        [row.validation_accuracy for row in rows if row.validation_accuracy is not None]
    )
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


@torch.no_grad()
def follow_weights(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Include a network's weights after a step: average = decay * average + (1 - decay) * weights."""
    held: list[Tensor] = list(network.parameters())
    torch._foreach_lerp_(list(average.parameters()), held, 1.0 - decay)
