"""Two builds to be compared by the figures of their reports and programs, of any version, by dotted keys."""

from collections.abc import Iterable
from functools import cached_property
from typing import Any

from hw_model.values import Frozen
from locsnn_compile.errors import InputError
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.flat import Figures, flatten
from locsnn_compile.report.format import NONE, plural

_CONTENTS = "program.contents."
_EVENTS = ("input_events", "transpose_events")
_LARGEST = 1e200
"""Numbers must be smaller, so that ratios of them can be computed."""
Change = tuple[Any, Any]
"""A figure before and after."""


class Build(Frozen):
    """The name of a build, its report, and the figures of its program."""

    name: str
    report: Document
    program: Document

    @cached_property
    def figures(self) -> Figures:
        """Figures of the report by their dotted keys."""
        return flatten(self.report)

    @property
    def timed(self) -> bool:
        """Whether the report knows how long a recording takes; reports of earlier versions do not say."""
        return self.figures.get("latency.timed") is not False

    def number(self, key: str) -> float:
        """Return a number of the report by its dotted key; ``InputError`` if there is none."""
        value: Any = self.figures.get(key)
        if not is_number(value):
            what, fix = f"report.json has no number {key!r}", "Compile it again with this version."
            raise InputError(f"build {self.name!r}", what, fix=fix)
        return float(value)

    def share(self, key: str) -> float | None:
        """Return a share of what was compared; None if the report says that nothing was."""
        return None if self.figures.get(key, 0) is None else self.number(key)

    @property
    def score_error(self) -> float | None:
        """How far class scores are off; None if nothing was compared, and in reports of versions without scores."""
        return self.share("match.score_error") if "match.score_error" in self.figures else None

    def text(self, key: str) -> str:
        """Return a text of the report; a dash if it has no such text."""
        value = self.figures.get(key)
        return value if isinstance(value, str) else NONE


def changes(before: Build, after: Build) -> dict[str, Change]:
    """Return both values of every figure of reports and programs that differs, apart from histograms."""
    a, b = (_figures(build) for build in (before, after))
    keys = [*a, *(key for key in b if key not in a)]
    return {key: (a.get(key), b.get(key)) for key in keys if a.get(key) != b.get(key)}


def contents_changed(changed: Iterable[str], within: str = "") -> list[str]:
    """Return what differs in two programs, if all keys of figures that ``changed`` and begin with ``within`` say that.

    Then figures, which are sums and extremes, are equal, and programs are not.
    """
    keys = [key for key in changed if key.startswith(within)]
    parts = [key.removeprefix(_CONTENTS) for key in keys if key.startswith(_CONTENTS)]
    return parts if len(parts) == len(keys) else []


def percent(before: Any, after: Any) -> str:
    """Return the change of a number in percent; an empty text if either is not a number, or the first is 0."""
    if not (is_number(before) and is_number(after) and before):
        return ""
    return f"{100 * (after / before - 1):+.1f} %"


def is_number(value: Any) -> bool:
    """Tell whether a value is a number to calculate with; reports may hold values of any kind and size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _LARGEST


def _figures(build: Build) -> Figures:
    """Return the figures of a report and its program, without histograms."""
    figures = build.figures | flatten(build.program, "program")
    return {key: value for key, value in figures.items() if "_histogram." not in f"{key}."}


def recordings_words(build: Build) -> str:
    """Return how many recordings a build was checked on, and which."""
    return f"{plural(build.number('match.samples'), 'recording')} of {build.text('match.events_source')}"


def same_recordings(before: Build, after: Build) -> bool:
    """Tell whether recordings have one source and number, and as many events in every phase that both builds have."""
    return recordings_words(before) == recordings_words(after) and agree(
        before, after, "operations.by_branch.", _EVENTS
    )


def same_profile(before: Build, after: Build) -> bool:
    """Tell whether both are priced by a profile of one name and, since chip files may change it, of equal constants."""
    a, b = (build.text("energy.profile") for build in (before, after))
    return a == b and agree(before, after, f"energy.profiles.{a}.")


def same_chip(before: Build, after: Build) -> bool:
    """Tell whether both are for a target of one name, whose registers and cores hold the same."""
    equal_registers = agree(before, after, ("program.registers.", "resources.mesh."))
    # How much of a limit is used is the program's.
    equal_limits = agree(before, after, "resources.limits.", ".limit")
    return before.text("target") == after.text("target") and equal_registers and equal_limits


def agree(
    before: Build, after: Build, begin: str | tuple[str, ...], end: str | tuple[str, ...] = ""
) -> bool:
    """Tell whether figures that both have are equal, by the beginning and the end of their keys."""
    a, b = (_figures(build) for build in (before, after))
    return all(
        a[key] == b[key] for key in a if key in b and key.startswith(begin) and key.endswith(end)
    )
