"""The first layers of a network on the host: numbers go in, and the spikes that come out are those of the framework.

The expected spikes were recorded with spikingjelly and norse, or are those of the whole network in the float reference.
"""

import json

import nir
import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.request.recordings import recordings_for
from tests.support.host_layer_messages import BAD_NUMBERS
from tests.support.nir_graphs import DT, chain, cuba, lif
from tests.support.recorded_torch_layers import STEPS, write_recorded

# Framework whose recorded network is used, and its last layer on the host.
FRAMEWORKS = {
    "an image that is held, through spikingjelly": ("spikingjelly", "if1"),
    "signals, through norse": ("norse", "lif1"),
}


@pytest.mark.parametrize("case", FRAMEWORKS)
def test_host_and_chip_together_spike_as_the_framework(case, tmp_path):
    framework, last_on_host = FRAMEWORKS[case]
    state, description, recorded = write_recorded(framework, tmp_path)
    inputs = recorded.pop("inputs")
    network = lc.load(state, config=description, host_layers=1)
    assert [population.name for population in network.own_populations] == [
        name for name in recorded if name != last_on_host
    ]
    events = recordings_for(network, inputs[None]).spikes
    np.testing.assert_array_equal(events[0], recorded.pop(last_on_host))
    ours = evaluate(network, events).spikes
    for depth, (name, expected) in enumerate(recorded.items(), start=1):
        assert expected.sum() > 10
        np.testing.assert_array_equal(ours[name][0][depth:], expected[:-depth])


def affine(rng, outs, ins):
    """Return an Affine node of random weights (outs, ins) and biases, so that neurons behind it spike."""
    return nir.Affine(rng.normal(0.3, 0.5, (outs, ins)), rng.normal(0.1, 0.2, outs))


def graph_file(folder, *nodes_behind):
    """Write a NIR graph of three layers of six neurons, with more nodes after them; return its file."""
    rng = np.random.default_rng(3)
    nodes = []
    for number in (1, 2, 3):
        nodes += [(f"fc{number}", affine(rng, outs=6, ins=6)), (f"lif{number}", lif(rng, 6))]
    nir.write(folder / "net.nir", chain((6,), *nodes, *nodes_behind))
    return folder / "net.nir"


@pytest.mark.parametrize(("host_layers", "on_host"), [(1, 1), (2, 2), ("lif2", 2)])
def test_host_and_chip_compute_the_whole_network(host_layers, on_host, tmp_path):
    path = graph_file(tmp_path)
    undivided = lc.load(path, dt=DT)
    divided = lc.load(path, dt=DT, host_layers=host_layers)
    values = (np.random.default_rng(1).random((3, 30, 6)) < 0.4).astype(np.uint8)
    expected = evaluate(undivided, values).spikes
    events = recordings_for(divided, values.astype(float)).spikes
    ours = evaluate(divided, events).spikes
    np.testing.assert_array_equal(events[:, :-on_host], expected[f"lif{on_host}"][:, on_host:])
    # A layer on the chip comes as many steps later as there are layers on the host.
    for number in range(on_host + 1, 4):
        assert expected[f"lif{number}"].any()
        np.testing.assert_array_equal(
            ours[f"lif{number}"][:, :-on_host], expected[f"lif{number}"][:, on_host:]
        )


def test_the_report_counts_the_host_apart(tmp_path, capsys):
    state, description, recorded = write_recorded("spikingjelly", tmp_path)
    image = recorded["inputs"][:1]
    np.savez(tmp_path / "image.npz", values=image, labels=[3])
    options = ["--config", str(description), "--host-layers", "if1", "--steps", str(STEPS)]
    output_options = [
        "-o",
        str(tmp_path / "out"),
        "--json",
        "--emit",
        "network",
        "events",
    ]
    events = ["--events", str(tmp_path / "image.npz")]
    assert main(["compile", str(state), *options, *events, *output_options]) == 0
    report = json.loads(capsys.readouterr().out)
    # A kernel of 3 x 3 on an image of 8 x 8 with padding 1: along each axis, one tap at each border is outside.
    taps = (3 * 8 - 2) ** 2
    assert report["host"] == {
        "layers": {
            "if1": {
                "neurons": 256,
                "multiplications": 4 * taps * STEPS,
                "neuron_updates": 256 * STEPS,
            }
        },
        "lines": 256,
    }
    assert report["operations"]["per_sample"]["input_events"] == recorded["if1"].sum()
    assert (
        f"Layers 'if1' run in float on the host (--host-layers): their {4 * taps} multiplications a "
        "step are not among the chip's operations, energy and time."
    ) in report["assumptions"]
    assert "## Layers on the host" in (tmp_path / "out" / "report.md").read_text()
    assert "conv" not in (tmp_path / "out" / "network.txt").read_text()
    sent = tmp_path / "out" / "events.npz"
    np.testing.assert_array_equal(lc.read_recordings(sent).spikes[0], recorded["if1"])
    assert main(["run", str(tmp_path / "out"), "--events", str(sent)]) == 0
    numbers = str(tmp_path / "image.npz")
    assert main(["run", str(tmp_path / "out"), "--events", numbers]) == 2


# Words of the report on the worst time, and entries of its list of unknown facts.
OTHER_FAMILIES = {
    "spinnaker1": (
        "**How fast at worst? Not known.** A board that keeps up takes 1 ms a step; loading it takes "
        "longer, and is not included. Whether a board keeps up with the busiest step is not known: "
        "there is no bound on its time.",
        ("worst time: whether a board finishes the busiest step in 1 ms", "nothing ran on a board"),
    ),
    "xylo-audio3": (
        "**How fast at worst? Not known.** Neither the time of a recording nor a bound on it is known, "
        "because no table of the energies or times of this chip is published.",
        (
            "worst time: no table of the energies or times of this chip is published",
            "nothing ran on a chip",
        ),
    ),
}


@pytest.mark.parametrize("target", OTHER_FAMILIES)
def test_reports_of_all_families_count_the_host_and_list_what_is_unknown(target, tmp_path):
    rng = np.random.default_rng(3)
    nodes = []
    for number in (1, 2, 3):
        neurons = cuba(rng, 6) if number == 1 else slow_cuba(6)
        nodes += [
            (f"fc{number}", nir.Linear(rng.normal(0.3, 0.5, (6, 6)))),
            (f"c{number}", neurons),
        ]
    nir.write(tmp_path / "net.nir", chain((6,), *nodes))
    # A Xylo has no reset to zero.
    reset = "subtract" if target == "xylo-audio3" else None
    network = lc.load(tmp_path / "net.nir", dt=DT, host_layers=1, reset=reset)
    compiled = lc.compile(network, target, events=rng.random((3, 30, 6)))
    assert compiled.report["host"] == {
        "layers": {"c1": {"neurons": 6, "multiplications": 36 * 30, "neuron_updates": 6 * 30}},
        "lines": 6,
    }
    text = compiled.files()["report.md"].decode()
    assert "## Layers on the host" in text
    assert "| c1 | 6 | 1,080 | 180 |" in text
    worst, points = OTHER_FAMILIES[target]
    for sentence in (worst, "**What is not known? 5 points.**", *points):
        assert sentence in text


def slow_cuba(size):
    """Return neurons that lose less than half of their current per step, which a Xylo needs."""
    tau = np.full(size, 8 * DT)
    one = np.ones(size)
    return nir.CubaLIF(tau_syn=tau, tau_mem=tau, r=one, v_leak=0 * one, v_threshold=one, w_in=one)


# The option --host-layers, and the end of the error.
BAD_LAYERS = {
    **BAD_NUMBERS,
    "a name that does not exist": ("lif9", "there is no layer 'lif9'. Did you mean 'lif3'?"),
    "the last layer by name": ("lif3", "no neurons are left for the chip. Name fewer layers."),
}


@pytest.mark.parametrize("case", BAD_LAYERS)
def test_layers_that_cannot_run_on_the_host_are_refused(case, tmp_path):
    host_layers, message = BAD_LAYERS[case]
    path = graph_file(tmp_path)
    with pytest.raises(lc.InputError) as refused:
        lc.load(path, dt=DT, host_layers=host_layers)
    assert str(refused.value) == f"model 'net.nir', --host-layers: {message}"


def test_an_input_that_passes_the_host_is_refused(tmp_path):
    rng = np.random.default_rng(3)
    nodes = {"input": nir.Input(np.array([6])), "output": nir.Output(np.array([6]))}
    for number in (1, 2):
        nodes |= {f"fc{number}": affine(rng, outs=6, ins=6), f"lif{number}": lif(rng, 6)}
    edges = [("input", "fc1"), ("fc1", "lif1"), ("lif1", "fc2"), ("input", "fc2")]
    edges += [("fc2", "lif2"), ("lif2", "output")]
    nir.write(tmp_path / "net.nir", nir.NIRGraph(nodes, edges, type_check=False))
    with pytest.raises(lc.InputError) as refused:
        lc.load(tmp_path / "net.nir", dt=DT, host_layers=1)
    assert str(refused.value) == (
        "model 'net.nir', --host-layers: the input also reaches the chip past these layers, and it "
        "is not made of spikes. Name more layers, up to where all paths meet."
    )


# Arrays of numbers, and the end of the error.
BAD_VALUES = {
    "other axes": (
        np.zeros((2, 5, 7)),
        "its axes do not fit the input ((2, 5, 7) for steps of (6,)). Give (samples, steps, "
        "channels), or (samples, channels).",
    ),
    "numbers that do not change, without steps": (
        np.zeros((2, 6)),
        "the numbers do not change, and nothing says for how many steps they last. Give --steps, or "
        "repeat them along an axis of steps.",
    ),
    "not a number": (np.full((2, 5, 6), np.nan), "a number is not finite. Give finite numbers."),
    "texts": (
        np.array([["a"]]),
        "it is not an array of real numbers (<U1 of shape (1, 1)). Give (samples, steps, channels), "
        "or (samples, channels).",
    ),
}


@pytest.mark.parametrize("case", BAD_VALUES)
def test_numbers_that_do_not_fit_are_refused(case, tmp_path):
    values, message = BAD_VALUES[case]
    network = lc.load(graph_file(tmp_path), dt=DT, host_layers=1)
    with pytest.raises(lc.InputError) as refused:
        recordings_for(network, values)
    assert str(refused.value) == f"values 'array': {message}"


def test_options_that_describe_events_are_refused(tmp_path, capsys):
    np.save(tmp_path / "values.npy", np.zeros((2, 5, 6)))
    arguments = [str(graph_file(tmp_path)), "--dt", str(DT), "--host-layers", "1"]
    options = [
        "--events",
        str(tmp_path / "values.npy"),
        "--grid",
        "3x2",
        "-o",
        str(tmp_path / "out"),
    ]
    assert main(["compile", *arguments, *options]) == 2
    assert capsys.readouterr().err == (
        "--grid: it describes recordings of events, and layers on the host take arrays of numbers. "
        "Leave it out.\n"
    )


def test_networks_with_layers_on_the_host_are_not_joined(tmp_path):
    network = lc.load(graph_file(tmp_path), dt=DT, host_layers=1)
    with pytest.raises(lc.InputError) as refused:
        lc.compile([network, network])
    assert str(refused.value) == (
        "model 'net': it has layers on the host, and networks are joined without such layers. "
        "Compile it by itself."
    )


def test_a_format_without_such_layers_refuses_the_option(tmp_path):
    with pytest.raises(lc.InputError) as refused:
        lc.load("examples/models/objects-best.pt", host_layers=1)
    assert str(refused.value) == (
        "model 'objects-best.pt': host_layers was given, but a checkpoint takes spikes. Leave "
        "host_layers out."
    )
