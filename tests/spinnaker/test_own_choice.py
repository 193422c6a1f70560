"""The shifts that sPyNNaker would choose by itself, and networks stored for other shifts.

The formulas are computed once more here, with scipy's Poisson distribution. That they are sPyNNaker's was checked by
mapping networks with sPyNNaker, see ``test_compiled_for_spinnaker.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import poisson

from locsnn_compile.spinnaker.own_choice import (
    Incoming,
    can_be_played,
    expected_sum,
    own_shifts,
    with_shifts,
)
from tests.support.small_spinnaker import Synapse, network, population, projection


def test_equal_delays_take_the_largest_weight_times_the_most_synapses():
    first = Incoming(3, np.array([1.0, 2.0, 0.5]), delays_vary=False)
    second = Incoming(2, np.array([4.0, 1.0]), delays_vary=False)
    assert expected_sum([first, second]) == 3 * 2.0 + 2 * 4.0
    assert expected_sum([]) == 0.0


@pytest.mark.parametrize("synapses", [40, 400, 3000])
def test_unequal_delays_take_five_deviations_of_a_poisson_number_of_spikes(synapses):
    weights = np.linspace(0.5, 2.0, 50)
    part = Incoming(synapses, weights, delays_vary=True)
    # 30 spikes a second are 0.03 in a step of 1 ms.
    spikes = synapses * 0.03
    limit = round(spikes + 3 * np.sqrt(spikes))
    counted_share = poisson.cdf(limit - 1, spikes)
    # For a single projection, the pooled variance is just that of its weights.
    variance_of_sum = spikes * weights.mean() ** 2 + spikes * weights.var() * counted_share
    expected = spikes * weights.mean() + 5 * np.sqrt(variance_of_sum)
    assert expected_sum([part]) == pytest.approx(expected, rel=1e-9)


def test_the_sum_is_at_least_the_largest_weight():
    single_synapse = Incoming(1, np.array([3.0]), delays_vary=True)
    assert expected_sum([single_synapse]) == 3.0


def test_shifts_are_chosen_by_receptor():
    inhibitory = projection(
        Synapse(source=0, target=0, weight=1 << 14, delay=1), receptor="inhibitory"
    )
    excitatory = projection(
        Synapse(source=0, target=0, weight=1 << 15, delay=1),
        Synapse(source=0, target=0, weight=1 << 14, delay=1),
    )
    cells = population(shifts=(3, 5))
    small = network(populations=(cells,), projections=(excitatory, inhibitory))
    # Weights 8 and 4 nA on one neuron: 2 * 8 = 16 needs 5 bits; 16 nA alone need 5, too.
    assert own_shifts(small) == {"cells": (5, 5)}


def test_other_shifts_store_the_same_currents_and_lose_what_does_not_fit():
    cells = population(shifts=(3, 0))
    # A stored weight of 2^14 with a shift of 3 is 2^14 * 2^(3 - 15) = 4 nA.
    small = network(
        populations=(cells,),
        projections=(projection(Synapse(source=0, target=0, weight=1 << 14, delay=1)),),
    )
    wider = with_shifts(small, {"cells": (5, 0)})
    narrower = with_shifts(small, {"cells": (1, 0)})
    assert wider.projections[0].weight.tolist() == [1 << 12]
    # It would be stored as 2^16, and loses its high bit.
    assert narrower.projections[0].weight.tolist() == [0]
    assert wider.populations[0].shifts == (5, 0)


@pytest.mark.parametrize(("shift", "playable"), [(16, True), (17, False)])
def test_shifts_that_no_witness_has_seen_are_not_played(shift, playable):
    assert can_be_played({"cells": (shift, 0)}) is playable
