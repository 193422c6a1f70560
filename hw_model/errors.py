"""The errors a user can meet, each one line: where, what was measured against which limit, and a way out.

    LocsnnError
    ├── InputError    what was given cannot be read or used: a file, an option, an array.     exit code 2
    └── TargetError   the model is sound, but this chip cannot hold it as asked.              exit code 1

Nothing else is raised on purpose; any other exception is a defect of this project.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class LocsnnError(Exception):
    """``where: what (measured against limit). fix`` - the one shape of every message.

    ``measured`` is the text inside the parentheses, left out where there is no number to show.
    """

    def __init__(self, where: str, what: str, *, measured: str = "", fix: str) -> None:
        self.where, self.what, self.measured, self.fix = where, what, measured, fix
        detail = f" ({measured})" if measured else ""
        line = f"{where}: {what}{detail}. {fix}"
        super().__init__(" ".join(line.split()))


class InputError(LocsnnError):
    """Something given by the user cannot be read or used."""


class TargetError(LocsnnError):
    """A sound model that this chip cannot hold as asked."""


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """Return ``Did you mean 'x'?`` for a near miss, else the list of what exists."""
    names = sorted(known)
    close = get_close_matches(given, names, n=1)
    return f"Did you mean {close[0]!r}?" if close else f"Choose one of: {', '.join(names)}."
