"""Look up figures of two builds, and find those that differ, for ``locsnn diff``.

A build is the folder that ``locsnn build`` writes; ``cli/diff.py`` reads its files. Its figures are those of
report.json and of the program, by dotted keys such as ``energy.per_sample_pj``. The reports may come from other
versions, so a figure may be missing or of another type, and nothing here assumes a key without checking it.
"""

from collections.abc import Iterable
from functools import cached_property
from typing import Any

from hw_model.values import Frozen
from locsnn_compile.errors import InputError
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.flat import Figures, flatten
from locsnn_compile.report.format import NONE, plural

_CONTENTS = "program.contents."
"""The beginning of the keys of checksums, which tell that programs differ where no other figure does."""
_EVENTS = ("input_events", "transpose_events")
"""Ends of keys that count the events of recordings."""
_LARGEST = 1e200
"""Numbers must be smaller. JSON may hold integers of any size, and Python raises OverflowError where it divides one
that no float can hold. Sums and percentages of smaller numbers are finite; only a quotient by a tiny number may be inf.
"""
Change = tuple[Any, Any]
"""The value of a figure before and after; None where a build does not have it."""


class Build(Frozen):
    """The name of a build, its report, and the figures of its program (see ``figures/any_program.py``)."""

    name: str
    report: Document
    program: Document

    @cached_property
    def figures(self) -> Figures:
        """The figures of the report by their dotted keys."""
        return flatten(self.report)

    @property
    def timed(self) -> bool:
        """Whether the report knows how long a recording takes.

        Reports of earlier versions do not have the key. They are taken to know the time: if they do not have it either,
        :meth:`number` raises an error.
        """
        return self.figures.get("latency.timed") is not False

    def number(self, key: str) -> float:
        """Return a number of the report by its dotted key. Raise InputError if there is none."""
        value: Any = self.figures.get(key)
        if not is_number(value):
            raise InputError(
                f"build {self.name!r}",
                f"report.json has no number {key!r}",
                fix="Compile it again with this version.",
            )
        return float(value)

    def share(self, key: str) -> float | None:
        """Return a share, such as an agreement, by its dotted key; None if the report says that nothing was compared.

        Raise InputError if the key is missing, unlike a key whose value is null.
        """
        is_null = key in self.figures and self.figures[key] is None
        return None if is_null else self.number(key)

    @property
    def score_error(self) -> float | None:
        """How far class scores are off; None if nothing was compared, and in reports of versions without scores."""
        return self.share("match.score_error") if "match.score_error" in self.figures else None

    def text(self, key: str) -> str:
        """Return a text of the report by its dotted key; a dash if it has no such text."""
        value = self.figures.get(key)
        return value if isinstance(value, str) else NONE


def changes(before: Build, after: Build) -> dict[str, Change]:
    """Return both values of every figure of reports and programs that differs, apart from histograms.

    The order is that of the first build, followed by the figures that only the second has.
    """
    figures_before = _figures(before)
    figures_after = _figures(after)
    keys = dict.fromkeys((*figures_before, *figures_after))
    both = {key: (figures_before.get(key), figures_after.get(key)) for key in keys}
    return {key: change for key, change in both.items() if change[0] != change[1]}


def contents_changed(changed: Iterable[str], within: str = "") -> list[str]:
    """Return the parts of the program, such as arrays, whose checksums alone show that they differ.

    ``changed`` are the keys of figures that differ, of which only those that begin with ``within`` count. If all
    of them are checksums, every other figure is equal although the programs are not, which a reader must be told:
    the result has the parts. If any of them is another figure, that figure shows the difference, and the result is
    empty; so it is if nothing changed.
    """
    keys = [key for key in changed if key.startswith(within)]
    parts = [key.removeprefix(_CONTENTS) for key in keys if key.startswith(_CONTENTS)]
    has_only_checksums = len(parts) == len(keys)
    return parts if has_only_checksums else []


def percent(before: Any, after: Any) -> str:
    """Return the change of a number in percent; an empty text if either is not a number, or the first is 0."""
    if not (is_number(before) and is_number(after) and before):
        return ""
    return f"{100 * (after / before - 1):+.1f} %"


def is_number(value: Any) -> bool:
    """Whether a value is a number that can be calculated with; reports may hold values of any type and size."""
    # True and False are int in Python; NaN is not below any number.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST


def _figures(build: Build) -> Figures:
    """Return the figures of a report and its program, without histograms.

    Every bin of a histogram is a figure; dozens of small changes would hide what matters.
    """
    figures = build.figures | flatten(build.program, "program")
    # The dot lets the key of a histogram without bins match as well.
    return {key: value for key, value in figures.items() if "_histogram." not in f"{key}."}


def recordings_words(build: Build) -> str:
    """Return on how many recordings a build was checked, and on which."""
    recordings = plural(build.number("match.samples"), "recording")
    return f"{recordings} of {build.text('match.events_source')}"


def same_recordings(before: Build, after: Build) -> bool:
    """Whether two builds were checked on the same recordings, as far as their reports show.

    A report does not hold the recordings. So their source and number must be the same, and the number of
    events in every phase that both builds have.
    """
    if recordings_words(before) != recordings_words(after):
        return False
    # In reports, a branch is a phase of the program.
    return agree(before, after, "operations.by_branch.", _EVENTS)


def same_profile(before: Build, after: Build) -> bool:
    """Whether the energies of both builds are computed with the same costs.

    An equal name is not enough, because a chip file may change the constants of a profile.
    """
    profile = before.text("energy.profile")
    if profile != after.text("energy.profile"):
        return False
    return agree(before, after, f"energy.profiles.{profile}.")


def same_chip(before: Build, after: Build) -> bool:
    """Whether both builds are for targets of the same name, registers, mesh and limits."""
    has_equal_registers = agree(before, after, ("program.registers.", "resources.mesh."))
    # Only the limits themselves: how much of them is used depends on the program.
    has_equal_limits = agree(before, after, "resources.limits.", ".limit")
    has_equal_name = before.text("target") == after.text("target")
    return has_equal_name and has_equal_registers and has_equal_limits


def agree(
    before: Build, after: Build, begin: str | tuple[str, ...], end: str | tuple[str, ...] = ""
) -> bool:
    """Whether figures are equal whose keys have one of these beginnings and ends, where both builds have them."""
    figures_before = _figures(before)
    figures_after = _figures(after)
    return all(
        value == figures_after[key]
        for key, value in figures_before.items()
        if key in figures_after and key.startswith(begin) and key.endswith(end)
    )
