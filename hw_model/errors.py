"""The errors that a user can meet. Each is one line: where, what was measured against which limit, and a way out.

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
"""Characters of a part of a message; longer ones are cut. Chosen by hand."""
MAX_FIX = 2000
"""Characters of the way out, which may list every name that exists. Chosen by hand."""


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
        # Unpickling calls the class with `args`, the finished message, which is not what __init__ takes:
        # without this no error could come back from a worker process.
        return partial(type(self), measured=self.measured, fix=self.fix), (self.where, self.what)


def _shown(text: str, longest: int = MAX_PART) -> str:
    """Return part of a message on one line, cut, with control characters escaped.

    Names from files may hold any characters, also those that move the cursor of a terminal.
    """
    line = " ".join(text.split())
    if len(line) > longest:
        line = f"{line[:longest]}..."
    return "".join(map(_printable, line))


def _printable(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode("ascii")


class InputError(LocsnnError):
    """A file, an option or an argument that cannot be read or used."""


class TargetError(LocsnnError):
    """A sound model that this chip cannot hold as asked."""


def check_most(
    size: float, limit: float, where: str, what: str, *, unit: str = "", fix: str
) -> None:
    """Raise ``InputError`` if a number, ``size`` in ``unit``, is above its limit."""
    if size > limit:
        number = f"{size} {unit}" if unit else f"{size}"
        raise InputError(where, what, measured=f"{number} against {limit}", fix=fix)


def check_same(measured: object, expected: object, where: str, what: str, *, fix: str) -> None:
    """Raise ``InputError`` if a measured value is not the expected one."""
    if measured != expected:
        raise InputError(where, what, measured=f"{measured} against {expected}", fix=fix)


def check_range(value: float, low: float, high: float, where: str) -> None:
    """Raise ``InputError`` if a number is not within ``low..high``."""
    if not low <= value <= high:
        measured = f"got {value} against {low}..{high}"
        raise InputError(where, "it is out of range", measured=measured, fix="Correct the number.")


def check_known(
    where: str, what: str, given: object, known: Collection[str], more: str = ""
) -> None:
    """Raise ``InputError`` if a name is not a known one; None is accepted.

    ``more`` is a further way out, behind the known names.
    """
    if given is not None and given not in known:
        raise InputError(where, what, fix=did_you_mean(given, known) + more)


def counted(number: int, one: str, many: str = "") -> str:
    """Return a count with its noun: ``1 core``, ``2 cores``."""
    if number == 1:
        return f"{number} {one}"
    return f"{number} {many or f'{one}s'}"


def listed(items: Sequence[str], word: str = "and") -> str:
    """Return ``a, b and c``, or with another word than "and"."""
    if len(items) == 1:
        return items[0]
    return f"{', '.join(items[:-1])} {word} {items[-1]}"


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """Return ``Did you mean 'x'?`` if a known name is similar, else the list of known names."""
    names = sorted(known)
    close = get_close_matches(str(given), names, n=1)
    return f"Did you mean {close[0]!r}?" if close else f"Choose one of: {', '.join(names)}."
