"""``lc.train``, the Python function behind the command ``locsnn train``: from recordings to a checkpoint.

A run learns from the train part of the recordings, and measures the test part once. torch is imported only when the
function is called. The command uses the functions for reading parts as well.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hw_model.io.arguments import checked
from hw_model.io.extras import needed
from hw_model.values import ArrayLike, picked
from locsnn_compile.data.class_names import in_order_of
from locsnn_compile.data.joining import on_one_sensor
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import (
    OPEN,
    EventTimes,
    Expected,
    Recordings,
    same_within_rounding,
)
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
_ONLY_OF_FILES = ("split", "fold", "axes", *SELECTING, *_OF_FILES)
"""Options that only apply to recordings in files, not to recordings in memory."""


def read_parts(
    data: str | Path, config: TrainingConfig, start: Checkpoint | None
) -> tuple[Recordings, Recordings | None]:
    """Return (train part, test part or None), both in one length: that of the longest recording, or the option's.

    Data without a train part are all used for training, and have no test part. ``start`` is the network to start from,
    whose input the recordings must fit. Raises ``InputError`` for data that cannot be read or used.
    """
    options = picked(config, "step_seconds", "steps", "axes", "fold", *SELECTING, *_OF_FILES)
    options["sensor"] = config.recorded
    options["start"] = config.start_at
    options["threshold"] = config.event_threshold
    options["test_share"] = config.split
    options["model"] = OPEN if start is None else _expected_by(start)
    parts = [
        read_recordings(data, split=name, **options) for name in _parts_to_read(data, config.split)
    ]
    parts = _in_same_channels(parts)
    steps = max(part.spikes.shape[1] for part in parts)
    parts = [part.with_steps(steps) for part in parts]
    train_part = parts[0]
    if len(parts) == 1:
        return train_part, None
    return train_part, in_order_of(parts[1], train_part.class_names)


def _expected_by(start: Checkpoint) -> Expected:
    """Return what the network to start from expects of recordings."""
    layout = start.description.input
    return Expected(
        "the network to start from",
        step_seconds=layout.step_seconds,
        threshold=layout.event_threshold,
        steps=layout.steps,
        channels=layout.channels,
        class_names=start.description.class_names,
        inputs=layout.sensor.inputs,
        numbering="yxp",
        event_times=start.event_times or EventTimes(),
        recorded=start.recorded,
    )


def _parts_to_read(data: str | Path, test_share: float | None) -> list[str | None]:
    """Return the parts of the data, the train part first; None stands for data that are not in parts."""
    parts = recording_parts(data, test_share=test_share)
    if "train" not in parts:
        return [None]
    return [part for part in ("train", "test") if part in parts]


def _in_same_channels(parts: Sequence[Recordings]) -> list[Recordings]:
    """Return the train and the test part with the same channels; ``InputError`` if their sensors differ."""
    train_part, *further_parts = on_one_sensor(parts)
    channels = train_part.spikes.shape[2]
    for part in further_parts:
        what = f"their channels are not those of recordings {train_part.source!r}"
        fix = "Give recordings of one sensor."
        check_same(part.spikes.shape[2], channels, f"recordings {part.source!r}", what, fix=fix)
    return [train_part, *further_parts]


def all_classes(recordings: Recordings, test: Recordings | None) -> int | None:
    """Return the number of classes according to the names and labels of both parts; None without any."""
    parts = [part for part in (recordings, test) if part is not None]
    by_names = [len(part.class_names) for part in parts if part.class_names is not None]
    by_labels = [int(part.labels.max()) + 1 for part in parts if part.labels is not None]
    return max([*by_names, *by_labels], default=None)


def _adapted_to_options(part: Recordings, config: TrainingConfig) -> Recordings:
    """Return recordings in memory, padded or cut to the option ``steps``.

    Raises ``InputError`` for options that only apply to files, and for options that contradict the recordings.
    """
    for name, value in picked(config, *_ONLY_OF_FILES).items():
        # Compared by identity: only_polarity 0 is an option that was given, and equals False.
        if value is not None and value is not False:
            raise _needs_file(part, name, value)
    # If recordings do not say how wide their bins are, the option says it, and nothing is to be checked.
    if part.step_seconds is not None:
        _check_binned_so("step_seconds", config.step_seconds, part.step_seconds)
    if part.threshold is not None:
        _check_binned_so("event_threshold", config.event_threshold, part.threshold)
    elif config.event_threshold is not None:
        raise _needs_file(part, "event_threshold", config.event_threshold)
    return part if config.steps is None else part.with_steps(config.steps)


def _check_binned_so(option: str, option_value: float | None, stored_value: float) -> None:
    """Refuse an option, if given, that is not the value with which the recordings were binned."""
    if option_value is not None and not same_within_rounding(option_value, stored_value):
        measured = f"got {option_value} against {stored_value:g}"
        raise _unfit_option(option, "the recordings have another", measured)


def _needs_file(part: Recordings, option: str, value: object) -> InputError:
    """Return the error for an option that only applies to files."""
    what = f"recordings {part.source!r} are in memory, as they are"
    return _unfit_option(option, what, f"got {value}")


def _unfit_option(option: str, what: str, measured: str) -> InputError:
    """Return the error for an option that does not fit recordings in memory."""
    fix = "Leave it out, or give a file."
    return InputError(f"training option {option!r}", what, measured=measured, fix=fix)


def _recordings_of(
    recordings: Recordings | ArrayLike, labels: ArrayLike | None, step_seconds: float | None
) -> Recordings:
    """Return ``recordings``, or those of an array and its labels, with bins of the width ``step_seconds``."""
    if isinstance(recordings, Recordings):
        return recordings
    label_array = None if labels is None else np.asarray(labels)
    return Recordings(np.asarray(recordings), label_array, step_seconds, source="array")


_log = logging.getLogger("locsnn")


@checked
def train(  # noqa: PLR0913 - public: each is an option of its own
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
    needed(package="torch", extra="train", where="lc.train")
    from locsnn_compile.training.export import export_checkpoint
    from locsnn_compile.training.train import train as run

    values: Mapping[str, Any] | None = None
    if not isinstance(config, TrainingConfig):
        values = read_config(config) if isinstance(config, str | Path) else config or {}
        config = config_from_mapping(values)
    if isinstance(recordings, str | Path):
        train_part, test_of_file = read_parts(recordings, config, start=None)
        test = test or test_of_file
    else:
        train_part = _adapted_to_options(
            _recordings_of(recordings, labels, config.step_seconds), config
        )
    if test is not None:
        train_part, test = _in_same_channels([train_part, test])
        if config.steps:
            test = test.with_steps(config.steps)
    classes = all_classes(train_part, test)
    # A whole TrainingConfig is taken as it is; of other options, those left out are chosen.
    chosen = None
    if values is not None:
        chosen = choose(values, train_part, classes)
        config = chosen.config
        for line in chosen.lines:
            _log.info(line)
    result = run(
        train_part, config, name=name, classes=classes, progress=progress, notice=_log.warning
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.pt"
        export_checkpoint(path, result, config, train_part, test, carried=carried, chosen=chosen)
        for remark in result.remarks:
            _log.warning(remark)
        return read_checkpoint(path)
