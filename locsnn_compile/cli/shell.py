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

from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED as EXIT_INTERRUPTED
from locsnn_compile.cli.interrupt import leaving_at_once
from locsnn_compile.errors import InputError, LocsnnError

# Before numpy is there: matrices are small, threads of a busy machine wait for each other, and with one of them results
# do not hang on the number of cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Most objects are modules and live to the end: looking for garbage among them took a tenth of the time.
gc.set_threshold(100_000)

EXIT_TARGET, EXIT_INPUT, EXIT_GATE = 1, 2, 3
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, like all others."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Refuse arguments that are not text in this locale: they would be names in reports, which are text."""
        for text in sys.argv[1:] if args is None else args:
            if any("\udc80" <= letter <= "\udcff" for letter in text):
                self.error(f"argument {text!r} is not text in this locale; rename the file, or choose a UTF-8 locale")
        return super().parse_known_args(args, namespace)

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
    parser.set_defaults(run=command.run)


def guarded(run: Callable[[], int]) -> int:
    """Run a command; print an error as its one line and return the exit code that its kind has."""
    _ready_streams()
    _show_log()
    try:
        with leaving_at_once():
            code = run()
            sys.stdout.flush()
            return code
    except InputError as error:
        print(error, file=sys.stderr)
        return EXIT_INPUT
    except LocsnnError as error:
        print(error, file=sys.stderr)
        return EXIT_TARGET
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


def _show_log() -> None:
    """Show what the packages log on standard error, where somebody watches: the first run compiles for seconds."""
    if sys.stderr.isatty():
        logging.basicConfig(format="%(message)s")
        for package in ("hw_model", "locsnn_compile"):
            logging.getLogger(package).setLevel(logging.INFO)


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
