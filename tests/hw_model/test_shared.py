"""Compiled loops that call other code by its address pass arguments of the types for which it was compiled.

Nothing checks them at run time: other types would be read as if they were these. So each caller is compiled again, and
the types that numba infers for its calls are compared with those of the compiled code.
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
    """Return the types of arguments in each call by address of a compiled function, for all its versions.

    A call by address has two arguments, the address and a tuple, and returns an integer.
    """
    kinds = []
    for signature in function.nopython_signatures:
        # Compile again: code from a cache has no information on the types of its calls.
        function_again = numba.njit(**compiled.OPTIONS)(function.py_func)
        function_again.compile(signature.args)
        annotation = function_again.overloads[signature.args].type_annotation
        for call in annotation.calltypes.values():
            if (
                call is not None
                and len(call.args) == 2
                and call.return_type == numba.int64
                and is_tuple(call.args[1])
            ):
                kinds.append(call.args[1].types)
    return kinds


def is_tuple(kind: object) -> bool:
    """Return whether a type of numba is a tuple of different types."""
    return isinstance(kind, numba.types.Tuple)


@pytest.mark.slow
@pytest.mark.parametrize(
    "loop", [fast.run_recordings, time_phase._run], ids=["simulations", "sessions"]
)
def test_loops_pass_a_tile_the_types_that_it_is_compiled_for(loop):
    program, recording = random_hybrid(0, channels_per_step=1)
    hw.simulate(program, recording)
    hw.Session(program).push(recording)
    kinds = kinds_given(loop)
    assert kinds
    assert set(kinds) <= set(tiles.run_tile.overloads)


@pytest.mark.slow
def test_a_tile_passes_deliveries_the_types_that_they_are_compiled_for():
    for seed in range(6):
        program, recording = random_hybrid(seed, channels_per_step=1)
        hw.simulate(program, recording)
    # This compiles the functions that become part of a tile, such as `deliver`.
    kinds_given(tiles.run_tile)
    kinds = set(kinds_given(delivery.deliver))
    assert kinds
    for function in (delivery.by_lists, delivery.by_rows):
        assert set(function.overloads) <= kinds
    assert delivery.by_lists.overloads


@pytest.mark.slow
def test_replays_pass_pairs_the_types_that_they_are_compiled_for():
    for seed in range(12):
        program, recording = random_hybrid(seed, channels_per_step=1)
        hw.Session(program).push(recording)
    kinds_given(location_phase._push)
    kinds = set(kinds_given(location_phase._run_again))
    assert kinds
    assert set(location_phase._run_pair.overloads) <= kinds


@compiled.shared
def _add(one, two):
    """A function that is called by address, with two integers."""
    return one + two


@numba.njit
def _right(at, x):
    """Call :func:`_add` with the types that it is compiled for."""
    return compiled.call_at(at, (x, x))


@numba.njit
def _wrong(at, x):
    """Call :func:`_add` with another type."""
    return compiled.call_at(at, (x, np.int32(x)))


def test_a_call_with_other_types_is_noticed_by_this_test():
    x = np.int64(5)
    at = compiled.address(_add, x, x)
    assert _right(at, x) == 10
    _wrong.compile("(int64, int64)")
    assert set(kinds_given(_right)) <= set(_add.overloads)
    assert not set(kinds_given(_wrong)) <= set(_add.overloads)
