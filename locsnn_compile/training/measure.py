"""The loss of a batch, the figures of a set of recordings, and remarks about runs that learned nothing.

Losses are those of Kang et al. 2022, over output spike counts: the spike-count loss of SLAYER, with its sum over time,
over locations, or over both with weights. Every count is (batch, classes), every loss (batch,).
"""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from hw_model.mapping.graph import decided
from hw_model.values import ByteArray, FloatArray, IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, counted
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig


class Loss:
    """The loss of a configuration; ``targets`` (classes, classes) are the desired outputs for each label.

    Targets are spikes for the spike-count loss, and shares for cross-entropy. Raises ``InputError`` for neighbours that
    are not classes.
    """

    def __init__(self, config: TrainingConfig, classes: int) -> None:
        self.config = config
        if config.loss == "spike-count":
            targets = config.target_wrong + (config.target_right - config.target_wrong) * np.eye(
                classes
            )
        else:
            targets = label_shares(config, classes)
        self.targets = torch.from_numpy(targets).to(config.device)

    def __call__(
        self,
        network: TouchModel,
        activity: Mapping[str, Tensor],
        labels: Tensor,
        weights: Tensor | None = None,
    ) -> Tensor:
        """Return the scalar loss for the result of the network's ``forward``, and labels (batch,).

        ``weights`` (classes,): how much a recording of each class counts; None: all count alike.
        """
        scores, alone = network.scores(activity), self.config.branch_loss
        each = self.of_counts(weighted_counts(scores, self.config.location_weight), labels)
        if alone:
            own = torch.stack([self.of_counts(counts, labels) for counts in scores.values()]).mean(
                dim=0
            )
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
        return torch.nn.functional.cross_entropy(
            self.config.count_scale * counts, targets, reduction="none"
        )


def weighted_counts(branch_counts: Mapping[str, Tensor], location_weight: float) -> Tensor:
    """Return sum_t o1 + lambda * sum_l o2 + windows, (batch, classes); a single branch has weight 1."""
    first, *others = branch_counts.items()
    total = first[1]
    for branch, counts in others:
        total = total + (location_weight * counts if branch == "location" else counts)
    return total


def label_shares(config: TrainingConfig, classes: int) -> FloatArray:
    """Return the share of each class in each label, (classes, classes); rows add up to 1.

    With s = ``label_smoothing``, K classes and n = ``neighbour_smoothing``, every class gets s / K. Of the remaining
    1 - s, each neighbour gets the share n, and the right class the rest.
    """
    given = config.neighbour_smoothing * _neighbours(config.class_order, classes)
    left = 1.0 - given.sum(axis=1)
    crowded = int(np.argmin(left - given.max(axis=1)))
    if left[crowded] <= given[crowded].max():
        where, what = (
            "training option 'neighbour_smoothing'",
            f"label {crowded} would get no more than a neighbour",
        )
        measured = f"{left[crowded]:.3g} against {given[crowded].max():.3g}"
        raise InputError(where, what, measured=measured, fix="Give a smaller share.")
    smooth = config.label_smoothing
    return np.asarray((1.0 - smooth) * (given + np.diag(left)) + smooth / classes)


def _neighbours(order: str, classes: int) -> FloatArray:
    """Return how much each class (column) is a neighbour of each label (row), (classes, classes).

    ``order`` has ranges such as 0-4 5-9, in which adjacent classes are neighbours, or names a .csv file of the matrix.
    """
    if order.endswith(".csv"):
        return _matrix(Path(order), classes)
    near = np.zeros((classes, classes))
    for text in order.replace(",", " ").split():
        first, _, last = text.partition("-")
        if not all(end.isascii() and end.isdigit() and len(end) < 9 for end in (first, last)):
            raise _refused("it must be ranges of classes, or a .csv file", f"got {text[:60]!r}")
        if not int(first) < int(last) < classes:
            raise _refused(
                "a range must rise within the classes", f"got {text!r} against 0-{classes - 1}"
            )
        for label in range(int(first), int(last)):
            near[label, label + 1] = near[label + 1, label] = 1
    return near


def _matrix(path: Path, classes: int) -> FloatArray:
    """Return the matrix in a file of numbers separated by commas."""
    try:
        near = np.loadtxt(path, delimiter=",", ndmin=2)
    except (OSError, ValueError):
        raise _refused(
            "its file is missing, or does not hold numbers", f"got {path.name!r}"
        ) from None
    if near.shape != (classes, classes):
        raise _refused(
            "its matrix is not (classes, classes)", f"got {near.shape} against {(classes, classes)}"
        )
    if not (np.isfinite(near) & (near >= 0)).all() or near.diagonal().any():
        raise _refused(
            "its matrix must hold 0 or more, and 0 for a class and itself", f"got {path.name!r}"
        )
    return near


def _refused(what: str, measured: str) -> InputError:
    return InputError(
        "training option 'class_order'",
        what,
        measured=measured,
        fix="Give, for example, '0-4 5-9'.",
    )


NO_CLASS = "tie"
"""What a recording predicts in which all classes tie, in tables."""
_LIKELY = 1.645
"""95 % of guesses stay below this number of standard deviations above chance."""
_NAMED = 12
"""Largest number of labels that are named; others are only counted."""
_UNEVEN = 5
"""Ratio of recordings of the commonest and the rarest label from which a run remarks on it."""


def class_weights(config: TrainingConfig, labels: IntArray, classes: int) -> Tensor | None:
    """Return how much a recording of each class counts, so that classes count alike; None if recordings count alike."""
    if config.class_weights == "equal":
        return None
    counts = np.bincount(labels, minlength=classes)
    found = len(labels) / (np.count_nonzero(counts) * np.maximum(counts, 1))
    return torch.from_numpy(found.astype(np.float32)).to(config.device)


def _played(network: TouchModel, spikes: ByteArray) -> Iterator[tuple[slice, Mapping[str, Tensor]]]:
    """Yield rows of spikes (samples, steps, channels) and the result of ``forward``, in the network's float type."""
    like = next(network.parameters())
    for start in range(0, len(spikes), 32):
        rows = slice(start, start + 32)
        yield rows, network(torch.from_numpy(np.array(spikes[rows])).to(like))


@torch.no_grad()
def class_scores(network: TouchModel, spikes: ByteArray) -> FloatArray:
    """Return the scores (samples, classes) summed over all branches."""
    found = [network.total(activity).cpu().numpy() for _, activity in _played(network, spikes)]
    return np.concatenate(found).astype(np.float64)


def confusion(network: TouchModel, recordings: Recordings) -> IntArray:
    """Return how often each label (row) was predicted as each class (column), (classes, classes + 1).

    The last column counts the recordings in which all classes tie, so that none is predicted.
    Raises ``InputError`` for recordings without labels, and for those that do not fit the network.
    """
    labels, classes = recordings.needed_labels("measure with"), network.description.classes
    predicted = decided(class_scores(network, recordings.spikes), network.tie_class)
    columns = classes + 1
    pairs = labels * columns + np.where(predicted < 0, classes, predicted)
    return np.bincount(pairs, minlength=classes * columns).reshape(classes, columns)


@torch.no_grad()
def evaluate(
    network: TouchModel, loss: Loss, spikes: ByteArray, labels: IntArray
) -> tuple[float, float]:
    """Return (mean loss, accuracy) on spikes (samples, steps, channels), in the network's own float type."""
    total, right = 0.0, 0
    for rows, activity in _played(network, spikes):
        scores = network.total(activity)
        y = torch.from_numpy(labels[rows].copy()).to(scores.device)
        total += float(loss(network, activity, y)) * len(y)
        predicted = decided(scores.cpu().numpy(), network.tie_class)
        right += int((predicted == labels[rows]).sum())
    return total / len(labels), right / len(labels)


def check_events(recordings: Recordings) -> None:
    """Refuse training recordings if none of them has an event."""
    if not recordings.spikes.any():
        lost = recordings.binned is not None and recordings.binned.dropped > 0
        measured = (
            recordings.binned.words
            if recordings.binned and lost
            else counted(len(recordings), "recording")
        )
        fix = "Lower --threshold, or give more --steps." if lost else "Give recordings with events."
        raise InputError(
            f"recordings {recordings.source!r}",
            "none of them has an event",
            measured=measured,
            fix=fix,
        )


def data_remarks(recordings: Recordings, classes: int, config: TrainingConfig) -> list[str]:
    """Return a sentence for everything that recordings cannot teach: empty ones, and rare or missing labels."""
    labels, found = recordings.needed_labels("train on"), []
    counts = np.bincount(labels, minlength=classes)
    heard = np.bincount(labels[recordings.spikes.any(axis=(1, 2))], minlength=classes)
    if empty := len(labels) - int(heard.sum()):
        of = f"{empty} of {counted(len(labels), 'recording')}"
        found.append(f"{of} to train on {'has' if empty == 1 else 'have'} no event.")
    silent = np.flatnonzero((counts > 0) & (heard == 0))
    found += [_silent_remark(recordings, int(label), config) for label in silent[:_NAMED]]
    missing = np.flatnonzero(counts == 0)
    if len(missing):
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        named = ", ".join(map(str, missing[:_NAMED])) + more
        found.append(
            f"No recording to train on has label {named}: labels count from 0 to {classes - 1} here."
        )
    most, least = int(counts.argmax()), int(np.where(counts, counts, len(labels) + 1).argmin())
    if np.count_nonzero(counts) == 1:
        found.append(
            f"All recordings to train on have label {most}: there is nothing to tell apart."
        )
    if counts[most] >= _UNEVEN * counts[least] and config.class_weights == "equal":
        uneven = f"{recordings.called(most)} has {counted(counts[most], 'recording')}"
        uneven += f", {recordings.called(least)} {counts[least]}"
        found.append(
            f"Labels are uneven: {uneven}. With balanced class weights, all count equally."
        )
    found += _walk_remarks(recordings.spikes.shape[2], config)
    if counts[most] == 1 and config.validation_fraction > 0:
        found.append(
            "Every label has one recording to train on: none was held back, and the last epoch was taken."
        )
    return found


def _silent_remark(recordings: Recordings, label: int, config: TrainingConfig) -> str:
    """Return the sentence on a label without an event; where silence makes all classes tie, what that means for it."""
    silent = f"No recording of {recordings.called(label)} has an event"
    structure = ARCHITECTURES[config.model]
    if config.tie is not None or not structure.spiking or structure.neurons == "windows":
        return f"{silent}."
    return f"{silent}: all classes tie, so it is never right. With --tie {label}, ties predict it."


_LOCATIONS_OF_LATENCY = 2
"""A spike acts from the next location on, so after two layers an output spikes two locations after an event."""


def _walk_remarks(channels: int, config: TrainingConfig) -> list[str]:
    """Return a sentence if a location branch ends before its outputs can spike."""
    structure = ARCHITECTURES[config.model]
    walks = "location" in structure.branches and structure.neurons == "srm"
    if not walks or channels > _LOCATIONS_OF_LATENCY:
        return []
    what = f"The location branch walks over {counted(channels, 'channel')}"
    why = f"its outputs spike {_LOCATIONS_OF_LATENCY} channels after an event at the earliest"
    return [f"{what} and says nothing: {why}. Give --model tactile-snn, or window-snn."]


def tie_remarks(confused: IntArray) -> list[str]:
    """Return a sentence on the recordings in which all classes tie, the last column of a confusion matrix."""
    ties, measured = int(confused[:, -1].sum()), int(confused.sum())
    if not ties:
        return []
    recordings = counted(measured, "test recording")
    return [
        f"All classes tie in {ties} of {recordings}: they predict no class (column {NO_CLASS!r}) and count as wrong."
    ]


def result_remarks(
    network: TouchModel,
    recordings: Recordings,
    advice: str = "Give more --epochs, or a larger --learning-rate.",
) -> list[str]:
    """Return a sentence if outputs are silent on the training recordings, or if their accuracy is at chance.

    ``advice`` is what to do about outputs that are silent.
    """
    labels, scores = recordings.needed_labels("train on"), class_scores(network, recordings.spikes)
    predicted = decided(scores, network.tie_class)
    if (decided(scores) < 0).all() and scores.shape[1] > 1:
        return [f"{silent_outputs(network, len(labels))}: every prediction is a tie. {advice}"]
    accuracy = float((predicted == labels).mean())
    return chance_remarks(accuracy, labels, "it was trained on")


def silent_outputs(network: TouchModel, recordings: int) -> str:
    """Return the start of a sentence: outputs said nothing in any of so many recordings."""
    structure = network.description.structure
    spiking = structure.spiking and structure.neurons != "windows"
    what = "No output neuron spikes" if spiking else "All class scores are equal"
    return f"{what} in any of the {counted(recordings, 'recording')} it was trained on"


def chance_remarks(accuracy: float, labels: IntArray, which: str) -> list[str]:
    """Return a sentence if guessing the commonest class could reach this accuracy on the recordings ``which``."""
    chance = float(np.bincount(labels).max() / len(labels))
    if chance == 1 or accuracy > chance + _LIKELY * math.sqrt(chance * (1 - chance) / len(labels)):
        return []
    what = f"Accuracy {accuracy:.3f} on the {counted(len(labels), 'recording')} {which} is not clearly above chance"
    return [f"{what}, {chance:.3f} for the commonest label."]
