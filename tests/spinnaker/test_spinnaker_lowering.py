"""Compartments of ``loihi`` lowered to neurons of SpiNNaker: their scales, their synapses, and what is refused.

Independent answers: both arithmetics written down once more (``play_loihi``, ``play_spinnaker``), and potentials in
real numbers (``exact``).
"""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.arithmetic import spinnaker
from hw_model.errors import TargetError
from hw_model.mapping.graph import CompartmentGraph, Readout, Synapses
from hw_model.spinnaker.chips import spinnaker_chip
from hw_model.spinnaker.fast import play_fast
from hw_model.spinnaker.network import SpinnakerNetwork
from hw_model.spinnaker.range import safe_period
from locsnn_compile.network.neurons import SoftCuba
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.spinnaker.fits import check_neurons
from locsnn_compile.spinnaker.lower import LoweredSpinnaker, lower_to_spinnaker
from tests.support.small_spinnaker_graphs import LAST, cells, graph, synapses

CHIP = spinnaker_chip("spinnaker1")
RANDOM_LAYERS = 40
HEAVY_LAYERS = 60


def lowered(compartments: CompartmentGraph) -> LoweredSpinnaker:
    """Lower a graph for the chip that ships."""
    return lower_to_spinnaker(compartments, CHIP)


def test_the_hybrid_gets_the_largest_scales_at_which_nothing_can_wrap():
    network = lc.load("examples/models/objects-hybrid.pt")
    chip = hw.chip("loihi-sim")
    result = lowered(lower_neurons(quantize(network, chip, strategy="reset"), chip))
    # Name, weight unit in nA, potential unit in mV, shifts of excitation and inhibition.
    rows = [
        (scaled.name, scaled.scales.weight_unit, scaled.scales.potential_unit, population.shifts)
        for scaled, population in zip(result.scaled, result.network.populations, strict=True)
    ]
    assert rows == [
        ("time_hidden", 1, 1 / 16, (13, 12)),
        ("time_output", 1, 1 / 16, (10, 13)),
        ("location_hidden", 1 / 4, 1 / 64, (13, 11)),
        ("location_output", 1, 1 / 16, (11, 12)),
    ]
    assert sum(scaled.weights_rounded for scaled in result.scaled) == 0
    assert [population.cores for population in result.network.populations] == [1, 1, 1, 1]


def test_synapses_that_act_together_are_one_with_their_sum():
    fine = synapses([[5, -3], [7, 0]], exponent=1)
    coarse = synapses([[1, 6], [0, 9]], exponent=0)
    late = synapses([[4, 0], [0, 0]], delay=np.array([3]))
    result = lowered(graph(fine, coarse, late, lines=2, groups=(cells(2),)))
    # By receptor: source, target, delay in steps, weight in nA.
    synapses_of = {}
    for projection in result.network.projections:
        shift = result.network.population("cells").shifts[projection.receptor == "inhibitory"]
        synapses_of[projection.receptor] = list(
            zip(
                projection.source_index.tolist(),
                projection.target_index.tolist(),
                projection.delay.tolist(),
                (projection.weight * 2.0 ** (shift - 15)).tolist(),
                strict=True,
            )
        )
    # From line 0: 5 * 2 + 1 and 7 * 2, the late one apart; from line 1: -3 * 2 + 6 is gone.
    assert synapses_of == {
        "excitatory": [(0, 0, 1, 11.0), (0, 0, 4, 4.0), (0, 1, 1, 14.0), (1, 1, 1, 9.0)]
    }


def test_weights_that_lose_bits_are_counted():
    exact = lowered(graph(synapses([[255] * 128]), lines=128))
    # 32,640 is below 2^15; with 65,280, a ring buffer of 16 bits has no bit for odd weights.
    heavy = lowered(graph(synapses([[255, 254] * 128]), lines=256))
    assert exact.scaled[0].weights_rounded == 0
    assert heavy.scaled[0].weights_rounded == 128


@pytest.mark.parametrize(
    ("size", "delay", "slots", "neurons"),
    [
        # On SpiNNaker a delay is one step more: 31 becomes 32, which fits 32 slots, and 32 becomes 33.
        pytest.param(10, 0, 2, 256, id="the fewest slots"),
        pytest.param(256, 31, 32, 256, id="8 + 5 + 1 bits of 14"),
        pytest.param(256, 32, 64, 128, id="7 + 6 + 1 bits of 14"),
        pytest.param(300, 62, 64, 128, id="several cores"),
        pytest.param(100, 62, 64, 256, id="fewer neurons than a core holds"),
    ],
)
def test_longer_delays_leave_room_for_fewer_neurons_a_core(size, delay, slots, neurons):
    part = synapses(np.full((size, 1), 9), delay=np.full(size, delay))
    population = lowered(graph(part, groups=(cells(size),))).network.population("cells")
    assert (population.slots, population.neurons_per_core) == (slots, neurons)
    assert population.ring_bits <= 14


def test_rows_that_are_too_long_for_a_core_are_divided():
    parts = [synapses(np.full((200, 1), 9), delay=np.full(200, delay)) for delay in range(2)]
    population = lowered(graph(*parts, groups=(cells(200),))).network.population("cells")
    assert population.neurons_per_core == 128
    assert population.cores == 2


def test_neurons_whose_potentials_are_read_have_a_threshold_that_none_reaches():
    readout = Readout(("cells",), (1.0,), potentials_from=0)
    population = lowered(graph(readout=readout)).network.population("cells")
    assert population.parameters.v_thresh.tolist() == [2**31 - 1]


def test_a_floor_that_no_input_reaches_is_no_obstacle():
    # A charge of -640 settles below -640 * 4096 / 379 = -6,917, and v below -70,653.
    part = synapses([[-10]])
    assert lowered(graph(part, groups=(cells(vmin=1 - (1 << 17)),))).network
    with pytest.raises(TargetError, match="floor that inputs can reach"):
        lowered(graph(part, groups=(cells(vmin=1 - (1 << 16)),)))


REFUSED = {
    "joined compartments": (
        graph(groups=(cells(), cells(name="cells/dendrite", joined_to="cells"))),
        "population 'cells/dendrite': it is joined to 'cells', and SpiNNaker joins no compartments. "
        "Use strategy reset.",
    ),
    "a potential that keeps all": (
        graph(groups=(cells(decay_v=0),)),
        "population 'cells': its potential never decays, and on SpiNNaker no input would then move "
        "it (decay_v 0 against at least 1 of 4096). "
        "Train with a shorter time constant, or take longer steps.",
    ),
    "a current that is too slow": (
        graph(groups=(cells(decay_u=5),)),
        "population 'cells': its current decays too slowly: a weight would leave 32 bits on "
        "SpiNNaker (decay_u 5 against at least 6 of 4096). "
        "Train with a shorter time constant, or take longer steps.",
    ),
    "a floor": (
        graph(synapses([[-100]]), groups=(cells(vmin=1 - (1 << 17)),)),
        "population 'cells': its potential has a floor that inputs can reach, and on SpiNNaker it "
        "has none (-706392 against -131071 in neuron 0). Train without a floor.",
    ),
    "delays": (
        graph(synapses([[1]], delay=np.array([9000]))),
        "population 'cells': its ring buffer is too large (15 against 14). "
        "Lower its neurons a core, or its delays.",
    ),
    "a row": (
        graph(*(synapses([[1]], delay=np.array([delay])) for delay in range(257))),
        "synapses 'lines' -> 'cells': too many synapses of a source on a core (257 against 256). "
        "Lower the neurons a core of the target, or prune synapses.",
    ),
    "cores": (
        graph(groups=(cells(256 * 857),)),
        "phase 'time': too many cores (857 against 856). Train a network with fewer neurons.",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("compartments", "message"), REFUSED.values(), ids=REFUSED)
def test_what_spinnaker_does_not_have_is_refused_by_name(compartments, message):
    with pytest.raises(TargetError) as caught:
        lowered(compartments).network.check_fits(CHIP)
    assert str(caught.value) == message


def test_resets_by_subtraction_and_joined_integers_are_refused_before_any_rounding():
    soft = SoftCuba.of(1, decay_u=0.1, decay_v=0.1, threshold=1.0, drop=0.9)
    network = lc.load("examples/models/objects-hybrid-loihi.pt")
    with pytest.raises(TargetError) as caught:
        check_neurons(network)
    assert str(caught.value) == (
        "population 'time_hidden': its integers join compartments, and a neuron of SpiNNaker is a "
        "single one. Give the network in float, as it was before it was trained in integers."
    )
    first = replace(network.populations[0], neuron=soft)
    with pytest.raises(TargetError) as caught:
        check_neurons(replace(network, populations=(first,)))
    assert str(caught.value) == (
        "population 'time_hidden': a spike subtracts from its potential, and on SpiNNaker it resets "
        "it to 0. Train neurons that reset to 0, such as Cuba."
    )


@pytest.mark.slow
def test_random_layers_spike_as_on_loihi():
    """At most one in a thousand differs, since the time constants are not exact."""
    differing = 0
    compared = 0
    for seed in range(RANDOM_LAYERS):
        layer, rows = random_layer(np.random.default_rng(seed))
        expected = play_loihi(layer, rows)
        spikes = play_spinnaker(lowered(layer).network, rows)
        differing += int((spikes != expected).sum())
        compared += expected.size
        # Some layers are silent, but the first is not.
        assert expected.sum() > 0 or seed > 0
    assert compared > 1000 * RANDOM_LAYERS
    assert differing <= compared / 1000


def test_what_is_chosen_is_proven_to_fit_and_no_input_wraps():
    """For layers with any decays, with weights up to the heaviest of a format, and a spike on every line and step."""
    for seed in range(HEAVY_LAYERS):
        random = np.random.default_rng(seed)
        layer, rows = random_layer(random)
        (part,) = layer.synapses
        heavy = replace(layer, synapses=(replace(part, exponent=int(random.integers(0, 8))),))
        network = lowered(heavy).network
        assert safe_period(network, "cells") == 1, seed
        result = play_fast(network, "time", np.ones_like(rows))
        for event in ("ring_wraps", "current_wraps", "potential_wraps", "saturated_weights"):
            assert result.events[event] == 0, (seed, event)


def random_layer(random: np.random.Generator) -> tuple[CompartmentGraph, np.ndarray]:
    """Return a layer with random decays, biases, refractory steps and delays, and rows for its lines."""
    size = int(random.integers(1, 12))
    lines = int(random.integers(5, 40))
    group = cells(
        size,
        decay_u=int(random.choice([4096, random.integers(6, 2000)])),
        decay_v=int(random.integers(20, 3000)),
        threshold=int(random.integers(100, 1500)),
        bias_mantissa=int(random.choice([0, 8 * random.integers(-40, 200)])),
        refractory=int(random.integers(1, 5)),
    )
    weights = random.integers(-100, 128, (size, lines)) * 2
    part = synapses(weights)
    part = replace(part, delay=random.integers(0, 6, len(part.mantissa)))
    rows = (random.random((200, lines)) < random.uniform(0.02, 0.3)).astype(np.int64)
    return graph(part, lines=lines, groups=(group,)), rows


def test_potentials_are_nearer_to_exact_ones_than_the_integers_they_come_from():
    """Most of the difference between the two chips is due to the truncation of ``loihi``, not to SpiNNaker's decay."""
    random = np.random.default_rng(3)
    size = 4
    lines = 30
    decay = 390
    kept = (4096 - decay) / 4096
    unreachable = cells(size, decay_u=decay, decay_v=decay, threshold=(1 << 17) - 1)
    layer = synapses(random.integers(-100, 128, (size, lines)) * 2)
    compartments = graph(layer, lines=lines, groups=(unreachable,))
    rows = (random.random((400, lines)) < 0.05).astype(np.int64)
    charge = np.zeros((len(rows), size))
    charge[1:] = rows[:-1] @ dense(layer, size, lines).T

    network = lowered(compartments).network
    population = network.population("cells")
    result = play_fast(network, "time", rows)
    on_spinnaker = result.potential / (population.potential_unit * spinnaker.ONE)
    kept_of_current = int(population.constants.synapse_decay[0, 0]) / spinnaker.SPAN
    # In weights of 1, the unit of `exact`.
    assert np.abs(on_spinnaker - exact(charge, kept_of_current, kept)).max() < 0.02

    on_loihi = potentials_of_loihi(charge, decay)
    assert np.abs(on_loihi - exact(charge, kept, kept)).max() > 0.5


def dense(part: Synapses, size: int, lines: int) -> np.ndarray:
    """Return synapses as a matrix of mantissas (size, lines)."""
    weights = np.zeros((size, lines), dtype=np.int64)
    weights[part.target_index, part.source_index] = part.mantissa
    return weights


def exact(charge: np.ndarray, kept_of_u: float, kept_of_v: float) -> np.ndarray:
    """Return the potentials (steps, n) of leaky neurons without threshold, in real numbers and in weights of 1."""
    u = np.zeros(charge.shape[1])
    v = np.zeros(charge.shape[1])
    potentials = np.zeros_like(charge)
    for t, arrived in enumerate(charge):
        u = kept_of_u * u + arrived
        v = kept_of_v * v + u
        potentials[t] = v
    return potentials


def potentials_of_loihi(charge: np.ndarray, decay: int) -> np.ndarray:
    """Return the potentials (steps, n) of ``loihi``, which truncates u and v to 64ths of a weight of 1."""
    u = np.zeros(charge.shape[1], dtype=np.int64)
    v = np.zeros(charge.shape[1], dtype=np.int64)
    potentials = np.zeros_like(charge)
    for t, arrived in enumerate(charge.astype(np.int64)):
        u = np.sign(u) * (np.abs(u) * (4096 - decay) >> 12) + 64 * arrived
        v = np.sign(v) * (np.abs(v) * (4096 - decay) >> 12) + u
        potentials[t] = v / 64
    return potentials


def play_loihi(layer: CompartmentGraph, rows: np.ndarray) -> np.ndarray:
    """Return the spikes (steps, n) of a layer by the arithmetic of ``loihi``, written down once more."""
    (group,) = layer.groups
    (part,) = layer.synapses
    # Room for charges that arrive after the end; delays are 5 at most, plus a step.
    charge = np.zeros((len(rows) + 8, group.size), dtype=np.int64)
    u = np.zeros(group.size, dtype=np.int64)
    v = u.copy()
    blocked = u.copy()
    spikes = np.zeros((len(rows), group.size), dtype=np.int64)

    def kept(x, decay):
        return np.sign(x) * (np.abs(x) * (4096 - decay) >> 12)

    bias = group.bias_mantissa << group.bias_exponent
    for t, row in enumerate(rows):
        u = kept(u, group.decay_u) + charge[t]
        v = kept(v, group.decay_v) + u + bias
        v[blocked > 0] = 0
        fired = (v > 64 * group.threshold) & (blocked == 0)
        v[fired] = 0
        blocked = np.where(fired, group.refractory - 1, np.maximum(blocked - 1, 0))
        spikes[t] = fired
        for line, cell, mantissa, delay in zip(
            part.source_index, part.target_index, part.mantissa, part.delay, strict=True
        ):
            if row[line]:
                charge[t + 1 + delay, cell] += 64 * mantissa
    assert np.abs(v).max() < LAST
    return spikes


def play_spinnaker(network: SpinnakerNetwork, rows: np.ndarray) -> np.ndarray:
    """Return the spikes (steps, n) by the step of SpiNNaker's arithmetic, with a queue of weights instead of a ring.

    The queue has no end, so nothing saturates or is late; it is asserted that a ring buffer would have held it.
    """
    population = network.population("cells")
    arrived = np.zeros((len(rows) + 9, population.size, 2), dtype=np.int64)
    state = spinnaker.State(
        population.parameters.v_init,
        np.zeros((population.size, 2), dtype=np.int64),
        np.zeros(population.size, dtype=np.int64),
    )
    spikes = np.zeros((len(rows), population.size), dtype=np.int64)
    for t, row in enumerate(rows):
        assert arrived[t].max() <= spinnaker.RING_MAX
        step = spinnaker.step(
            population.parameters,
            population.constants,
            np.array(population.shifts),
            state,
            arrived[t],
        )
        assert not any(step.wraps.values())
        state = step.state
        spikes[t] = step.fired
        for projection in network.projections:
            receptor = int(projection.receptor == "inhibitory")
            acts = row[projection.source_index] != 0
            place = (t + projection.delay[acts], projection.target_index[acts], receptor)
            np.add.at(arrived, place, projection.weight[acts])
    return spikes
