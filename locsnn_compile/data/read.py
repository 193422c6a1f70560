"""Read recordings of any supported format, and divide them into train and test parts.

:func:`read_recordings` is what commands and Python users call. It chooses a reader by the kind of
the path, and then adapts the result to the options and to the model that will take the recordings.

Recordings whose files have no parts are divided in one of two ways: by a share of each class, or by
lists of rows next to the file. VT_SNN's preprocessed sets have such lists. They are a ``tact.pt`` of
(samples, 78 cells, 2 polarities, steps), and next to it lie, for each of five rounds k of
cross-validation, ``train_80_20_<k>.txt`` and ``test_80_20_<k>.txt``, with the number and the class
of one recording per line.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.io.arguments import checked
from hw_model.io.files import near, read_bytes
from hw_model.mapping.recorded import ChannelSelection, RecordedChannels
from hw_model.values import Frozen, IntArray
from locsnn_compile.data.archives import archive_parts, is_archive, read_archive
from locsnn_compile.data.arrays import labels_beside, read_arrays
from locsnn_compile.data.axes import check_axes, is_one, parse_axes
from locsnn_compile.data.class_names import in_order_of, parse_classes, with_classes
from locsnn_compile.data.event_stream import Binning
from locsnn_compile.data.formats import event_format, read_suffixes
from locsnn_compile.data.joining import described, join_channels, merged
from locsnn_compile.data.members import PARTS
from locsnn_compile.data.recordings import MAX_ELEMENTS, MAX_STEPS, OPEN, Expected, Recordings
from locsnn_compile.data.selection import selected, selected_count
from locsnn_compile.data.sensor import POLARITIES, SensorLayout, asked_layout
from locsnn_compile.data.sets import holds_sets, read_sets
from locsnn_compile.errors import InputError, check_known, check_range

PREPROCESSED = "tact.pt"
"""The name of VT_SNN's preprocessed file."""
_ROWS = re.compile(r"train_80_20_(\d{1,3})\.txt")
"""The name of a list of the training recordings of a round."""


class Division(Frozen):
    """How recordings are divided into a train and a test part.

    - ``share``: the fraction of every class that goes to the test part. Without it, the lists of rows
      next to the recordings divide them, if there are any.
    - ``fold``: the round of cross-validation, from 1

    Each round tests on different recordings: with a share of 0.2, every recording is in the test part
    of one of five rounds. If a class has fewer recordings than there are rounds, but two at least,
    each round tests on one of them.
    """

    share: float | None = None
    fold: int | None = None

    def divides(self, path: Path) -> bool:
        """Return whether it divides the recordings at ``path``.

        Raises ``InputError`` if these have parts already and options ask for a division.
        """
        option = "fold" if self.share is None else "split"
        is_asked_for = self.share is not None or self.fold is not None
        rounds = _rounds(path)
        # Looking for parts opens the archive, so it is done only if an option could contradict them.
        parts = archive_parts(path) if is_asked_for else ()
        if parts or (rounds and self.share is not None):
            measured = f"into {', '.join(parts)}" if parts else "into rounds"
            raise InputError(
                option, f"{path.name!r} is divided already", measured=measured, fix="Leave it out."
            )
        return is_asked_for or bool(rounds)

    def part(self, recordings: Recordings, path: Path, part: str) -> Recordings:
        """Return the train or test part of the recordings at ``path``; ``InputError`` if there is none."""
        rounds = range(1, _rounds_of(self.share) + 1) if self.share else _rounds(path)
        # Without --fold, the first round; if there is no round at all, this raises.
        fold = 1 if self.fold is None else self.fold
        if fold not in rounds:
            measured = f"got {fold} against {', '.join(map(str, rounds)) or 'none'}"
            fix = "Choose one of them."
            if not rounds:
                fix = "Add --split with the share of every class to test on."
            raise InputError("fold", f"{path.name!r} has no such round", measured=measured, fix=fix)
        part_number = PARTS.index(part)
        if self.share is None:
            rows_and_labels = _rows_of_files(path, fold, len(recordings))[part_number]
            rows, labels = rows_and_labels.T
            words = f"round {fold} of {len(rounds)}"
        else:
            all_labels = recordings.needed_labels(purpose="divide them by")
            rows = stratified_split(all_labels, self.share, seed=0, fold=fold)[part_number]
            labels = all_labels[rows]
            words = f"split {self.share:g}, round {fold}"
        source = f"{path.name}, {part} part ({words})"
        return replace(recordings.subset(rows), labels=labels, source=source)

    def __post_init__(self) -> None:
        if self.share is not None:
            check_range(self.share, low=0.001, high=0.9, where="split")


def _rounds_of(share: float) -> int:
    """Return how many rounds can each test on a different ``share`` of the recordings."""
    # A share such as 0.2 is a rounded float, whose inverse may lie just below a whole number.
    return int(1 / share + 1e-9)


def stratified_split(
    labels: IntArray, fraction: float, seed: int, fold: int = 1
) -> tuple[IntArray, IntArray]:
    """Return sorted indices (kept, held out): ``fraction`` of each class is held out, rounded.

    If ``fraction`` is above 0, at least one recording of a class of two or more is held out, and at
    least one is kept. ``fold`` counts from 1 to 1 / fraction, rounded down; every fold holds out
    other recordings:

    - Fold 1 holds out the same recordings as a single split without folds would.
    - Folds from 2 on share evenly what fold 1 has left of the recordings that all folds together
      hold out (about ``fraction * folds`` of the class, which is all of it for 1/2, 1/5, ...).
    - In a class of fewer recordings than folds, the recordings take turns, and begin again at the
      first once all were held out.

    Equal arguments give equal draws on every machine.
    """
    # PCG64 is named because numpy may change its default generator.
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 0])))
    folds = 1 if fold == 1 else _rounds_of(fraction)
    held_out: list[IntArray] = [np.zeros(0, dtype=np.int64)]
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        count = round(fraction * len(members))
        if fraction > 0 and len(members) >= 2:
            # Neither part may lack a class that has enough recordings for both.
            count = min(max(count, 1), len(members) - 1)
        drawn = rng.permutation(members)
        if len(members) < folds:
            held_out.append(np.roll(drawn, -(fold - 1) * count)[:count])
        elif fold == 1:
            held_out.append(drawn[:count])
        else:
            # Rounding makes the counts of folds differ by one: begin and end are the rounded ends of
            # equal shares, so that no recording is in two folds and none between two is left out.
            in_all_folds = max(folds, round(fraction * folds * len(members)))
            in_later_folds = in_all_folds - count
            begin = count + in_later_folds * (fold - 2) // (folds - 1)
            end = count + in_later_folds * (fold - 1) // (folds - 1)
            held_out.append(drawn[begin:end])
    chosen = np.sort(np.concatenate(held_out))
    return np.setdiff1d(np.arange(len(labels)), chosen), chosen


def _rounds(path: Path) -> list[int]:
    """Return the rounds for which there are files next to a ``tact.pt``."""
    files = path.parent.glob("train_80_20_*.txt") if path.name == PREPROCESSED else ()
    return sorted(
        int(match[1]) for match in (_ROWS.fullmatch(file.name) for file in files) if match
    )


def _rows_of_files(path: Path, fold: int, samples: int) -> list[IntArray]:
    """Return an array (rows, 2) for the train and for the test part of a round.

    Its columns are the number of a recording and its class; no number occurs twice in a round.
    Raises ``InputError`` for a list that is missing, is not two numbers per line, or names a
    recording twice or one that does not exist.
    """
    fix = "Write the number of a recording and its class on every line."
    taken: set[int] = set()
    parts = []
    for part in PARTS:
        file = path.with_name(f"{part}_80_20_{fold}.txt")
        where = f"file {file.name!r}"
        if not file.exists():
            raise InputError(
                where, "it does not exist, but the file of the other part does", fix="Give both."
            )
        try:
            rows = [
                [int(word) for word in line.split()]
                for line in read_bytes(file, where).splitlines()
            ]
        except ValueError:
            rows = []
        if not rows or {len(row) for row in rows} != {2}:
            raise InputError(where, "it does not hold two whole numbers per line", fix=fix)
        for number, _ in rows:
            if number in taken or not 0 <= number < samples:
                what = "in the round twice" if number in taken else "not there"
                raise InputError(
                    where,
                    f"recording {str(number)[:20]} is {what}",
                    measured=f"of {samples}",
                    fix=fix,
                )
            taken.add(number)
        parts.append(np.array(rows))
    return parts


@checked
def read_recordings(  # noqa: C901, PLR0913 - public: each is an option of its own, checked alone
    path: Path | str,
    *,
    split: str | None = None,
    step_seconds: float | None = None,
    threshold: int | None = None,
    channels: int | None = None,
    steps: int | None = None,
    polarities: int | None = None,
    columns: int | None = None,
    axes: str | None = None,
    grid: str | None = None,
    sensor: SensorLayout | None = None,
    merge_polarities: bool | None = None,
    only_taxels: str | None = None,
    only_polarity: int | None = None,
    merge_channels: int | None = None,
    test_share: float | None = None,
    fold: int | None = None,
    classes: str | None = None,
    start: float | str | None = None,
    time_unit: str | None = None,
    max_steps: int | None = None,
    model: Expected = OPEN,
) -> Recordings:
    """Return the recordings at ``path``, in any supported format, for a ``model`` in the numbering of its inputs.

    ``path`` is a ``.zip`` or folder with one recording per file (``.npy`` or events), one such file, or a ``.npz``,
    ``.pt`` or HDF5 file, or a folder or ``.zip`` of these.

    - ``split``: ``train`` or ``test`` of an archive or folder that has these parts (None: ``test``). Recordings without
      parts are divided by ``test_share`` and ``fold``: see :class:`locsnn_compile.data.read.Division`.
    - Events are put into bins as :class:`locsnn_compile.data.event_stream.Binning` describes, according to the options
      and to what ``model`` expects. Arrays hold bins already: (samples, channels, steps), unless ``axes`` or the file
      names another order, such as ``samples,steps,channels``. ``step_seconds`` is their width if the file does not
      give it.
    - ``steps``: shorter recordings are padded with silence, longer ones are cut. Without it, all recordings of an
      archive or folder get the length of the longest.
    - ``start``: the seconds at which step 0 of events begins, or ``first``: at the first event of each recording. None:
      as in the training of ``model``, or as the format has it, or else at the first event. ``time_unit`` of fields
      ``t``, of tables and in HDF5: ns, us, ms or s, by default that of the training. ``max_steps``: longer recordings
      of events are refused, unless ``steps`` is given.
    - ``classes``: the names of classes from class 0 on, separated by commas. Without it, class names have the order of
      ``model``, or of the file, or else a known one: numbers, number words, or by name.
    - The sensor: ``sensor``, or ``grid`` (columns x rows, such as ``34x34``), or ``channels`` with ``columns`` if they
      are those of a grid, and ``polarities``, those that the sensor has. Other channels are refused.
    - ``merge_polarities``: events and bins of both polarities of a pixel become one channel. ``only_taxels``,
      ``only_polarity`` and ``merge_channels`` pick and merge channels: see
      :class:`hw_model.mapping.recorded.ChannelSelection`. Without any of them, recordings of the sensor on which
      ``model`` was trained are read as its training read them.

    Raises ``InputError`` for anything that cannot be used, and for an option that contradicts the model or the file.
    """
    path = _file_of(Path(path))
    division = Division(test_share, fold)
    class_names = None if classes is None else parse_classes(classes)
    if grid is not None:
        sensor = asked_layout(grid, polarities, channels, layout=None)
    # Options that make sense for single events only. For bins, polarities and columns are meaningful
    # as well, but only together with the channels (or sensor) that they describe: see below.
    of_events = {"threshold": threshold, "start": start, "time_unit": time_unit}
    counts = of_events | {"polarities": polarities, "columns": columns}
    selection = ChannelSelection(only_taxels, only_polarity, bool(merge_polarities), merge_channels)
    trained = _as_trained(selection, sensor, model)
    if trained is not None:
        selection = trained.selection
        sensor = sensor or _sensor_of(trained)
    if sensor is not None:
        channels, polarities, columns = sensor.channels, sensor.polarities, sensor.columns
    if channels is not None:
        counts = of_events
    merge = selection.merge_polarities
    if merge and channels is not None and polarities is None:
        # Polarities to be merged are two, if only the number of channels is given.
        polarities = 2
    order = None if axes is None else parse_axes(axes, "axes")
    binning_options = Binning(
        step_seconds=step_seconds,
        threshold=threshold,
        channels=channels,
        steps=steps,
        polarities=polarities,
        columns=columns,
        axes=order,
        start=start,
        time_unit=time_unit,  # type: ignore[arg-type]  # checked in the next line
        max_steps=MAX_STEPS if max_steps is None else max_steps,
    )
    binning_options.check()
    check_known("split", f"{split!r} is not known", split, PARTS)
    binning = _binning_for(model, binning_options, selection)
    if sensor is not None:
        _check_sensor(sensor, model, selection)
    elif selection == ChannelSelection():
        # A selection changes the number of channels, so only without one must both numbers agree.
        model.agreed(channels=channels)
    divided = division.divides(path)
    recordings = _read(path, None if divided else split, binning, step_seconds)
    if class_names is not None:
        recordings = with_classes(recordings, class_names)
    elif is_archive(path) and not holds_sets(path):
        # Folders name their classes in no order of their own.
        recordings = in_order_of(recordings, model.class_names)
    if divided:
        recordings = division.part(recordings, path, split or "test")
    if recordings.threshold is None:
        _refuse_options_of_events(recordings, counts)
    # Bins that were saved after the training's selection have the channels of the model already:
    # they are not selected a second time.
    if trained is None or not _has_inputs_of(model, recordings):
        if channels is not None and (recordings.threshold is None or recordings.channels is None):
            recordings = described(recordings, sensor or _layout(binning_options))
        if merge:
            recordings = merged(recordings)
        recordings = selected(recordings, selection, polarities or POLARITIES)
        if trained is not None:
            recordings = recordings.assuming(_as_in_training(trained))
    model.check(recordings)
    recordings = join_channels(recordings, model)
    return recordings if steps is None else recordings.with_steps(steps)


def _binning_for(model: Expected, options: Binning, selection: ChannelSelection) -> Binning:
    """Return the binning that ``options`` ask for, completed by what a model expects where they leave it open.

    Raises ``InputError`` for an option that contradicts the model.
    """
    agreed = model.agreed(
        step_seconds=options.step_seconds, threshold=options.threshold, steps=options.steps
    )
    # Events are read in the channels of the whole sensor, and only then picked and merged. So while
    # they are read, the model's number of channels says nothing about them.
    read_for = model
    if not selection.merges_polarities_at_most:
        read_for = replace(model, channels=None, inputs=None)
    merge = selection.merge_polarities
    return replace(
        options,
        step_seconds=agreed["step_seconds"],
        threshold=agreed["threshold"],
        channels=_channels_of_events(options, read_for, merge=merge),
        most_steps=model.steps,
        model_channels=read_for.channels,
        model_inputs=read_for.inputs,
        merge_polarities=merge,
        usual_step_seconds=model.usual_step_seconds,
        usual_times=model.event_times,
    )


def _refuse_options_of_events(recordings: Recordings, options: Mapping[str, object]) -> None:
    """Refuse options, by name, that describe single events, as these recordings are bins already."""
    for name, value in options.items():
        if value is not None:
            what = f"{recordings.source!r} holds bins, not single events to count"
            raise InputError(name, what, fix="Leave it out.")


def _as_trained(
    selection: ChannelSelection, sensor: SensorLayout | None, model: Expected
) -> RecordedChannels | None:
    """Return how the training of ``model`` read its sensor, if the options do not ask for another way.

    None if they do, or if the training read all channels of its sensor. Also None if ``sensor`` has
    as many channels as the model: it then describes channels that were picked and merged already.
    """
    recorded = model.recorded
    if recorded is None or selection not in (ChannelSelection(), recorded.selection):
        return None
    if sensor is not None and sensor.channels == model.channels:
        return None
    return recorded


def _sensor_of(recorded: RecordedChannels) -> SensorLayout:
    """Return the layout of a sensor of which the number of taxels is known."""
    taxels = recorded.columns * recorded.rows
    columns = recorded.columns if recorded.rows > 1 else None
    return SensorLayout("of the training", taxels, recorded.polarities, columns=columns)


def _has_inputs_of(model: Expected, recordings: Recordings) -> bool:
    """Return whether recordings from files of bins have as many channels as a model."""
    return recordings.threshold is None and recordings.spikes.shape[2] == model.channels


def _as_in_training(recorded: RecordedChannels) -> str:
    """Return the sentence that says how channels were picked and merged."""
    return f"Channels were read as in the training ({recorded.selection.options})."


def _check_sensor(sensor: SensorLayout, model: Expected, selection: ChannelSelection) -> None:
    """Refuse a sensor of which the selection leaves another number of channels than the model has."""
    channels = selected_count(sensor.channels, sensor.polarities, selection)
    if model.channels is not None and channels != model.channels:
        what, measured = f"{model.whose} has other channels", f"{channels} against {model.channels}"
        fix = "Describe the sensor that it was made for."
        raise InputError(f"sensor {sensor.name!r}", what, measured=measured, fix=fix)


def _channels_of_events(binning: Binning, model: Expected, *, merge: bool) -> int | None:
    """Return how many channels the events of each recording are binned into; None if they decide it.

    That is the number asked for, or the number that a model without a grid has. A model with a grid
    does not decide it: events keep their own extent, and are placed in the grid later.
    """
    if binning.channels is None:
        flat = model.inputs is None or not model.inputs.is_grid
        return model.channels if flat else None
    return binning.channels // (binning.polarities or 2) if merge else binning.channels


def _layout(binning: Binning) -> SensorLayout:
    """Return the sensor described by the numbers of channels, polarities and columns that were asked for."""
    layout = asked_layout(
        grid=None,
        polarities=binning.polarities,
        channels=binning.channels,
        layout=None,
        columns=binning.columns,
    )
    assert layout is not None  # it has channels
    return layout


def _read(
    path: Path, split: str | None, binning: Binning, asked_seconds: float | None
) -> Recordings:
    """Return the recordings at ``path`` by the reader of its kind, before anything is selected.

    ``asked_seconds`` is the width of a bin that an option asks for; that in ``binning`` may also be
    the model's, from which files of bins may differ.
    """
    _check_file(path)
    if split is not None and not is_archive(path):
        measured, fix = "a single file is not divided", "Leave the part out."
        raise InputError(
            f"file {path.name!r}", f"there is no part {split!r}", measured=measured, fix=fix
        )
    if is_archive(path) and holds_sets(path):
        return read_sets(path, split=split, binning=binning, asked_seconds=asked_seconds)
    if is_archive(path) or event_format(path.suffix):
        return read_archive(path, split=split, binning=binning)
    return read_arrays(path, binning, asked_seconds)


@checked
def recording_parts(path: Path | str, *, test_share: float | None = None) -> tuple[str, ...]:
    """Return which of the parts ``train`` and ``test`` the recordings at ``path`` have, or get from ``test_share``."""
    path = _file_of(Path(path))
    if Division(test_share).divides(path):
        return PARTS
    _check_file(path)
    return archive_parts(path)


def _file_of(path: Path) -> Path:
    """Return the file inside a folder of preprocessed recordings; any other path as it is."""
    return path / PREPROCESSED if (path / PREPROCESSED).is_file() else path


def _check_file(path: Path) -> None:
    if is_archive(path):
        return
    if not path.exists():
        raise InputError(
            f"file {path.name!r}", "it does not exist", fix=near(path, "Check the path.")
        )
    if path.suffix not in read_suffixes():
        fix = f"Give one of: {', '.join(read_suffixes())}, or a folder."
        raise InputError(
            f"file {path.name!r}",
            "its kind is not known",
            measured=f"ending {path.suffix!r}",
            fix=fix,
        )


def read_in_chunks(
    path: str, many: int, *, model: Expected, **options: Any
) -> Iterator[Recordings]:
    """Yield what :func:`read_recordings` returns, but ``many`` recordings at a time where possible.

    It is possible for a ``.npy`` file of bins that no option changes. Other files are read at once,
    because their longest recording decides the length of all. A faulty recording raises its
    ``InputError`` only when its chunk is read.
    """
    as_they_are = {*options.values()} == {None} and model.recorded is None
    chunks = _chunks(Path(path), many, model) if as_they_are else None
    return iter([read_recordings(path, model=model, **options)]) if chunks is None else chunks


def _chunks(path: Path, many: int, model: Expected) -> Iterator[Recordings] | None:
    """Return an iterator over chunks of ``many`` recordings of a ``.npy`` file of bins.

    None for any other file, and for one that is faulty: :func:`read_recordings` then reads it, or
    raises the error that names the fault.
    """
    try:
        mapped = np.load(path, mmap_mode="r")
        shape, dtype, begin = mapped.shape, mapped.dtype, mapped.offset
    # numpy's parser raises many kinds of exception on a damaged header.
    except Exception:
        return None
    is_batch = len(shape) in (3, 4) and not is_one(shape, model.channels)
    bins_each = math.prod(shape[1:])
    if not is_batch or not mapped.flags.c_contiguous or bins_each * many <= 0:
        return None
    labels = labels_beside(path, shape[0])
    if dtype.kind not in "biuf" or bins_each * many > MAX_ELEMENTS:
        return None
    if labels is not None and len(labels) != shape[0]:
        return None
    # The whole array shows in which order its axes are; a chunk does not.
    check_axes(mapped, f"file {path.name!r}", model.channels)

    def chunks() -> Iterator[Recordings]:
        for start in range(0, shape[0], many):
            count = min(many, shape[0] - start)
            offset = begin + start * bins_each * dtype.itemsize
            # Not a slice of the mapped array, which would end the process if the file became shorter.
            values = np.fromfile(path, dtype, count * bins_each, offset=offset)
            if len(values) < count * bins_each:
                raise InputError(
                    f"file {path.name!r}", "it became shorter while it was read", fix="Start again."
                )
            # From (samples, [taxels, polarities or] channels, steps) to (samples, steps, channels).
            bins = values.reshape(count, -1, shape[-1]).transpose(0, 2, 1)
            chunk_labels = None if labels is None else labels[start : start + count]
            recordings = Recordings(
                bins, chunk_labels, step_seconds=model.step_seconds, source=path.name, first=start
            )
            yield join_channels(recordings, model)

    return chunks()
