"""The compiled engine of SpiNNaker against the plain one on random networks, and both against numbers by hand.

`network()` is one neuron behind one input line. The ring buffer of its core has 8 slots: a slot collects the weights that
are due in one step, so delays are 1 to 8 steps.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from hw_model.arithmetic.spinnaker import EVENTS, LATENESS_MAX
from hw_model.errors import InputError
from hw_model.spinnaker.fast import play_fast
from hw_model.spinnaker.reference import play_reference
from tests.support.random_spinnaker import PHASE, random_case
from tests.support.small_spinnaker import Synapse, network, population, projection

STRONG = 30_000
"""A stored weight that moves the membrane potential by far more than its unit."""
SLOTS = 8
"""Slots of a ring buffer of `population()`, and so its longest delay in steps."""
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
    delays = projection(
        Synapse(source=0, target=0, weight=STRONG, delay=1),
        Synapse(source=0, target=1, weight=STRONG, delay=3),
    )
    two_neurons = network(populations=(population(size=2),), projections=(delays,))
    spikes_in_step_0 = np.eye(5, 1)  # (steps, lines)
    result = play(two_neurons, PHASE, spikes_in_step_0)
    has_moved = result.potential > 0
    first_steps = has_moved.argmax(axis=0)
    assert first_steps.tolist() == [1, 3]


@pytest.mark.parametrize("play", [play_reference, play_fast])
def test_weights_saturate_synapse_by_synapse(play):
    # A ring buffer holds 65,535: the second and the third addition do not fit.
    synapse = Synapse(source=0, target=0, weight=40_000, delay=1)
    heavy = projection(synapse, synapse, synapse)
    result = play(network(projections=(heavy,)), PHASE, [[1], [0]])
    assert result.events["saturated_weights"] == 2


@pytest.mark.parametrize("play", [play_reference, play_fast])
@pytest.mark.parametrize(
    ("lateness", "delay", "late"),
    [
        pytest.param(1, 1, 1, id="as late as its delay"),
        pytest.param(1, 2, 0, id="less late than its delay"),
        pytest.param(7, 7, 1, id="as late as the longest delay but one"),
        pytest.param(SLOTS, SLOTS, 0, id="a delay of all slots"),
        pytest.param(LATENESS_MAX, SLOTS, 0, id="a delay of all slots, as late as can be"),
    ],
)
def test_a_synapse_comes_too_late_if_its_core_is_behind_by_its_delay(play, lateness, delay, late):
    """A core that is `lateness` steps behind counts a synapse as late if `delay` is no longer than that.

    A delay of all 8 slots wraps to 0 in the three bits that store it, and the machine code never finds a 0 late.
    """
    synapse = projection(Synapse(source=0, target=0, weight=STRONG, delay=delay))
    steps = 20  # more than any spike here is late by, or delayed
    spikes_in_step_0 = np.eye(steps, 1)
    sources = 2  # the line and the neuron
    lateness_of_spikes = np.zeros((steps, sources), dtype=np.int64)
    lateness_of_spikes[0, 0] = lateness
    result = play(network(projections=(synapse,)), PHASE, spikes_in_step_0, lateness_of_spikes)
    assert result.events["late_synapses"] == late


@pytest.mark.parametrize("play", [play_reference, play_fast])
def test_rows_that_do_not_fit_are_refused(play):
    with pytest.raises(InputError) as caught:
        play(network(), PHASE, [[1, 0]])
    assert str(caught.value) == (
        "input spikes: they do not fit the lines ((1, 2) against (rows, 1)). "
        "Give a row of 0 and 1 for each step."
    )
