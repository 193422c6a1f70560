"""The compiled engine of SpiNNaker against the plain one on random networks, and both against numbers by hand."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from hw_model.arithmetic.spinnaker import EVENTS
from hw_model.errors import InputError
from hw_model.spinnaker.fast import play_fast
from hw_model.spinnaker.reference import play_reference
from tests.support.random_spinnaker import PHASE, random_case
from tests.support.small_spinnaker import network, population, projection

REGISTERS = ("spikes", "potential", "v", "current", "refractory")
RANDOM_NETWORKS = 60
"""Enough that every event that the arithmetic counts happens in some."""


def test_both_engines_give_the_same_registers_and_counts_whatever_happens():
    total_events = Counter()
    for seed in range(RANDOM_NETWORKS):
        case = random_case(seed)
        plain = play_reference(case.network, PHASE, case.spikes, case.lateness)
        fast = play_fast(case.network, PHASE, case.spikes, case.lateness)
        for name in REGISTERS:
            assert np.array_equal(getattr(plain, name), getattr(fast, name)), (seed, name)
        assert fast.events == plain.events, seed
        total_events.update(plain.events)
    assert all(total_events[event] > 0 for event in EVENTS)


@pytest.mark.parametrize("play", [play_reference, play_fast])
def test_a_delay_acts_so_many_steps_after_its_spike(play):
    delays = projection((0, 0, 30000, 1), (0, 1, 30000, 3))
    two_neurons = network(populations=(population(size=2),), projections=(delays,))
    # One line for 5 steps, which spikes in step 0 only.
    result = play(two_neurons, "run", np.eye(5, 1))
    moved = result.potential > 0
    assert moved.argmax(axis=0).tolist() == [1, 3]


@pytest.mark.parametrize("play", [play_reference, play_fast])
def test_weights_saturate_synapse_by_synapse(play):
    # A ring buffer holds 65,535: the second and the third addition do not fit.
    heavy = projection((0, 0, 40000, 1), (0, 0, 40000, 1), (0, 0, 40000, 1))
    result = play(network(projections=(heavy,)), "run", [[1], [0]])
    assert result.events["saturated_weights"] == 2


@pytest.mark.parametrize("play", [play_reference, play_fast])
@pytest.mark.parametrize(
    ("lateness", "delay", "late"),
    [
        pytest.param(1, 1, 1, id="as late as its delay"),
        pytest.param(1, 2, 0, id="less late than its delay"),
        pytest.param(7, 7, 1, id="as late as the longest delay but one"),
        pytest.param(8, 8, 0, id="a delay of all slots is stored as 0"),
        pytest.param(15, 8, 0, id="and never found late"),
    ],
)
def test_a_spike_is_late_if_its_delay_is_no_longer_than_it_is_late_by(play, lateness, delay, late):
    part = projection((0, 0, 30000, delay))
    # The line spikes in step 0 of 20; sources are the line and the neuron.
    spikes = np.eye(20, 1)
    lateness_of_spikes = np.zeros((20, 2), dtype=np.int64)
    lateness_of_spikes[0, 0] = lateness
    result = play(network(projections=(part,)), "run", spikes, lateness_of_spikes)
    assert result.events["late_synapses"] == late


@pytest.mark.parametrize("play", [play_reference, play_fast])
def test_rows_that_do_not_fit_are_refused(play):
    with pytest.raises(InputError) as caught:
        play(network(), "run", [[1, 0]])
    assert str(caught.value) == (
        "input spikes: they do not fit the lines ((1, 2) against (rows, 1)). "
        "Give a row of 0 and 1 for each step."
    )
