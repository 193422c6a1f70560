"""The directive ``command-help PROGRAM``: what ``PROGRAM --help`` prints, taken from the parser itself."""

from __future__ import annotations

from argparse import ArgumentParser

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from locsnn_compile.cli import compile as compile_command
from locsnn_compile.cli import main as locsnn_command


def parsers() -> dict[str, ArgumentParser]:
    """Return every parser, by how its program is called: ``locsnn-compile``, ``locsnn``, ``locsnn train``, ..."""
    locsnn = locsnn_command.parser()
    return {
        "locsnn-compile": compile_command.parser(),
        "locsnn": locsnn,
        **_below("locsnn", locsnn),
    }


def _below(program: str, parser: ArgumentParser) -> dict[str, ArgumentParser]:
    """Return the commands below a parser, and those below a group of commands in its place."""
    found = {}
    for action in parser._actions:
        for name, command in action.choices.items() if isinstance(action.choices, dict) else ():
            called = f"{program} {name}"
            found |= _below(called, command) or {called: command}
    return found


def programs() -> list[str]:
    """Return how all programs are called."""
    return list(parsers())


def help_of(program: str) -> str:
    """Return what ``PROGRAM --help`` prints."""
    return parsers()[program].format_help()


class CommandHelp(SphinxDirective):
    """A block of text with the help of the program that the argument names."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Return the block."""
        text = help_of(self.arguments[0])
        return [nodes.literal_block(text, text, language="text")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
