"""``lc.train``: from recordings to the checkpoint of ``locsnn train``. torch is imported when it is called.

A run takes a train part, and a test part that is measured once.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hw_model.io.extras import needed
from hw_model.io.given import checked
from hw_model.values import ArrayLike, picked
from locsnn_compile.data.class_names import in_order_of
from locsnn_compile.data.joining import on_one_sensor
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import OPEN, EventTimes, Expected, Recordings, same
from locsnn_compile.data.selection import SELECTING
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.training.chosen import choose
from locsnn_compile.training.config import (
    Progress,
    TrainingConfig,
    config_from_mapping,
    read_config,
)

_OF_FILES = ("classes", "time_unit", "max_steps")
"""Options that say how files are read."""
_PICKING = ("only_taxels", "only_polarity", "merge_channels")
"""Options that pick and merge channels of what is read."""


def read_parts(
    data: str | Path, config: TrainingConfig, start: Checkpoint | None
) -> tuple[Recordings, Recordings | None]:
    """Return the train part and the test part, in one length: that of the longest recording, or as asked for."""
    model = OPEN
    if start is not None:
        own = start.description.input
        sizes = own.step_seconds, own.event_threshold, own.steps, own.channels
        model = Expected(
            "the network to start from",
            *sizes,
            start.description.class_names,
            own.sensor.inputs,
            "yxp",
            event_times=start.event_times or EventTimes(),
            recorded=start.recorded,
        )
    parts = [
        part for part in ("train", "test") if part in recording_parts(data, test_share=config.split)
    ]
    asked = picked(config, "step_seconds", "steps", "axes", "fold", *SELECTING, *_OF_FILES)
    asked["sensor"] = config.recorded
    asked["start"] = config.start_at
    asked |= {"threshold": config.event_threshold, "test_share": config.split, "model": model}
    read = [
        read_recordings(data, split=part, **asked)
        for part in (parts if "train" in parts else [None])
    ]
    read = _alike(read)
    steps = max(part.spikes.shape[1] for part in read)
    recordings, *test = (part.with_steps(steps) for part in read)
    test = [in_order_of(part, recordings.class_names) for part in test]
    return recordings, test[0] if test else None


def _alike(parts: Sequence[Recordings]) -> list[Recordings]:
    """Return the train and the test part in the same channels; ``InputError`` if they have others."""
    train_part, *others = on_one_sensor(parts)
    channels = train_part.spikes.shape[2]
    for part in others:
        what = f"their channels are not those of recordings {train_part.source!r}"
        fix = "Give recordings of one sensor."
        check_same(part.spikes.shape[2], channels, f"recordings {part.source!r}", what, fix=fix)
    return [train_part, *others]


def all_classes(recordings: Recordings, test: Recordings | None) -> int | None:
    """Return the number of classes according to the names and labels of both parts; None without any."""
    parts = [part for part in (recordings, test) if part is not None]
    counts = [len(part.class_names) for part in parts if part.class_names is not None]
    return max(
        counts + [int(part.labels.max()) + 1 for part in parts if part.labels is not None],
        default=None,
    )


def _as_asked(part: Recordings, config: TrainingConfig) -> Recordings:
    """Return recordings in memory in the length asked for; ``InputError`` for options that only a file can follow."""
    theirs = {"step_seconds": part.step_seconds, "event_threshold": part.threshold}
    for name in ("split", "fold", "axes", *_PICKING, *_OF_FILES, *theirs):
        asked, own = getattr(config, name), theirs.get(name)
        if asked is None or (name == "step_seconds" if own is None else same(asked, own)):
            continue
        what, measured = f"recordings {part.source!r} are in memory, as they are", f"got {asked}"
        if own is not None:
            what, measured = "the recordings have another", f"{measured} against {own:g}"
        raise InputError(
            f"training option {name!r}",
            what,
            measured=measured,
            fix="Leave it out, or give a file.",
        )
    return part if config.steps is None else part.with_steps(config.steps)


_log = logging.getLogger("locsnn")


@checked
def train(
    recordings: str | Path | Recordings | ArrayLike,
    config: TrainingConfig | Mapping[str, Any] | str | Path | None = None,
    *,
    labels: ArrayLike | None = None,
    test: Recordings | None = None,
    name: str = "model",
    carried: int = 8,
    progress: Progress | None = None,
) -> Checkpoint:
    """Train a network and return it, to save, to load or to compile.

    - ``recordings``: a file, archive or folder; or :class:`Recordings`; or an array (samples, steps, channels) of 0 and
      1 with ``labels`` (samples,). What is in memory is in the order of these axes, and not divided
    - ``test``: a test part, which is measured once at the end; by default that of the file, if it has one
    - ``config``: training options by name, or a YAML file of them; options that are left out are chosen from the data,
      unless a whole ``TrainingConfig`` is given
    - ``carried``: the number of recordings that go into the checkpoint, for checks
    - ``progress``: called after every epoch with (epochs done, total number as far as known, the epoch's figures)

    Remarks about runs that learned nothing are logged as warnings. Raises ``InputError`` for data and options that
    cannot be used.
    """
    needed("torch", "train", "lc.train")
    from locsnn_compile.training.export import export_checkpoint
    from locsnn_compile.training.train import train as run

    values: Mapping[str, Any] | None = None
    if not isinstance(config, TrainingConfig):
        values = read_config(config) if isinstance(config, str | Path) else config or {}
        config = config_from_mapping(values)
    if isinstance(recordings, str | Path):
        part, of_file = read_parts(recordings, config, None)
        test = test or of_file
    elif isinstance(recordings, Recordings):
        part = _as_asked(recordings, config)
    else:
        known = None if labels is None else np.asarray(labels)
        part = _as_asked(
            Recordings(np.asarray(recordings), known, config.step_seconds, "array"), config
        )
    if test is not None:
        part, test = _alike([part, test])
    test = test.with_steps(config.steps) if test and config.steps else test
    classes, chosen = all_classes(part, test), None
    if values is not None:
        chosen = choose(values, part, classes)
        config = chosen.config
        for line in chosen.lines:
            _log.info(line)
    result = run(part, config, name=name, classes=classes, progress=progress, notice=_log.warning)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.pt"
        export_checkpoint(path, result, config, part, test, carried=carried, chosen=chosen)
        for remark in result.remarks:
            _log.warning(remark)
        return read_checkpoint(path)
