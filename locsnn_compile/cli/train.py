"""``locsnn train``: train a touch network and write a checkpoint.

Train a touch network on recordings and write a checkpoint to compile.

example:
  locsnn train --data examples/recordings/motions.npz --epochs 20 -o motions.pt
  locsnn train --data examples/recordings/motions.npz --from motions.pt --target loihi-sim -o motions-loihi.pt

With --target the forward pass is the chip's integer arithmetic, so the compiled program spikes exactly as the network
did in training. --from fine-tunes a trained network, by default for 60 epochs at a rate of 0.001 on the whole train
part, which that network may have seen already.

The epoch is chosen on a validation share of the train part. The test part, if the data have one, is measured once, at
the end, and next to it ridge regression on numbers of events. A run that learns nothing says so after a few epochs, and
exits with 3. Next to OUT.pt it writes a log OUT.csv and its picture OUT.svg and, while it runs, OUT.pt.state for
--resume.
Options without a flag here are keys of the --config file: taxel_dropout, time_shift, weight_average, ...
"""

# The docstring above is the help of the command, so it stays in these words.

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.io.arguments import check_path
from hw_model.io.extras import needed
from hw_model.io.partial import claimed
from hw_model.io.records import field_kinds
from hw_model.values import IntArray
from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED
from locsnn_compile.cli.options import given_options
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, MoveBar, progress_bar
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.report.format import plural
from locsnn_compile.training.config import (
    EpochRecord,
    Progress,
    TrainingConfig,
    check_used,
    config_from_mapping,
    read_config,
)
from locsnn_compile.training.describe import FINE_TUNING, check_fits_start, fine_tuning_config
from locsnn_compile.training.profile import tensorboard_log

if TYPE_CHECKING:
    from locsnn_compile.training.export import Measured
    from locsnn_compile.training.train import TrainingResult

SHOWN_CLASSES = 20
"""The confusion matrix is printed for this many classes at most: chosen by hand, as is the next."""
SHOWN_NAMES = 60
"""It is printed with the names of classes if these have fewer letters in all."""
OPTION_OF_KEY = {
    "location_weight": "--lambda",
    "event_threshold": "--threshold",
    "start_at": "--start",
}
"""Keys of a training configuration whose options have other names."""


def run(args: argparse.Namespace) -> int:
    """Train as ``args`` ask; return the exit code. Raises ``InputError`` for what cannot be used."""
    output = Path(args.output)
    check_path(output, f"-o {args.output!r}")
    if output.suffix != ".pt" or output.is_dir() or not output.parent.is_dir():
        where = f"output {output.name or str(output)!r}"
        what = "it is not a .pt file in an existing folder"
        raise InputError(where, what, fix="Correct -o.")
    _check_places(args, output)
    # Two trainings at once would overwrite each other's state, so the second one is refused.
    with claimed(output, f"-o {args.output!r}"):
        return _train(args, output)


def _train(args: argparse.Namespace, output: Path) -> int:
    """Train, write the checkpoint, and print the summary; return the exit code."""
    start = None if args.from_model is None else read_checkpoint(args.from_model)
    config, given_values = training_config(args, start)
    needed(package="torch", extra="train", where="locsnn train")

    # Imported only now: torch takes seconds, and wrong options are refused before.
    from locsnn_compile.training.chosen import choose
    from locsnn_compile.training.export import export_checkpoint
    from locsnn_compile.training.from_python import all_classes, read_parts
    from locsnn_compile.training.train import train

    recordings, test = read_parts(args.data, config, start)
    classes = all_classes(recordings, test)
    chosen = None
    if start is None:  # a network that exists keeps its windows and architecture
        with progress_bar("choosing windows", show=not args.quiet) as move_bar:
            chosen = choose(given_values, recordings, classes, move_bar)
        config = chosen.config
        if not args.quiet:
            print("".join(f"{line}\n" for line in chosen.lines), end="", flush=True)

    state_path = _state_path(output)
    if not args.resume:
        state_path.unlink(missing_ok=True)
    with progress_bar("training", show=not args.quiet) as move_bar:
        try:
            result = train(
                recordings,
                config,
                name=output.stem,
                classes=classes,
                start=start,
                state_path=state_path,
                log_path=output.with_suffix(".csv"),
                progress=after_epochs(args, move_bar),
                notice=None if args.quiet else _print_remark,
            )
            measured = export_checkpoint(
                output,
                result,
                config,
                recordings,
                test,
                carried=args.recordings,
                start=start,
                chosen=chosen,
            )
        except KeyboardInterrupt:
            advice = "No epoch was kept yet: start again."
            if state_path.exists():
                advice = "Continue with the same command and --resume."
            print(f"Stopped. {advice}", file=sys.stderr)
            return EXIT_INTERRUPTED
        except InputError as error:
            # Only if the system refused something, such as a write to a full disk, can the same
            # command succeed later.
            is_of_system = isinstance(error.__context__, OSError)
            if not (is_of_system and state_path.exists()):
                raise
            fix = "Free space or fix access, then repeat the command with --resume."
            raise InputError(error.where, error.what, measured=error.measured, fix=fix) from None
    # Only now, after the checkpoint is written: until then the state could resume the run.
    state_path.unlink(missing_ok=True)
    if not args.quiet:
        print(_summary(output, result, measured, recordings, test))
    return 0 if result.learned else EXIT_GATE


def _print_remark(remark: str) -> None:
    """Print a remark while training goes on, such as that nothing is learned."""
    print(f"! {remark}", file=sys.stderr, flush=True)


def _state_path(output: Path) -> Path:
    """Return the file of the unfinished run: OUT.pt.state."""
    return output.with_name(f"{output.name}.state")


def _check_places(args: argparse.Namespace, output: Path) -> None:
    """Refuse outputs that are inputs, files next to them that no training wrote, and ``--resume`` without a state."""
    option = f"-o {args.output!r}"
    state_path = _state_path(output)
    # Files that a training writes next to its output, each with bytes by which it is recognised: a file of this name
    # without them is somebody else's.
    mark_of_file = {
        output.with_suffix(".csv"): b"phase,epoch,learning_rate,",
        output.with_suffix(".svg"): b"Training of ",
        state_path: b"locsnn-training-state",
    }
    inputs = given_options(args, ("--data", "--config", "--target", "--layout"))
    inputs["--from"] = args.from_model
    check_places(inputs, [(option, path) for path in (output, *mark_of_file)])
    for path, mark in mark_of_file.items():
        if path.exists() and mark not in path.read_bytes():
            what = f"{path.name!r} next to it would be replaced, but no training wrote it"
            raise InputError(option, what, fix="Write elsewhere.")
    if args.resume and not state_path.exists():
        measured = f"no {state_path.name!r}"
        raise InputError(
            "--resume",
            "there is nothing to resume",
            measured=measured,
            fix="Train without --resume.",
        )


def training_config(
    args: argparse.Namespace, start: Checkpoint | None
) -> tuple[TrainingConfig, dict[str, Any]]:
    """Return the training configuration, and those of its values that the user gave.

    A value on the command line takes precedence over one in the ``--config`` file, and that over the
    defaults: those of fine-tuning if the run begins with the network ``start``.

    Raises ``InputError`` for values that would change nothing in this run.
    """
    file_values: dict[str, Any] = {} if args.config is None else read_config(args.config)
    typed_values = _typed_values(args)
    given_values = file_values | typed_values
    defaults = {} if start is None else {"model": start.description.architecture} | FINE_TUNING
    config = config_from_mapping(defaults | given_values)
    options = {key: OPTION_OF_KEY.get(key, f"--{key.replace('_', '-')}") for key in typed_values}
    check_used(options, config)
    # A file may serve several runs: it may hold what would count without the other options and, if it does not name the
    # model, what counts for any model.
    is_for_any_model = args.model is not None and "model" not in file_values
    models = ARCHITECTURES if is_for_any_model else [config.model]
    other_configs = [
        config_from_mapping(defaults | {"model": model} | file_values) for model in models
    ]
    places_in_file = {key: f"config {Path(args.config).name!r}, {key}" for key in file_values}
    check_used(places_in_file, config, *other_configs)
    if start is None:
        return config, given_values
    check_fits_start(given_values, start.description)
    times = start.event_times
    if times is not None and config.start_at is None:
        config = replace(config, start_at=times.start)
    if times is not None and config.time_unit is None:
        config = replace(config, time_unit=times.time_unit)
    return fine_tuning_config(config, start.description), given_values


def _typed_values(args: argparse.Namespace) -> dict[str, Any]:
    """Return what was typed on the command line, by the keys of a training configuration."""
    values = dict(vars(args))
    # The keys of these two options have other names. In the record of a run, for example, ``start``
    # is the network that it starts from.
    values["event_threshold"] = values.pop("threshold")
    values["start_at"] = values.pop("start")
    keys = field_kinds(TrainingConfig)
    return {key: value for key, value in values.items() if key in keys and value is not None}


def _summary(
    output: Path,
    result: TrainingResult,
    measured: Measured,
    recordings: Recordings,
    test: Recordings | None,
) -> str:
    """Return the lines that end a run: its accuracy, the confusion matrix, and remarks, after a "!"."""
    from locsnn_compile.training.export import accuracy_of
    from locsnn_compile.training.measure import chance_remarks, tie_remarks

    confusion = measured.confusion
    remarks = list(result.remarks)
    epoch_line = f"epoch {result.chosen_epoch} chosen"
    if result.validation_accuracy is not None:
        epoch_line += f" by validation accuracy {result.validation_accuracy:.3f}"
    lines = [epoch_line]
    if confusion is not None and test is not None and test.labels is not None:
        accuracy = accuracy_of(confusion, test)
        if recordings.source != test.source:
            lines += [
                f"{part.source}: {plural(len(part), 'recording')}" for part in (recordings, test)
            ]
        lines.append(f"test accuracy {accuracy:.3f} on {plural(len(test), 'recording')}")
        lines += confusion_lines(confusion, test.class_names)
        remarks += tie_remarks(confusion)
        remarks += chance_remarks(accuracy, test.labels, "of the test part")
    if measured.comparison is not None:
        lines.append(measured.comparison.words)
        classes = set(recordings.needed_labels(purpose="train on").tolist())
        # A comparison says something only if there was more than one class to learn.
        if result.learned and len(classes) > 1 and measured.comparison.lost:
            remarks.append(measured.comparison.lost)
    return "\n".join([*lines, *(f"! {remark}" for remark in remarks), f"wrote {output}"])


def confusion_lines(confusion: IntArray, names: tuple[str, ...] | None = None) -> list[str]:
    """Return the confusion matrix as lines, with class names if there is room; nothing for more than SHOWN_CLASSES.

    A row is a label, a column a prediction, and the last column counts recordings in which all
    classes tie, so that nothing is predicted. It is left out if there are none.
    """
    if len(confusion) > SHOWN_CLASSES:
        return []
    from locsnn_compile.training.measure import NO_CLASS

    labels = [str(label) for label in range(len(confusion))]
    if names is not None and sum(map(len, names)) < SHOWN_NAMES:
        labels = list(names)
    columns = [*labels, NO_CLASS]
    counts = confusion
    if not confusion[:, -1].any():
        columns = labels
        counts = confusion[:, :-1]
    width = max(len(text) for text in (*columns, str(counts.max()))) + 2
    heading = "label \\ predicted"
    lines = [heading + "".join(f"{name:>{width}}" for name in columns)]
    for label, row in zip(labels, counts.tolist(), strict=True):
        cells = "".join(f"{count:>{width}}" for count in row)
        lines.append(f"{label:>{len(heading)}}{cells}")
    return lines


def after_epochs(args: argparse.Namespace, move_bar: MoveBar | None) -> Progress:
    """Return the function that is called after each epoch.

    It moves the progress bar, or prints a line if there is no bar, and logs for TensorBoard.
    """
    log = tensorboard_log(Path(args.tensorboard)) if args.tensorboard else None

    def after_epoch(done: int, expected: int, record: EpochRecord) -> None:
        if log is not None:
            log(done, expected, record)
        validation = ""
        if record.validation_accuracy is not None:
            validation = f", validation {record.validation_accuracy:.3f}"
        line = f"{record.phase} epoch {record.epoch}, loss {record.loss:.3f}{validation}"
        if move_bar is not None:
            move_bar(done, expected, line)
        elif not args.quiet:
            print(f"{done}/{expected} {line}", file=sys.stderr, flush=True)

    return after_epoch
