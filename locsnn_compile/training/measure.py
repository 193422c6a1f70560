"""The loss of a batch and the figures of a set of recordings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.losses import count_cross_entropy, spike_count_loss, weighted_counts


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


def class_scores(network: TouchModel, spikes: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the scores (samples, classes) of all branches together; the first of the largest is predicted."""
    like = next(network.parameters())
    found = []
    with torch.no_grad():
        for start in range(0, len(spikes), 32):
            x = torch.from_numpy(np.array(spikes[start : start + 32])).to(like)
            found.append(torch.stack(list(network.scores(network(x)).values())).sum(dim=0).cpu().numpy())
    return np.concatenate(found).astype(np.float64)


def evaluate(
    network: TouchModel, config: TrainingConfig, spikes: NDArray[np.uint8], labels: NDArray[np.int64]
) -> tuple[float, float]:
    """Return (mean loss, accuracy) on spikes (samples, steps, channels), in the network's own float type."""
    like = next(network.parameters())
    loss, right = 0.0, 0
    with torch.no_grad():
        for start in range(0, len(labels), 32):
            x = torch.from_numpy(np.array(spikes[start : start + 32])).to(like)
            y = torch.from_numpy(labels[start : start + 32].copy()).to(like.device)
            activity = network(x)
            scores = torch.stack(list(network.scores(activity).values())).sum(dim=0)
            loss += float(_loss(network, config, activity, y)) * len(y)
            right += int((scores.argmax(dim=1) == y).sum())
    return loss / len(labels), right / len(labels)
