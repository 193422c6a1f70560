"""The learning rate of each epoch, the choice of the best epoch, and the running average of the weights.

A run has up to two phases. ``select`` trains on a part of the training recordings, measures every epoch on the rest of
them (validation), and chooses an epoch. ``refit`` then trains afresh on all training recordings, for as many epochs.
"""

import math

import numpy as np
import torch
from torch import Tensor, nn

from locsnn_compile.training.config import EpochRecord, TrainingConfig


def learning_rate(config: TrainingConfig, epoch: int, epochs: int) -> float:
    """Return the learning rate of an epoch from 1 to ``epochs``, the number of epochs of the phase.

    With lr the rate of the configuration, it is constant, or falls by half a cosine,
    lr * (1 + cos(pi (epoch - 1) / epochs)) / 2, from lr to almost 0. A refit has as many epochs as validation chose, so
    it also ends with a rate near 0 and settled weights.
    """
    if config.schedule == "constant":
        return config.learning_rate
    return config.learning_rate * 0.5 * (1.0 + math.cos(math.pi * (epoch - 1) / epochs))


def choose_epoch(history: list[EpochRecord], smoothing_epochs: int, validated: int) -> int:
    """Return the epoch that validation chooses; the last one if there was no validation.

    ``validated`` is the number of validation recordings. Each epoch is judged by its accuracy averaged with that of the
    ``smoothing_epochs - 1`` epochs before it, because a few dozen recordings give noisy figures. The rule takes the
    latest epoch whose average is within one standard error, sqrt(p (1 - p) / validated), of the best average p: a
    smaller difference is chance, and a later epoch has the more settled weights of a lower learning rate (the
    one-standard-error rule of Breiman et al. 1984, sec. 3.4.3).
    """
    rows = [row for row in history if row.phase == "select"]
    accuracy = np.array(
        [row.validation_accuracy for row in rows if row.validation_accuracy is not None]
    )
    if not len(accuracy):
        return rows[-1].epoch
    # Moving averages as differences of running sums; the first epochs have fewer before them.
    sums = np.concatenate([[0.0], np.cumsum(accuracy)])
    ends = np.arange(1, len(accuracy) + 1)
    starts = np.maximum(ends - smoothing_epochs, 0)
    averages = (sums[ends] - sums[starts]) / (ends - starts)
    # Rounding may bring an average above 1, of which the standard error would be a nan.
    best = min(float(averages.max()), 1.0)
    standard_error = math.sqrt(best * (1 - best) / validated)
    # The slack keeps equal averages equal, in whatever order their sums were rounded.
    is_near_best = averages >= best - standard_error - 1e-9
    return rows[int(np.flatnonzero(is_near_best)[-1])].epoch


@torch.no_grad()
def follow_weights(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Update the running average by the weights of ``network``: average = decay * average + (1 - decay) * weights.

    ``average`` is a copy of the network whose parameters are the averages.
    """
    weights: list[Tensor] = list(network.parameters())
    # One call for all parameters, as torch's own optimizers do: a call for each would cost more than the sums.
    torch._foreach_lerp_(list(average.parameters()), weights, 1.0 - decay)
