"""The errors a user can meet, each one line: where, what was measured against which limit, and a way out.

    LocsnnError
    ├── InputError    what was given cannot be read or used: a file, an option, an array.     exit code 2
    └── TargetError   the model is sound, but this chip cannot hold it as asked.              exit code 1

Nothing else is raised on purpose; any other exception is a defect of this project.
"""

from collections.abc import Collection, Iterable, Sequence
from difflib import get_close_matches
from functools import partial
from typing import Any

MAX_PART = 500
"""Most characters of a part of a message."""
MAX_FIX = 2000
"""Most characters of the way out, which may list all that exists."""


class LocsnnError(Exception):
    """``where: what (measured against limit). fix`` - the one shape of every message.

    ``measured`` is the text inside the parentheses, left out where there is no number to show.
    """

    def __init__(self, where: str, what: str, *, measured: str = "", fix: str) -> None:
        self.where = where
        self.what = what
        self.measured = measured
        self.fix = fix
        detail = f" ({_shown(measured)})" if measured else ""
        message = f"{_shown(where)}: {_shown(what)}{detail}. {_shown(fix, MAX_FIX)}"
        super().__init__(message.rstrip())

    def __reduce__(self) -> tuple[Any, ...]:
        # What goes to another process is made again from its parts.
        return partial(type(self), measured=self.measured, fix=self.fix), (self.where, self.what)


def _shown(text: str, longest: int = MAX_PART) -> str:
    """Return a part of a message as it prints: names out of files may hold anything, even what moves the cursor."""
    line = " ".join(text.split())
    if len(line) > longest:
        line = f"{line[:longest]}..."
    return "".join(map(_printable, line))


def _printable(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode("ascii")


class InputError(LocsnnError):
    """Something given by the user cannot be read or used."""


class TargetError(LocsnnError):
    """A sound model that this chip cannot hold as asked."""


def check_most(
    size: float, limit: float, where: str, what: str, *, unit: str = "", fix: str
) -> None:
    """Refuse what was given where a number, ``size`` in ``unit``, is above its limit."""
    if size > limit:
        number = f"{size} {unit}" if unit else f"{size}"
        raise InputError(where, what, measured=f"{number} against {limit}", fix=fix)


def check_same(measured: object, expected: object, where: str, what: str, *, fix: str) -> None:
    """Refuse what was given where something measured is not what it should be."""
    if measured != expected:
        raise InputError(where, what, measured=f"{measured} against {expected}", fix=fix)


def check_range(value: float, low: float, high: float, where: str) -> None:
    """Refuse a number that is not from ``low`` to ``high``."""
    if not low <= value <= high:
        measured = f"got {value} against {low}..{high}"
        raise InputError(where, "it is out of range", measured=measured, fix="Correct the number.")


def check_known(
    where: str, what: str, given: object, known: Collection[str], more: str = ""
) -> None:
    """Refuse a name that is none of those known; None is none. ``more``: a way out besides them."""
    if given is not None and given not in known:
        raise InputError(where, what, fix=did_you_mean(given, known) + more)


def counted(number: int, one: str, many: str = "") -> str:
    """Return a count with its noun: ``1 core``, ``2 cores``."""
    if number == 1:
        return f"{number} {one}"
    return f"{number} {many or f'{one}s'}"


def listed(items: Sequence[str], word: str = "and") -> str:
    """Return ``a, b and c``, or with another word."""
    if len(items) == 1:
        return items[0]
    return f"{', '.join(items[:-1])} {word} {items[-1]}"


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """Return ``Did you mean 'x'?`` for a near miss, else the list of what exists."""
    names = sorted(known)
    close = get_close_matches(str(given), names, n=1)
    return f"Did you mean {close[0]!r}?" if close else f"Choose one of: {', '.join(names)}."
