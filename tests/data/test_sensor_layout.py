"""The layout of the NeuTouch sensor: named orders of its 39 taxels, walks over its channels, and orders that are refused."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locsnn_compile.data.orders import channel_walk, location_order
from locsnn_compile.data.sensor import LOCATION_ORDERS, TAXEL_COORDINATES_MM, TAXELS, neutouch
from locsnn_compile.errors import InputError


@pytest.mark.parametrize("name", sorted(LOCATION_ORDERS))
def test_orders_are_permutations(name: str) -> None:
    assert sorted(LOCATION_ORDERS[name]) == list(range(1, TAXELS + 1))


def test_coordinates_are_those_of_a_symmetric_fingertip() -> None:
    assert len(TAXEL_COORDINATES_MM) == TAXELS
    assert len(set(TAXEL_COORDINATES_MM)) == TAXELS
    # Every taxel has its mirror image across the long axis of the fingertip.
    assert {(x, -y) for x, y in TAXEL_COORDINATES_MM} == set(TAXEL_COORDINATES_MM)


@given(order=st.permutations(range(1, TAXELS + 1)), fingertips=st.integers(1, 3))
@settings(max_examples=30, deadline=None)
def test_walk_is_channel_pairs_in_order(order: list[int], fingertips: int) -> None:
    expected = []
    for fingertip in range(fingertips):
        for taxel in order:
            # Taxels are numbered from 1, and have two channels each.
            first_channel = 2 * TAXELS * fingertip + 2 * (taxel - 1)
            expected += [first_channel, first_channel + 1]
    walk = channel_walk(order, neutouch(fingertips))
    assert walk.tolist() == expected
    assert not walk.flags.writeable


def test_order_loop_visits_channels_in_the_order_of_their_numbers() -> None:
    assert channel_walk(LOCATION_ORDERS["loop"], neutouch(2)).tolist() == list(range(156))


LOOP = list(range(1, 40))


@pytest.mark.parametrize(
    ("order", "message"),
    [
        pytest.param(
            [1, 1, *LOOP[2:]],
            "location order: taxel 1 is repeated at entry 2. "
            "Give every taxel from 1 to 39 exactly once.",
            id="repeated",
        ),
        pytest.param(
            LOOP[1:],
            "location order: taxel 1 is missing (38 of 39 taxels given). "
            "Give every taxel from 1 to 39 exactly once.",
            id="missing",
        ),
        pytest.param(
            [*LOOP[:-1], 40],
            "location order: entry 39 is not a taxel of the sensor (got 40 against 1..39). "
            "Give every taxel from 1 to 39 exactly once.",
            id="out of range",
        ),
        pytest.param(
            [],
            "location order: taxel 1 is missing (0 of 39 taxels given). "
            "Give every taxel from 1 to 39 exactly once.",
            id="empty",
        ),
    ],
)
def test_orders_that_are_no_permutation_are_refused(order: list[int], message: str) -> None:
    with pytest.raises(InputError) as caught:
        channel_walk(order, neutouch(1))
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        pytest.param("arch", ("arch", LOCATION_ORDERS["arch"]), id="arch"),
        pytest.param("loop", ("loop", LOCATION_ORDERS["loop"]), id="loop"),
        pytest.param("whorl", ("whorl", LOCATION_ORDERS["whorl"]), id="whorl"),
        pytest.param(
            ", ".join(map(str, LOOP[::-1])), ("custom", tuple(LOOP[::-1])), id="comma list"
        ),
    ],
)
def test_an_order_is_given_by_its_name_or_as_a_list(
    text: str, expected: tuple[str, tuple[int, ...]]
) -> None:
    assert location_order(text, neutouch()) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(
            "wohrl", "location order: 'wohrl' is not known. Did you mean 'whorl'?", id="misspelt"
        ),
        pytest.param(
            "radial",
            "location order: 'radial' is not known. "
            "Choose one of: arch, hilbert, loop, raster, reverse, snake, spiral, tour, whorl.",
            id="unknown",
        ),
        pytest.param(
            "1,2,x",
            "location order: entry 3 is not a taxel number (got 'x'). "
            "Give taxels separated by commas.",
            id="no number",
        ),
    ],
)
def test_texts_that_are_no_order_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        location_order(text, neutouch())
    assert str(caught.value) == message
