"""What all commands share: one-line errors, exit codes, progress bars."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from locsnn_compile.cli.interrupt import EXIT_INTERRUPTED as EXIT_INTERRUPTED
from locsnn_compile.cli.interrupt import leaving_at_once
from locsnn_compile.errors import InputError, LocsnnError

EXIT_TARGET, EXIT_INPUT, EXIT_GATE = 1, 2, 3


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, like all others."""

    def error(self, message: str) -> NoReturn:
        """Print the one line and exit with 2."""
        print(f"{self.prog}: {message}. See {self.prog} --help.", file=sys.stderr)
        raise SystemExit(EXIT_INPUT)


def guarded(run: Callable[[], int]) -> int:
    """Run a command; print an error as its one line and return the exit code that its kind has."""
    _show_log()
    try:
        with leaving_at_once():
            return run()
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
        # The reader of our output went away: leave without a word, and keep the interpreter from flushing into it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _show_log() -> None:
    """Show what the packages log on standard error, where somebody watches: the first run compiles for seconds."""
    if sys.stderr.isatty():
        logging.basicConfig(format="%(message)s")
        for package in ("hw_model", "locsnn_compile"):
            logging.getLogger(package).setLevel(logging.INFO)


@contextmanager
def progress_bar(title: str, *, show: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Give a callback (done, in all) that moves a bar on standard error; None where nobody watches."""
    if not (show and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
