"""The base classes of immutable types: frozen, compared by fields or by identity, added, and shown in short."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.description.counts import COUNTED, DERIVED
from hw_model.values import Frozen, Shown, Sums


class Point(Frozen):
    x: int
    y: int = 0


class Place(Point, order=True):
    name: str = ""


class Row(Frozen, eq=False):
    cells: np.ndarray


class Short(Shown):
    cells: np.ndarray
    many: int = 1


class Counted(Sums):
    many: int
    by_name: dict[str, int]
    rows: tuple[int, ...] = ()


def test_a_frozen_value_cannot_be_changed():
    point = Point(1)
    with pytest.raises(FrozenInstanceError):
        point.x = 2
    assert replace(point, x=2) == Point(2, 0)


def test_values_are_equal_by_fields_or_by_identity():
    assert Point(1) == Point(1, 0)
    assert len({Point(1), Point(1, 0)}) == 1
    assert Place(1, 2, "a") < Place(1, 2, "b")
    row = Row(np.zeros(2))
    assert row == row
    assert row != Row(np.zeros(2))
    assert Short(row.cells) != Short(row.cells)


def test_the_repr_of_a_shown_value_is_short():
    assert repr(Short(np.zeros(2))) == "Short(cells=<float64 (2,)>)"
    assert repr(Short(np.zeros(2), 3)) == "Short(cells=<float64 (2,)>, many=3)"


class Shaped:
    """It has a shape but no type of numbers, so that it is no array."""

    shape = (2,)

    def __repr__(self) -> str:
        return "Shaped()"


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("a" * 40, repr("a" * 40)),
        ("a" * 41, repr("a" * 40) + "..."),
        ((1, 2, 3, 4), "(1, 2, 3, 4)"),
        ((1, 2, 3, 4, 5), "<5 items>"),
        (range(9), "range(0, 9)"),
        ({"a": 1}, "<1 entry>"),
        (Point(1), "<Point>"),
        (Place(1, 2, "here"), "<Place 'here'>"),
        (np.array(3), "3"),
        (Shaped(), "Shaped()"),
    ],
    ids=["text", "long text", "items", "many items", "range", "mapping", "record", "record with a name", "number", "shape"],
)  # fmt: skip
def test_a_field_is_shown_in_short(value, shown):
    assert repr(Short(value)) == f"Short(cells={shown})"


def test_sums_add_up_field_by_field():
    left = Counted(1, {"a": 1, "b": 2}, (1,))
    right = Counted(2, {"b": 3, "c": 4}, (2, 3))
    assert left + right == Counted(3, {"a": 1, "b": 5, "c": 4}, (1, 2, 3))
    assert left == Counted(1, {"a": 1, "b": 2}, (1,))


def test_counts_are_a_mapping_of_all_names():
    counts = hw.Counts(spikes=3, charge_wraps=2)
    assert list(counts) == [*COUNTED, *DERIVED]
    assert len(counts) == len(dict(counts)) == len(list(counts.items()))
    assert (counts["spikes"], counts.get("wraps"), counts.get("nothing")) == (3, 2, None)
    assert "cycles" in counts
    assert "nothing" not in counts
    assert counts == hw.Counts(spikes=3, charge_wraps=2) != hw.Counts()
