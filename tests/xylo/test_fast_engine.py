"""The compiled engine of Xylo against the plain one on random networks, and against what xylosim was recorded to do.

xylosim is the vendor's simulator; a record of what it did with a network is called a *witness*.
"""

from __future__ import annotations

import numpy as np
import pytest

from hw_model.arithmetic import xylo
from hw_model.errors import InputError
from hw_model.xylo.fast import play_fast
from hw_model.xylo.reference import play_xylo
from tests.support.numbered_arrays import read
from tests.support.random_xylo import random_xylo
from tests.support.witness_files import RECORDED, RECORDED_COMPILED, REGISTERS, network_of

WITNESSES = [*read(RECORDED), *read(RECORDED_COMPILED)]


SEEDS_PER_TEST = 40


@pytest.mark.slow
@pytest.mark.parametrize("first_seed", range(2000, 2200, SEEDS_PER_TEST))
def test_both_engines_give_the_same_registers_and_counts(first_seed):
    for seed in range(first_seed, first_seed + SEEDS_PER_TEST):
        network, events = random_xylo(seed)
        plain = play_xylo(network, events)
        compiled = play_fast(network, events)
        for name in REGISTERS:
            assert np.array_equal(getattr(plain, name), getattr(compiled, name)), (seed, name)
        assert compiled.events == plain.events, seed


@pytest.mark.parametrize("number", range(len(WITNESSES)))
def test_every_register_of_every_row_is_that_of_the_witness(number):
    witness = WITNESSES[number]
    result = play_fast(network_of(witness), witness["events"])
    for name in REGISTERS:
        assert np.array_equal(getattr(result, name), witness[name]), name


def test_a_recording_without_rows_does_nothing():
    network, events = random_xylo(2)
    result = play_fast(network, events[:0])
    assert result.spikes.shape == (0, network.hidden.size)
    assert result.events == dict.fromkeys(xylo.EVENTS, 0)


def test_events_must_fit_the_inputs():
    network, _ = random_xylo(2)
    inputs = len(network.weights_in)
    with pytest.raises(InputError) as error:
        play_fast(network, np.full((3, inputs), -1))
    assert str(error.value) == (
        f"input events: they do not fit the inputs ((3, {inputs}) against (rows, {inputs})). Give "
        "a row of counts, 0 or more, for each step."
    )
