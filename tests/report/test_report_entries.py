"""Entries, the types of report.json: writing and reading them are inverse, and documents of another shape are refused.

``Part`` is an entry with every kind of field that entries may have; ``DOCUMENT`` is what it must look like in JSON.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import pytest

from locsnn_compile.errors import InputError
from locsnn_compile.report.figures.entries import (
    INLINED,
    NULLS,
    Entry,
    IfKnown,
    LeftOut,
    keys_of,
    plain,
)
from locsnn_compile.report.figures.typed import typed


class Size(Entry):
    width: int
    height: float


class Named(Entry):
    class_: str


class Part(Entry):
    name: str
    size: Annotated[Size, INLINED]
    from_: tuple[int, int]
    kind: Literal["round", "square"]
    scale: int | float | tuple[float, ...]
    note: IfKnown[str]
    budget: Annotated[Size | None, LeftOut(without="note")]
    energy: Annotated[Size | None, NULLS]
    times: Annotated[Named | None, INLINED, NULLS]
    timed: bool
    parts: Mapping[str, tuple[Size, ...]]
    choice: Size | Named | None


# Fields that end in an underscore have keys that are words of Python; ``note`` and ``budget`` are absent, and
# ``energy`` and ``times`` are written as null keys.
PART = Part(
    name="a",
    size=Size(width=1, height=2.0),
    from_=(3, 4),
    kind="round",
    scale=5,
    note=None,
    budget=None,
    energy=None,
    times=None,
    timed=False,
    parts={"left": (Size(width=6, height=7.0),)},
    choice=None,
)
DOCUMENT = {
    "name": "a",
    "width": 1,
    "height": 2.0,
    "from": [3, 4],
    "kind": "round",
    "scale": 5,
    "energy": {"width": None, "height": None},
    "class": None,
    "timed": False,
    "parts": {"left": [{"width": 6, "height": 7.0}]},
    "choice": None,
}


def test_the_fields_of_an_entry_are_keys_in_their_order():
    assert list(plain(PART).items()) == list(DOCUMENT.items())
    assert keys_of(Part) == [*list(DOCUMENT)[:6], "note", "budget", *list(DOCUMENT)[6:]]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        pytest.param("note", "said", id="left-out-where-none"),
        pytest.param("energy", {"width": 1, "height": 0.5}, id="nulls-where-none"),
        pytest.param("class", "of the inlined", id="inlined-nulls"),
        pytest.param("scale", 0.5, id="a-number"),
        pytest.param("scale", [0.5, 1.5], id="or-two"),
        pytest.param("choice", {"width": 1, "height": 0.5}, id="the-first-type"),
        pytest.param("choice", {"class": "b"}, id="the-second-type"),
        pytest.param("parts", {}, id="no-parts"),
    ],
)
def test_reading_a_document_and_writing_it_again_changes_nothing(key, value):
    document = DOCUMENT | {key: value}
    # The key ``budget`` is absent only where ``note`` is.
    if key == "note":
        document["budget"] = None
    assert plain(typed(Part, document)) == document
    assert typed(Part, DOCUMENT) == PART != typed(Part, document)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param(
            {"width": "1"},
            "report.json: width: it must be a whole number (got '1'). {fix}",
            id="inlined",
        ),
        pytest.param(
            {"parts": {"left": [{"width": 1, "height": None}]}},
            "report.json: parts.left.height: it must be a number (got None). {fix}",
            id="within",
        ),
        pytest.param(
            {"energy": {"width": 1}},
            "report.json: energy: the key 'height' is missing. {fix}",
            id="missing",
        ),
        pytest.param(
            {"from": [1]}, "report.json: from: it must be a list of 2 (got 1). {fix}", id="length"
        ),
        pytest.param(
            {"kind": "rounds"},
            "report.json: kind: 'rounds' is not known. Did you mean 'round'?",
            id="word",
        ),
        pytest.param(
            {"nam": 1}, "report.json: unknown key 'nam'. Did you mean 'name'?", id="unknown"
        ),
        pytest.param(
            {"choice": {"height": 1.0}},
            "report.json: choice: the key 'width' is missing. {fix}",
            id="neither-type",
        ),
    ],
)
def test_a_document_of_another_shape_is_refused_with_the_path_of_the_value(
    changes: dict[str, Any], message: str
):
    with pytest.raises(InputError) as caught:
        typed(Part, DOCUMENT | changes)
    assert str(caught.value) == message.format(fix="Compile it again with this version.")
