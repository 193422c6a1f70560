"""What ``locsnn explore`` reads: the network, and the recordings on which it is compared."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from hw_model.values import Frozen
from locsnn_compile.cli.options import given
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.step_options import (
    FILE_OPTIONS,
    STEP_OPTIONS,
    file_reading,
    on_sensor,
    reading_arguments,
    with_steps,
)
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.explore.events import Chosen, as_read, choose_events, written
from locsnn_compile.explore.point import ModelFile
from locsnn_compile.frontends.format_rows import LoadOptions
from locsnn_compile.network.network import Network
from locsnn_compile.request.recordings import calibration_recordings
from locsnn_compile.settings import check_matters

READ = ("--config", "--events", "--report-on", "--calibration")
EVENTS, CALIBRATION, REPORTED = "events.npz", "calibration.npz", "reported.npz"
COPIES = (EVENTS, CALIBRATION, REPORTED)
"""Recordings that commands need and that no other file holds as they were read."""


class ExploredFiles(Frozen, eq=False):
    """The files that the printed commands name, and the options by which they read them.

    ``calibration_file`` is None if it is the file of ``events``.
    """

    events: Chosen
    calibration_file: str | None
    reading_arguments: tuple[str, ...]


class Compared(Frozen, eq=False):
    """A network, the recordings on which it is compared, and those for which it is rounded.

    ``calibration_file`` is that of ``--calibration``. ``rewritten``: the recordings were read by
    options that a file with what they became does not need again.
    """

    model: ModelFile
    network: Network
    events: Chosen
    calibration: Recordings
    calibration_file: str | None
    folder: Path
    rewritten: bool
    reading_arguments: tuple[str, ...]
    step_arguments: tuple[str, ...]

    def written(self) -> ExploredFiles:
        """Return files with these recordings; write those that no file holds exactly."""
        events = written(self.events, self.folder / EVENTS)
        if not self.rewritten:
            return ExploredFiles(events, self.calibration_file, self.reading_arguments)
        # One command reads all its files with the same options, and these were read already.
        calibration_file = self.calibration_file
        if calibration_file is not None:
            copy = written(as_read(self.calibration), self.folder / CALIBRATION)
            calibration_file = copy.file
        return ExploredFiles(events, calibration_file, self.step_arguments)


def read_compared(args: argparse.Namespace, folder: Path) -> Compared:
    """Read what the options give; refuse options that change nothing, and places of inputs."""
    model = ModelFile(args.model, LoadOptions.of(args))
    network = on_sensor(with_steps(model.load(), args), args)
    reading = file_reading(args)
    files = (args.events, args.calibration, args.report_on, args.channel_order)
    if not any(files):
        for option in given(args, FILE_OPTIONS):
            raise InputError(option, "there are no events to read", fix="Give them with --events.")
    check_matters(network, {"calibration": "--calibration"} if args.calibration else {})
    events = choose_events(network, args.events, args.part, args.recordings, reading)
    reading_again = reading_arguments(args)
    steps_again = reading_arguments(args, STEP_OPTIONS)
    rewritten = events.file is None and reading_again != steps_again
    if events.file is None:
        check_explored_places(args, folder, COPIES if rewritten else COPIES[:1])
    # By default never the recordings in the model: they may belong to its test part.
    calibration = events.recordings
    if args.calibration:
        calibration = calibration_recordings(network, args.calibration, reading)
    return Compared(
        model=model,
        network=network,
        events=events,
        calibration=calibration,
        calibration_file=args.calibration,
        folder=folder,
        rewritten=rewritten,
        reading_arguments=reading_again,
        step_arguments=steps_again,
    )


def check_explored_places(args: argparse.Namespace, folder: Path, names: Sequence[str]) -> None:
    """Refuse to overwrite inputs with files of these ``names`` in the output folder."""
    reads = {"MODEL": args.model, **given(args, READ)}
    for target in args.target or ():
        reads[f"--target {target}" if args.target[1:] else "--target"] = target
    check_places(reads, [], [(f"-o {str(folder)!r}", folder / name) for name in names])
