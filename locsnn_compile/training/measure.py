"""The loss of a batch and the figures of a set of recordings."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from locsnn_compile.models.networks import TouchNetwork
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.losses import count_cross_entropy, spike_count_loss, weighted_counts


def batch_loss(network: TouchNetwork, config: TrainingConfig, x: Tensor, labels: Tensor) -> Tensor:
    """Return the scalar loss that ``config`` names for x (batch, steps, channels), labels (batch,)."""
    spikes = network(x)
    branches = {name: spikes[f"{name}_output"].sum(dim=1) for name in network.description.branches}
    counts = weighted_counts(branches, config.location_weight)
    if config.loss == "spike-count":
        loss = spike_count_loss(counts, labels, target_right=config.target_right, target_wrong=config.target_wrong)
    else:
        loss = count_cross_entropy(
            counts, labels, count_scale=config.count_scale, label_smoothing=config.label_smoothing
        )
    if config.spike_cost:
        hidden = [spikes[f"{name}_hidden"].sum(dim=1).mean() for name in network.description.branches]
        loss = loss + config.spike_cost * torch.stack(hidden).sum()
    return loss


def evaluate(
    network: TouchNetwork, config: TrainingConfig, spikes: NDArray[np.uint8], labels: NDArray[np.int64]
) -> tuple[float, float]:
    """Return (mean loss, accuracy) on spikes (samples, steps, channels), in the network's own float type."""
    kind = next(network.parameters()).dtype
    loss, right = 0.0, 0
    with torch.no_grad():
        for start in range(0, len(labels), 32):
            x = torch.from_numpy(np.array(spikes[start : start + 32])).to(kind)
            y = torch.from_numpy(labels[start : start + 32].copy())
            loss += float(batch_loss(network, config, x, y)) * len(y)
            right += int((network.counts(x).argmax(dim=1) == y).sum())
    return loss / len(labels), right / len(labels)
