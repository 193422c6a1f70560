"""From a trained network to a checkpoint: measure the test part once, and record how the network was trained."""

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
    """The accuracy of a network next to those of counting events, on recordings that none of them learned from.

    ``part`` is that of the ``recordings`` (a number): ``test``, or ``validation`` where the data have no test part.
    """

    part: str
    recordings: int
    accuracy: float
    baselines: Baselines

    @property
    def words(self) -> str:
        """The line that gives the baselines."""
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
    return "too large to solve" if accuracy is None else f"{accuracy:.3f}"


def compare_with_counting(
    result: TrainingResult,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None,
    confused: IntArray | None,
) -> Comparison | None:
    """Return the comparison on the test part, else on the validation part; None if nothing was held out."""
    labels = recordings.needed_labels("train on")
    if test is not None and confused is not None:
        truth = test.needed_labels("measure with")
        counting = measure_baselines(recordings.spikes, labels, test.spikes, truth)
        return Comparison("test", len(test), accuracy_of(confused, test), counting)
    if result.validation_accuracy is None:
        return None
    training, held = stratified_split(labels, config.validation_fraction, config.seed)
    counting = measure_baselines(
        recordings.spikes[training], labels[training], recordings.spikes[held], labels[held]
    )
    return Comparison("validation", len(held), result.validation_accuracy, counting)


class Measured(Frozen, eq=False):
    """What an export measured: the confusion of the test part, None without one, and the comparison with counting."""

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
    """Return the checkpoint's ``training`` entry: data, figures and confusion of the test, the whole configuration."""
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
    """Return the rows of a confusion matrix; without its column of ties where there is none."""
    shown = confused if confused[:, -1].any() else confused[:, :-1]
    return "; ".join(" ".join(map(str, row)) for row in shown.tolist())


def accuracy_of(confused: IntArray, test: Recordings) -> float:
    """Return the share of recordings that a confusion matrix has as predicted correctly."""
    return int(np.trace(confused)) / len(test)


def carried_rows(labels: IntArray | None, available: int, wanted: int) -> IntArray:
    """Return min(wanted, available) row numbers: equally many of every class, up to a difference of one.

    Classes with too few rows give all of them, and the others share the rest evenly. Rows are spread evenly over each
    class.
    """
    if labels is None:
        return spread_rows(available, wanted)
    rows = {int(label): np.flatnonzero(labels == label) for label in np.unique(labels)}
    take, left = dict.fromkeys(rows, 0), min(wanted, available)
    while left:
        open_classes = [label for label in rows if take[label] < len(rows[label])]
        for i in spread_rows(len(open_classes), left):
            take[open_classes[i]] += 1
            left -= 1
    return np.sort(
        np.concatenate([own[spread_rows(len(own), take[label])] for label, own in rows.items()])
    )


def spread_rows(available: int, wanted: int) -> IntArray:
    """Return min(wanted, available) row numbers, evenly spread."""
    count = min(wanted, available)
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
    # In float64, like the compiler's reference; the network stays in float64.
    confused = None if test is None else confusion(network.double(), test)
    comparison = compare_with_counting(result, config, recordings, test, confused)
    pool = recordings if test is None else test
    kept = pool.subset(carried_rows(pool.labels, len(pool), carried)) if carried > 0 else None
    training = training_entry(result, config, recordings, test, confused, comparison)
    if recordings.recorded is not None:
        training |= recorded_entries(recordings.recorded)
    if chosen is not None and chosen.reasons:
        training |= {"chosen": chosen.text}
    if start is not None:
        training |= {"start": start.description.name, "start_sha256": start.sha256}
    numbers = picked(network, "chip", "xylo")
    Checkpoint(network.description, weights, kept, training, **numbers).save(path)
    return Measured(confused, comparison)
