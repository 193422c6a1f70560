"""Strategy ``dendrite``: programs against integer filters written from the recursive form, without cores or compartments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.pipeline import lower
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import TAU_ON_GRID, UNIT, hybrid, recordings, with_weights_of_chip

CHIP = hw.chip("loihi-sim")


def kept(x, decay):
    """Return what a step keeps of a register: 4096 - decay parts of 4096, rounded toward zero."""
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)


def integer_srm(drive, q):
    """Return the spikes (steps, n) of integer SRM neurons ``q`` for charges ``drive`` (steps, n).

    Two filters in a row make the response to the input, and two the response to own spikes; there is no reset.
    """
    steps, n = drive.shape
    current = np.zeros(n, dtype=np.int64)
    response = np.zeros(n, dtype=np.int64)
    refractory_current = np.zeros(n, dtype=np.int64)
    refractory = np.zeros(n, dtype=np.int64)
    spikes = np.zeros((steps, n), dtype=np.int64)
    limit = 2**23 - 1  # of the voltage register, in its units
    decay = q.decay_u
    refractory_decay = q.refractory.decay
    own_charge = UNIT * q.refractory.mantissa[0] * 2 ** q.refractory.exponent[0]
    for t in range(steps):
        if t:
            current = kept(current, decay) + drive[t - 1]
            refractory_current = (
                kept(refractory_current, refractory_decay) + own_charge * spikes[t - 1]
            )
        response = np.clip(kept(response, decay) + current, -limit, limit)
        refractory = np.clip(kept(refractory, refractory_decay) + refractory_current, -limit, limit)
        spikes[t] = np.clip(response + refractory, -limit, limit) > UNIT * q.threshold
    return spikes


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.sampled_from([1, 3, 8]),
    tau_ref=st.sampled_from([1.0, 4.0]),
)
def test_compartments_do_what_the_recursion_does(seed, bits, tau_ref):
    network = hybrid(
        seed,
        steps=40,
        hidden=5,
        neuron=SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=tau_ref, scale_ref=2.0),
    )
    levels = lower(network, CHIP, bits)
    played = recordings(network, samples=1, seed=seed)
    result = hw.simulate(levels.program, played[0])
    spikes = {view.name: view.play(played)[0].astype(np.int64) for view in network.views}
    for q in levels.quantized.populations:
        name = q.population.name
        drive = 0
        for projection in levels.quantized.projections:
            if projection.target == name:
                charges = UNIT * projection.mantissa * 2**projection.exponent
                drive = drive + spikes[projection.source] @ charges.T
        spikes[name] = integer_srm(drive, q.neuron)
        assert np.array_equal(result.spikes[name], spikes[name]), name


def test_compartments_are_named_after_their_population():
    program = lower(hybrid(), CHIP, weight_bits=8).program
    assert list(program.populations) == [
        f"{name}{part}"
        for name in ("time_hidden", "time_output", "location_hidden", "location_output")
        for part in ("/dendrite", "/refractory", "")
    ]


def test_each_axis_is_a_phase_on_cores_of_its_own():
    program = lower(hybrid(), CHIP, weight_bits=8).program
    assert [(phase.name, phase.steps) for phase in program.phases] == [
        ("time", 12),
        ("location", 4),
    ]
    assert [core.phase for core in program.cores] == ["time", "location"]


def test_no_refractory_kernel_needs_no_self_synapse():
    network = hybrid(neuron=SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=0.0))
    graph = lower(network, CHIP, weight_bits=8).compartments
    assert not [s for s in graph.synapses if s.target.endswith("/refractory")]


@pytest.mark.parametrize("seed", range(5))
def test_a_network_whose_weights_and_decays_the_chip_holds_spikes_nearly_as_in_float(seed):
    """Only states and the refractory kernel are rounded then."""
    neuron = SrmAlpha(theta=10.0, tau_sr=TAU_ON_GRID, tau_ref=1.0, scale_ref=2.0)
    network = hybrid(seed, steps=60, hidden=8, neuron=neuron)
    exact = with_weights_of_chip(network, CHIP)
    levels = lower(exact, CHIP, weight_bits=8)
    match = compare(Observed(levels, recordings(exact, samples=4, seed=seed)))
    assert match.spikes.reference_spikes > 100
    assert match.spikes.agreement > 0.97
