"""``locsnn completion``: print a script that completes commands in your shell.

Print a script that completes options, values and files of our commands in your shell.

example:
  locsnn completion bash > locsnn-completion.sh

Then `source` that file in ~/.bashrc or ~/.zshrc. For fish, write to ~/.config/fish/completions/locsnn.fish.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse
import os

PROGRAMS = ("locsnn", "locsnn-compile")
"""The programs whose command lines the script completes."""


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(list(PROGRAMS), shell=args.shell), end="")
    return 0


def answer_shell(parser: argparse.ArgumentParser) -> None:
    """If a shell asks for completions of a command line, print them and exit; otherwise do nothing.

    The script of ``locsnn completion`` makes the shell run the program with the variable
    ``_ARGCOMPLETE`` set whenever the user presses Tab.
    """
    if "_ARGCOMPLETE" not in os.environ:
        return
    # Only here, because importing it slows every command.
    import argcomplete

    argcomplete.autocomplete(parser)


def chips(prefix: str, **_: object) -> list[str]:
    """Return the included meshes of cores, and chip files that begin with ``prefix``.

    argcomplete calls this for options that name a chip, with keyword arguments that are not needed
    here. It completes the files for all other options without ``choices`` by itself.
    """
    from argcomplete.completers import FilesCompleter

    import hw_model as hw

    return [*hw.chip_names(), *FilesCompleter((".yaml", ".yml"))(prefix)]


def chips_of_all_families(prefix: str, **_: object) -> list[str]:
    """Return the included chips of every family (meshes, Xylo, SpiNNaker), and chip files."""
    from hw_model.targets.families import FAMILIES, MESHES

    completions = chips(prefix)
    for family in FAMILIES:
        if family is not MESHES:  # chips() has these
            completions.extend(family.names())
    return completions
