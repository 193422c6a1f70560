"""What all commands share: how they are added, one-line errors, exit codes, streams, progress bars."""

from __future__ import annotations

import argparse
import errno
import gc
import io
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn, Protocol

from locsnn_compile import __version__
from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED as EXIT_INTERRUPTED
from locsnn_compile.cli.interrupt import leaving_at_once
from locsnn_compile.cli.option_file import read_options
from locsnn_compile.errors import InputError, LocsnnError

# Before numpy is there: matrices are small, threads of a busy machine wait for each other, and with one of them results
# do not hang on the number of cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Most objects are modules and live to the end: looking for garbage among them took a tenth of the time.
gc.set_threshold(100_000)

EXIT_TARGET, EXIT_INPUT, EXIT_GATE = 1, 2, 3
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, like all others, and that reads the file of ``--options``."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Refuse arguments that are not text in this locale: they would be names in reports, which are text."""
        for text in sys.argv[1:] if args is None else args:
            if any("\udc80" <= letter <= "\udcff" for letter in text):
                self.error(f"argument {text!r} is not text in this locale; rename the file, or choose a UTF-8 locale")
        found, rest = super().parse_known_args(args, namespace)
        if "--options" in self._option_string_actions and found.options is not None:
            values = read_options(self, found.options)
            # A default is taken only where there is no attribute: what is None after this was not typed.
            typed, _ = super().parse_known_args(args, argparse.Namespace(**dict.fromkeys(values)))
            for name, value in values.items():
                setattr(found, name, value if getattr(typed, name) is None else getattr(typed, name))
        return found, rest

    def error(self, message: str) -> NoReturn:
        """Print the one line and exit with 2."""
        print(f"{self.prog}: {message}. See {self.prog} --help.", file=sys.stderr)
        raise SystemExit(EXIT_INPUT)


class Command(Protocol):
    """What a module of a command has: its help, ending with an example, its options, and what it does."""

    HELP: str
    DESCRIPTION: str
    EXAMPLE: str

    def add_options(self, parser: argparse.ArgumentParser, /) -> None:
        """Add the options."""

    def run(self, args: argparse.Namespace, /) -> int:
        """Do it; return the exit code."""


def add_command(commands: argparse._SubParsersAction[Any], name: str, command: Command) -> None:
    """Add a command below ``locsnn``."""
    parser = commands.add_parser(
        name,
        help=command.HELP,
        description=command.DESCRIPTION,
        epilog=command.EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_options(parser)
    add_common(parser)
    parser.set_defaults(run=command.run)


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add the options that all commands have."""
    help_ = "say on standard error what is being done"
    parser.add_argument("--verbose", action="store_true", default=argparse.SUPPRESS, help=help_)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}", help="print the version")


def guarded(parser: Parser, typed: Sequence[str] | None, run: Callable[[argparse.Namespace], int]) -> int:
    """Run a command; print an error as its one line and return the exit code that its kind has.

    ``typed``: the words of the command line, by default this program's own.
    """
    _ready_streams()
    try:
        args = parser.parse_args(typed)
        _show_log("verbose" in args)
        with leaving_at_once():
            code = run(args)
            sys.stdout.flush()
            return code
    except LocsnnError as error:
        print(_as_typed(error, sys.argv[1:] if typed is None else typed), file=sys.stderr)
        return EXIT_INPUT if isinstance(error, InputError) else EXIT_TARGET
    except KeyboardInterrupt:
        print("Interrupted; nothing was written.", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output went away: leave without a word.
        _drop_output()
        return 0
    except OSError as error:
        print(_system_error(error), file=sys.stderr)
        if error.filename is None and error.errno in _NO_ROOM:
            _drop_output()
        return EXIT_INPUT


def _as_typed(error: LocsnnError, typed: Sequence[str]) -> LocsnnError:
    """Return an error that shows a path as it was typed, where it shows the name of the file; of two such, neither."""
    found = {word.partition("=")[2] if word.startswith("--") else word for word in typed}
    names = [os.path.basename(path.rstrip("/")) for path in found]
    for path, name in zip(found, names, strict=True):
        if names.count(name) == 1 and repr(name) in error.where:
            where = error.where.replace(repr(name), repr(path))
            return type(error)(where, error.what, measured=error.measured, fix=error.fix)
    return error


def _system_error(error: OSError) -> LocsnnError:
    """Return what the system refused, where no reader or writer said it in words of its own."""
    if error.filename is not None:
        name = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else str(error.filename)
        return InputError(f"{name[:60]!r}", "it cannot be used", measured=error.strerror or "", fix="Check the path.")
    if error.errno == errno.ENOENT:
        return InputError("working directory", "it does not exist any more", fix="Change to one that does.")
    if error.errno in _NO_ROOM:
        return InputError("standard output", f"it cannot be written: {error.strerror}", fix="Write it elsewhere.")
    return InputError("system", f"it refused: {error.strerror or type(error).__name__}", fix="Try again elsewhere.")


def _ready_streams() -> None:
    """Go on where a stream is closed, and where the locale has no code for a letter, which is then a ``?``."""
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _drop_output() -> None:
    """Keep the interpreter, when it ends, from flushing into an output that takes nothing."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _show_log(verbose: bool) -> None:
    """Show on standard error what is logged: all of it, or, where somebody watches, what takes seconds."""
    if verbose or sys.stderr.isatty():
        logging.basicConfig(format="%(message)s")
        logging.getLogger("locsnn").setLevel(logging.DEBUG if verbose else logging.INFO)


class Moved(Protocol):
    """What moves a progress bar."""

    def __call__(self, done: int, total: int | None, now: str = ..., /) -> None:
        """Show how much is done, of how much where that is known, and what."""


@contextmanager
def progress_bar(title: str, *, show: bool) -> Iterator[Moved | None]:
    """Give a callback (done, in all, and a title) that moves a bar on standard error; None where nobody watches."""
    if not (show and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total, now=title: bar.update(task, completed=done, total=total, description=now)
