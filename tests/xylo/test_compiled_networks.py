"""Networks of leaky neurons compiled for a Xylo: their integers, their spikes, and the report.

Independent answers: what xylosim, the vendor's simulator, was recorded to do with these very programs (the *witness*),
integers worked out by hand, and the float equations written down once more.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.arithmetic import xylo, xylo_inverse
from hw_model.xylo.chips import xylo_chip
from hw_model.xylo.playing import play_program, rows_of
from hw_model.xylo.reference import play_xylo
from locsnn_compile.xylo.quantize import float_peak
from tests.support.numbered_arrays import read
from tests.support.small_xylo_networks import (
    NETWORKS,
    STEPS,
    TIME,
    memoryless_network,
    network,
    small_network,
    soft,
    touches,
)
from tests.support.witness_files import RECORDED_COMPILED, REGISTERS, network_of

WITNESS = dict(zip(NETWORKS, read(RECORDED_COMPILED), strict=True))
WEIGHTS = ("weights_in", "weights_hidden", "weights_out", "shift_in", "shift_hidden", "shift_out")


def compiled_for(network: lc.Network, target: str = "xylo-audio3", **options: object):
    """Compile a network, checked on the usual recordings."""
    return lc.compile(network, target=target, events=touches(), **options)


@pytest.mark.parametrize("name", NETWORKS)
def test_a_compiled_network_plays_as_in_xylosim(name):
    """Every register of every row; what xylosim did was recorded of this very program."""
    program = compiled_for(NETWORKS[name]()).program
    recorded = network_of(WITNESS[name])
    for part in WEIGHTS:
        assert np.array_equal(getattr(program.network, part), getattr(recorded, part)), part
    rows = rows_of(touches()[0])
    assert np.array_equal(rows, WITNESS[name]["events"])
    result = play_xylo(program.network, rows)
    for register in REGISTERS:
        assert np.array_equal(getattr(result, register), WITNESS[name][register]), register


def test_the_recorded_compiled_networks_spike_often_and_saturate():
    """Otherwise the comparison with them would show little."""
    spikes = {name: int(witness["spikes"].sum()) for name, witness in WITNESS.items()}
    assert min(spikes.values()) > 20
    # In a row, some neuron spikes about half as often as it can, 31 times.
    assert max(int(witness["spikes"].max()) for witness in WITNESS.values()) > 15
    busiest = WITNESS["saturating"]
    events = play_xylo(network_of(busiest), busiest["events"]).events
    assert events["current_saturations"] > 100
    assert events["potential_saturations"] > 10
    assert all("bias" in witness for witness in WITNESS.values())


def one_hidden_neuron(weight: float, neuron: lc.Cuba | lc.SoftCuba) -> lc.Network:
    """An input, a hidden neuron with one synapse, and an output with another."""
    return network(
        (
            lc.Population("hidden", TIME, 1, neuron),
            lc.Population(
                "classes", TIME, 1, soft(size=1, decay_u=0.5, decay_v=0.5, threshold=1.0)
            ),
        ),
        (
            lc.Projection("touch", "hidden", np.array([[weight]])),
            lc.Projection("hidden", "classes", np.array([[1.0]])),
        ),
        channels=1,
        views=(lc.InputView("touch", TIME, 1),),
    )


def test_the_integers_of_a_neuron_by_hand():
    """Decays 1/2 and 1/4, a weight of 0.5, and a threshold of 2 that must be passed.

    Response to a charge of 1, i halving and v keeping 3/4: 1, 5/4, 19/16, 65/64, ... so its peak is
    5/4. The chip's current halves before it acts: its peak is half of that, and g = 2. Scale:
    127 2^level / 0.5 = 254 2^level units, and the threshold 2 * 254 / 2 = 254 2^level, plus 1.
    A current stays below (127 2^level + 1) * 2 - 1, and a potential below that plus the threshold:
    at level 6 that is 16257 + 16257 = 32514, and at level 7 too much. Rounded decays add 1/4 to the
    current in a step, which adds up to 1/2, and 3/8 to the potential: the bias takes away 1.
    """
    program = lc.compile(
        one_hidden_neuron(0.5, soft(size=1, decay_u=0.5, decay_v=0.25, threshold=2.0)),
        target="xylo-audio2",
        events=np.zeros((1, STEPS, 1), np.uint8),
    ).program
    hidden = program.network.hidden
    assert hidden.dash_syn.tolist() == [[1]]
    assert hidden.dash_mem.tolist() == [2]
    assert program.network.weights_in.tolist() == [[[127]]]
    assert program.network.shift_in == 6
    assert hidden.threshold.tolist() == [254 * 64 + 1]
    assert hidden.bias.tolist() == [-1]


def test_a_threshold_that_need_only_be_reached_gets_no_extra_unit():
    neuron = lc.Cuba.of(1, decay_u=0.5, decay_v=1.0, threshold=2.0, rule=">=")
    program = lc.compile(
        one_hidden_neuron(0.5, neuron),
        target="xylo-imu",
        events=np.zeros((1, STEPS, 1), np.uint8),
    ).program
    # The chip's peak is half of the neuron's, so the threshold is 2 * 254 2^level / 2; the shift is the level.
    shift = program.network.shift_in
    assert program.network.hidden.threshold.tolist() == [254 << shift]
    assert program.network.hidden.dash_mem.tolist() == [0]


@pytest.mark.parametrize(
    ("decay_u", "decay_v"), [(0.5, 0.25), (0.25, 0.25), (0.3, 0.02), (0.1, 1.0)], ids=str
)
def test_the_peak_of_a_float_response_is_that_of_the_recursion(decay_u, decay_v):
    i = 1.0
    v = 0.0
    highest = 0.0
    # Long enough for the slowest of these neurons to peak.
    for _ in range(2000):
        v = (1 - decay_v) * v + i
        i = (1 - decay_u) * i
        highest = max(highest, v)
    assert float_peak(decay_u, decay_v) == pytest.approx(highest, rel=1e-12)


def test_weights_are_within_half_a_unit_of_what_their_scale_asks_for():
    compiled = compiled_for(small_network())
    parts = {p.target: p for p in compiled.network.projections if p.source != p.target}
    program = compiled.program
    scale = compiled.quantized.hidden_scales.current[program.places["first"]]
    exact = parts["first"].weights.T * scale
    stored = program.network.weights_in[:, program.places["first"], 0] << program.network.shift_in
    assert np.abs(stored - exact).max() <= 2**program.network.shift_in / 2
    assert np.abs(program.network.weights_in).max() == xylo.WEIGHT_MAX


def test_the_small_group_of_synapses_gets_the_smaller_shift():
    """Weights among hidden neurons are a tenth of those from inputs: 12.7 units at level 0.

    At level 2 they are 50.8, which 8 bits hold without a shift: not 13 << 2, but 51.
    """
    populations = (
        lc.Population("hidden", TIME, 4, soft(size=4, decay_u=0.5, decay_v=0.25, threshold=40.0)),
        lc.Population("classes", TIME, 2, soft(size=2, decay_u=0.5, decay_v=0.25, threshold=1.0)),
    )
    projections = (
        lc.Projection("touch", "hidden", np.full((4, 16), 1.0)),
        lc.Projection("hidden", "hidden", np.full((4, 4), 0.1)),
        lc.Projection("hidden", "classes", np.full((2, 4), 0.5)),
    )
    program = compiled_for(network(populations, projections)).program.network
    assert (program.shift_in, program.shift_hidden) == (2, 0)
    assert np.unique(program.weights_in).tolist() == [127]
    assert np.unique(program.weights_hidden).tolist() == [51]


@pytest.mark.parametrize("rate", [0.1, 0.5, 1.0], ids=str)
def test_nothing_saturates_upwards_while_sources_send_once_in_a_step(rate):
    """The compiler chose the level for that. At a rate of 1, as many events arrive as there can be."""
    populations = (
        lc.Population("hidden", TIME, 6, soft(size=6, decay_u=0.25, decay_v=0.125, threshold=2.0)),
        lc.Population("classes", TIME, 2, soft(size=2, decay_u=0.5, decay_v=0.25, threshold=1.0)),
    )
    r = np.random.default_rng(3)
    projections = (
        lc.Projection("touch", "hidden", r.uniform(0.0, 0.2, (6, 16))),
        lc.Projection("hidden", "classes", r.uniform(0.0, 0.1, (2, 6))),
    )
    program = compiled_for(network(populations, projections)).program
    (counts,) = play_program(program, touches(1, rate)).counts
    assert counts.current_saturations == 0
    assert counts.potential_saturations == 0


def test_step_t_of_the_program_is_step_t_of_the_network():
    """One event acts a step later on both sides, then the hidden spike a step after that."""
    neuron = soft(size=1, decay_u=0.5, decay_v=0.5, threshold=1.0)
    compiled = lc.compile(
        one_hidden_neuron(1.5, neuron),
        target="xylo-audio3",
        events=np.zeros((1, STEPS, 1), np.uint8),
    )
    recording = np.zeros((1, 6, 1), np.uint8)
    recording[0, 2] = 1
    played = play_program(compiled.program, recording)
    assert played.spikes["hidden"][0, :, 0].tolist() == [0, 0, 0, 1, 0, 0]
    assert np.flatnonzero(played.potential["classes"][0, :, 0] > 0).tolist()[0] == 4


def test_the_last_row_of_a_recording_would_act_after_it_and_is_not_played():
    compiled = compiled_for(small_network())
    recording = touches(1)
    inverted_end = recording.copy()
    inverted_end[:, -1] = 1 - inverted_end[:, -1]
    played = play_program(compiled.program, recording)
    played_inverted = play_program(compiled.program, inverted_end)
    assert np.array_equal(played.spikes["first"], played_inverted.spikes["first"])
    assert played.counts == played_inverted.counts


def test_counts_are_those_of_the_spikes_that_were_played():
    compiled = compiled_for(small_network())
    network = compiled.program.network
    played = play_program(compiled.program, touches(1))
    (counts,) = played.counts
    hidden = np.concatenate([played.spikes["first"], played.spikes["second"]], axis=2)[0]
    outputs = played.spikes["classes"][0]
    synapses_of_input = (network.weights_in != 0).sum(axis=(1, 2))
    synapses_among_hidden = (network.weights_hidden != 0).sum(axis=(1, 2))
    synapses_of_hidden = synapses_among_hidden + (network.weights_out != 0).sum(1)
    # What happens in the last row would act after the end.
    input_events = touches(1)[0][:-1]
    acting_spikes = hidden[:-1].astype(int)
    assert counts.synaptic_ops == int(
        (input_events * synapses_of_input).sum() + (acting_spikes * synapses_of_hidden).sum()
    )
    assert counts.spikes == int(hidden.sum()) + int(outputs.sum())
    assert counts.input_events == int(input_events.sum())
    # Layers of 12 and 8 neurons, and 4 outputs.
    assert counts.neuron_updates == STEPS * (12 + 8 + 4)
    assert counts.extra_spikes == int(np.maximum(hidden.astype(int) - 1, 0).sum())


def test_the_match_counts_the_spikes_of_both_sides():
    compiled = compiled_for(small_network())
    reference = _reference_spikes(compiled.network)
    played = play_program(compiled.program, touches())
    for name, match in compiled.match.by_population.items():
        chip = played.spikes[name].astype(int)
        assert match.reference_spikes == int(reference[name].sum())
        assert match.chip_spikes == int(chip.sum())
        assert match.common_spikes == int(np.minimum(reference[name], chip).sum())
    assert compiled.match.spikes.agreement > 0.85


def _reference_spikes(network: lc.Network) -> dict[str, np.ndarray]:
    """Return the spikes (batch, steps, n) of the float network: the equations of ``SoftCuba``, written down once more."""
    events = touches().astype(float)
    batch = len(events)
    spikes = {name: np.zeros((batch, STEPS, p.size)) for name, p in _by_name(network).items()}
    # Currents and potentials.
    state = {name: np.zeros((2, batch, p.size)) for name, p in _by_name(network).items()}
    for t in range(1, STEPS):
        for name, population in _by_name(network).items():
            neuron = population.neuron
            charge = sum(
                ((events if p.source == "touch" else spikes[p.source])[:, t - 1] @ p.weights.T)
                for p in network.projections
                if p.target == name
            )
            i, v = state[name]
            i = (1 - neuron.decay_u) * i + charge
            v = (1 - neuron.decay_v) * v + i - neuron.drop * spikes[name][:, t - 1]
            state[name] = np.stack([i, v])
            spikes[name][:, t] = v > neuron.threshold
    return {name: array.astype(int) for name, array in spikes.items()}


def _by_name(network: lc.Network) -> dict[str, lc.Population]:
    """Return the populations of a network by name."""
    return {population.name: population for population in network.populations}


def test_a_bias_is_that_of_the_network_less_the_drift_of_rounded_decays():
    """Dashes 2 and 0: (4 - 1) / 2 units a step from the current, and nothing from the potential."""
    compiled = compiled_for(memoryless_network())
    scale = compiled.quantized.hidden_scales.potential
    # The network's biases are those of `memoryless_network`.
    expected = np.linspace(-0.2, 0.4, 10) * scale - 1.5
    assert np.abs(compiled.program.network.hidden.bias - expected).max() <= 0.5


@pytest.mark.parametrize(("dash_syn", "dash_mem"), [(2, 3), (1, 4), (3, 0), (4, 5)], ids=str)
def test_the_drift_is_what_rounded_decays_were_seen_to_add_to_potentials(dash_syn, dash_mem):
    """A long run in integers is compared with the same recursion in real numbers; there are no spikes."""
    r = np.random.default_rng(8)
    charges = r.integers(0, 200, 20_000)
    i = 0
    v = 0
    exact_i = 0.0
    exact_v = 0.0
    difference = 0.0
    for charge in charges.tolist():
        i = i + charge - ((i + charge) >> dash_syn)
        v = v - (v >> dash_mem) + i
        exact_i = (exact_i + charge) * (1 - 2.0**-dash_syn)
        exact_v = exact_v * (1 - 2.0**-dash_mem) + exact_i
        difference += v - exact_v
    # A potential keeps what is added for 2^dash steps.
    added = difference / len(charges) * 2.0**-dash_mem
    drift = float(xylo_inverse.rounding_drift(np.array(dash_syn), np.array(dash_mem)))
    assert added == pytest.approx(drift, rel=0.03)


def test_long_time_constants_do_not_move_the_potential_at_rest_far():
    """A dash of 8 would drift by 127.5 units a step; a sixteenth of the threshold is the most."""
    populations = (
        lc.Population(
            "hidden", TIME, 2, soft(size=2, decay_u=2.0**-8, decay_v=0.25, threshold=400.0)
        ),
        lc.Population("classes", TIME, 2, soft(size=2, decay_u=0.5, decay_v=0.25, threshold=1.0)),
    )
    projections = (
        lc.Projection("touch", "hidden", np.full((2, 16), 0.4)),
        lc.Projection("hidden", "classes", np.full((2, 2), 0.5)),
    )
    hidden = compiled_for(network(populations, projections)).program.network.hidden
    # With a decay of 1/4, the potential rests at 4 times the bias. Its rounding to a unit moves that by up to 4 units.
    units_below_0 = -hidden.bias * 4
    assert (units_below_0 <= hidden.threshold / 16 + 4).all()
    assert (hidden.bias < 0).all()


def test_the_report_has_the_keys_of_every_report_and_names_what_is_not_known():
    report = compiled_for(small_network(), labels=[0, 1, 2, 3, 0, 1]).report
    assert report["target"] == "xylo-audio3"
    assert report["weight_bits"] == 8
    assert report["energy"]["per_sample_pj"] is None
    assert report["energy"]["not_included"] == [
        "no table of the energies or times of this chip is published"
    ]
    assert report["latency"]["per_sample_ns"] is None
    assert report["latency"]["timed"] is False
    assert report["accuracy"].keys() == {"reference", "chip"}
    assert report["resources"]["limits"] == {
        "inputs": {"used": 16, "limit": 16},
        "hidden_neurons": {"used": 20, "limit": 992},
        "outputs": {"used": 4, "limit": 32},
        "currents_of_a_hidden_neuron": {"used": 1, "limit": 2},
    }
    assert report["match"]["wraps"] == 0
    assert report["match"]["clips"] == 0
    assert report["quantization"]["second"]["current_decay_error"] == 0.0
    assert json.loads(json.dumps(report)) == report


def test_saturations_are_counted_and_lead_the_report():
    compiled = compiled_for(NETWORKS["saturating"]())
    saturations = compiled.match.total_counts.saturations
    assert saturations > 1000
    assert compiled.report["match"]["clips"] == saturations
    (notice,) = compiled.composed.notices
    assert notice.title == "Registers saturated."
    assert f"{saturations:,} times" in notice.text


def test_decays_that_no_dash_meets_are_reported_with_their_error():
    """In octaves, the nearest power of 1/2 to a decay of 0.3 is 1/4, which is a sixth less."""
    populations = (
        lc.Population("hidden", TIME, 2, soft(size=2, decay_u=0.3, decay_v=0.125, threshold=2.0)),
        lc.Population("classes", TIME, 2, soft(size=2, decay_u=0.5, decay_v=0.25, threshold=1.0)),
    )
    projections = (
        lc.Projection("touch", "hidden", np.full((2, 16), 0.4)),
        lc.Projection("hidden", "classes", np.full((2, 2), 0.5)),
    )
    numbers = compiled_for(network(populations, projections)).report["quantization"]["hidden"]
    assert numbers["dash_syn"] == 2
    assert numbers["current_decay_error"] == pytest.approx(1 / 6)
    assert numbers["potential_decay_error"] == 0.0


def test_a_chip_may_be_given_instead_of_its_name():
    compiled = lc.compile(small_network(), target=xylo_chip("xylo-imu"), events=touches())
    assert compiled.program.chip.name == "xylo-imu"
    assert repr(compiled) == (
        "<CompiledXylo 'small' on xylo-imu: The chip predicts the same class as the float network "
        "in 6 of 6 recordings>"
    )


def test_recordings_of_any_length_suit_a_network_of_any_length():
    longer = np.concatenate([touches(2), touches(2)], axis=1)
    program = lc.compile(
        replace(small_network(), any_length=True), target="xylo-audio3", events=longer
    ).program
    assert play_program(program, longer).spikes["classes"].shape == (2, 2 * STEPS, 4)
