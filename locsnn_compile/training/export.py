"""Write the checkpoint of a trained network: measure it on the test part, once, and record how it was trained."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from hw_model.values import Frozen, IntArray, picked
from locsnn_compile.data.read import stratified_split
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.selection import recorded_entries
from locsnn_compile.errors import counted
from locsnn_compile.models.checkpoint import Checkpoint, Plain
from locsnn_compile.training.chosen import Chosen
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.event_counts import BINS, Baselines, measure_baselines
from locsnn_compile.training.measure import confusion
from locsnn_compile.training.train import TrainingResult


class Comparison(Frozen):
    """The accuracy of a network next to those of counting events, on recordings from which none of them learned.

    - ``part``: ``test``, or ``validation`` if the data have no test part; ``recordings``: their number
    - ``accuracy``: of the network; ``baselines``: of counting events, see :mod:`.event_counts`
    """

    part: str
    recordings: int
    accuracy: float
    baselines: Baselines

    @property
    def words(self) -> str:
        """The line that states the accuracies of the baselines."""
        counts = _figure(self.baselines.counts)
        in_bins = _figure(self.baselines.counts_in_bins)
        on = f"on {counted(self.recordings, 'recording')} of the {self.part} part"
        return f"baselines {on}: counts {counts}, counts in {BINS} bins of time {in_bins}"

    @property
    def lost(self) -> str:
        """A sentence if counting does better; empty otherwise."""
        if self.accuracy >= self.baselines.better:
            return ""
        against = f"{self.accuracy:.3f} against {self.baselines.better:.3f} on the {self.part} part"
        fix = "Give more --epochs, or --model window-snn, whose neurons count."
        return f"Counting events does better than this network ({against}). {fix}"


def _figure(accuracy: float | None) -> str:
    """Return an accuracy in words."""
    return "too large to solve" if accuracy is None else f"{accuracy:.3f}"


def compare_with_counting(
    result: TrainingResult,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None,
    confused: IntArray | None,
) -> Comparison | None:
    """Return the comparison on the test part, or else on the validation part; None if nothing was held out.

    ``confused`` is the confusion matrix of the test part.
    """
    labels = recordings.needed_labels(purpose="train on")
    if test is not None and confused is not None:
        truth = test.needed_labels(purpose="measure with")
        counting = measure_baselines(recordings.spikes, labels, test.spikes, truth)
        return Comparison("test", len(test), accuracy_of(confused, test), counting)
    if result.validation_accuracy is None:
        return None
    # The same split as in training.
    training, validation = stratified_split(labels, config.validation_fraction, config.seed)
    counting = measure_baselines(
        recordings.spikes[training],
        labels[training],
        recordings.spikes[validation],
        labels[validation],
    )
    return Comparison("validation", len(validation), result.validation_accuracy, counting)


class Measured(Frozen, eq=False):
    """What an export measured: the confusion matrix of the test part, None without one, and the comparison."""

    confusion: IntArray | None
    comparison: Comparison | None


def training_entry(
    result: TrainingResult,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None = None,
    confused: IntArray | None = None,
    comparison: Comparison | None = None,
) -> dict[str, Plain]:
    """Return the checkpoint's entry ``training``: the data, the figures of the test, and the whole configuration."""
    counting = None if comparison is None else comparison.baselines
    figures: dict[str, Plain] = {
        "dataset": recordings.source,
        "train_recordings": len(recordings),
        "chosen_epoch": result.chosen_epoch,
        "validation_accuracy": result.validation_accuracy,
        "test_recordings": None if test is None else len(test),
        "test_accuracy": None if test is None or confused is None else accuracy_of(confused, test),
        "test_confusion": None if confused is None else _confusion_text(confused),
        "accuracy_of_counts": None if counting is None else counting.counts,
        "accuracy_of_counts_in_bins": None if counting is None else counting.counts_in_bins,
    }
    return figures | asdict(config) | {"tie": result.network.tie_class}


def _confusion_text(confused: IntArray) -> str:
    """Return the rows of a confusion matrix as text, without the last column, that of ties, if there are no ties."""
    shown = confused if confused[:, -1].any() else confused[:, :-1]
    return "; ".join(" ".join(map(str, row)) for row in shown.tolist())


def accuracy_of(confused: IntArray, test: Recordings) -> float:
    """Return the share of the test recordings that were predicted correctly, by their confusion matrix."""
    return int(np.trace(confused)) / len(test)


def carried_rows(labels: IntArray | None, available: int, most: int) -> IntArray:
    """Return min(most, available) row numbers: equally many of every class, up to a difference of one.

    Classes with too few rows give all of them, and the others share the rest evenly. The rows of a class are spread
    evenly over it.
    """
    if labels is None:
        return spread_rows(available, most)
    rows_of_class = {int(label): np.flatnonzero(labels == label) for label in np.unique(labels)}
    counts = dict.fromkeys(rows_of_class, 0)
    unassigned = min(most, available)
    # Round by round, one row for each class that has rows left; in the last round, for some of them.
    while unassigned:
        open_classes = [label for label, rows in rows_of_class.items() if counts[label] < len(rows)]
        for i in spread_rows(len(open_classes), unassigned):
            counts[open_classes[i]] += 1
            unassigned -= 1
    chosen = [rows[spread_rows(len(rows), counts[label])] for label, rows in rows_of_class.items()]
    return np.sort(np.concatenate(chosen))


def spread_rows(available: int, most: int) -> IntArray:
    """Return min(most, available) row numbers, evenly spread from 0 on."""
    count = min(most, available)
    return np.arange(count, dtype=np.int64) * available // max(count, 1)


def export_checkpoint(  # noqa: PLR0913 - what earlier steps made, each used once
    path: Path,
    result: TrainingResult,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None,
    *,
    carried: int = 8,
    start: Checkpoint | None = None,
    chosen: Chosen | None = None,
) -> Measured:
    """Measure ``test`` once, write the checkpoint to ``path``, and return what was measured.

    ``start`` is the checkpoint that the run began with; ``chosen``: what was chosen from the data. The file gets
    ``carried`` recordings for checks, spread over the classes, from the test part or, without one, from the train part.
    """
    network = result.network
    weights = dict(network.stored_weights())
    # Measured in float64, like the compiler's reference; double() changes the network itself, so the
    # weights to store were taken before.
    confused = None if test is None else confusion(network.double(), test)
    comparison = compare_with_counting(result, config, recordings, test, confused)
    pool = recordings if test is None else test
    carried_recordings = None
    if carried > 0:
        carried_recordings = pool.subset(carried_rows(pool.labels, len(pool), carried))
    training = training_entry(result, config, recordings, test, confused, comparison)
    if recordings.recorded is not None:
        training |= recorded_entries(recordings.recorded)
    if chosen is not None and chosen.reasons:
        training |= {"chosen": chosen.text}
    if start is not None:
        training |= {"start": start.description.name, "start_sha256": start.sha256}
    numbers = picked(network, "chip", "xylo")
    checkpoint = Checkpoint(
        network.description, weights, recordings=carried_recordings, training=training, **numbers
    )
    checkpoint.save(path)
    return Measured(confused, comparison)
