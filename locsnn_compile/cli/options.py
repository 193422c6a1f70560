"""The options of each command by its name, and checks that several commands share."""

import argparse
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from locsnn_compile.cli.declarations import (
    compile,
    completion,
    diff,
    events,
    explore,
    fit,
    pack,
    run,
    sim,
    stream,
    stress,
    targets,
    train,
)
from locsnn_compile.errors import InputError

if TYPE_CHECKING:
    from locsnn_compile.data.recordings import Recordings

DECLARATIONS: Mapping[str, Callable[[argparse.ArgumentParser], None]] = {
    "compile": compile.declare,
    "train": train.declare,
    "pack": pack.declare,
    "run": run.declare,
    "events": events.declare,
    "explore": explore.declare,
    "diff": diff.declare,
    "stress": stress.declare,
    "targets": targets.declare,
    "completion": completion.declare,
    "sim": sim.declare,
    "fit": fit.declare,
    "stream": stream.declare,
}


def add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a command."""
    DECLARATIONS[command](parser)


def given(args: argparse.Namespace, options: Iterable[str]) -> dict[str, Any]:
    """Return the values of the options that were given, by the option as it is typed."""
    values = {option: getattr(args, option.strip("-").replace("-", "_")) for option in options}
    return {option: value for option, value in values.items() if value is not None}


def recording_of(option: int | None, recordings: "Recordings") -> int:
    """Return the number of the recording asked for, by default the first; refuse one that does not exist."""
    number = option or 0
    if not 0 <= number < len(recordings):
        measured = f"{len(recordings)} in {recordings.source}"
        fix = f"Count from 0 to {len(recordings) - 1}."
        raise InputError(
            f"--recording {number}", "there is no such recording", measured=measured, fix=fix
        )
    return number
