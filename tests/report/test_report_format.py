"""Numbers of the report as text: three significant digits, units that suit them, and shares that never claim too much."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from locsnn_compile.report.format import (
    any_value,
    count,
    energy,
    memory,
    plain,
    plural,
    points,
    ratio,
    share,
    time,
    told_apart,
)


@pytest.mark.parametrize(
    ("formatted", "text"),
    [
        pytest.param(energy(0.0), "0 pJ", id="energy-nothing"),
        pytest.param(energy(0.0236), "0.0236 pJ", id="energy-below-the-first-unit"),
        pytest.param(energy(23.6), "23.6 pJ", id="energy-one-operation"),
        pytest.param(energy(999.4), "999 pJ", id="energy-last-of-a-unit"),
        pytest.param(energy(999.5), "1.00 nJ", id="energy-rounds-into-the-next"),
        pytest.param(energy(4378.2), "4.38 nJ", id="energy-nano"),
        pytest.param(energy(936394.0), "936 nJ", id="energy-no-decimals-from-100"),
        pytest.param(energy(10651708.6), "10.7 µJ", id="energy-micro"),
        pytest.param(energy(9.996e6), "10.0 µJ", id="energy-rounding-adds-a-digit"),
        pytest.param(energy(3.34e9), "3.34 mJ", id="energy-milli"),
        pytest.param(energy(5e12), "5.00 J", id="energy-joule"),
        pytest.param(energy(12345e12), "12,345 J", id="energy-no-larger-unit"),
        pytest.param(time(0), "0 ns", id="time-nothing"),
        pytest.param(time(113.0), "113 ns", id="time-nano"),
        pytest.param(time(491127.2), "491 µs", id="time-micro"),
        pytest.param(time(1401416.2), "1.40 ms", id="time-milli"),
        pytest.param(time(5e9), "5.00 s", id="time-seconds"),
        pytest.param(time(4.2e12), "4,200 s", id="time-no-larger-unit"),
        pytest.param(share(0.0), "0 %", id="share-none"),
        pytest.param(share(1.0), "100 %", id="share-all"),
        pytest.param(share(0.5), "50.0 %", id="share-half"),
        pytest.param(share(143 / 144), "99.31 %", id="share-near-all-keeps-two-digits-of-the-rest"),
        pytest.param(share(0.99996), "99.9960 %", id="share-never-rounded-to-all"),
        pytest.param(share(0.999999999999), "> 99.999999 %", id="share-beyond-what-is-shown"),
        pytest.param(share(6.25e-05), "0.0063 %", id="share-small"),
        pytest.param(share(1e-12), "< 0.000001 %", id="share-never-rounded-to-none"),
        pytest.param(count(243630.43), "243,630", id="mean-of-counts"),
        pytest.param(count(12.5), "12.5", id="small-mean"),
        pytest.param(count(7), "7", id="whole"),
        pytest.param(count(0.0), "0", id="zero"),
        pytest.param(ratio(12.666), "12.7", id="ratio"),
        pytest.param(ratio(3567.8), "3,568", id="large-ratio"),
        pytest.param(ratio(0.0), "0", id="no-ratio"),
        pytest.param(memory(267456), "33.4 kB", id="memory"),
        pytest.param(memory(0), "0 B", id="no-memory"),
        pytest.param(points(-0.0069), "−0.69 points", id="fewer-points"),  # noqa: RUF001
        pytest.param(points(0.01), "+1.00 points", id="more-points"),
        pytest.param(points(0.0), "no difference", id="same-points"),
        pytest.param(plural(1, "core"), "1 core", id="one"),
        pytest.param(plural(2, "core"), "2 cores", id="several"),
        pytest.param(any_value(None), "–", id="none"),  # noqa: RUF001
        pytest.param(any_value([0, 1]), "0, 1", id="list"),
        pytest.param(any_value([]), "–", id="empty-list"),  # noqa: RUF001
        pytest.param(any_value(True), "yes", id="bool"),
        pytest.param(any_value(44236.9), "44,236.9", id="float"),
        pytest.param(any_value(0.904785), "0.904785", id="small-float"),
        pytest.param(any_value("text"), "text", id="text"),
        pytest.param(
            plain("a\nb\x1b[0m\u202e\ud800"), r"a\nb\x1b[0m\u202e\ud800", id="unprintable"
        ),
        pytest.param(plain("µ touch 1"), "µ touch 1", id="printable"),
    ],
)
def test_a_value_has_this_text(formatted: str, text: str) -> None:
    assert formatted == text


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        pytest.param(
            (10.0002176, 9.97762, 10.0), ["10.0002", "9.97762", "10"], id="six-digits-will-do"
        ),
        pytest.param((9.99999999, 10.0, 10.0), ["9.99999999", "10", "10"], id="more-digits"),
        pytest.param((1.0, 1.0, 1.0), ["1", "1", "1"], id="equal"),
    ],
)
def test_different_numbers_get_enough_digits_to_look_different(
    values: tuple[float, ...], texts: list[str]
) -> None:
    assert told_apart(values) == texts


@given(st.floats(0, 1, exclude_min=True, exclude_max=True))
def test_a_share_is_never_rounded_to_its_ends(value: float) -> None:
    assert share(value) not in ("0 %", "100 %")
    assert set(share(value)) - set("<> 0.%")


@given(st.floats(1e-3, 1e15))
def test_three_digits_are_kept_and_one_unit_is_chosen(pj: float) -> None:
    pj_per_unit = {"pJ": 1.0, "nJ": 1e3, "µJ": 1e6, "mJ": 1e9, "J": 1e12}
    number, unit = energy(pj).split()
    shown_pj = float(number.replace(",", "")) * pj_per_unit[unit]
    # Three digits are at least 100, so rounding changes at most half of a hundredth, and a little for floats.
    assert abs(shown_pj - pj) <= 0.0051 * pj
