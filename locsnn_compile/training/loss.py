"""The loss of a batch, and what outputs ought to say of a label.

Losses are those of Kang et al. 2022 over output spike counts. Every count is (batch, classes), every loss (batch,): the
spike-count loss of SLAYER with its sum over time, over locations, or over both weighted.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from hw_model.values import FloatArray
from locsnn_compile.errors import InputError
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig


class Loss:
    """The loss that a configuration names; ``targets`` (classes, classes): what the outputs ought to say of each label.

    That is spikes for the spike-count loss, and shares for cross-entropy. ``InputError`` for neighbours that there are
    none of.
    """

    def __init__(self, config: TrainingConfig, classes: int) -> None:
        self.config = config
        if config.loss == "spike-count":
            targets = config.target_wrong + (config.target_right - config.target_wrong) * np.eye(classes)
        else:
            targets = label_shares(config, classes)
        self.targets = torch.from_numpy(targets).to(config.device)

    def __call__(
        self, network: TouchModel, activity: Mapping[str, Tensor], labels: Tensor, weights: Tensor | None = None
    ) -> Tensor:
        """Return the scalar loss of what the network's ``forward`` returned, for labels (batch,).

        ``weights`` (classes,): how much a recording of each class counts; None: all alike.
        """
        scores, alone = network.scores(activity), self.config.branch_loss
        each = self.of_counts(weighted_counts(scores, self.config.location_weight), labels)
        if alone:
            own = torch.stack([self.of_counts(counts, labels) for counts in scores.values()]).mean(dim=0)
            each = (1.0 - alone) * each + alone * own
        loss = (each if weights is None else weights[labels] * each).mean()
        if self.config.spike_cost:
            hidden = [spikes.sum(dim=1).mean() for spikes in network.hidden_spikes(activity)]
            loss = loss + self.config.spike_cost * sum(hidden, start=torch.zeros(()))
        return loss

    def of_counts(self, counts: Tensor, labels: Tensor) -> Tensor:
        """Return the loss of each recording of a batch, (batch,).

        Spike-count: 1/2 sum_k (counts_k - target_k)^2. Cross-entropy: of ``softmax(count_scale * counts)``.
        """
        targets = self.targets[labels].to(counts.dtype)
        if self.config.loss == "spike-count":
            return 0.5 * (counts - targets).square().sum(dim=1)
        return torch.nn.functional.cross_entropy(self.config.count_scale * counts, targets, reduction="none")


def weighted_counts(branch_counts: Mapping[str, Tensor], location_weight: float) -> Tensor:
    """Return sum_t o1 + lambda * sum_l o2 + windows, (batch, classes); a branch that is alone counts as it is."""
    first, *others = branch_counts.items()
    total = first[1]
    for branch, counts in others:
        total = total + (location_weight * counts if branch == "location" else counts)
    return total


def label_shares(config: TrainingConfig, classes: int) -> FloatArray:
    """Return what share each class has of each label, (classes, classes), rows adding up to 1.

    With s = ``label_smoothing``, K classes and n = ``neighbour_smoothing`` a neighbour has n of what 1 - s leaves, the
    right class the rest of it, and every class s / K.
    """
    given = config.neighbour_smoothing * _neighbours(config.class_order, classes)
    left = 1.0 - given.sum(axis=1)
    crowded = int(np.argmin(left - given.max(axis=1)))
    if left[crowded] <= given[crowded].max():
        raise InputError(
            "training option 'neighbour_smoothing'",
            f"label {crowded} would be no larger than its neighbours",
            measured=f"{left[crowded]:.3g} against {given[crowded].max():.3g}",
            fix="Give a smaller share.",
        )
    smooth = config.label_smoothing
    return np.asarray((1.0 - smooth) * (given + np.diag(left)) + smooth / classes)


def _neighbours(order: str, classes: int) -> FloatArray:
    """Return how much each class (column) is a neighbour of each label (row), (classes, classes).

    ``order``: ranges such as 0-4 5-9, in which each class is a neighbour of the next, or a .csv file of the matrix.
    """
    if order.endswith(".csv"):
        return _matrix(Path(order), classes)
    near = np.zeros((classes, classes))
    for text in order.replace(",", " ").split():
        first, _, last = text.partition("-")
        if not all(end.isascii() and end.isdigit() and len(end) < 9 for end in (first, last)):
            raise _refused("it must be ranges of classes, or a .csv file", f"got {text[:60]!r}")
        if not int(first) < int(last) < classes:
            raise _refused("a range must rise within the classes", f"got {text!r} against 0-{classes - 1}")
        for label in range(int(first), int(last)):
            near[label, label + 1] = near[label + 1, label] = 1
    return near


def _matrix(path: Path, classes: int) -> FloatArray:
    """Return the matrix of a file of numbers, separated by commas."""
    try:
        near = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError):
        raise _refused("its file is missing, or does not hold numbers", f"got {path.name!r}") from None
    if near.shape != (classes, classes):
        raise _refused("its matrix is not (classes, classes)", f"got {near.shape} against {(classes, classes)}")
    if not (np.isfinite(near) & (near >= 0)).all() or near.diagonal().any():
        raise _refused("its matrix must hold 0 and more, and 0 for a class and itself", f"got {path.name!r}")
    return near


def _refused(what: str, measured: str) -> InputError:
    fix = "Give, for example, '0-4 5-9'."
    return InputError("training option 'class_order'", what, measured=measured, fix=fix)
