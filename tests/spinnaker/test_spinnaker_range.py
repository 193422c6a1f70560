"""The proven bounds of SpiNNaker's registers: no run exceeds them, some come close, and limits are exact to one unit.

Registers are compared with runs of the compiled engine, and bounds with geometric series in real numbers.
"""

from __future__ import annotations

import numpy as np
import pytest

from hw_model.spinnaker.fast import play_fast
from hw_model.spinnaker.range import reach_of, safe_period
from tests.support.random_spinnaker import PHASE, random_case
from tests.support.small_spinnaker import Synapse, network, parameters, population, projection

SEEDS = range(3000, 3120)
FEWEST_PROVEN = 5
"""How many of the random networks must be proven to fit, lest the test shows little: most are made to overflow."""
SPAN = 2**32
"""1 in the format of the exponentials, u0.32."""


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
    assert proven >= FEWEST_PROVEN


def test_a_current_comes_close_to_its_bound():
    """With a spike of weight 1000 in every step, the current rises to what a step brings over the share it loses."""
    small = network()
    result = play_fast(small, "run", np.ones((400, 1), dtype=np.uint8))
    constants = small.population("cells").constants
    kept = int(constants.synapse_decay[0, 0]) / SPAN
    brought = 1000 * int(constants.synapse_init[0, 0]) / SPAN
    bound = int(reach_of(small, "cells").current[0, 0])
    # A few units of tolerance: the chip rounds down in every step.
    assert bound == pytest.approx(brought / (1 - kept), abs=8)
    # Currents are recorded after the decay of the step.
    highest_before_decay = int(result.current.max()) / kept
    assert bound - 12 <= highest_before_decay <= bound


# By case: weights of synapses onto the neuron, changes to it, and whether it may saturate and may wrap.
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


def test_a_current_comes_close_to_its_bound_for_rarer_spikes():
    """With a spike in every fourth step, the current rises to what a spike brings over the share that four steps lose."""
    small = network()
    rows = np.zeros((400, 1), dtype=np.uint8)
    rows[::4] = 1
    result = play_fast(small, "run", rows)
    constants = small.population("cells").constants
    kept = int(constants.synapse_decay[0, 0]) / SPAN
    brought = 1000 * int(constants.synapse_init[0, 0]) / SPAN
    bound = int(reach_of(small, "cells", period=4).current[0, 0])
    assert bound == pytest.approx(brought / (1 - kept**4), abs=2)
    highest_before_decay = int(result.current.max()) / kept
    assert bound - 8 <= highest_before_decay <= bound


def test_rarer_spikes_wrap_nothing_where_every_step_would():
    """With tau_syn of 200 ms, a current of 65,536 nA needs 400 nA or so in every step.

    A spike brings 2^11 (init / 2^32) nA, and a step keeps d = 1 - 1/200 of it: the current settles at
    2^11 init / (2^32 - d^p 2^32) nA, below 65,536 nA from p = 7 on, which rounds up to the period 8.
    """
    wide = population(parameters=parameters(c_m=400.0, tau_syn=200.0), shifts=(12, 0))
    synapses = projection(Synapse(source=0, target=0, weight=16384, delay=1))
    limited = network(populations=(wide,), projections=(synapses,))
    constants = limited.population("cells").constants
    kept = int(constants.synapse_decay[0, 0]) / SPAN
    # A stored weight of 16,384 with a shift of 12 is 16,384 * 2^(12 - 15) = 2,048 nA.
    brought = 2048 * int(constants.synapse_init[0, 0]) / SPAN
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
    full = network(
        projections=(
            projection(
                Synapse(source=0, target=0, weight=40000, delay=1),
                Synapse(source=0, target=0, weight=40000, delay=1),
            ),
        )
    )
    assert safe_period(full, "cells") == 0
