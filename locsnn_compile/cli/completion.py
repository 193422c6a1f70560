"""``locsnn completion``: print a script that completes commands in your shell.

Print a script that completes options, values and files of our commands in your shell.

example:
  locsnn completion bash > locsnn-completion.sh

Then `source` that file in ~/.bashrc or ~/.zshrc. For fish, write to ~/.config/fish/completions/locsnn.fish.
"""

import argparse
import os
from collections.abc import Callable, Iterable, Iterator, Sequence

from locsnn_compile.backends import EMIT_KINDS
from locsnn_compile.cli.explore import ENGINES, PARTS
from locsnn_compile.cli.run import STOPS
from locsnn_compile.errors import check_known
from locsnn_compile.settings import AUTO, STRATEGIES

SHELLS = ("bash", "zsh", "fish")
PROGRAMS = ("locsnn", "locsnn-compile")
WORDS = {"shells": ", ".join(SHELLS)}
"""Fill the placeholders in this command's options."""


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    check_known(f"shell {args.shell!r}", "there is no completion for it", args.shell, SHELLS)
    from argcomplete.shell_integration import shellcode

    print(shellcode(list(PROGRAMS), shell=args.shell), end="")
    return 0


def answer_shell(parser: argparse.ArgumentParser) -> None:
    """If a shell asks for completions of a command line, answer and exit; otherwise do nothing."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    import argcomplete

    for action in _actions(parser):
        for option in action.option_strings or (action.dest,):
            if option in _VALUES:
                action.completer = _completer(_VALUES[option])  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        yield action
        if isinstance(action.choices, dict):
            for below in action.choices.values():
                yield from _actions(below)


def _completer(values: Sequence[str] | Callable[[str], Iterable[str]]) -> Callable[..., list[str]]:
    return lambda prefix, **_: list(values(prefix) if callable(values) else values)


def _chips(prefix: str) -> Iterable[str]:
    from argcomplete.completers import FilesCompleter

    import hw_model as hw

    return *hw.chip_names(), *FilesCompleter((".yaml", ".yml"))(prefix)


_VALUES: dict[str, Sequence[str] | Callable[[str], Iterable[str]]] = {
    "--target": _chips,
    "--show": _chips,
    "--emit": EMIT_KINDS,
    "--stop": STOPS,
    "--engine": ENGINES,
    "--engines": ENGINES,
    "--part": PARTS,
    "--strategy": (AUTO, *STRATEGIES),
    "shell": SHELLS,
}
"""The values of options and arguments. All others that take a value are completed as files."""
