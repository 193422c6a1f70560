"""Losses over output spike counts; every count is (batch, classes), every loss the mean over the batch.

Kang et al. 2022: the spike-count loss of SLAYER with its sum over time, over locations, or over both
weighted.
"""

from __future__ import annotations

import torch
from torch import Tensor


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
