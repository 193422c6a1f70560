"""What all commands share: their parser, one-line errors, exit codes, streams and progress bars."""

import argparse
import errno
import gc
import io
import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from hw_model.io.memory import (
    PLAYING_BYTES,
    READING_BYTES,
    check_memory,
    keep_reserve,
    lacks_memory,
    spend_reserve,
    too_little,
)
from hw_model.io.partial import forget_written, written
from locsnn_compile import __version__
from locsnn_compile.cli.completion import answer_shell
from locsnn_compile.cli.interrupt import INTERRUPTED, Ending, ending, leaving_at_once
from locsnn_compile.cli.options import add_options
from locsnn_compile.cli.options_file import read_options
from locsnn_compile.errors import InputError, LocsnnError, counted, did_you_mean, listed

if TYPE_CHECKING:
    from rich.console import Console

# Must be set before numpy is imported. Matrices are small, threads on a busy machine wait for each other, and with one
# thread results do not depend on the number of cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Most objects are modules and live to the end; searching them for garbage took a tenth of the time.
gc.set_threshold(100_000)

EXIT_TARGET, EXIT_INPUT, EXIT_GATE = 1, 2, 3
PLAYING = frozenset({"compile", "explore", "rtl/sim", "run", "stress", "train"})
"""The commands that play recordings, and load the compiled loops for it."""
SHOWN_FILES = 3
"""Files that a line names; of more it gives the number."""
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


class _Help(argparse.RawDescriptionHelpFormatter):
    """A help that breaks lines at blanks only, so that names such as ``locsnn-compile`` stay whole."""

    def _split_lines(self, text: str, width: int) -> list[str]:
        import textwrap

        return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)


class Parser(argparse.ArgumentParser):
    """An argument parser that reads the file of ``--options``, and whose errors are one line like all others."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Refuse unknown arguments, and those that are not text in this locale: they become names in reports."""
        for text in sys.argv[1:] if args is None else args:
            if any("\udc80" <= letter <= "\udcff" for letter in text):
                self.error(
                    f"argument {text!r} is not text in this locale; rename the file, or choose a UTF-8 locale"
                )
        parsed, rest = super().parse_known_args(args, namespace)
        if rest:  # refused here, where the help of the command itself is at hand
            self.error(f"unrecognized arguments: {' '.join(rest)}")
        if "--options" in self._option_string_actions and parsed.options is not None:
            values = read_options(self, parsed.options)
            # argparse sets a default only if the attribute is missing: what is still None after this was not typed.
            typed, _ = super().parse_known_args(args, argparse.Namespace(**dict.fromkeys(values)))
            for name, value in values.items():
                setattr(
                    parsed, name, value if getattr(typed, name) is None else getattr(typed, name)
                )
        for action in self._actions:
            value = getattr(parsed, action.dest, None)
            if "" in (value if isinstance(value, list) else [value]):
                self.error(
                    f"argument {'/'.join(action.option_strings) or action.metavar}: it is empty"
                )
        return parsed, rest

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            fix = did_you_mean(value, action.choices)
            raise argparse.ArgumentError(None, f"{action.metavar} {value!r} is not known. {fix}")

    def error(self, message: str) -> NoReturn:
        """Print the one line and exit with 2."""
        print(
            f"{self.prog}: {message}{'' if message.endswith(('.', '?')) else '.'} See {self.prog} --help.",
            file=sys.stderr,
        )
        raise SystemExit(EXIT_INPUT)


def _docstring_of(command: str) -> str:
    """Return the help of a command: the docstring of its module, which is imported only if the command runs."""
    return Path(__file__).parent.joinpath(f"{command}.py").read_text("utf-8").split('"""')[1]


def texts_of(command: str) -> dict[str, Any]:
    """Return the texts for a command's parser from its docstring: a paragraph below the first line, and the example."""
    _, description, example = _docstring_of(command).split("\n\n", 2)
    return {"description": description, "epilog": example, "formatter_class": _Help}


def add_command(commands: "argparse._SubParsersAction[Any]", command: str) -> None:
    """Add a command: a module of this folder with ``run``, whose docstring is its help, such as ``rtl/sim``."""
    name = command.rpartition("/")[2]
    line = _docstring_of(command).partition("\n")[0]
    parser = commands.add_parser(
        name, help=line.partition(": ")[2].rstrip("."), **texts_of(command)
    )
    declared(parser, name).set_defaults(run=partial(_run, command))


def _run(command: str, args: argparse.Namespace) -> int:
    check_limits(command)
    code: int = import_module(f"{__package__}.{command.replace('/', '.')}").run(args)
    return code


def check_limits(command: str) -> None:
    """Refuse to begin a command that an inherited limit on memory would end in a library, without a word."""
    check_memory(PLAYING_BYTES if command in PLAYING else READING_BYTES)
    keep_reserve()


def declared(parser: Parser, command: str) -> Parser:
    """Return the parser after adding the options of a command and those that all commands have."""
    add_options(parser, command)
    add_common(parser)
    return parser


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add the options that all commands have."""
    help_ = "report on standard error what is being done"
    parser.add_argument("--verbose", action="store_true", default=argparse.SUPPRESS, help=help_)
    parser.add_argument(
        "--version", action="version", version=f"%(prog)s {__version__}", help="print the version"
    )


def guarded(
    parser: Parser, typed: Sequence[str] | None, run: Callable[[argparse.Namespace], int]
) -> int:
    """Run a command, or answer a shell that completes its line; print an error as one line, and return the exit code.

    ``typed``: the words of the command line, by default those of this process.
    """
    _ready_streams()
    forget_written()
    answer_shell(parser)
    try:
        args = parser.parse_args(typed)
        _show_log("verbose" in args)
        with leaving_at_once():
            code = run(args)
            sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, KeyboardInterrupt) or ending() is not None:
            return _code_of_ending(ending() or INTERRUPTED)
        return _code_of(error, sys.argv[1:] if typed is None else typed)
    ended = ending()
    if ended is None or ended is INTERRUPTED:
        return code
    return _code_of_ending(ended)  # the command has tidied up, and said how to go on


def _code_of_ending(ended: Ending) -> int:
    """Print why a command was ended by a signal, and return the exit code."""
    print(interrupted_line() if ended is INTERRUPTED else ended.line, file=sys.stderr)
    return ended.code


def interrupted_line() -> str:
    """Return what is said after Ctrl-C: whether anything was written before."""
    files = written()
    if not files:
        return "Interrupted; nothing was written."
    if len(files) > SHOWN_FILES:
        return f"Interrupted; {counted(len(files), 'file')} had been written."
    return f"Interrupted; {listed([path.name for path in files])} had been written."


def _code_of(error: Exception, typed: Sequence[str]) -> int:
    """Print the line of an error that ended a command, and return the exit code; raise what is a defect of ours."""
    if isinstance(error, LocsnnError):
        print(_as_typed(error, typed), file=sys.stderr)
        return EXIT_INPUT if isinstance(error, InputError) else EXIT_TARGET
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone: exit silently.
        _drop_output()
        return 0
    if lacks_memory(error):
        spend_reserve()
        print(too_little(error), file=sys.stderr)
        return EXIT_INPUT
    if isinstance(error, OSError):
        print(_system_error(error), file=sys.stderr)
        if error.filename is None and error.errno in _NO_ROOM:
            _drop_output()
        return EXIT_INPUT
    raise error


def terminal() -> "Console":
    """Return a console with colours. Unlike rich's, it does not exit with 1 when the reader of our output has gone."""
    from rich.console import Console

    class Terminal(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    console = Terminal()
    console.width = console.width or 80  # some terminals say that they have no columns
    return console


def _as_typed(error: LocsnnError, typed: Sequence[str]) -> LocsnnError:
    """Return an error with the path as typed in place of the bare file name, unless two typed paths have that name."""
    paths = {word.partition("=")[2] if word.startswith("--") else word for word in typed}
    names = [os.path.basename(path.rstrip("/")) for path in paths]
    for path, name in zip(paths, names, strict=True):
        if names.count(name) == 1 and repr(name) in error.where:
            where = error.where.replace(repr(name), repr(path))
            return type(error)(where, error.what, measured=error.measured, fix=error.fix)
    return error


def _system_error(error: OSError) -> LocsnnError:
    """Return a message for an error of the system that no reader or writer has put into words."""
    if error.filename is not None:
        name = (
            os.fsdecode(error.filename)
            if isinstance(error.filename, str | bytes)
            else str(error.filename)
        )
        return InputError(
            f"{name[:60]!r}",
            "it cannot be used",
            measured=error.strerror or "",
            fix="Check the path.",
        )
    if error.errno == errno.ENOENT:
        return InputError(
            "working directory", "it does not exist any more", fix="Change to one that does."
        )
    if error.errno in _NO_ROOM:
        return InputError(
            "standard output", f"it cannot be written: {error.strerror}", fix="Write it elsewhere."
        )
    return InputError(
        "system", f"an operation failed: {error.strerror or type(error).__name__}", fix="Try again."
    )


def _ready_streams() -> None:
    """Cope with closed streams, and print ``?`` for characters that the locale cannot encode."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _drop_output() -> None:
    """Keep the interpreter from flushing, at exit, into an output that accepts nothing."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _show_log(verbose: bool) -> None:
    """Show the log on standard error: all of it if ``verbose``, and on a terminal what takes seconds."""
    if verbose or sys.stderr.isatty():
        logging.basicConfig(format="%(message)s")
        logging.getLogger("locsnn").setLevel(logging.DEBUG if verbose else logging.INFO)


def say(args: argparse.Namespace, document: object, lines: Iterable[str]) -> None:
    """Print what a command found: with ``--json`` all of it, otherwise these lines."""
    import json

    print(json.dumps(document, indent=2, allow_nan=False) if args.json else "\n".join(lines))


Moved = Callable[..., None]
"""Moves a progress bar: called with the work done, the total or None, and a new title if it changed."""


@contextmanager
def progress_bar(title: str, *, show: bool) -> Iterator[Moved | None]:
    """Give a callback (done, total, title) that moves a bar on standard error; None if that is not a terminal."""
    if not (show and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total, now=title: bar.update(
            task, completed=done, total=total, description=now
        )
