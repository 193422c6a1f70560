"""What ``locsnn explore`` reads: the network, and the recordings on which settings are compared.

Explore prints a command for each point, by which ``locsnn-compile`` reproduces its figures. Such a
command must read exactly the same recordings. Where no file holds them, because only some of the
recordings were used or options changed them on reading, explore writes a copy next to its results.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from hw_model.values import Frozen
from locsnn_compile.cli.options import given_options
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.step_options import (
    FILE_OPTIONS,
    STEP_OPTIONS,
    file_reading_options,
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
"""Options that name files to read, which no output may replace."""
EVENTS = "events.npz"
CALIBRATION = "calibration.npz"
REPORTED = "reported.npz"
COPIES = (EVENTS, CALIBRATION, REPORTED)
"""Copies of recordings in the output folder, for commands that no other file can serve."""


class ExploredFiles(Frozen, eq=False):
    """The files that the printed commands name, and the options by which they read them.

    ``calibration_file`` is None if it is the file of ``events``.
    """

    events: Chosen
    calibration_file: str | None
    reading_arguments: tuple[str, ...]


class Compared(Frozen, eq=False):
    """A network, the recordings on which it is compared, and those for which it is rounded.

    - ``events``: the recordings of ``--events``, or synthetic ones
    - ``calibration``: the recordings for which weights are rounded
    - ``calibration_file``: the file of ``--calibration``, None without that option
    - ``folder``: where copies are written
    - ``rewritten``: whether a copy of ``events`` is needed and options changed them on reading; a
      command that reads the copy must not apply these options again
    - ``reading_arguments``: all options on reading, as they were typed
    - ``step_arguments``: those of them that a command needs for a copy as well
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
        """Return files with these recordings; write copies of those that no file holds exactly."""
        events = written(self.events, self.folder / EVENTS)
        if not self.rewritten:
            return ExploredFiles(events, self.calibration_file, self.reading_arguments)
        # A command reads all its files with the same options. The options that changed the events
        # are left out for their copy, so the calibration recordings need a copy too.
        calibration_file = self.calibration_file
        if calibration_file is not None:
            copy = written(as_read(self.calibration), self.folder / CALIBRATION)
            calibration_file = copy.file
        return ExploredFiles(events, calibration_file, self.step_arguments)


def read_compared(args: argparse.Namespace, folder: Path) -> Compared:
    """Read the model and the recordings that the options name.

    Raises ``InputError`` for options that would change nothing, and for copies of recordings that
    would replace an input.
    """
    model = ModelFile(args.model, LoadOptions.of(args))
    network = on_sensor(with_steps(model.load(), args), args)
    file_options = file_reading_options(args)
    # Options on reading describe files of recordings or, with --channel-order, the model's inputs.
    has_use_for_file_options = any(
        (args.events, args.calibration, args.report_on, args.channel_order)
    )
    if not has_use_for_file_options:
        for option in given_options(args, FILE_OPTIONS):
            raise InputError(option, "there are no events to read", fix="Give them with --events.")
    if args.calibration:
        check_matters(network, {"calibration": "--calibration"})
    events = choose_events(network, args.events, args.part, args.recordings, file_options)
    all_arguments = reading_arguments(args)
    step_arguments = reading_arguments(args, STEP_OPTIONS)
    rewritten = events.file is None and all_arguments != step_arguments
    if events.file is None:
        check_explored_places(args, folder, COPIES if rewritten else (EVENTS,))
    # By default never the recordings in the model: they may belong to its test part.
    calibration = events.recordings
    if args.calibration:
        calibration = calibration_recordings(network, args.calibration, file_options)
    return Compared(
        model=model,
        network=network,
        events=events,
        calibration=calibration,
        calibration_file=args.calibration,
        folder=folder,
        rewritten=rewritten,
        reading_arguments=all_arguments,
        step_arguments=step_arguments,
    )


def check_explored_places(args: argparse.Namespace, folder: Path, names: Sequence[str]) -> None:
    """Refuse to overwrite inputs with files of these ``names`` in the output folder."""
    inputs = {"MODEL": args.model, **given_options(args, READ)}
    targets = args.target or []
    for target in targets:
        # A message names the target only if there are several.
        option = "--target" if len(targets) == 1 else f"--target {target}"
        inputs[option] = target
    entries = [(f"-o {str(folder)!r}", folder / name) for name in names]
    check_places(inputs, files=[], entries=entries)
