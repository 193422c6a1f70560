"""The losses of Kang et al. 2022 over output spike counts, the loss of a batch, and the figures of a set of recordings.

Every count is (batch, classes), every loss the mean over the batch: the spike-count loss of SLAYER with its sum over
time, over locations, or over both weighted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig


def batch_loss(network: TouchModel, config: TrainingConfig, x: Tensor, labels: Tensor) -> Tensor:
    """Return the scalar loss that ``config`` names for x (batch, steps, channels), labels (batch,)."""
    return _loss(network, config, network(x), labels)


def _loss(network: TouchModel, config: TrainingConfig, activity: Mapping[str, Tensor], labels: Tensor) -> Tensor:
    """Return the loss of what the network's ``forward`` returned."""
    counts = weighted_counts(network.scores(activity), config.location_weight)
    if config.loss == "spike-count":
        loss = spike_count_loss(counts, labels, target_right=config.target_right, target_wrong=config.target_wrong)
    else:
        loss = count_cross_entropy(
            counts, labels, count_scale=config.count_scale, label_smoothing=config.label_smoothing
        )
    if config.spike_cost:
        hidden = [spikes.sum(dim=1).mean() for spikes in network.hidden_spikes(activity)]
        loss = loss + config.spike_cost * sum(hidden, start=torch.zeros(()))
    return loss


def _played(network: TouchModel, spikes: NDArray[np.uint8]) -> Iterator[tuple[slice, Mapping[str, Tensor]]]:
    """Yield rows of spikes (samples, steps, channels), and what ``forward`` returns of them, in its own float type."""
    like = next(network.parameters())
    for start in range(0, len(spikes), 32):
        rows = slice(start, start + 32)
        yield rows, network(torch.from_numpy(np.array(spikes[rows])).to(like))


@torch.no_grad()
def class_scores(network: TouchModel, spikes: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the scores (samples, classes) of all branches together; the first of the largest is predicted."""
    found = [network.total(activity).cpu().numpy() for _, activity in _played(network, spikes)]
    return np.concatenate(found).astype(np.float64)


@torch.no_grad()
def evaluate(
    network: TouchModel, config: TrainingConfig, spikes: NDArray[np.uint8], labels: NDArray[np.int64]
) -> tuple[float, float]:
    """Return (mean loss, accuracy) on spikes (samples, steps, channels), in the network's own float type."""
    loss, right = 0.0, 0
    for rows, activity in _played(network, spikes):
        scores = network.total(activity)
        y = torch.from_numpy(labels[rows].copy()).to(scores.device)
        loss += float(_loss(network, config, activity, y)) * len(y)
        right += int((scores.argmax(dim=1) == y).sum())
    return loss / len(labels), right / len(labels)


def spike_count_loss(counts: Tensor, labels: Tensor, *, target_right: float, target_wrong: float) -> Tensor:
    """Return mean over the batch of 1/2 sum_k (counts_k - target_k)^2.

    target_k is ``target_right`` for the class of ``labels`` (batch,), ``target_wrong`` for the others. With
    the counts of a location branch this is the location spike-count loss.
    """
    targets = torch.full_like(counts, target_wrong)
    targets.scatter_(1, labels.unsqueeze(1), target_right)
    return 0.5 * (counts - targets).square().sum(dim=1).mean()


def weighted_counts(branch_counts: dict[str, Tensor], location_weight: float) -> Tensor:
    """Return sum_t o1 + lambda * sum_l o2, (batch, classes); a branch that is alone counts as it is."""
    if len(branch_counts) == 1:
        return next(iter(branch_counts.values()))
    return branch_counts["time"] + location_weight * branch_counts["location"]


def count_cross_entropy(counts: Tensor, labels: Tensor, *, count_scale: float, label_smoothing: float) -> Tensor:
    """Return the cross-entropy of ``softmax(count_scale * counts)`` against the smoothed labels.

    With s = ``label_smoothing`` and K classes the target of the right class is 1 - s + s / K, of others s /
    K.
    """
    return torch.nn.functional.cross_entropy(count_scale * counts, labels, label_smoothing=label_smoothing)
