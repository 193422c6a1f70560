"""Loops that call the code of a tile where it lies give it arguments of the kinds that it is compiled for.

Nothing else looks: others would be read as if they were of those kinds.
"""

from __future__ import annotations

import numba
import numpy as np
import pytest

import hw_model as hw
from hw_model.engine import compiled, delivery, fast, tiles
from hw_model.streaming import location_phase, time_phase
from tests.support.hybrids import random_hybrid


def kinds_given(function: object) -> list[tuple[object, ...]]:
    """Return the kinds that a compiled function gives to what it calls by its address, for all that it was given."""
    found = []
    for signature in function.nopython_signatures:
        anew = numba.njit(**compiled.OPTIONS)(
            function.py_func
        )  # of what is read from a cache nothing is known
        anew.compile(signature.args)
        for call in anew.overloads[signature.args].type_annotation.calltypes.values():
            if (
                call is not None
                and len(call.args) == 2
                and call.return_type == numba.int64
                and is_tuple(call.args[1])
            ):
                found.append(call.args[1].types)
    return found


def is_tuple(kind: object) -> bool:
    return isinstance(kind, numba.types.Tuple)


@pytest.mark.slow
@pytest.mark.parametrize("loop", [fast._run, time_phase._run], ids=["simulations", "sessions"])
def test_a_tile_is_given_what_it_is_compiled_for(loop):
    program, recording = random_hybrid(0, channels_per_step=1)
    hw.simulate(program, recording)
    hw.Session(program).push(recording)
    kinds = kinds_given(loop)
    assert kinds
    assert set(kinds) <= set(tiles.run_tile.overloads)


@pytest.mark.slow
def test_what_a_tile_calls_is_given_what_it_is_compiled_for():
    for seed in range(6):
        program, recording = random_hybrid(seed, channels_per_step=1)
        hw.simulate(program, recording)
    kinds_given(tiles.run_tile)  # compiles what a tile takes in, of which a cache knows nothing
    given = set(kinds_given(delivery.deliver))
    assert given
    for function in (delivery.by_lists, delivery.by_rows):
        assert set(function.overloads) <= given
    assert delivery.by_lists.overloads


@pytest.mark.slow
def test_pairs_are_given_what_they_are_compiled_for():
    for seed in range(12):
        program, recording = random_hybrid(seed, channels_per_step=1)
        hw.Session(program).push(recording)
    kinds_given(location_phase._push)
    given = set(kinds_given(location_phase._run_again))
    assert given
    assert set(location_phase._run_pair.overloads) <= given


@compiled.shared
def _add(one, two):
    return one + two


@numba.njit
def _right(at, x):
    return compiled.call_at(at, (x, x))


@numba.njit
def _wrong(at, x):
    return compiled.call_at(at, (x, np.int32(x)))


def test_a_call_with_other_kinds_is_found():
    x = np.int64(5)
    at = compiled.address(_add, x, x)
    assert _right(at, x) == 10
    _wrong.compile("(int64, int64)")
    assert [set(kinds_given(one)) <= set(_add.overloads) for one in (_right, _wrong)] == [
        True,
        False,
    ]
