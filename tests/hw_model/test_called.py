"""Machine code that is called without a check of its arguments gets the same types in every call.

Arguments of other types would be read as if they were of the first call's types: garbage. Recordings of
every type, order in memory and container are played while a stand-in watches the types.
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

FIRST = np.zeros((1, 2), np.int64)
"""Room for where the list of each row begins."""
CHANNEL = np.zeros(40, np.int32)
"""Room for the channels of events."""
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
    """Stands in for :func:`compiled.called` and :func:`compiled.entry`, and asserts that types never change.

    ``kinds_of`` holds the types of the arguments of the first call, by function.
    """

    def __init__(self) -> None:
        self.kinds_of: dict[object, tuple[object, ...]] = {}

    def __call__(self, function: Callable[..., object], *arguments: object) -> object:
        self._check(function, arguments, self.kinds_of.setdefault(function, _kinds(arguments)))
        return compiled.called(function, *arguments)

    def entry(self, function: Callable[..., object], *arguments: object) -> Callable[..., object]:
        code = compiled.entry(function, *arguments)
        first = _kinds(arguments)
        self.kinds_of[function] = first

        def checked(*given: object) -> object:
            self._check(function, given, first)
            return code(*given)

        return checked

    def _check(
        self, function: Callable[..., object], given: tuple[object, ...], first: tuple[object, ...]
    ) -> None:
        assert _kinds(given) == first, f"{function.__name__} is given {_kinds(given)} after {first}"


def _kinds(arguments: tuple[object, ...]) -> tuple[object, ...]:
    """Return numba's types of some arguments."""
    return tuple(numba.typeof(argument) for argument in arguments)


@pytest.fixture
def watched(monkeypatch):
    """A watch that stands in for all calls of machine code from Python."""
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
        alone = hw.simulate(program, rows)
        batch = hw.simulate(program, KINDS[kind](np.stack([recording] * 2)))
        for name, spikes in expected.spikes.items():
            assert np.array_equal(alone.spikes[name], spikes), name
            assert np.array_equal(batch.spikes[name], np.stack([spikes] * 2)), name
        at_once = hw.Session(program).push(rows)
        by_row = hw.Session(program)
        scores = np.concatenate([by_row.push(row).scores for row in rows])
        assert np.array_equal(at_once.scores, scores)
        assert np.array_equal(scores[-1], expected.scores)
    assert {function.__name__ for function in watched.kinds_of} == {
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
def test_arguments_of_other_types_are_noticed_by_this_test(watched, planted, place):
    right = np.zeros(4, np.uint8), 4, FIRST, CHANNEL
    watched(events.list_into, *right)
    with pytest.raises(AssertionError, match="list_into is given"):
        watched.entry(events.list_into, *right)(*planted)
    with pytest.raises(AssertionError) as caught:
        watched(events.list_into, *planted)
    first = tuple(map(numba.typeof, right))
    other = (*first[:place], numba.typeof(planted[place]), *first[place + 1 :])
    assert str(caught.value).splitlines()[0] == f"list_into is given {other} after {first}"


def test_entries_check_their_arguments_in_the_tests_only(monkeypatch):
    right = (np.zeros(4, np.uint8), 4, FIRST, CHANNEL)
    wrong = (np.zeros(8, np.uint8)[::2], 4, FIRST, CHANNEL)
    code = compiled.entry(events.list_into, *right)
    # Read-only arrays are accepted, as they lie in memory like others.
    assert code(np.frombuffer(bytes(4), np.uint8), *right[1:]) == code(*right)
    with pytest.raises(TypeError) as caught:
        code(*wrong)
    assert str(caught.value) == "list_into: made for array(uint8, 1d, C), given array(uint8, 1d, A)"
    monkeypatch.delenv(compiled.CHECK_KINDS)
    compiled.entry(events.list_into, *right)(*wrong)
