"""Write numbers as people read them: one function per quantity, used by every form of the report.

Most numbers get three significant digits: energies and times are modelled, and more digits would claim too much. A
share is never rounded up to 100 % or down to 0 %: one wrong spike in a million must not look like none.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")
NONE = "–"  # noqa: RUF001 - an en dash stands for a number that does not exist
"""Shown where there is no number."""
SILENT = "silent"
"""Shown where neither side spikes, so there is no share of equal spikes."""
_WHOLE_FROM = 99.95
"""From here on, three significant digits are a whole number: 99.94 is written 99.9, and 99.95 is written 100."""
_ENERGY_UNITS = ("pJ", "nJ", "µJ", "mJ", "J")
_TIME_UNITS = ("ns", "µs", "ms", "s")
_SIZE_UNITS = ("B", "kB", "MB", "GB")
BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:[pnuµm]?[Js]|[kMG]?B|[kMG]?Hz|%)(?!\w))")
"""The space between a number and its unit, at which no line should break."""
_MOST_DECIMALS = 6
"""Most decimals of a percentage, chosen by hand; nearer to 0 or 100 % only a bound is shown."""


def energy(pj: float) -> str:
    """Return an energy given in picojoules, in the unit that suits it."""
    return _scaled(pj, _ENERGY_UNITS)


def time(ns: float) -> str:
    """Return a time given in nanoseconds, in the unit that suits it."""
    return _scaled(ns, _TIME_UNITS)


def seconds(value: float) -> str:
    """Return a time given in seconds, in the unit that suits it."""
    return time(1e9 * value)


def memory(bits: int) -> str:
    """Return a size given in bits, in bytes of the multiple that suits it (1 kB is 1000 bytes)."""
    return _scaled(bits / 8, _SIZE_UNITS)


def count(value: float) -> str:
    """Return a count or a mean of counts: whole from 100 on, with commas between thousands."""
    if value == int(value) or abs(value) >= _WHOLE_FROM:
        return f"{value:,.0f}"
    return _three_digits(value)


def ratio(value: float) -> str:
    """Return a ratio, without a unit."""
    return _three_digits(value)


def share(value: float) -> str:
    """Return a share of 0..1 as a percentage; only exactly 1 is 100 %, and only exactly 0 is 0 %."""
    if value in (0.0, 1.0):
        return f"{value:.0%}".replace("%", " %")
    percent = 100.0 * value
    # Two significant digits of the distance to the nearer end, so that 99.9987 % does not become
    # 100.0 %; at least one decimal.
    distance_to_end = min(abs(percent), abs(100.0 - percent))
    decimals = max(1, 1 - math.floor(math.log10(distance_to_end)))
    if decimals <= _MOST_DECIMALS:
        return f"{percent:.{decimals}f} %"
    smallest_shown = 10.0**-_MOST_DECIMALS
    if percent > 50:
        return f"> {100 - smallest_shown:.{_MOST_DECIMALS}f} %"
    return f"< {smallest_shown:.{_MOST_DECIMALS}f} %"


def percent(value: float, decimals: int) -> str:
    """Return a share as a percentage with ``decimals`` decimals."""
    return f"{100 * value:.{decimals}f} %"


def known(value: T | None, shown: Callable[[T], str], unknown: str = NONE) -> str:
    """Return a value as the function ``shown`` writes it, or the text ``unknown`` for None."""
    return unknown if value is None else shown(value)


def agreed(value: float | None, unknown: str = SILENT) -> str:
    """Return the share of equal spikes or predictions, or the text ``unknown`` if nothing was compared."""
    return known(value, share, unknown)


def short(value: float) -> str:
    """Return a magnitude with two significant digits and no exponent; below a millionth, only that bound."""
    if value == 0:
        return "0"
    if value < 1e-6:
        return "< 0.000001"
    # Round before counting digits: 9.96 rounds to 10, which needs no decimal.
    rounded = float(f"{value:.1e}")
    decimals = max(0, 1 - math.floor(math.log10(rounded)))
    return f"{value:.{decimals}f}"


def points(difference: float) -> str:
    """Return a difference of two shares in percentage points, with its sign."""
    if difference == 0:
        return "no difference"
    return f"{100 * difference:+.2f} points".replace("-", "−")  # noqa: RUF001 - a minus sign, as wide as the plus


def plural(number: float, one: str, many: str | None = None) -> str:
    """Return a count with its noun: ``1 core``, ``2 cores``; ``many`` is the plural if it is not ``one`` with an s."""
    noun = one if number == 1 else many or f"{one}s"
    return f"{count(number)} {noun}"


def told_apart(values: Sequence[float]) -> list[str]:
    """Return numbers with six digits, or with enough more for different numbers to look different."""
    # Not even 16 digits tell all floats apart; repr does, with 17 where they are needed.
    for digits in range(6, 17):
        texts = [f"{value:.{digits}g}" for value in values]
        if len(set(texts)) == len(set(values)):
            return texts
    return [repr(value) for value in values]


def plain(text: str) -> str:
    """Return a string on one line; characters that cannot be printed are shown as escapes."""
    if text.isprintable():
        return text
    return "".join(_printable(character) for character in text)


def _printable(character: str) -> str:
    if character.isprintable():
        return character
    return character.encode("unicode_escape").decode()


def shortened(text: str, longest: int) -> str:
    """Return a text of at most ``longest`` characters; an ellipsis replaces the rest."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def any_value(value: object) -> str:
    """Return a value of any kind as text: None, a truth value, a number, a text, or a list of these."""
    if value is None:
        return NONE
    if isinstance(value, list | tuple):
        return ", ".join(any_value(item) for item in value) or NONE
    # Before int: True is an int as well.
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,d}"
    if isinstance(value, float):
        return f"{value:,.1f}" if abs(value) >= 1000 else f"{value:.6g}"
    return str(value)


def _scaled(value: float, units: Sequence[str]) -> str:
    """Return a value in the first unit in which it stays below 1000 after rounding."""
    if value == 0:
        return f"0 {units[0]}"
    for unit in units[:-1]:
        # 999.5 rounds to 1000, which is 1 of the next unit.
        if abs(value) < 999.5:
            return f"{_three_digits(value)} {unit}"
        value /= 1000.0
    return f"{_three_digits(value)} {units[-1]}"


def _three_digits(value: float) -> str:
    """Return three significant digits without an exponent; from 100 on whole, with commas between thousands."""
    if value == 0 or abs(value) >= _WHOLE_FROM:
        return f"{value:,.0f}"
    # Round before counting digits: 9.996 rounds to 10.0, which has one decimal.
    rounded = float(f"{value:.2e}")
    decimals = 2 - math.floor(math.log10(abs(rounded)))
    return f"{value:.{decimals}f}"
