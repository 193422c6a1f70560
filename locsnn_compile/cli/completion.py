"""``locsnn completion``: print a script that completes commands in your shell.

Print a script that completes options, values and files of our commands in your shell.

example:
  locsnn completion bash > locsnn-completion.sh

Then `source` that file in ~/.bashrc or ~/.zshrc. For fish, write to ~/.config/fish/completions/locsnn.fish.
"""

import argparse
import os

PROGRAMS = ("locsnn", "locsnn-compile")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(list(PROGRAMS), shell=args.shell), end="")
    return 0


def answer_shell(parser: argparse.ArgumentParser) -> None:
    """If a shell asks for completions of a command line, answer and exit; otherwise do nothing."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    import argcomplete

    argcomplete.autocomplete(parser)


def chips(prefix: str, **_: object) -> list[str]:
    """Return the chips that ship, and chip files; all other options without choices complete files."""
    from argcomplete.completers import FilesCompleter

    import hw_model as hw

    return [*hw.chip_names(), *FilesCompleter((".yaml", ".yml"))(prefix)]


def chips_of_all_families(prefix: str, **known: object) -> list[str]:
    """Return the chips that ship, of every family, and chip files."""
    from hw_model.targets.families import FAMILIES, MESHES

    others = [family.names() for family in FAMILIES if family is not MESHES]
    return [*chips(prefix, **known), *(name for names in others for name in names)]
