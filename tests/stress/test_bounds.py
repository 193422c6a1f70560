"""The bound that is derived for errors of potentials, against the same recursion written here once more for one neuron.

The chip rounds weights, decays and, in every step, the states u and v. The bound says how far its potentials can be from
those of float64, in three parts by source: ``weights``, ``decays`` and ``states`` (``stress/bounds.py``).
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from locsnn_compile.network.chip_neurons import ChipCuba
from locsnn_compile.pipeline import lower
from locsnn_compile.stress.bounds import SOURCES
from locsnn_compile.stress.cases.case import lif, network_of, random_input, random_weights, srm
from locsnn_compile.stress.measure import Sides
from locsnn_compile.verification.error_budget.budget import STAGES

CHIP = hw.chip("loihi-sim")
FLOAT_ERROR = 1e-6
"""In units of a register: by how much a bound may be exceeded, because bounds and errors are computed in float64."""


def state_bound(keep_u: float, keep_v: float) -> float:
    """Return the bound of ``states`` for all time, of compartments that keep fractions of u and v in a step.

    Rounding a state toward zero removes less than 1 per step. Of an earlier error, the fraction that is kept stays, so
    errors add up to at most 1 / (1 - fraction). A fraction of 0 or 1 rounds nothing. The error of u adds to that of v in
    every step.
    """
    u = 1.0 / (1.0 - keep_u) if 0 < keep_u < 1 else 0.0
    if keep_v == 1:
        return np.inf if u else 0.0
    return (u + 1.0) / (1.0 - keep_v) if keep_v > 0 else u


def cut(x, decay):
    """Return what a decay, in parts of 4096, leaves of an integer, rounded toward zero."""
    return int(x * (4096 - decay) / 4096)


@settings(max_examples=60, deadline=None)
@given(
    decay_u=st.integers(0, 4096),
    decay_v=st.integers(1, 4096),
    charges=st.lists(st.integers(-5000, 5000), min_size=1, max_size=200),
)
def test_truncation_never_takes_more_than_the_bound_for_all_time(decay_u, decay_v, charges):
    keep_u = 1 - decay_u / 4096
    keep_v = 1 - decay_v / 4096
    exact_u = exact_v = 0.0
    u = v = 0
    for charge in charges:
        exact_u = keep_u * exact_u + charge
        u = cut(u, decay_u) + charge
        exact_v = keep_v * exact_v + exact_u
        v = cut(v, decay_v) + u
        assert abs(v - exact_v) <= state_bound(keep_u, keep_v)


@pytest.mark.parametrize(
    ("keep_u", "keep_v", "bound"),
    [(0.0, 0.0, 0.0), (0.0, 0.5, 2.0), (0.5, 0.0, 2.0), (0.5, 0.5, 6.0), (1.0, 0.5, 2.0), (0.5, 1.0, np.inf), (0.0, 1.0, 0.0)],
)  # fmt: skip
def test_the_bound_for_all_time_is_that_of_its_formula(keep_u, keep_v, bound):
    """1 / (1 - fraction) per register, and nothing where all or nothing is kept; see :func:`state_bound`."""
    assert state_bound(keep_u, keep_v) == bound


def played(network, strategy="dendrite"):
    """Return both sides of a network, chip and float64, on random input, and the bound of the error by its source."""
    recordings = random_input(network.steps, channels=network.channels)
    sides = Sides(lower(network, CHIP, weight_bits=8, strategy=strategy), recordings)
    bound = sides.bound()
    return sides, bound


@pytest.mark.parametrize("tau", [0.7, 3.0, 33.0])
def test_the_bound_of_a_leaky_integrator_is_that_of_a_recursion_by_hand(tau):
    """The parts by weights, decay and rounded state of a neuron that never spikes, step by step."""
    steps = 60
    network = network_of(
        lif(tau, size=1, threshold=1e4),  # too high to spike
        random_weights(tau, response="leak", size=1)[:, :3],
        steps=steps,
    )
    sides, bound = played(network)
    (pair,) = sides.phase.program_neurons.groups
    (synapses,) = sides.phase.program_neurons.synapses
    chip_keeps, exact_keeps = pair.chip.keep_v[0], pair.exact.keep_v[0]
    v = 0.0
    expected_parts = np.zeros(3)
    # Of weights, decays and states, in this order. What arrives in a step acts in the next one.
    for step in range(1, steps):
        arrived = sides.lines["touch"][0, step - 1].astype(float)
        before = expected_parts.copy()
        expected_parts = chip_keeps * expected_parts + [
            arrived @ np.abs(synapses.chip - synapses.exact_fitted)[0],
            arrived @ np.abs(synapses.exact_fitted - synapses.exact.weights)[0]
            + abs(chip_keeps - exact_keeps) * abs(v),
            1.0 if v or before.any() else 0.0,
        ]
        v = exact_keeps * v + arrived @ synapses.exact.weights[0]
        bound_parts = [bound[source][0, step, 0] for source in SOURCES]
        assert bound_parts == pytest.approx(expected_parts.tolist(), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset"])
def test_every_potential_is_within_its_bound(strategy):
    sides, bound = played(network_of(srm(), random_weights()), strategy)
    error = np.abs(sides.forced(*STAGES) - sides.float.potential)
    assert (error <= sides.model_error() + sum(bound.values()) + FLOAT_ERROR).all()
    assert error.max() > 0


def test_the_error_of_one_stage_alone_is_within_the_part_of_its_source():
    """With only weights or only states rounded. The part is derived for all stages at once, hence the 1 % of slack."""
    sides, bound = played(network_of(lif(), random_weights(response="leak")))
    exact = sides.forced()
    for stages, source in ((("weights",), "weights"), (("states",), "states")):
        error = np.abs(sides.forced(*stages) - exact)
        assert (error <= 1.01 * bound[source] + FLOAT_ERROR).all()


def test_numbers_that_the_chip_holds_leave_only_truncation():
    neuron = ChipCuba.of(3, decay_u=4096, decay_v=100, threshold=900, refractory=3)
    _, bound = played(network_of(neuron, np.arange(-9, 9).reshape(3, 6) * 20))
    assert not bound["weights"].any()
    assert not bound["decays"].any()
    assert 0 < bound["states"].max() <= state_bound(0.0, 1 - 100 / 4096)


def test_a_spike_forgets_the_error_of_the_voltage():
    network = network_of(lif(size=1, threshold=1.0), [[5.0]], steps=10)
    sides, bound = played(network)
    spikes = sides.float.spikes[0, :, 0]
    assert spikes.any()
    step_after = np.flatnonzero(spikes)[0] + 1
    # What arrives with the spike acts in the step after it, where it brings an error of its own.
    nothing_arrives = sides.lines["touch"][0, step_after - 1, 0] == 0
    has_no_error = sum(bound.values())[0, step_after, 0] == 0
    assert has_no_error == bool(nothing_arrives)
