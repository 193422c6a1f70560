"""The recordings of a training run: a train part, and a test part that is measured once."""

from pathlib import Path

from locsnn_compile.data.expected import OPEN, Expected
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.training.config import TrainingConfig


def read_parts(
    data: str | Path, config: TrainingConfig, start: Checkpoint | None
) -> tuple[Recordings, Recordings | None]:
    """Return the train part and the test part, of one length: that of the longest recording, or as asked for."""
    model = OPEN
    if start is not None:
        own = start.description.input
        sizes = own.step_seconds, own.event_threshold, own.steps, own.channels
        model = Expected("the network to start from", *sizes, start.description.class_names, **own.sensor.event_options)
    parts = [part for part in ("train", "test") if part in recording_parts(data, test_share=config.split)]
    read = [
        read_recordings(
            data,
            split=part,
            step_seconds=config.step_seconds,
            threshold=config.event_threshold,
            steps=config.steps,
            axes=config.axes,
            sensor=config.sensor,
            test_share=config.split,
            fold=config.fold,
            model=model,
        )
        for part in (parts if "train" in parts else [None])
    ]
    steps = max(part.spikes.shape[1] for part in read)
    recordings, *test = (part.with_steps(steps) for part in read)
    return recordings, test[0] if test else None


def all_classes(recordings: Recordings, test: Recordings | None) -> int | None:
    """Return how many classes the names and labels of both parts show; None without any."""
    parts = [part for part in (recordings, test) if part is not None]
    counts = [len(part.class_names) for part in parts if part.class_names is not None]
    return max(counts + [int(part.labels.max()) + 1 for part in parts if part.labels is not None], default=None)
