"""What all commands share: their parser, one-line errors, exit codes, streams and progress bars.

``compile.py`` and ``main.py`` make a :class:`Parser` and call :func:`run_guarded`, which runs the
command and turns whatever ends it into a line on standard error and an exit code. Only packages of
the standard library are imported here at the top, besides small modules of ours: the help, shell
completion and errors of usage must not wait for numpy.
"""

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
# Most objects are modules and live to the end: with Python's usual threshold of 700 new objects, searching them for
# garbage took a tenth of the time.
gc.set_threshold(100_000)

EXIT_TARGET = 1
"""The chip cannot hold the model."""
EXIT_INPUT = 2
"""Wrong usage, or an input that cannot be used."""
EXIT_GATE = 3
"""The command is done, but a figure does not meet a bound that was asked for."""
PLAYING = frozenset({"compile", "explore", "rtl/sim", "run", "stress", "train"})
"""The commands that play recordings, and load compiled loops and their memory for it."""
SHOWN_FILES = 3
"""Files that a line names; of more it gives the number. Chosen by hand."""
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Errors of a write that the disk refuses: it is full, the user's quota is used up, or it is broken."""


class _Help(argparse.RawDescriptionHelpFormatter):
    """A help that breaks lines at blanks only, so that names such as ``locsnn-compile`` stay whole.

    Descriptions and examples are printed as they are written in the docstrings of the commands.
    """

    def _split_lines(self, text: str, width: int) -> list[str]:
        # argparse calls this for the help of an option, and offers no public way to change it.
        import textwrap

        return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)


class Parser(argparse.ArgumentParser):
    """An argument parser that reads the file of ``--options``, and whose errors are one line like all others."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Parse a command line, and refuse what would fail later or less clearly.

        argparse calls this for the whole line and for the part that belongs to a command. Arguments
        that it does not know, that are empty, or that are not text are refused.
        """
        self._check_text(sys.argv[1:] if args is None else args)
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            # argparse would refuse them at the end of the whole line, and then refer to the help of
            # ``locsnn`` instead of the help of the command.
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        if "--options" in self._option_string_actions and parsed.options is not None:
            self._add_options_of_file(parsed, args)
        self._check_not_empty(parsed)
        return parsed, unknown

    def _check_text(self, words: Sequence[str]) -> None:
        """Refuse words that are not text in this locale, because they become names in reports."""
        for word in words:
            # Python reads a byte that it cannot decode as one of these 128 surrogates.
            if any("\udc80" <= letter <= "\udcff" for letter in word):
                self.error(
                    f"argument {word!r} is not text in this locale; rename the file, or choose a UTF-8 locale"
                )

    def _add_options_of_file(self, parsed: argparse.Namespace, args: Sequence[str] | None) -> None:
        """Set what the file of ``--options`` gives, except options that were also typed."""
        values = read_options(self, parsed.options)
        # Which options were typed cannot be seen from ``parsed``, which has defaults as well. argparse
        # sets a default only where the attribute is missing, so the line is parsed once more into
        # attributes that are None: what is still None afterwards was not typed.
        typed, _ = super().parse_known_args(args, argparse.Namespace(**dict.fromkeys(values)))
        for name, value in values.items():
            typed_value = getattr(typed, name)
            setattr(parsed, name, value if typed_value is None else typed_value)

    def _check_not_empty(self, parsed: argparse.Namespace) -> None:
        """Refuse an empty argument, which is usually a shell variable that is not set."""
        for action in self._actions:
            value = getattr(parsed, action.dest, None)
            values = value if isinstance(value, list) else [value]
            if "" in values:
                name = "/".join(action.option_strings) or action.metavar
                self.error(f"argument {name}: it is empty")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        # argparse lists all choices and suggests none.
        if action.choices is not None and value not in action.choices:
            fix = did_you_mean(value, action.choices)
            raise argparse.ArgumentError(None, f"{action.metavar} {value!r} is not known. {fix}")

    def error(self, message: str) -> NoReturn:
        """Print the error as one line, without argparse's lines of usage, and exit with 2."""
        full_stop = "" if message.endswith((".", "?")) else "."
        print(f"{self.prog}: {message}{full_stop} See {self.prog} --help.", file=sys.stderr)
        raise SystemExit(EXIT_INPUT)


def _docstring_of(command: str) -> str:
    """Return the help of a command: the docstring of its module, read from the source as text.

    The module is not imported for it: the help of ``locsnn`` would otherwise import all commands.
    """
    source = Path(__file__).parent.joinpath(f"{command}.py").read_text("utf-8")
    return source.split('"""')[1]


def parser_texts(command: str) -> dict[str, Any]:
    """Return the arguments of a command's parser that its docstring gives.

    The docstring is a first line, a paragraph that describes the command, and everything else, which
    begins with the example and is printed below the options.
    """
    _, description, epilog = _docstring_of(command).split("\n\n", 2)
    return {"description": description, "epilog": epilog, "formatter_class": _Help}


def add_command(commands: "argparse._SubParsersAction[Any]", command: str) -> None:
    """Add a command: a module of this folder with ``run``, whose docstring is its help, such as ``rtl/sim``."""
    name = command.rpartition("/")[2]
    # ``locsnn run``: play recordings to a compiled program.
    first_line = _docstring_of(command).partition("\n")[0]
    summary = first_line.partition(": ")[2].rstrip(".")
    parser = commands.add_parser(name, help=summary, **parser_texts(command))
    with_declared_options(parser, name).set_defaults(run=partial(_run, command))


def _run(command: str, args: argparse.Namespace) -> int:
    """Import the module of a command, which may take a second, and run it."""
    check_limits(command)
    module = import_module(f"{__package__}.{command.replace('/', '.')}")
    exit_code: int = module.run(args)
    return exit_code


def check_limits(command: str) -> None:
    """Refuse to begin a command for which a limit on memory (``ulimit -v``) is too low.

    A library that gets no memory while it is loaded may end the process without any message.
    """
    check_memory(PLAYING_BYTES if command in PLAYING else READING_BYTES)
    # Memory to be freed if none is left later, so that there is some for printing the error.
    keep_reserve()


def with_declared_options(parser: Parser, command: str) -> Parser:
    """Return the parser after adding the options of a command and those that all commands have."""
    add_options(parser, command)
    add_common(parser)
    return parser


def add_common(parser: argparse.ArgumentParser) -> None:
    """Add the options that all commands have."""
    help_ = "report on standard error what is being done"
    # Both ``locsnn`` and its commands have this option. With a default, the command's parser would
    # overwrite the value of ``locsnn --verbose COMMAND``; so the attribute is missing if not typed.
    parser.add_argument("--verbose", action="store_true", default=argparse.SUPPRESS, help=help_)
    parser.add_argument(
        "--version", action="version", version=f"%(prog)s {__version__}", help="print the version"
    )


def run_guarded(
    parser: Parser, typed: Sequence[str] | None, run: Callable[[argparse.Namespace], int]
) -> int:
    """Run a command, or answer a shell that completes its line; print an error as one line, and return the exit code.

    ``typed``: the words of the command line, by default those of this process.
    """
    _prepare_streams()
    forget_written()  # of an earlier command in this process, as in a notebook
    answer_shell(parser)
    try:
        args = parser.parse_args(typed)
        _configure_log("verbose" in args)
        with leaving_at_once():
            exit_code = run(args)
            # Within the try: a full disk or a closed pipe is only noticed when the output is flushed.
            sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        # A signal may have turned into another error in a library that was being imported.
        if isinstance(error, KeyboardInterrupt) or ending() is not None:
            return _report_ending(ending() or INTERRUPTED)
        return _report_error(error, sys.argv[1:] if typed is None else typed)
    ended_by = ending()
    if ended_by is None or ended_by is INTERRUPTED:
        # A command may handle Ctrl-C itself: it has then printed how to go on, and chosen its code.
        return exit_code
    # It treats the end of its processor time like Ctrl-C, and does not know the reason.
    return _report_ending(ended_by)


def _report_ending(ended_by: Ending) -> int:
    """Print why a signal ended the command, and return the exit code."""
    print(interrupted_line() if ended_by is INTERRUPTED else ended_by.line, file=sys.stderr)
    return ended_by.code


def interrupted_line() -> str:
    """Return the line for Ctrl-C, which says whether any file had been written before."""
    files = written()
    if not files:
        return "Interrupted; nothing was written."
    if len(files) > SHOWN_FILES:
        return f"Interrupted; {counted(len(files), 'file')} had been written."
    return f"Interrupted; {listed([path.name for path in files])} had been written."


def _report_error(error: Exception, typed: Sequence[str]) -> int:
    """Print the line of an error that ended a command, and return the exit code.

    Any other error is a defect of this program: it is raised again, with its traceback.
    """
    if isinstance(error, LocsnnError):
        print(_with_typed_path(error, typed), file=sys.stderr)
        return EXIT_INPUT if isinstance(error, InputError) else EXIT_TARGET
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone, as in ``locsnn targets | head -1``: exit silently.
        _drop_output()
        return 0
    if lacks_memory(error):
        spend_reserve()  # frees what the next line needs
        print(too_little(error), file=sys.stderr)
        return EXIT_INPUT
    if isinstance(error, OSError):
        print(_system_error(error), file=sys.stderr)
        is_of_standard_output = error.filename is None and error.errno in _NO_ROOM
        if is_of_standard_output:
            _drop_output()
        return EXIT_INPUT
    raise error


def terminal() -> "Console":
    """Return a console with colours.

    Where rich's own would end the process with 1, because the reader of our output has gone, it
    raises an error, which ``_report_error`` treats as for all other output.
    """
    from rich.console import Console

    class Terminal(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    console = Terminal()
    console.width = console.width or 80  # some terminals say that they have no columns
    return console


def _with_typed_path(error: LocsnnError, typed: Sequence[str]) -> LocsnnError:
    """Return an error with the path as typed in place of the bare file name.

    Errors name a file without its folder, because the code that raises them is also used from Python
    and in reports. If two typed paths have this file name, it stays bare: either could be meant.
    """
    # A path is a word of its own, or follows the equals sign in --events=PATH.
    paths = {word.partition("=")[2] if word.startswith("--") else word for word in typed}
    name_of = {path: os.path.basename(path.rstrip("/")) for path in paths}
    names = list(name_of.values())
    for path, name in name_of.items():
        if names.count(name) == 1 and repr(name) in error.where:
            where = error.where.replace(repr(name), repr(path))
            return type(error)(where, error.what, measured=error.measured, fix=error.fix)
    return error


def _system_error(error: OSError) -> LocsnnError:
    """Return a message for an error of the system that no reader or writer has put into words."""
    if error.filename is not None:
        name = str(error.filename)  # it may also be the number of an open file
        if isinstance(error.filename, bytes):
            name = os.fsdecode(error.filename)
        reason = error.strerror or ""
        return InputError(
            f"{name[:60]!r}", "it cannot be used", measured=reason, fix="Check the path."
        )
    # Without a file name, only these operations of ours are left.
    if error.errno == errno.ENOENT:
        return InputError(
            "working directory", "it does not exist any more", fix="Change to one that does."
        )
    if error.errno in _NO_ROOM:
        return InputError(
            "standard output", f"it cannot be written: {error.strerror}", fix="Write it elsewhere."
        )
    reason = error.strerror or type(error).__name__
    return InputError("system", f"an operation failed: {reason}", fix="Try again.")


def _prepare_streams() -> None:
    """Replace closed streams, and print ``?`` for characters that the locale cannot encode."""
    for name in ("stdout", "stderr"):
        # Python sets a stream to None if the shell closed it, as in ``locsnn targets >&-``.
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
    # Tests and notebooks put other objects in its place. Standard error escapes such characters.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def _drop_output() -> None:
    """Send what is left of standard output nowhere.

    Python flushes it at exit. If that fails again, it prints an error and changes the exit code.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _configure_log(verbose: bool) -> None:
    """Show the log on standard error: all of it if ``verbose``; on a terminal, steps that take seconds.

    These are logged at the level INFO, everything else at DEBUG.
    """
    if verbose or sys.stderr.isatty():
        logging.basicConfig(format="%(message)s")
        logging.getLogger("locsnn").setLevel(logging.DEBUG if verbose else logging.INFO)


def print_result(args: argparse.Namespace, document: object, lines: Iterable[str]) -> None:
    """Print the result of a command: with ``--json`` the document, otherwise these lines."""
    import json

    if args.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        print("\n".join(lines))


MoveBar = Callable[..., None]
"""Moves a progress bar: called with the work done, the total or None, and a new title if it changed."""


@contextmanager
def progress_bar(title: str, *, show: bool) -> Iterator[MoveBar | None]:
    """Give a callback that moves a bar on standard error; None unless ``show``, and on a terminal.

    The callback is called with (done, total, title). The bar disappears at the end.
    """
    if not (show and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)

        def move_bar(done: float, total: float | None, new_title: str = title) -> None:
            bar.update(task, completed=done, total=total, description=new_title)

        yield move_bar
