"""What is proven of registers of SpiNNaker holds in every run, and says no where it must."""

from __future__ import annotations

import numpy as np
import pytest

from hw_model.spinnaker.fast import play_fast
from hw_model.spinnaker.range import reach_of, safe_period
from tests.support.random_spinnaker import PHASE, random_case
from tests.support.small_spinnaker import network, parameters, population, projection

SEEDS = range(3000, 3120)


def test_no_run_leaves_its_bounds_and_nothing_wraps_where_they_fit():
    proven = 0
    for seed in SEEDS:
        case = random_case(seed)
        result = play_fast(case.network, PHASE, case.spikes, case.lateness)
        reaches = {
            item.name: reach_of(case.network, item.name) for item in case.network.populations
        }
        if not all(reach.fits for reach in reaches.values()):
            continue
        proven += 1
        for event in ("ring_wraps", "current_wraps", "potential_wraps", "saturated_weights"):
            assert result.events[event] == 0, (seed, event)
        for name, columns in case.network.columns_of(PHASE).items():
            current = result.current[:, columns]
            assert (current >= 0).all()
            assert (current <= reaches[name].current).all(), (seed, name)
    assert proven >= 5


def test_a_current_comes_to_its_bound():
    """A spike in every step, weight 1000: what a step brings over what a step loses, from below."""
    one = network()
    result = play_fast(one, "run", np.ones((400, 1), dtype=np.uint8))
    constants = one.population("cells").constants
    kept = int(constants.synapse_decay[0, 0]) / 2**32
    brought = 1000 * int(constants.synapse_init[0, 0]) / 2**32
    bound = int(reach_of(one, "cells").current[0, 0])
    assert bound == pytest.approx(brought / (1 - kept), abs=8)
    highest = int(result.current.max()) / kept  # before the step takes its share
    assert bound - 12 <= highest <= bound


LIMITS = {
    "a sum of 65,535": ((32767, 32768), {}, (False, False)),
    "a sum of 65,536": ((32768, 32768), {}, (True, False)),
    "a shift of 15": (
        (65535,),
        {"shifts": (15, 0), "parameters": parameters(tau_syn=0.09)},
        (False, False),
    ),
    "a shift of 16": (
        (65535,),
        {"shifts": (16, 0), "parameters": parameters(tau_syn=0.09)},
        (False, True),
    ),
    "a goal of 65,535 mV": (
        (),
        {"parameters": parameters(c_m=10.0, v_rest=65535.0)},
        (False, False),
    ),
    "a reset that far from its goal": (
        (),
        {"parameters": parameters(c_m=10.0, v_rest=65535.0, v_reset=-2.0)},
        (False, True),
    ),
}


@pytest.mark.parametrize("case", LIMITS)
def test_saturations_and_wraps_are_excluded_up_to_the_limit(case):
    weights, changes, expected = LIMITS[case]
    synapses = projection(*((0, 0, weight, 1) for weight in weights))
    limited = network(populations=(population(**changes),), projections=(synapses,))
    reach = reach_of(limited, "cells")
    assert (reach.saturates, reach.wraps) == expected
    assert reach.fits == (expected == (False, False))


def test_a_current_comes_to_its_bound_of_rarer_spikes():
    """A spike in every fourth step: what it brings over what four steps lose."""
    one = network()
    rows = np.zeros((400, 1), dtype=np.uint8)
    rows[::4] = 1
    result = play_fast(one, "run", rows)
    constants = one.population("cells").constants
    kept = int(constants.synapse_decay[0, 0]) / 2**32
    brought = 1000 * int(constants.synapse_init[0, 0]) / 2**32
    bound = int(reach_of(one, "cells", 4).current[0, 0])
    assert bound == pytest.approx(brought / (1 - kept**4), abs=2)
    highest = int(result.current.max()) / kept
    assert bound - 8 <= highest <= bound


def test_rarer_spikes_wrap_nothing_where_every_step_would():
    """With tau_syn of 200 ms, a current of 65,536 nA needs 400 nA or so in every step.

    A spike brings 2^11 (init / 2^32) nA, and a step keeps d = 1 - 1/200 of it: the current settles at
    2^11 init / (2^32 - d^p 2^32) nA, below 65,536 nA from p = 7 on, which rounds up to the period 8.
    """
    wide = population(parameters=parameters(c_m=400.0, tau_syn=200.0), shifts=(12, 0))
    synapses = projection((0, 0, 16384, 1))
    limited = network(populations=(wide,), projections=(synapses,))
    constants = limited.population("cells").constants
    kept = int(constants.synapse_decay[0, 0]) / 2**32
    brought = 2048 * int(constants.synapse_init[0, 0]) / 2**32
    settles = {period: brought / (1 - kept**period) for period in (6, 8)}
    assert settles[6] > 65536 > settles[8]
    assert safe_period(limited, "cells") == 8
    for period, wraps in ((1, True), (8, False)):
        rows = np.zeros((3000, 1), dtype=np.uint8)
        rows[::period] = 1
        result = play_fast(limited, "run", rows)
        assert (result.events["current_wraps"] > 0) == wraps, period
        assert result.events["potential_wraps"] == 0 or wraps


def test_a_ring_buffer_that_one_step_fills_has_no_safe_period():
    full = network(projections=(projection((0, 0, 40000, 1), (0, 0, 40000, 1)),))
    assert safe_period(full, "cells") == 0
