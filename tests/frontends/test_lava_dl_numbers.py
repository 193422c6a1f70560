"""lava-dl networks that take real numbers: layers on the host and on the chip spike as slayer's forward pass did.

The expected spikes were recorded with lava-dl itself.
"""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.network.input_scaling import InputScaling
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.request.recordings import recordings_for
from tests.support.host_layer_messages import BAD_NUMBERS
from tests.support.net_files import dense, neuron, write_net

RECORDED = Path(__file__).parent / "lava-dl-numbers"
"""Written by ``tests/peers/record_lava_dl_numbers.py``."""
RNG = np.random.default_rng(7)
INPUT = {
    "type": "input",
    "shape": np.array([10]),
    "neuron": neuron(i_decay=1024, v_decay=128, threshold=60),
}


def recorded(name, folder):
    """Write a recorded network; return its file, its inputs and its spikes by layer."""
    with np.load(RECORDED / f"{name}.npz") as arrays:
        arrays_of_file = dict(arrays)
    path = folder / f"{name}.net"
    path.write_bytes(arrays_of_file.pop("net").tobytes())
    return path, arrays_of_file.pop("inputs"), arrays_of_file


def played(path, inputs, host_layers):
    """Return the spikes of the last layer on the host, and those of the chip's, by name."""
    network = lc.load(path, host_layers=host_layers)
    events = recordings_for(network, inputs).spikes
    (sent,) = network.host.sends
    chip = evaluate(network, events).spikes
    return {sent.population: events} | {p.name: chip[p.name] for p in network.populations}


# The recorded network, --host-layers, and the number of the last layer on the host.
DIVIDED = {
    "signals, scaled by an input layer": ("signals", 1, 0),
    "signals, and a layer behind it on the host": ("signals", "layer1", 1),
    "images through an input layer": ("images", 1, 0),
    "images, and a convolution on the host": ("images", 2, 1),
    "signals straight into weights": ("direct", "layer0", 0),
    "signals into recurrent neurons": ("recurrent", 1, 0),
    "images into a convolution": ("convolved", 1, 0),
}


@pytest.mark.parametrize("case", DIVIDED)
def test_host_and_chip_spike_as_slayer_did(case, tmp_path):
    name, host_layers, last_on_host = DIVIDED[case]
    path, inputs, spikes = recorded(name, tmp_path)
    ours = played(path, inputs, host_layers)
    assert list(ours) == list(spikes)[last_on_host:]
    for layer, layer_spikes in ours.items():
        assert spikes[layer].sum() > 50
        np.testing.assert_array_equal(layer_spikes, spikes[layer], err_msg=layer)


@pytest.mark.parametrize("name", ["signals", "images", "direct"])
def test_the_program_spikes_as_slayer_did(name, tmp_path):
    path, inputs, spikes = recorded(name, tmp_path)
    network = lc.load(path, host_layers=1)
    program = lc.compile(network, events=inputs, diagnosis=False).program
    events = recordings_for(network, inputs).spikes
    result = hw.simulate(program, events)
    for population in network.populations:
        np.testing.assert_array_equal(result.spikes[population.name], spikes[population.name])


@pytest.mark.parametrize("on_host", [1, 2])
def test_zeros_and_ones_through_the_host_are_the_whole_network_on_events(on_host, tmp_path):
    biases = RNG.integers(-9, 30, 12)
    layers = [
        INPUT | {"weight": np.array([50.0])},
        dense(RNG, outs=12, ins=10, bias=biases),
        dense(RNG, outs=5, ins=12, bias=biases[:5]),
    ]
    write_net(tmp_path / "model.net", layers)
    events = (RNG.random((3, 40, 10)) < 0.4).astype(np.uint8)
    whole = evaluate(lc.load(tmp_path / "model.net"), events).spikes
    divided = played(tmp_path / "model.net", events.astype(float), on_host)
    assert len(divided) == 4 - on_host
    for layer, layer_spikes in divided.items():
        assert whole[layer].sum() > 50
        np.testing.assert_array_equal(layer_spikes, whole[layer])


# The recorded network, a dataset of its file, and the error that is added to it.
FAULTS = {
    "the weight of the input layer": ("signals", "layer/0/weight", 2),
    "the bias of the input layer": ("signals", "layer/0/bias", -2),
    "a threshold on the host": ("images", "layer/0/neuron/vThMant", 2),
    "a decay on the host": ("signals", "layer/0/neuron/iDecay", 40),
    "weights of numbers": ("direct", "layer/0/weight", 2),
    "weights on the chip": ("images", "layer/3/weight", 4),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_in_the_numbers_of_a_file_changes_the_spikes(case, tmp_path):
    name, dataset, error = FAULTS[case]
    path, inputs, spikes = recorded(name, tmp_path)
    with h5py.File(path, "r+") as file:
        file[dataset][...] += error
    ours = played(path, inputs, 1)
    assert any((ours[layer] != spikes[layer]).any() for layer in ours)


def test_a_fault_in_the_inputs_changes_the_spikes(tmp_path):
    path, inputs, spikes = recorded("signals", tmp_path)
    ours = played(path, inputs + 1 / 32, 1)
    assert (ours["layer0"] != spikes["layer0"]).any()


def test_an_input_layer_rounds_numbers_to_eight_bits():
    numbers = np.array([0.0, 1 / 64, 3 / 64, 0.02, -0.02, 3.98, 1e300, -4.01, -1e300])
    rounded = np.array([0, 0, 2, 1, -1, 127, 127, -128, -128]) / 32
    scaling = InputScaling(weight=0.8125, bias=-0.25)
    np.testing.assert_array_equal(scaling.scaled(numbers), rounded * 0.8125 - 0.25)


def test_the_report_counts_the_host_apart(tmp_path, capsys):
    path, inputs, spikes = recorded("signals", tmp_path)
    np.savez(tmp_path / "numbers.npz", values=inputs)
    folder = tmp_path / "out"
    events = ["--host-layers", "1", "--events", str(tmp_path / "numbers.npz")]
    exact = ["--min-agreement", "1", "--max-spike-error", "0"]
    arguments = ["compile", str(path), *events, *exact, "-o", str(folder), "--json"]
    assert main([*arguments, "--emit", "network", "events"]) == 0
    report = json.loads(capsys.readouterr().out)
    samples, steps, _ = inputs.shape
    counts_of_host = {"neurons": 12, "multiplications": 12 * steps, "neuron_updates": 12 * steps}
    assert report["host"] == {"layers": {"layer0": counts_of_host}, "lines": 12}
    numbers_cut = np.count_nonzero((inputs < -4) | (inputs > 127 / 32))
    assert numbers_cut > 20
    sent = spikes["layer0"].sum() / samples
    assert report["operations"]["per_sample"]["input_events"] == pytest.approx(sent)
    assert report["assumptions"] == [
        "The host rounds numbers to multiples of 1/32 from -4 to 3.96875, as slayer's input layer does.",
        "Layers 'layer0' run in float and integers on the host (--host-layers): their 12 "
        "multiplications a step are not among the chip's operations, energy and time.",
        f"{numbers_cut} of {inputs.size} numbers are outside -4 to 3.96875, and are cut to these: give them in "
        "the range of the training.",
        "How long a step lasts is not known, because neither the model nor the recordings say it "
        "(--step-seconds): there is no comparison with the pace of a sensor.",
    ]
    page = (folder / "report.md").read_text()
    assert "## Layers on the host" in page
    assert "run outside the chip, on numbers, and send spikes to it over 12 lines" in page
    assert "layer0" not in (folder / "network.txt").read_text()
    assert main(["run", str(folder), "--events", str(folder / "events.npz")]) == 0


BAD_LAYERS = {
    **BAD_NUMBERS,
    "a name that does not exist": ("layer7", "there is no layer 'layer7'. Did you mean 'layer2'?"),
    "the last layer by name": (
        "layer0,layer2",
        "no neurons are left for the chip. Name fewer layers.",
    ),
}


@pytest.mark.parametrize("case", BAD_LAYERS)
def test_layers_that_cannot_run_on_the_host_are_refused(case, tmp_path):
    host_layers, message = BAD_LAYERS[case]
    path, _, _ = recorded("signals", tmp_path)
    with pytest.raises(lc.InputError) as refused:
        lc.load(path, host_layers=host_layers)
    assert str(refused.value) == f"model 'signals.net', --host-layers: {message}"


def refusal(layers, folder, host_layers):
    """Write layers, and return the message with which they are refused."""
    write_net(folder / "model.net", layers)
    with pytest.raises(lc.InputError) as refused:
        lc.load(folder / "model.net", host_layers=host_layers)
    return str(refused.value)


def test_a_bias_of_the_input_layer_needs_numbers(tmp_path):
    layers = [INPUT | {"bias": np.array([10.0])}, dense(RNG, outs=5, ins=10)]
    assert refusal(layers, tmp_path, None) == (
        "model 'model.net', layer 0: it adds a bias to the numbers before its neurons, and events "
        "have none (10). Run the layer on the host, and give numbers: --host-layers 1."
    )


def test_sums_without_neurons_are_refused_on_the_host(tmp_path):
    sums = {key: value for key, value in dense(RNG, outs=8, ins=10).items() if key != "neuron"}
    layers = [sums, dense(RNG, outs=6, ins=8), dense(RNG, outs=5, ins=6)]
    assert refusal(layers, tmp_path, "layer1") == (
        "model 'model.net', layer 0: it has no neurons. Use CUBA neurons."
    )


def test_neurons_that_send_numbers_are_refused_on_the_host_too(tmp_path):
    graded = INPUT | {"neuron": neuron(i_decay=1024, v_decay=128, threshold=60, kind="SDNN")}
    assert refusal([graded, dense(RNG, outs=5, ins=10)], tmp_path, 1) == (
        "model 'model.net', layer 0: 'SDNN' neurons do not fit into one compartment of the chip. "
        "Use CUBA neurons."
    )


def test_numbers_within_the_range_need_no_sentence():
    scaling = InputScaling(weight=1.0, bias=0.0)
    assert scaling.cut_sentences(np.array([-4.0, 0.3, 127 / 32])) == ()


def test_numbers_beyond_any_register_count_as_the_largest_charge(tmp_path):
    weights = np.array([[2.0], [-2.0]])
    fast = neuron(i_decay=4096, v_decay=4096, threshold=2**17 - 1)
    write_net(
        tmp_path / "model.net",
        [dense(RNG, outs=2, ins=1, weight=weights, neuron=fast), dense(RNG, outs=5, ins=2)],
    )
    sent = played(tmp_path / "model.net", np.full((1, 9, 1), 1e300), 1)["layer0"][0]
    np.testing.assert_array_equal(sent[1:], np.tile([1, 0], (8, 1)))


def test_currents_on_the_host_wrap_in_no_register_of_the_chip(tmp_path):
    # 3.9 is rounded to 125 / 32, whose charge is 250 * 64 = 16,000. A current that keeps all of it passes 2^23 after 525
    # steps, and would then be negative.
    keeps_current = neuron(i_decay=0, v_decay=4096, threshold=100)
    layer = {"type": "input", "shape": np.array([4]), "neuron": keeps_current}
    write_net(tmp_path / "model.net", [layer, dense(RNG, outs=5, ins=4)])
    sent = played(tmp_path / "model.net", np.full((1, 600, 4), 3.9), 1)["layer0"][0]
    assert sent[1:].all()


def test_a_delay_on_the_host_holds_numbers_back(tmp_path):
    layers = [dense(RNG, outs=8, ins=10, delay=3.5), dense(RNG, outs=5, ins=8)]
    write_net(tmp_path / "late.net", layers)
    write_net(tmp_path / "early.net", [layers[0] | {"delay": 0.0}, layers[1]])
    inputs = RNG.normal(0.3, 0.5, (2, 30, 10))
    late = played(tmp_path / "late.net", inputs, 1)
    early = played(tmp_path / "early.net", inputs, 1)
    assert early["layer0"].any()
    np.testing.assert_array_equal(late["layer0"][:, 3:], early["layer0"][:, :-3])
    assumed = lc.load(tmp_path / "late.net", host_layers=1).assumptions
    assert "Of layer 0, 1 of 1 delay lose a fraction of a step, as in netx." in assumed
