"""The table of the functions that declare each command's options, and checks that commands share.

The declarations lie apart from the commands, in ``cli/declarations``, so that the help and shell
completion import no command and none of the heavy modules that it needs.
"""

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
"""By the last part of a command's name: ``sim`` declares the options of ``locsnn rtl sim``."""


def add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Add the options of a command."""
    DECLARATIONS[command](parser)


def given_options(args: argparse.Namespace, options: Iterable[str]) -> dict[str, Any]:
    """Return the values of those ``options``, such as ``--min-agreement``, that the user gave.

    An option that was not given is None: those that are asked about here have no other default.
    """
    # argparse stores --min-agreement as the attribute min_agreement.
    values = {option: getattr(args, option.strip("-").replace("-", "_")) for option in options}
    return {option: value for option, value in values.items() if value is not None}


def recording_number(option: int | None, recordings: "Recordings") -> int:
    """Return the number that ``--recording`` gives, or 0 if it was not given.

    Raises ``InputError`` if there is no such recording.
    """
    number = 0 if option is None else option
    if not 0 <= number < len(recordings):
        measured = f"{len(recordings)} in {recordings.source}"
        fix = f"Count from 0 to {len(recordings) - 1}."
        raise InputError(
            f"--recording {number}", "there is no such recording", measured=measured, fix=fix
        )
    return number
