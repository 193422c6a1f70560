"""Checks of options that several commands have; each refusal is one line."""

import math
from argparse import Namespace
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from locsnn_compile.errors import InputError

if TYPE_CHECKING:
    from locsnn_compile.data.recordings import Recordings


def given(args: Namespace, options: Iterable[str]) -> dict[str, Any]:
    """Return the values of those options, as they are typed, that were given."""
    values = {option: getattr(args, option.strip("-").replace("-", "_")) for option in options}
    return {option: value for option, value in values.items() if value is not None}


def check_number(option: str, value: float | None, what: str, holds: Callable[[float], bool], fix: str) -> None:
    """Refuse a number that is not finite, or does not hold."""
    if value is not None and not (math.isfinite(value) and holds(value)):
        raise InputError(option, what, measured=f"got {value:g}", fix=fix)


def check_psi(psi: float | None) -> None:
    """Refuse a rate below 0."""
    check_number("--psi", psi, "it is not a valid rate", lambda x: x >= 0, "Give 0 or more, such as 10.")


def recording_of(asked: int | None, recordings: "Recordings") -> int:
    """Return the number of the recording that is asked for, by default the first; refuse one that is not there."""
    number = asked or 0
    if not 0 <= number < len(recordings):
        measured = f"{len(recordings)} in {recordings.source}"
        fix = f"Count from 0 to {len(recordings) - 1}."
        raise InputError(f"--recording {number}", "there is no such recording", measured=measured, fix=fix)
    return number
