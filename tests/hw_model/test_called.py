"""Compiled functions that look at the kinds of their arguments once only are given the same in every call.

Arguments of another kind would be read as if they were of that kind: numbers nobody gave.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
import pytest

import hw_model as hw
from hw_model.engine import compiled, events
from hw_model.streaming import location_phase, session, time_phase
from tests.support.hybrids import random_hybrid

FIRST, CHANNEL = np.zeros((1, 2), np.int64), np.zeros(40, np.int32)
KINDS: dict[str, Callable[[np.ndarray], object]] = {
    "bytes": lambda rows: rows,
    "booleans": lambda rows: rows.astype(bool),
    "long integers": lambda rows: rows.astype(np.int64),
    "floats": lambda rows: rows.astype(np.float32),
    "lists": lambda rows: rows.tolist(),
    "read-only": lambda rows: np.frombuffer(rows.tobytes(), np.uint8).reshape(rows.shape),
    "by columns": np.asfortranarray,
    "every other row": lambda rows: np.repeat(rows, 2, axis=-2)[..., ::2, :],
    "backwards": lambda rows: rows[..., ::-1, :].copy()[..., ::-1, :],
}


class OfOneKind:
    """Calls a compiled function as :func:`compiled.called` does, where it may; ``given`` are the kinds by function."""

    def __init__(self) -> None:
        self.given: dict[object, tuple[object, ...]] = {}

    def __call__(self, function: Callable[..., object], *arguments: object) -> object:
        self._check(function, arguments, self.given.setdefault(function, _kinds(arguments)))
        return compiled.called(function, *arguments)

    def entry(self, function: Callable[..., object], *arguments: object) -> Callable[..., object]:
        code = compiled.entry(function, *arguments)
        first = _kinds(arguments)
        self.given[function] = first

        def checked(*given: object) -> object:
            self._check(function, given, first)
            return code(*given)

        return checked

    def _check(
        self, function: Callable[..., object], given: tuple[object, ...], first: tuple[object, ...]
    ) -> None:
        assert _kinds(given) == first, f"{function.__name__} is given {_kinds(given)} after {first}"


def _kinds(arguments: tuple[object, ...]) -> tuple[object, ...]:
    return tuple(numba.typeof(argument) for argument in arguments)


@pytest.fixture
def watched(monkeypatch):
    watch = OfOneKind()
    for module in (events, session):
        monkeypatch.setattr(module, "called", watch)
    for module in (location_phase, time_phase):
        monkeypatch.setattr(module, "entry", watch.entry)
    return watch


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_recordings_of_every_kind_reach_compiled_code_as_one(watched, kind):
    for seed in range(6):
        program, recording = random_hybrid(seed, channels_per_step=1 + seed % 3)
        expected = hw.simulate(program, recording, engine="reference")
        rows = KINDS[kind](recording)
        for found in (
            hw.simulate(program, rows),
            hw.simulate(program, KINDS[kind](np.stack([recording] * 2))),
        ):
            assert all(np.array_equal(found.spikes[name], np.broadcast_to(spikes, found.spikes[name].shape))
                       for name, spikes in expected.spikes.items())  # fmt: skip
        at_once = hw.Session(program).push(rows)
        by_row = hw.Session(program)
        scores = np.concatenate([by_row.push(row).scores for row in rows])
        assert np.array_equal(at_once.scores, scores)
        assert np.array_equal(scores[-1], expected.scores)
    assert {function.__name__ for function in watched.given} == {
        "list_into",
        "_transpose",
        "weigh",
        "_run",
        "_push",
    }


@pytest.mark.parametrize(
    ("planted", "place"),
    [
        ((np.zeros(4, bool), 4, FIRST, CHANNEL), 0),
        ((np.zeros((1, 4), np.uint8), 4, FIRST, CHANNEL), 0),
        ((np.frombuffer(bytes(4), np.uint8), 4, FIRST, CHANNEL), 0),
        ((np.zeros(8, np.uint8)[::2], 4, FIRST, CHANNEL), 0),
        ((np.zeros(4, np.uint8), 4.0, FIRST, CHANNEL), 1),
        ((np.zeros(4, np.uint8), 4, FIRST.astype(np.int32), CHANNEL), 2),
        ((np.zeros(4, np.uint8), 4, FIRST, CHANNEL.astype(np.int64)), 3),
    ],
    ids=[
        "booleans",
        "two axes",
        "read-only",
        "every other",
        "a float",
        "short starts",
        "long channels",
    ],
)
def test_another_kind_is_found(watched, planted, place):
    right = np.zeros(4, np.uint8), 4, FIRST, CHANNEL
    watched(events.list_into, *right)
    with pytest.raises(AssertionError, match="list_into is given"):
        watched.entry(events.list_into, *right)(*planted)
    with pytest.raises(AssertionError) as caught:
        watched(events.list_into, *planted)
    first = tuple(map(numba.typeof, right))
    other = (*first[:place], numba.typeof(planted[place]), *first[place + 1 :])
    assert str(caught.value).splitlines()[0] == f"list_into is given {other} after {first}"


def test_in_the_tests_every_entry_looks_at_what_it_is_given(monkeypatch):
    right = (np.zeros(4, np.uint8), 4, FIRST, CHANNEL)
    wrong = (np.zeros(8, np.uint8)[::2], 4, FIRST, CHANNEL)
    code = compiled.entry(events.list_into, *right)
    assert code(np.frombuffer(bytes(4), np.uint8), *right[1:]) == code(
        *right
    )  # read-only: it lies in memory as others
    with pytest.raises(TypeError) as caught:
        code(*wrong)
    assert str(caught.value) == "list_into: made for array(uint8, 1d, C), given array(uint8, 1d, A)"
    monkeypatch.delenv(compiled.CHECK_KINDS)
    compiled.entry(events.list_into, *right)(*wrong)
