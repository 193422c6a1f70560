"""From a trained network to a checkpoint: measure the test part once, and record how the network was trained."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from hw_model.values import AnyArray, IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint import Checkpoint, Plain
from locsnn_compile.training.config import TrainingConfig
from locsnn_compile.training.measure import confusion
from locsnn_compile.training.train import TrainingResult


def training_entry(
    result: TrainingResult,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None = None,
    found: IntArray | None = None,
) -> dict[str, Plain]:
    """Return the checkpoint's ``training`` entry: data, figures and confusion of the test, the whole configuration."""
    figures: dict[str, Plain] = {
        "dataset": recordings.source,
        "train_recordings": len(recordings),
        "chosen_epoch": result.chosen_epoch,
        "validation_accuracy": result.validation_accuracy,
        "test_recordings": None if test is None else len(test),
        "test_accuracy": None if test is None or found is None else accuracy_of(found, test),
        "test_confusion": None if found is None else _confusion_text(found),
    }
    return figures | asdict(config) | {"tie": result.network.tie_class}


def _confusion_text(confused: IntArray) -> str:
    """Return the rows of a confusion matrix; without its column of ties where there is none."""
    shown = confused if confused[:, -1].any() else confused[:, :-1]
    return "; ".join(" ".join(map(str, row)) for row in shown.tolist())


def accuracy_of(found: IntArray, test: Recordings) -> float:
    """Return the share of recordings that a confusion matrix has as predicted correctly."""
    return int(np.trace(found)) / len(test)


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


def export_checkpoint(
    path: Path,
    result: TrainingResult,
    config: TrainingConfig,
    recordings: Recordings,
    test: Recordings | None,
    *,
    carried: int = 8,
    start: Checkpoint | None = None,
) -> IntArray | None:
    """Measure ``test`` once, write the checkpoint to ``path``, and return the confusion; None without a test part.

    ``start`` is the checkpoint that the run began with. The file gets ``carried`` recordings for checks, spread over
    the classes, from the test part or, without one, from the train part.
    """
    network = result.network
    weights: dict[str, AnyArray] = {
        **(network.weights() if network.chip is None else network.mantissas())
    }
    # In float64, like the compiler's reference; the network stays in float64.
    found = None if test is None else confusion(network.double(), test)
    pool = recordings if test is None else test
    kept = pool.subset(carried_rows(pool.labels, len(pool), carried)) if carried > 0 else None
    training = training_entry(result, config, recordings, test, found)
    if start is not None:
        training |= {"start": start.description.name, "start_sha256": start.sha256}
    Checkpoint(network.description, weights, kept, training, chip=network.chip).save(path)
    return found
