"""Parameters of IF_curr_exp with which it acts like a neuron of ``loihi``: nothing wraps, and the gain is right.

Scales and bounds are computed once more with exact fractions; time constants are compared with their neighbours.
"""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_model.arithmetic import spinnaker
from hw_model.arithmetic import spinnaker_inverse as inverse
from hw_model.arithmetic.spinnaker import ONE, SPAN, expk, expulr
from hw_model.arithmetic.spinnaker_inverse import LeakyNeuron, Scales, Sums

SUMS = st.builds(Sums, st.integers(0, 200_000), st.integers(0, 200_000))
NEURONS = st.builds(
    LeakyNeuron,
    decay_u=st.one_of(st.just(4096), st.integers(6, 4096)),
    decay_v=st.integers(1, 4096),
    threshold=st.integers(0, (1 << 17) - 1),
    bias=st.integers(-(1 << 19), 1 << 19),
    refractory=st.integers(1, 63),
)


def scales_of(neuron: LeakyNeuron, sums: Sums) -> Scales:
    """Return the scales that the compiler chooses for a population of this one neuron."""
    weight = inverse.weight_scale(inverse.membrane_of(neuron.decay_u, neuron.decay_v), sums)
    return Scales(weight, inverse.potential_scale(neuron, sums, weight))


def stored(neuron: LeakyNeuron, scales: Scales) -> spinnaker.Parameters:
    """Return one neuron as a core gets it."""
    membrane = inverse.membrane_of(neuron.decay_u, neuron.decay_v)
    fitted = inverse.fitted(neuron, scales)
    zero = np.zeros(1, dtype=np.int64)
    return spinnaker.Parameters(
        tau_m=np.array([membrane.tau_m]),
        c_m=np.array([fitted.c_m]),
        tau_syn=np.array([[membrane.tau_syn] * 2]),
        v_rest=zero,
        v_reset=zero,
        v_thresh=np.array([fitted.v_thresh]),
        v_init=zero,
        i_offset=np.array([fitted.i_offset]),
        tau_refrac=inverse.refractory_time(np.array([neuron.refractory])),
    )


@given(decay_v=st.integers(1, 4096))
def test_no_longer_time_constant_keeps_the_same_of_a_potential(decay_v):
    tau_m = inverse.longest_tau_m(decay_v)
    assert expk(-((1 << 30) // tau_m)) == 8 * (4096 - decay_v)
    if tau_m < 1 << 30:
        assert expk(-((1 << 30) // (tau_m + 1))) > 8 * (4096 - decay_v)


@given(decay_u=st.integers(6, 4096), step=st.integers(-2000, 2000))
def test_no_time_constant_is_nearer_to_the_decay_of_a_current(decay_u, step):
    # What a step keeps of 4096, as a number of 32 fractional bits.
    wanted = (4096 - decay_u) << 20
    tau = inverse.nearest_tau_syn(decay_u)
    error = abs(expulr(-((1 << 30) // tau)) - wanted)
    other_tau = min(max(tau + step, 1), 1 << 30)
    assert abs(expulr(-((1 << 30) // other_tau)) - wanted) >= error
    # The largest error of any decay.
    assert error / SPAN <= 1.51e-5


@pytest.mark.parametrize("decay_u", [6, 7, 379, 2047, 4095, 4096])
def test_the_error_of_a_decay_is_a_distance(decay_u):
    """It is never negative, whether the core keeps more or less than the page of ``loihi``."""
    tau = inverse.nearest_tau_syn(decay_u)
    kept = expulr(-((1 << 30) // tau))
    assert inverse.current_decay_error(decay_u) == abs(kept - ((4096 - decay_u) << 20)) / SPAN


def test_the_errors_of_decays_have_both_signs():
    kept_too_much = [
        expulr(-((1 << 30) // inverse.nearest_tau_syn(decay))) > (4096 - decay) << 20
        for decay in (6, 7, 379, 2047, 4095, 4096)
    ]
    assert set(kept_too_much) == {False, True}


def test_a_current_that_keeps_nothing_and_a_potential_that_keeps_nothing_are_exact():
    membrane = inverse.membrane_of(decay_u=4096, decay_v=4096)
    assert (membrane.synapse_decay, membrane.membrane_decay) == (0, 0)
    # In ms: e^(-1 / 0.09616) is below what the formats can hold.
    assert round(membrane.tau_m / ONE, 5) == 0.09616
    assert round(membrane.tau_syn / ONE, 5) == 0.09616


@pytest.mark.slow
@given(neuron=NEURONS, sums=SUMS)
def test_nothing_wraps_however_inputs_come_at_the_scales_of_the_bounds(neuron, sums):
    scales = scales_of(neuron, sums)
    parameters = stored(neuron, scales)
    constants = spinnaker.constants(parameters)
    assert inverse.fitted(neuron, scales).c_m >= 64
    assert constants.resistance[0] == (int(parameters.tau_m[0]) << 15) // int(parameters.c_m[0])
    sums_na = [largest_sum * scales.weight_unit for largest_sum in sums]
    shifts = [inverse.shift_for(sum_na) for sum_na in sums_na]
    excitation, inhibition = (
        inverse.stored_weights(np.array([sum_na]), shift)[0]
        for sum_na, shift in zip(sums_na, shifts, strict=True)
    )
    state = spinnaker.State(
        np.zeros(1, np.int64), np.zeros((1, 2), np.int64), np.zeros(1, np.int64)
    )
    for t in range(400):
        # For 200 steps all excitation, then for 200 steps all inhibition: V moves as far as it can.
        is_excited = t < 200
        arrived = np.array([[excitation, 0] if is_excited else [0, inhibition]])
        step = spinnaker.step(parameters, constants, np.array(shifts), state, arrived)
        assert step.wraps == {"ring_wraps": 0, "current_wraps": 0, "potential_wraps": 0}
        state = step.state


@given(neuron=NEURONS, sums=SUMS)
def test_scales_are_the_largest_powers_of_two_that_the_bounds_allow(neuron, sums):
    membrane = inverse.membrane_of(neuron.decay_u, neuron.decay_v)
    share, kept = Fraction(membrane.synapse_init, SPAN), Fraction(membrane.synapse_decay, SPAN)
    # What a current settles at if the sum arrives in every step.
    currents = [largest_sum * share / (1 - kept) for largest_sum in sums]
    scales = scales_of(neuron, sums)

    def weight_fits(power: int) -> bool:
        unit = Fraction(1, 2**power)
        return unit * max(sums) <= 32767 and unit * max(currents) <= 65535

    assert weight_fits(scales.weight)
    assert scales.weight == 0 or not weight_fits(scales.weight - 1)
    drive = sum(currents) + abs(Fraction(neuron.bias, 64)) * share
    moved = Fraction(ONE - membrane.membrane_decay, ONE)
    goal = drive / (moved * share)
    # The bound, with room for the rounding of the capacity.
    assert goal / 2**scales.potential <= 65535 * Fraction(100001, 100000)
    # One halving more is allowed where the rounded capacity would let a goal wrap.
    assert scales.potential < 2 or goal / 2 ** (scales.potential - 2) > 65535


@pytest.mark.parametrize("halvings", [0, 4, 8])
def test_a_weight_is_halved_once_more_just_above_the_largest_current(halvings):
    """The largest current that cannot wrap is 65,535 nA; a current that decays slowly adds up to it."""
    membrane = inverse.membrane_of(decay_u=379, decay_v=4096)
    settled = Fraction(membrane.synapse_init, SPAN - membrane.synapse_decay)
    most = int((65535 << halvings) / settled)
    assert inverse.weight_scale(membrane, Sums(most, 0)) == halvings
    assert inverse.weight_scale(membrane, Sums(0, most + 1)) == halvings + 1


@pytest.mark.parametrize(
    ("neuron", "sums"),
    [
        (
            LeakyNeuron(decay_u=3806, decay_v=2458, threshold=16688, bias=0, refractory=1),
            Sums(126518, 19651),
        ),
        (
            LeakyNeuron(decay_u=4096, decay_v=3925, threshold=67795, bias=167910, refractory=1),
            Sums(51387, 197167),
        ),
        (
            LeakyNeuron(decay_u=4096, decay_v=755, threshold=709, bias=-88207, refractory=1),
            Sums(16453, 175440),
        ),
    ],
    ids=["a current that stays", "a bias", "a negative bias"],
)
def test_a_potential_is_halved_once_more_where_the_rounded_resistance_is_too_large(neuron, sums):
    """Just above a power of two, R exceeds its exact value so far that a goal would leave 65,535 mV."""
    scales = scales_of(neuron, sums)
    membrane = inverse.membrane_of(neuron.decay_u, neuron.decay_v)
    drive = inverse.spread_of_drive(neuron, sums)

    def widest_goal(potential: int) -> float:
        c_m = inverse.capacity_of(membrane, Scales(scales.weight, potential))
        return drive * scales.weight_unit * inverse.resistance_of(c_m, membrane) / ONE

    assert widest_goal(scales.potential) <= 65535 < widest_goal(scales.potential - 1)


@given(neuron=NEURONS, sums=SUMS)
def test_a_neuron_spikes_where_its_rounded_gain_times_the_threshold_is_passed(neuron, sums):
    scales = scales_of(neuron, sums)
    parameters = stored(neuron, scales)
    constants = spinnaker.constants(parameters)
    moved = ONE - int(constants.membrane_decay[0])
    gain = Fraction(int(constants.resistance[0]) * moved, ONE * ONE)
    gain *= Fraction(int(constants.synapse_init[0, 0]), SPAN) / 2**scales.weight
    threshold = gain * neuron.threshold
    passed = Fraction(int(parameters.v_thresh[0]), ONE)
    assert passed == Fraction(2**31 - 1, ONE) or threshold < passed <= threshold + Fraction(1, ONE)


def test_a_weight_of_one_lifts_a_potential_by_its_unit():
    neuron = LeakyNeuron(decay_u=379, decay_v=401, threshold=6610, bias=0, refractory=1)
    scales = Scales(weight=2, potential=6)
    parameters = stored(neuron, scales)
    weight = inverse.stored_weights(np.array([100 * scales.weight_unit]), 15)
    state = spinnaker.State(
        np.zeros(1, np.int64), np.zeros((1, 2), np.int64), np.zeros(1, np.int64)
    )
    ring = np.array([[weight[0], 0]])
    step = spinnaker.step(
        parameters, spinnaker.constants(parameters), np.array([15, 15]), state, ring
    )
    assert step.potential[0] / ONE == pytest.approx(100 * scales.potential_unit, rel=1e-3)


@pytest.mark.parametrize(
    ("largest_sum", "shift"),
    [(0.0, 0), (0.3, 0), (1.0, 1), (1.5, 1), (2.0, 2), (1023.9, 10), (1024.0, 11), (32767.0, 15)],
)
def test_the_shift_is_the_least_power_of_two_above_the_largest_sum(largest_sum, shift):
    assert inverse.shift_for(largest_sum) == shift


@pytest.mark.parametrize(
    ("weight", "shift", "integer", "rounded"),
    [
        pytest.param(1.0, 1, 16384, 0, id="exact"),
        pytest.param(0.5, 15, 0, 1, id="a half is rounded down to the even 0"),
        pytest.param(1.5, 15, 2, 1, id="a half is rounded up to the even 2"),
        pytest.param(2.0, 0, 0, 0, id="2^16 loses its high bit"),
        pytest.param(2.5, 0, 16384, 0, id="above 2^16, the low bits stay"),
    ],
)
def test_weights_are_stored_to_nearest_in_16_bits(weight, shift, integer, rounded):
    assert inverse.stored_weights(np.array([weight]), shift).tolist() == [integer]
    assert inverse.loses_bits(np.array([weight]), shift) == rounded


def test_weights_delays_and_refractory_steps_act_as_on_the_page_of_loihi():
    assert inverse.weights_in_units(np.array([5, -5]), 1).tolist() == [10, -10]
    assert inverse.weights_in_units(np.array([5, -5]), -1).tolist() == [2, -3]
    assert inverse.delays_of(np.array([0, 62])).tolist() == [1, 63]
    assert inverse.refractory_time(np.array([1, 5])).tolist() == [0, 4 * ONE]
