"""How `measure.py`, which writes the table of resources in docs/research/hardware/resources-and-clock.md, shows a failure."""

from __future__ import annotations

import measure
import pytest

from hw_model.errors import InputError, TargetError

# By case: what an error measured, and the reason that the row shows, in which a | would end the cell.
REASONS = {
    "one line": ("no BELs remaining", "no BELs remaining"),
    "several lines": ("first\nsecond\n", "first"),
    "an error after warnings": (
        "Warning: slow\nERROR: Unable to place cell 'a|b'\n1 warning, 1 error",
        "ERROR: Unable to place cell 'a/b'",
    ),
    "an empty line first": ("\n make: *** [fit] Error 1\nmore", "make: *** [fit] Error 1"),
    "nothing measured": ("", "the core cannot be placed"),
}


@pytest.mark.parametrize(("measured", "shown"), REASONS.values(), ids=REASONS)
@pytest.mark.parametrize("kind", [InputError, TargetError])
def test_a_board_that_is_not_placed_takes_one_row(monkeypatch, kind, measured, shown):
    def fails(*_given):
        raise kind(
            "board", "the core cannot be placed", measured=measured, fix="Choose a larger device."
        )

    monkeypatch.setattr(measure, "compiled", lambda *_given: None)
    monkeypatch.setattr(measure, "fit", fails)
    assert (
        measure.placed("icebreaker", 5)
        == f"| `icebreaker` | `objects-hybrid`, `reset` | not placed: {shown} |||||"
    )
