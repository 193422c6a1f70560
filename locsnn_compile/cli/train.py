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

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.io.extras import needed
from hw_model.io.given import check_path
from hw_model.io.partial import claimed
from hw_model.io.records import field_kinds
from hw_model.values import IntArray
from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED
from locsnn_compile.cli.options import given
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, Moved, progress_bar
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

SHOWN_CLASSES, SHOWN_NAMES = 20, 60
"""The confusion matrix is printed for this many classes at most, and with names if they have fewer letters in all."""


def run(args: argparse.Namespace) -> int:
    """Train as ``args`` ask; return the exit code. Raises ``InputError`` for what cannot be used."""
    output = Path(args.output)
    check_path(output, f"-o {args.output!r}")
    if output.suffix != ".pt" or output.is_dir() or not output.parent.is_dir():
        where, what = (
            f"output {output.name or str(output)!r}",
            "it is not a .pt file in an existing folder",
        )
        raise InputError(where, what, fix="Correct -o.")
    _check_places(args, output)
    with claimed(output, f"-o {args.output!r}"):
        return _train(args, output)


def _train(args: argparse.Namespace, output: Path) -> int:
    start = None if args.from_model is None else read_checkpoint(args.from_model)
    config, values = training_config(args, start)
    needed("torch", "train", "locsnn train")

    from locsnn_compile.training.chosen import choose
    from locsnn_compile.training.export import export_checkpoint
    from locsnn_compile.training.from_python import all_classes, read_parts
    from locsnn_compile.training.train import train

    recordings, test = read_parts(args.data, config, start)
    classes = all_classes(recordings, test)
    chosen = None
    if start is None:
        with progress_bar("choosing windows", show=not args.quiet) as moved:
            chosen = choose(values, recordings, classes, moved)
        config = chosen.config
        if not args.quiet:
            print("".join(f"{line}\n" for line in chosen.lines), end="", flush=True)

    state_path = _state_path(output)
    if not args.resume:
        state_path.unlink(missing_ok=True)
    with progress_bar("training", show=not args.quiet) as moved:
        try:
            result = train(
                recordings,
                config,
                name=output.stem,
                classes=classes,
                start=start,
                state_path=state_path,
                log_path=output.with_suffix(".csv"),
                progress=after_epochs(args, moved),
                notice=None if args.quiet else _say_at_once,
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
            kept = state_path.exists()
            way_on = (
                "Continue with the same command and --resume."
                if kept
                else "No epoch was kept yet: start again."
            )
            print(f"Stopped. {way_on}", file=sys.stderr)
            return EXIT_INTERRUPTED
        except InputError as error:
            # Only what the system refused can be mended between two equal commands.
            if not (isinstance(error.__context__, OSError) and state_path.exists()):
                raise
            fix = "Free space or fix access, then repeat the command with --resume."
            raise InputError(error.where, error.what, measured=error.measured, fix=fix) from None
    state_path.unlink(missing_ok=True)
    if not args.quiet:
        print(_summary(output, result, measured, recordings, test))
    return 0 if result.learned else EXIT_GATE


def _say_at_once(remark: str) -> None:
    print(f"! {remark}", file=sys.stderr, flush=True)


def _state_path(output: Path) -> Path:
    return output.with_name(f"{output.name}.state")


def _check_places(args: argparse.Namespace, output: Path) -> None:
    """Refuse outputs that are inputs, files next to them that no training wrote, and ``--resume`` without a state."""
    option = f"-o {args.output!r}"
    beside = {
        output.with_suffix(".csv"): b"phase,epoch,learning_rate,",
        output.with_suffix(".svg"): b"Training of ",
        _state_path(output): b"locsnn-training-state",
    }
    reads = given(args, ("--data", "--config", "--target", "--layout")) | {
        "--from": args.from_model
    }
    check_places(reads, [(option, path) for path in (output, *beside)])
    for path, mark in beside.items():
        if path.exists() and mark not in path.read_bytes():
            what = f"{path.name!r} next to it would be replaced, but no training wrote it"
            raise InputError(option, what, fix="Write elsewhere.")
    if args.resume and not _state_path(output).exists():
        measured = f"no {_state_path(output).name!r}"
        raise InputError(
            "--resume",
            "there is nothing to resume",
            measured=measured,
            fix="Train without --resume.",
        )


def training_config(
    args: argparse.Namespace, start: Checkpoint | None
) -> tuple[TrainingConfig, dict[str, Any]]:
    """Return the configuration that the options give, and those of its values that were given."""
    values: dict[str, Any] = read_config(args.config) if args.config is not None else {}
    of_file = {name: f"config {Path(args.config).name!r}, {name}" for name in values}
    options = field_kinds(TrainingConfig)
    typed = vars(args) | {"event_threshold": args.threshold, "threshold": None}
    # In the record of a run, ``start`` is the network that it starts from.
    typed |= {"start_at": args.start, "start": None}
    typed_options = {
        name: value for name, value in typed.items() if name in options and value is not None
    }
    flags = {
        "location_weight": "--lambda",
        "event_threshold": "--threshold",
        "start_at": "--start",
    }
    usual = {} if start is None else {"model": start.description.architecture} | FINE_TUNING
    config = config_from_mapping(usual | values | typed_options)
    check_used(
        {name: flags.get(name, f"--{name.replace('_', '-')}") for name in typed_options}, config
    )
    # A file may serve several runs: it may hold what would count without the other options and, if it does not name the
    # model, what counts for any model.
    models = ARCHITECTURES if args.model is not None and "model" not in values else [config.model]
    shared = [config_from_mapping(usual | {"model": model} | values) for model in models]
    check_used(of_file, config, *shared)
    if start is None:
        return config, values | typed_options
    check_fits_start(values | typed_options, start.description)
    times = start.event_times
    if times is not None and config.start_at is None:
        config = replace(config, start_at=times.start)
    if times is not None and config.time_unit is None:
        config = replace(config, time_unit=times.time_unit)
    return fine_tuning_config(config, start.description), values | typed_options


def _summary(
    output: Path,
    result: TrainingResult,
    measured: Measured,
    recordings: Recordings,
    test: Recordings | None,
) -> str:
    from locsnn_compile.training.export import accuracy_of
    from locsnn_compile.training.measure import chance_remarks, tie_remarks

    confusion = measured.confusion
    lines, remarks = [f"epoch {result.chosen_epoch} chosen"], list(result.remarks)
    if result.validation_accuracy is not None:
        lines[0] += f" by validation accuracy {result.validation_accuracy:.3f}"
    if confusion is not None and test is not None and test.labels is not None:
        accuracy = accuracy_of(confusion, test)
        if recordings.source != test.source:
            lines += [
                f"{part.source}: {plural(len(part), 'recording')}" for part in (recordings, test)
            ]
        lines.append(f"test accuracy {accuracy:.3f} on {plural(len(test), 'recording')}")
        lines += _confusion(confusion, test.class_names)
        remarks += tie_remarks(confusion)
        remarks += chance_remarks(accuracy, test.labels, "of the test part")
    if measured.comparison is not None:
        lines.append(measured.comparison.words)
        several = len(set(recordings.needed_labels("train on").tolist())) > 1
        if result.learned and several and measured.comparison.lost:
            remarks.append(measured.comparison.lost)
    return "\n".join([*lines, *(f"! {remark}" for remark in remarks), f"wrote {output}"])


def _confusion(confusion: IntArray, names: tuple[str, ...] | None = None) -> list[str]:
    """Return the confusion matrix as lines, with class names if there is room; nothing for more than SHOWN_CLASSES.

    Its column of ties is left out where there is none.
    """
    if len(confusion) > SHOWN_CLASSES:
        return []
    from locsnn_compile.training.measure import NO_CLASS

    heads = [str(label) for label in range(len(confusion))]
    if names is not None and sum(map(len, names)) < SHOWN_NAMES:
        heads = list(names)
    ties = confusion[:, -1].any()
    shown = confusion if ties else confusion[:, :-1]
    columns = [*heads, NO_CLASS] if ties else heads
    width = max(len(text) for text in (*columns, str(shown.max()))) + 2
    rows = ["".join(f"{n:>{width}}" for n in row) for row in (columns, *shown.tolist())]
    return [
        f"{head:>17}{row}" for head, row in zip(("label \\ predicted", *heads), rows, strict=True)
    ]


def after_epochs(args: argparse.Namespace, moved: Moved | None) -> Progress:
    """Return the callback after each epoch: it moves the bar, or prints a line where there is none, and logs."""
    log = tensorboard_log(Path(args.tensorboard)) if args.tensorboard else None

    def after_epoch(done: int, expected: int, record: EpochRecord) -> None:
        if log is not None:
            log(done, expected, record)
        validation = ""
        if record.validation_accuracy is not None:
            validation = f", validation {record.validation_accuracy:.3f}"
        line = f"{record.phase} epoch {record.epoch}, loss {record.loss:.3f}{validation}"
        if moved is not None:
            moved(done, expected, line)
        elif not args.quiet:
            print(f"{done}/{expected} {line}", file=sys.stderr, flush=True)

    return after_epoch
