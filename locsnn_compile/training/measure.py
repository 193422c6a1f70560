"""The loss of a batch, the figures of a set of recordings, and remarks about runs that learned nothing.

Class scores are the numbers of output spikes (or the potentials of a branch of windows), added over the branches of a
network. Losses are those of Kang et al. 2022: the spike-count loss of SLAYER, of counts over time, over locations, or
over both with weights; or cross-entropy of the same counts. Every count is (batch, classes), every loss (batch,).

A *remark* is a sentence for the user. Recordings in which the scores of all classes are equal are *ties*: they predict
no class, unless the option ``tie`` names one.
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
from locsnn_compile.models.architectures import ARCHITECTURES, Architecture
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import TrainingConfig

NO_CLASS = "tie"
"""The name, in tables, of the column of ties."""
_LIKELY = 1.645
"""The accuracy of guessing is below chance plus this number of standard deviations in 95 % of cases (one-sided)."""
_MOST_NAMED = 12
"""Most labels that a remark names; more are only counted. Chosen by hand: about what fits a line."""
_UNEVEN = 5
"""The number of recordings of the commonest label divided by that of the rarest, from which on there is a remark.
Chosen by hand."""
_BATCH = 32
"""How many recordings are evaluated at a time, which bounds the memory; chosen by hand."""
_MOST_DIGITS = 8
"""Most digits of a class in the option ``class_order``: more than any network has, and ``int`` takes them quickly."""
_LAYERS = 2
_LAYERS_WITH_GRAPH = 4
"""Layers of a branch; with a graph, the graph convolution is the first. A spike acts from the next location on, as on
the chip, so an output spikes as many locations after an event as its branch has layers."""


class Loss:
    """The loss of a configuration.

    ``targets`` (classes, classes) has a row for each label, the outputs that are wanted: numbers of spikes for the
    spike-count loss, probabilities for cross-entropy. Raises ``InputError`` for neighbours that are not classes.
    """

    def __init__(self, config: TrainingConfig, classes: int) -> None:
        self.config = config
        if config.loss == "spike-count":
            difference = config.target_right - config.target_wrong
            targets = config.target_wrong + difference * np.eye(classes)
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
        """Return the scalar loss for the result of the network's ``forward``, ``activity``, and labels (batch,).

        ``weights`` (classes,): how much a recording of each class counts; None: all count alike.
        """
        scores = network.scores(activity)
        losses = self.of_counts(weighted_counts(scores, self.config.location_weight), labels)
        branch_share = self.config.branch_loss
        if branch_share:
            # Each branch also learns to predict alone, so that none relies on another's scores.
            branch_losses = [self.of_counts(counts, labels) for counts in scores.values()]
            mean_of_branches = torch.stack(branch_losses).mean(dim=0)
            losses = (1.0 - branch_share) * losses + branch_share * mean_of_branches
        if weights is not None:
            losses = weights[labels] * losses
        loss = losses.mean()
        if self.config.spike_cost:
            # For each hidden population, (batch, steps, n): its mean number of spikes per neuron and recording.
            mean_spikes = [spikes.sum(dim=1).mean() for spikes in network.hidden_spikes(activity)]
            loss = loss + self.config.spike_cost * sum(mean_spikes, start=torch.zeros(()))
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
    """Return the sum of the counts of all branches, (batch, classes), with the location branch times its weight.

    In the letters of Kang et al.: sum_t o1 + lambda * sum_l o2, and windows with weight 1. A single branch, whichever
    it is, has weight 1.
    """
    # Branches come in the order of their architecture, where the location branch is never the first of several.
    (_, total), *further_branches = branch_counts.items()
    for branch, counts in further_branches:
        weighted = location_weight * counts if branch == "location" else counts
        total = total + weighted
    return total


def label_shares(config: TrainingConfig, classes: int) -> FloatArray:
    """Return the target probability of each class (column) for each label (row); rows add up to 1.

    With s = ``label_smoothing``, K classes and n = ``neighbour_smoothing``, every class gets s / K. Of the remaining
    1 - s, each neighbour gets the share n, and the right class the rest. Raises ``InputError`` if the right class would
    get no more than a neighbour.
    """
    of_neighbours = config.neighbour_smoothing * _neighbours(config.class_order, classes)
    of_right_class = 1.0 - of_neighbours.sum(axis=1)
    most_of_neighbour = of_neighbours.max(axis=1)
    closest = int(np.argmin(of_right_class - most_of_neighbour))
    if of_right_class[closest] <= most_of_neighbour[closest]:
        where = "training option 'neighbour_smoothing'"
        what = f"label {closest} would get no more than a neighbour"
        measured = f"{of_right_class[closest]:.3g} against {most_of_neighbour[closest]:.3g}"
        raise InputError(where, what, measured=measured, fix="Give a smaller share.")
    smooth = config.label_smoothing
    shares = of_neighbours + np.diag(of_right_class)
    return np.asarray((1.0 - smooth) * shares + smooth / classes)


def _neighbours(order: str, classes: int) -> FloatArray:
    """Return how much each class (column) is a neighbour of each label (row), (classes, classes).

    ``order`` has ranges of classes such as ``0-4 5-9``, in each of which adjacent classes are neighbours (4 and 5 are
    not), or is the name of a .csv file of the matrix.
    """
    if order.endswith(".csv"):
        return _matrix(Path(order), classes)
    near = np.zeros((classes, classes))
    for text in order.replace(",", " ").split():
        first, _, last = text.partition("-")
        if not (_is_class_number(first) and _is_class_number(last)):
            raise _refused("it must be ranges of classes, or a .csv file", f"got {text[:60]!r}")
        if not int(first) < int(last) < classes:
            raise _refused(
                "a range must rise within the classes", f"got {text!r} against 0-{classes - 1}"
            )
        for label in range(int(first), int(last)):
            near[label, label + 1] = 1
            near[label + 1, label] = 1
    return near


def _is_class_number(text: str) -> bool:
    """Return whether a text is digits only, and few enough. ``isdigit`` alone would take digits such as a raised 2."""
    return text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS


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
    """Return the error for an option ``class_order`` that cannot be used."""
    return InputError(
        "training option 'class_order'",
        what,
        measured=measured,
        fix="Give, for example, '0-4 5-9'.",
    )


def class_weights(config: TrainingConfig, labels: IntArray, classes: int) -> Tensor | None:
    """Return the weight of a recording of each class, (classes,), with which all classes count alike.

    The weights of all recordings average to 1. None if the configuration wants recordings to count alike.
    """
    if config.class_weights == "equal":
        return None
    counts = np.bincount(labels, minlength=classes)
    occurring = np.count_nonzero(counts)
    # The maximum only avoids a division by 0 for classes that do not occur.
    weights = len(labels) / (occurring * np.maximum(counts, 1))
    return torch.from_numpy(weights.astype(np.float32)).to(config.device)


def _results_by_batch(
    network: TouchModel, spikes: ByteArray
) -> Iterator[tuple[slice, Mapping[str, Tensor]]]:
    """Yield (rows, result of ``forward`` on these rows) for spikes (samples, steps, channels), batch by batch.

    The network computes in its own float type.
    """
    like = next(network.parameters())
    for start in range(0, len(spikes), _BATCH):
        rows = slice(start, start + _BATCH)
        yield rows, network(torch.from_numpy(np.array(spikes[rows])).to(like))


@torch.no_grad()
def class_scores(network: TouchModel, spikes: ByteArray) -> FloatArray:
    """Return the class scores (samples, classes), added over all branches."""
    scores = [
        network.total(activity).cpu().numpy() for _, activity in _results_by_batch(network, spikes)
    ]
    return np.concatenate(scores).astype(np.float64)


def confusion(network: TouchModel, recordings: Recordings) -> IntArray:
    """Return how often each label (row) was predicted as each class (column), (classes, classes + 1).

    The last column counts the ties, recordings that predict no class. Raises ``InputError`` for recordings without
    labels, and for recordings that do not fit the network.
    """
    labels = recordings.needed_labels(purpose="measure with")
    classes = network.description.classes
    predicted = decided(class_scores(network, recordings.spikes), network.tie_class)
    columns = classes + 1
    # A tie is predicted as -1; it goes to the column after those of the classes.
    column = np.where(predicted < 0, classes, predicted)
    # One number for each pair of label and column, so that one count fills the whole matrix.
    pairs = labels * columns + column
    return np.bincount(pairs, minlength=classes * columns).reshape(classes, columns)


@torch.no_grad()
def evaluate(
    network: TouchModel, loss: Loss, spikes: ByteArray, labels: IntArray
) -> tuple[float, float]:
    """Return (mean loss, accuracy) on spikes (samples, steps, channels), in the network's own float type."""
    total_loss = 0.0
    right = 0
    for rows, activity in _results_by_batch(network, spikes):
        scores = network.total(activity)
        # A copy, because torch warns about arrays that are read-only.
        batch_labels = torch.from_numpy(labels[rows].copy()).to(scores.device)
        # The mean of a batch times its size, because the last batch may be smaller.
        total_loss += float(loss(network, activity, batch_labels)) * len(batch_labels)
        predicted = decided(scores.cpu().numpy(), network.tie_class)
        right += int((predicted == labels[rows]).sum())
    return total_loss / len(labels), right / len(labels)


def check_events(recordings: Recordings) -> None:
    """Refuse training recordings if none of them has an event."""
    if not recordings.spikes.any():
        measured = counted(len(recordings), "recording")
        fix = "Give recordings with events."
        if recordings.binned is not None and recordings.binned.dropped > 0:
            # There were events, but binning has left all of them out; the words say how many, and why.
            measured = recordings.binned.words
            fix = "Lower --threshold, or give more --steps."
        raise InputError(
            f"recordings {recordings.source!r}",
            "none of them has an event",
            measured=measured,
            fix=fix,
        )


def data_remarks(recordings: Recordings, classes: int, config: TrainingConfig) -> list[str]:
    """Return the remarks on training recordings: on empty ones, on labels without events, and on uneven labels."""
    labels = recordings.needed_labels(purpose="train on")
    # Recordings of each label, and those of them that have an event.
    counts = np.bincount(labels, minlength=classes)
    with_events = np.bincount(labels[recordings.spikes.any(axis=(1, 2))], minlength=classes)
    return [
        *_empty_remarks(len(labels), int(with_events.sum())),
        *_silent_remarks(recordings, np.flatnonzero((counts > 0) & (with_events == 0)), config),
        *_missing_remarks(counts),
        *_uneven_remarks(recordings, counts, config),
        *_walk_remarks(recordings.spikes.shape[2], config),
        *_single_remarks(counts, config),
    ]


def _empty_remarks(recordings: int, with_events: int) -> list[str]:
    """Return a sentence if some of the recordings have no event."""
    empty = recordings - with_events
    if not empty:
        return []
    have = "has" if empty == 1 else "have"
    return [f"{empty} of {counted(recordings, 'recording')} to train on {have} no event."]


def _silent_remarks(
    recordings: Recordings, silent_labels: IntArray, config: TrainingConfig
) -> list[str]:
    """Return a sentence for each of the first labels without an event in any of their recordings."""
    return [_silent_remark(recordings, int(label), config) for label in silent_labels[:_MOST_NAMED]]


def _missing_remarks(counts: IntArray) -> list[str]:
    """Return a sentence if labels have no recording; ``counts`` (classes,) are the recordings of each."""
    missing = np.flatnonzero(counts == 0)
    if not len(missing):
        return []
    named = ", ".join(map(str, missing[:_MOST_NAMED]))
    if len(missing) > _MOST_NAMED:
        named += f" and {len(missing) - _MOST_NAMED} more"
    largest = len(counts) - 1
    return [f"No recording to train on has label {named}: labels count from 0 to {largest} here."]


def _uneven_remarks(recordings: Recordings, counts: IntArray, config: TrainingConfig) -> list[str]:
    """Return sentences if all recordings have one label, or if some labels have many more recordings than others."""
    remarks = []
    most = int(counts.argmax())
    # The rarest label that occurs: labels without recordings get a count above all others.
    least = int(np.where(counts, counts, counts.sum() + 1).argmin())
    if np.count_nonzero(counts) == 1:
        remarks.append(
            f"All recordings to train on have label {most}: there is nothing to tell apart."
        )
    if counts[most] >= _UNEVEN * counts[least] and config.class_weights == "equal":
        uneven = f"{recordings.called(most)} has {counted(counts[most], 'recording')}"
        uneven += f", {recordings.called(least)} {counts[least]}"
        remarks.append(
            f"Labels are uneven: {uneven}. With balanced class weights, all count equally."
        )
    return remarks


def _single_remarks(counts: IntArray, config: TrainingConfig) -> list[str]:
    """Return a sentence if no label has two recordings, so that there can be no validation."""
    if counts.max() > 1 or config.validation_fraction == 0:
        return []
    what = "Every label has one recording to train on"
    return [f"{what}: none was held back, and the last epoch was taken."]


def _silent_remark(recordings: Recordings, label: int, config: TrainingConfig) -> str:
    """Return the sentence on a label without an event.

    In networks whose outputs are silent without events, such recordings are ties; the sentence then says what that
    means for the label.
    """
    silent = f"No recording of {recordings.called(label)} has an event"
    # The sentence on ties holds unless ties predict a class, or scores differ even without events.
    if config.tie is not None or not _scores_by_spikes_alone(ARCHITECTURES[config.model]):
        return f"{silent}."
    return f"{silent}: all classes tie, so it is never right. With --tie {label}, ties predict it."


def _scores_by_spikes_alone(structure: Architecture) -> bool:
    """Return whether class scores are numbers of output spikes only, so that all are 0 for a recording without events.

    The outputs of windows are potentials, and artificial networks compute theirs, both with biases.
    """
    return structure.spiking and not structure.window_branch


def _walk_remarks(channels: int, config: TrainingConfig) -> list[str]:
    """Return a sentence if a location branch ends before its outputs can spike.

    This cannot happen in ``window-snn``: its outputs are read as potentials, and its walk is followed by steps without
    events, in which the last events still reach them.
    """
    structure = ARCHITECTURES[config.model]
    spikes_over_locations = (
        "location" in structure.branches and structure.window_branch != "location"
    )
    layers = _LAYERS_WITH_GRAPH if structure.graph else _LAYERS
    if not spikes_over_locations or channels > layers:
        return []
    what = f"The location branch walks over {counted(channels, 'channel')}"
    why = f"its outputs spike {layers} channels after an event at the earliest"
    return [f"{what} and says nothing: {why}. Give --model tactile-snn, or window-snn."]


def tie_remarks(confused: IntArray) -> list[str]:
    """Return a sentence on the ties, the last column of a confusion matrix of the test part."""
    ties = int(confused[:, -1].sum())
    if not ties:
        return []
    recordings = counted(int(confused.sum()), "test recording")
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
    labels = recordings.needed_labels(purpose="train on")
    scores = class_scores(network, recordings.spikes)
    predicted = decided(scores, network.tie_class)
    # Decided again, without the class for ties: it would hide that all are ties (-1). With a single class there is
    # nothing to tell apart, as the remarks on the data say.
    if (decided(scores) < 0).all() and scores.shape[1] > 1:
        return [f"{silent_outputs(network, len(labels))}: every prediction is a tie. {advice}"]
    accuracy = float((predicted == labels).mean())
    return chance_remarks(accuracy, labels, "it was trained on")


def silent_outputs(network: TouchModel, recordings: int) -> str:
    """Return the start of a sentence about outputs that are silent in all of so many recordings."""
    what = "All class scores are equal"
    if _scores_by_spikes_alone(network.description.structure):
        what = "No output neuron spikes"
    return f"{what} in any of the {counted(recordings, 'recording')} it was trained on"


def chance_remarks(accuracy: float, labels: IntArray, which: str) -> list[str]:
    """Return a sentence if guessing could easily reach this accuracy; ``which`` says on which recordings it is.

    Chance is the share of the commonest label, with the standard deviation of so many independent guesses.
    """
    chance = float(np.bincount(labels).max() / len(labels))
    deviation = math.sqrt(chance * (1 - chance) / len(labels))
    if chance == 1 or accuracy > chance + _LIKELY * deviation:
        return []
    what = f"Accuracy {accuracy:.3f} on the {counted(len(labels), 'recording')} {which} is not clearly above chance"
    return [f"{what}, {chance:.3f} for the commonest label."]
