"""What a model or a program expects of recordings, and what becomes of options and files that say otherwise."""

import math
from typing import Any

from hw_model.values import Frozen
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError


class Expected(Frozen):
    """How a model takes recordings; None where it does not say. ``whose`` names it: ``model 'slip'``.

    - ``step_seconds``: width of a bin; ``threshold``: a bin is 1 where it has more events
    - ``steps`` of a recording, None where it takes any number; ``channels``
    - ``polarities`` of a taxel and ``columns`` of a grid, for events with x and y; ``class_names``
    """

    whose: str
    step_seconds: float | None = None
    threshold: int | None = None
    steps: int | None = None
    channels: int | None = None
    class_names: tuple[str, ...] | None = None
    polarities: int | None = None
    columns: int | None = None

    def agreed(self, **asked: float | None) -> dict[str, Any]:
        """Return each option as asked for, or as the model has it; ``InputError`` where both say it and differ."""
        for name, value in asked.items():
            own = getattr(self, name)
            if value is not None and own is not None and not same(value, own):
                raise InputError(
                    name, f"{self.whose} has another", measured=f"got {value:g} against {own:g}", fix="Leave it out."
                )
        return {name: getattr(self, name) if value is None else value for name, value in asked.items()}

    def check(self, recordings: Recordings) -> None:
        """Refuse classes of other names, and bins of another width, where the model has recordings of one length.

        A network that takes recordings of any length only sees steps; how long each was is for its user to know. What
        is known of one side only is not compared.
        """
        names = recordings.class_names
        if self.class_names is not None and names is not None and names != self.class_names:
            what = f"their classes have other names than those of {self.whose}"
            measured = f"{', '.join(names)[:80]} against {', '.join(self.class_names)[:80]}"
            fix = "Give recordings of the same classes, in the same order."
            raise InputError(f"recordings {recordings.source!r}", what, measured=measured, fix=fix)
        own, given = self.step_seconds, recordings.step_seconds
        if self.steps is not None and own is not None and given is not None and not same(own, given):
            raise InputError(
                f"recordings {recordings.source!r}",
                f"their steps are not as long as those of {self.whose}",
                measured=f"{given:g} s against {own:g} s",
                fix="Give recordings that were binned for it, or their single events.",
            )


OPEN = Expected("no model")
"""Expects nothing."""


def same(a: float, b: float) -> bool:
    """Return whether two numbers are equal, whatever floats make of their decimals."""
    return math.isclose(a, b, rel_tol=1e-9)
