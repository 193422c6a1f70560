"""The dendrite strategy against a model of its own: three filters in integers, without cores or compartments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from locsnn_compile.network.neurons import SrmAlpha
from locsnn_compile.pipeline import lower
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.networks import DECAY_OF_10, UNIT, hybrid, recordings

CHIP = hw.chip("loihi-sim")


def kept(x, decay):
    """What a step keeps of a register: 4096 - decay parts of 4096, rounded toward zero."""
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)


def integer_srm(drive, q):
    """Integer SRM neurons from the recursive form: two filters for the input, two for the own spikes, no reset."""
    steps, n = drive.shape
    current, response, refractory_current, refractory = np.zeros((4, n), dtype=np.int64)
    spikes = np.zeros((steps, n), dtype=np.int64)
    limit = 2**23 - 1  # of the voltage register, in its units
    decay, refractory_decay = q.decay_u, q.refractory.decay
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
    found = hw.simulate(levels.program, played[0])
    spikes = {view.name: view.play(played)[0].astype(np.int64) for view in network.views}
    for q in levels.quantized.populations:
        name = q.population.name
        drive = sum(
            spikes[p.source] @ (UNIT * p.mantissa * 2**p.exponent).T
            for p in levels.quantized.projections
            if p.target == name
        )
        spikes[name] = integer_srm(drive, q.neuron)
        assert np.array_equal(found.spikes[name], spikes[name]), name


def test_populations_keep_their_names_and_compartments_have_theirs():
    program = lower(hybrid(), CHIP, weight_bits=8).program
    assert list(program.populations) == [
        f"{name}{part}"
        for name in ("time_hidden", "time_output", "location_hidden", "location_output")
        for part in ("/dendrite", "/refractory", "")
    ]


def test_a_phase_an_axis_each_on_cores_of_its_own():
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
def test_fine_weights_and_decays_on_the_grid_leave_the_reference_nothing_to_disagree_with(seed):
    """A network whose weights and decays the chip holds exactly: what is left is the rounding of states."""
    tau = -1 / np.log(1 - DECAY_OF_10 / 4096)
    network = hybrid(
        seed,
        steps=60,
        hidden=8,
        neuron=SrmAlpha(theta=10.0, tau_sr=float(tau), tau_ref=1.0, scale_ref=2.0),
    )
    once = lower(network, CHIP, weight_bits=8).quantized
    gain = np.e * np.exp(-1 / tau) / tau
    on_grid = tuple(
        type(p)(
            p.source,
            p.target,
            q.mantissa * UNIT * 2.0**q.exponent / (once.population(p.target).scale[0] * gain),
        )
        for p, q in zip(network.projections, once.projections, strict=True)
    )
    exact = replace(network, projections=on_grid)
    levels = lower(exact, CHIP, weight_bits=8)
    match = compare(Observed(levels, recordings(exact, samples=4, seed=seed)))
    assert match.spikes.reference_spikes > 100
    assert match.spikes.agreement > 0.97
