"""Xylo's plain engine against the vendor's simulator, a second implementation, and numbers worked out by hand.

A *witness* is a record of what xylosim, the vendor's simulator, did with a network; the *oracle* is a second
implementation, in plain Python; the *engine* is ``play_xylo``. Planted faults show that the witnesses would find errors
of the arithmetic. The limits of chips and registers follow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hw_model.arithmetic import xylo, xylo_inverse
from hw_model.arithmetic.xylo import Counted, State
from hw_model.errors import InputError, TargetError
from hw_model.xylo.chips import xylo_chip, xylo_chip_names
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.reference import play_xylo
from tests.support import xylo_oracle
from tests.support.numbered_arrays import read
from tests.support.random_xylo import random_xylo
from tests.support.witness_files import RECORDED, REGISTERS, network_of

WITNESSES = read(RECORDED)


def differing_values(witness: dict[str, np.ndarray]) -> int:
    """Return how many registers and spikes of the engine are not those of the witness."""
    result = play_xylo(network_of(witness), witness["events"])
    return sum(int((getattr(result, name) != witness[name]).sum()) for name in REGISTERS)


@pytest.mark.parametrize("number", range(len(WITNESSES)))
def test_every_register_of_every_row_is_that_of_the_witness(number):
    assert differing_values(WITNESSES[number]) == 0


@pytest.mark.parametrize("number", range(len(WITNESSES)))
def test_the_oracle_agrees_with_the_witness_and_counts_the_events_of_the_engine(number):
    witness = WITNESSES[number]
    network = network_of(witness)
    arrays, event_counts = xylo_oracle.play(network, witness["events"])
    for name in REGISTERS:
        assert np.array_equal(arrays[name], witness[name]), name
    counts_of_engine = play_xylo(network, witness["events"]).events
    assert counts_of_engine == {name: event_counts[name] for name in xylo.EVENTS}


SEEDS_PER_TEST = 20


@pytest.mark.slow
@pytest.mark.parametrize("first_seed", range(3000, 3060, SEEDS_PER_TEST))
def test_random_networks_play_as_by_the_oracle(first_seed):
    for seed in range(first_seed, first_seed + SEEDS_PER_TEST):
        network, events = random_xylo(seed)
        arrays, event_counts = xylo_oracle.play(network, events)
        result = play_xylo(network, events)
        for name in REGISTERS:
            assert np.array_equal(getattr(result, name), arrays[name]), (seed, name)
        assert result.events == {name: event_counts[name] for name in xylo.EVENTS}, seed


def test_the_recorded_networks_meet_all_that_the_arithmetic_distinguishes():
    """Every counted event, the most spikes in a row, one and two currents, with and without biases and aliases."""
    event_counts = dict.fromkeys(xylo.EVENTS, 0)
    for witness in WITNESSES:
        for name, count in play_xylo(network_of(witness), witness["events"]).events.items():
            event_counts[name] += count
    assert all(event_counts.values())
    assert max(int(witness["spikes"].max()) for witness in WITNESSES) == xylo.HIDDEN_SPIKES_MAX
    assert {witness["dash_syn"].shape[1] for witness in WITNESSES} == {1, 2}
    assert {"bias" in witness for witness in WITNESSES} == {True, False}
    # Aliases are recorded as text: a list for each hidden neuron, or an empty list if there are none.
    assert {str(witness["aliases"]) == "[]" for witness in WITNESSES} == {True, False}


# Faulty versions of functions of hw_model/arithmetic/xylo.py, with the arguments of the sound ones. The counts that
# they return are not compared, so they may be wrong.


def _sum_first(i, spikes, charges):
    added = np.tensordot(spikes, charges, axes=1)
    return xylo.saturate(i + added), 0


def _bias_with_the_change(p, state):
    i = state.i - xylo.taken(state.i, p.dash_syn)
    bias = 0 if p.bias is None else p.bias
    change = xylo.saturate(xylo.wrap(-xylo.taken(state.v, p.dash_mem)) + i.sum(axis=1) + bias)
    return Counted(State(i, xylo.saturate(state.v + change)), {})


def _decay_after_the_sum(p, state):
    change = xylo.saturate(xylo.wrap(-xylo.taken(state.v, p.dash_mem)) + state.i.sum(axis=1))
    if p.bias is not None:
        change = xylo.saturate(change + p.bias)
    i = state.i - xylo.taken(state.i, p.dash_syn)
    return Counted(State(i, xylo.saturate(state.v + change)), {})


def _above_only(v, threshold, room):
    spikes = np.minimum(np.maximum(v - 1, 0) // threshold, room)
    return spikes, v - spikes * threshold


def _reset_to_0(v, threshold, room):
    spikes = np.minimum(np.maximum(v, 0) // threshold, room)
    return spikes, np.where(spikes > 0, 0, v)


# By what is wrong: the function or constant of the arithmetic, and what takes its place.
FAULTS = {
    "a decay may take nothing": ("taken", lambda x, dash: x >> dash),
    "a decay rounds towards 0": ("taken", lambda x, dash: np.sign(x) * (np.abs(x) >> dash)),
    "a sum saturates once": ("collect", _sum_first),
    "bias and change saturate together": ("respond", _bias_with_the_change),
    "a current decays after it was added": ("respond", _decay_after_the_sum),
    "no spike at the threshold itself": ("fire", _above_only),
    "a spike resets to 0": ("fire", _reset_to_0),
    "32 hidden spikes": ("HIDDEN_SPIKES_MAX", 32),
    "two output spikes": ("OUTPUT_SPIKES_MAX", 2),
    "16 input events": ("INPUT_EVENTS_MAX", 16),
    "a symmetric register": ("STATE_MIN", -32767),
    "a charge saturates": ("charge_of", lambda weight, shift: xylo.saturate(weight << shift)),
    "aliases are silent": (
        "fire_with_aliases",
        lambda v, threshold, _: xylo.fire(v, threshold, xylo.HIDDEN_SPIKES_MAX),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_witnesses_reveal_a_planted_fault(fault, monkeypatch):
    name, faulty = FAULTS[fault]
    monkeypatch.setattr(xylo, name, faulty)
    assert sum(map(differing_values, WITNESSES)) > 0


def one_neuron(**changes: object) -> XyloNetwork:
    """Return a network of one input, one hidden neuron and one output; decays take away a half and a quarter."""
    hidden = XyloPopulation(
        dash_syn=np.array([[1]]), dash_mem=np.array([2]), threshold=np.array([10])
    )
    outputs = replace(hidden, threshold=np.array([3]))
    network = XyloNetwork(
        hidden=hidden,
        outputs=outputs,
        weights_in=np.array([[[21]]]),
        weights_hidden=np.array([[[0]]]),
        weights_out=np.array([[8]]),
    )
    return replace(network, **changes)


def test_a_neuron_by_hand():
    """21 arrives twice: 42 halves to 21, two thresholds of 10 fit and 1 is left; two spikes reach the output a row on."""
    result = play_xylo(one_neuron(), np.array([[2], [0], [0]]))
    # i: 42 - 21; 21 - 10; 11 - 5. v: 21 - 20 = 1; 1 - 1 + 11 = 11, less 10; 1 - 1 + 6. A decay takes 1 at least.
    assert result.i[:, 0, 0].tolist() == [21, 11, 6]
    assert result.spikes[:, 0].tolist() == [2, 1, 0]
    assert result.v[:, 0].tolist() == [1, 1, 6]
    # i: 0; 2 * 8 - 8; 8 + 8 - 8. v: 8 - 3 after one spike only; 5 - 1 + 8 = 12, less 3.
    assert result.output_i[:, 0].tolist() == [0, 8, 8]
    assert result.output_spikes[:, 0].tolist() == [0, 1, 1]
    assert result.output_v[:, 0].tolist() == [0, 5, 9]
    assert result.events == dict.fromkeys(xylo.EVENTS, 0)


def test_events_beyond_fifteen_are_lost_and_counted():
    fifteen = play_xylo(one_neuron(), np.array([[15], [0]]))
    seventeen = play_xylo(one_neuron(), np.array([[17], [0]]))
    assert np.array_equal(fifteen.v, seventeen.v)
    assert seventeen.events["lost_input_events"] == 2


@pytest.mark.parametrize(
    ("dash_syn", "dash_mem"), [(1, 1), (3, 3), (2, 5), (5, 2), (4, 0)], ids=str
)
def test_the_peak_of_a_response_is_that_of_the_recursion_in_real_numbers(dash_syn, dash_mem):
    i = 1.0
    v = 0.0
    highest = 0.0
    # Long enough for the slowest of these neurons to peak.
    for _ in range(2000):
        i -= i / 2**dash_syn
        v += i - v / 2**dash_mem
        highest = max(highest, v)
    assert xylo_inverse.peak_response(dash_syn, dash_mem) == pytest.approx(highest, rel=1e-12)


def test_the_nearest_dash_is_nearest_in_octaves():
    # 2^-1.5 = 0.3536 lies between dashes 1 and 2; 15 is the largest dash.
    decays = np.array([1.0, 0.5, 0.36, 0.35, 2.0**-15, 1e-9, 0.0])
    assert xylo_inverse.nearest_dash(decays).tolist() == [0, 1, 1, 2, 15, 15, 15]


@pytest.mark.parametrize("charge", [1, 7, 100])
@pytest.mark.parametrize("dash", [0, 1, 3, 6])
def test_no_current_passes_its_bound(charge, dash):
    i = 0
    # The slowest current settles long before.
    for _ in range(3000):
        i = i + charge
        assert i <= xylo_inverse.largest_current(charge, dash)
        i = int(i - xylo.taken(np.array(i), np.array(dash)))


def test_three_chips_ship():
    assert xylo_chip_names() == ("xylo-audio2", "xylo-audio3", "xylo-imu")
    # Inputs, hidden neurons, outputs, currents of a hidden neuron.
    sizes = {}
    for name in xylo_chip_names():
        chip = xylo_chip(name)
        sizes[name] = (chip.inputs, chip.hidden, chip.outputs, chip.states)
    assert sizes == {
        "xylo-audio2": (16, 1000, 8, 2),
        "xylo-audio3": (16, 992, 32, 2),
        "xylo-imu": (16, 496, 16, 1),
    }


def two_states() -> XyloNetwork:
    """Return the network with a hidden neuron of two currents."""
    hidden = replace(one_neuron().hidden, dash_syn=np.array([[1, 2]]))
    return one_neuron(
        hidden=hidden, weights_in=np.ones((1, 1, 2), int), weights_hidden=np.ones((1, 1, 2), int)
    )


@pytest.mark.parametrize(
    ("network", "chip", "message"),
    [
        pytest.param(
            one_neuron(weights_in=np.ones((17, 1, 1), int)),
            "xylo-audio2",
            "xylo-audio2: too many inputs (17 against 16). Train a network with fewer inputs.",
            id="inputs",
        ),
        pytest.param(
            two_states(),
            "xylo-imu",
            "xylo-imu: too many currents of a hidden neuron (2 against 1). Train a network with "
            "fewer currents of a hidden neuron.",
            id="currents",
        ),
    ],
)
def test_a_network_that_is_too_large_is_refused_by_its_limit(network, chip, message):
    with pytest.raises(TargetError) as error:
        network.check_fits(xylo_chip(chip))
    assert str(error.value) == message


def with_hidden(**changes: object) -> dict[str, object]:
    """Return changes of the network: the hidden neuron with other parameters."""
    return {"hidden": replace(one_neuron().hidden, **changes)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param(
            {"weights_in": np.array([[[128]]])},
            "weights_in: the chip cannot hold it (128 against -128..127). Give a value in this range.",
            id="weight",
        ),
        pytest.param(
            with_hidden(threshold=np.array([0])),
            "hidden.threshold: the chip cannot hold it (0 against 1..32767). Give a value in this range.",
            id="threshold",
        ),
        pytest.param(
            with_hidden(dash_mem=np.array([16])),
            "hidden.dash_mem: the chip cannot hold it (16 against 0..15). Give a value in this range.",
            id="dash",
        ),
        pytest.param(
            with_hidden(bias=np.array([1])),
            "biases: the chip has them on or off for all neurons. Give both populations biases, "
            "or neither.",
            id="biases",
        ),
        pytest.param(
            {"weights_out": np.ones((2, 1), int)},
            "weights_out: the shape does not fit ((2, 1) against (1, 1)). Give this shape.",
            id="shape",
        ),
        pytest.param(
            {"aliases": ((1,),)},
            "aliases: they do not fit the hidden neurons. Give each of the 1 hidden neurons a "
            "tuple of numbers 0..0.",
            id="aliases",
        ),
    ],
)
def test_what_the_chip_cannot_hold_is_refused(changes, message):
    with pytest.raises(InputError) as error:
        one_neuron(**changes)
    assert str(error.value) == message


def test_events_must_fit_the_inputs():
    with pytest.raises(InputError) as error:
        play_xylo(one_neuron(), np.zeros((3, 2)))
    assert str(error.value) == (
        "input events: they do not fit the inputs ((3, 2) against (rows, 1)). Give a row of "
        "counts, 0 or more, for each step."
    )
