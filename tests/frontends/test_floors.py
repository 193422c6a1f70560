"""A floor, the lowest value of a potential, acts as sinabs' ``min_v_mem``, in the float reference and on the chip.

The expected spikes were recorded with sinabs itself, or are worked out by hand.
"""

from dataclasses import replace
from pathlib import Path

import nir
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from hw_model.errors import LocsnnError
from hw_model.streaming.early_stop import stop_when_proven
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.network.text import network_text, quantized_text
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from tests.support.net_files import dense, write_net
from tests.support.nir_graphs import chain, load_graph

RECORDED = Path(__file__).parent / "floors-by-sinabs.npz"
"""``tests/peers/record_sinabs_floors.py`` says what it holds and writes it."""
with np.load(RECORDED) as recorded:
    RECORDED_ARRAYS = {key: recorded[key] for key in recorded.files}
NETWORKS = sorted({key.split(".")[0] for key in RECORDED_ARRAYS})
LAYERS = {"1": "first", "3": "second"}
"""The neuron nodes of the recorded networks, and the names of their recorded spikes."""
CHIP_LEAST = 0.9
"""Least agreement of the chip, whose weights and decays are rounded, with sinabs' spikes of a first layer."""


def network_of(name: str, folder: Path, **options) -> lc.Network:
    """Return a network of sinabs; LIF neurons count their time constants in steps."""
    path = folder / "graph.nir"
    path.write_bytes(RECORDED_ARRAYS[f"{name}.nir"].tobytes())
    reset = name.split("-")[1]
    given = {"dt": 1.0, "discretisation": "hold", "floor": float(RECORDED_ARRAYS[f"{name}.floor"])}
    return lc.load(path, reset=reset, **{**given, **options})


def events_of(name: str):
    """The recorded input of a network, as a batch of one."""
    return RECORDED_ARRAYS[f"{name}.input"][None]


@pytest.mark.parametrize("name", NETWORKS)
def test_potentials_stop_falling_where_those_of_sinabs_do(name, tmp_path):
    network = network_of(name, tmp_path)
    ours = evaluate(network, events_of(name)).spikes
    for depth, (node, layer) in enumerate(LAYERS.items(), start=1):
        expected = RECORDED_ARRAYS[f"{name}.{layer}"]
        np.testing.assert_array_equal(ours[node][0, depth:], expected[:-depth], err_msg=layer)


@pytest.mark.parametrize("name", NETWORKS)
def test_without_a_floor_the_spikes_are_those_of_sinabs_without_min_v_mem(name, tmp_path):
    network = network_of(name, tmp_path, floor=None)
    ours = evaluate(network, events_of(name)).spikes["1"][0, 1:]
    np.testing.assert_array_equal(ours, RECORDED_ARRAYS[f"{name}.free"][:-1])
    assert (ours != RECORDED_ARRAYS[f"{name}.first"][:-1]).any()


@pytest.mark.parametrize("name", NETWORKS)
def test_the_chip_plays_the_integers_of_the_reference_to_the_bit(name, tmp_path):
    levels = lower(network_of(name, tmp_path), hw.chip("loihi-sim"), weight_bits=8)
    expected = evaluate(levels.quantized.on_grid(), events_of(name), potentials=True)
    for engine in ("fast", "reference"):
        probe = ("spikes", "potential")
        ours = hw.simulate(levels.program, events_of(name), engine=engine, probe=probe)
        for node in LAYERS:
            np.testing.assert_array_equal(ours.spikes[node], expected.spikes[node])
            np.testing.assert_array_equal(ours.potential[node], expected.potential[node])
        lowest = levels.quantized.population("1").neuron.vmin
        assert (expected.potential["1"].min(axis=(0, 1)) >= lowest).all()
        assert (expected.potential["1"].min(axis=(0, 1)) == lowest).any()


@pytest.mark.parametrize("name", NETWORKS)
def test_the_chip_spikes_nearly_as_sinabs_does(name, tmp_path):
    program = lower(network_of(name, tmp_path), hw.chip("loihi-sim"), weight_bits=8).program
    ours = hw.simulate(program, events_of(name)).spikes["1"][0, 1:]
    expected = RECORDED_ARRAYS[f"{name}.first"][:-1]
    assert 2 * (ours & expected).sum() / (ours.sum() + expected.sum()) >= CHIP_LEAST


def integrators(folder: Path, floor: float | None, thresholds=(1.0, 1.0), reset="zero", **options):
    """Return two layers of IF neurons, one for each of two inputs, with these thresholds."""
    layers = [
        nir.IF(r=np.ones(2), v_threshold=np.full(2, threshold), v_reset=np.zeros(2))
        for threshold in thresholds
    ]
    weights = [nir.Linear(np.array([[0.5, -0.75], [0.25, -2.0]])), nir.Linear(np.eye(2))]
    nodes = [("fc1", weights[0]), ("if1", layers[0]), ("fc2", weights[1]), ("if2", layers[1])]
    return load_graph(chain((2,), *nodes), folder, reset=reset, floor=floor, **options)


EVENTS = np.array([[[0, 1], [0, 1], [1, 0], [1, 0], [1, 0], [1, 0], [1, 0], [1, 0]]], np.uint8)
"""Two spikes of the second input, then the first input in every step, (1, 8, 2)."""


@pytest.mark.parametrize(
    ("floor", "potentials"),
    [
        # Neuron 0 gets -0.75 twice, then 0.5 in every step. A spike needs more than 1.
        pytest.param(None, (-0.75, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0), id="no floor"),
        pytest.param(-1.0, (-0.75, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5), id="at the threshold"),
        pytest.param(-0.25, (-0.25, -0.25, 0.25, 0.75, 1.25, 0.5, 1.0), id="above the first input"),
        pytest.param(0.0, (0.0, 0.0, 0.5, 1.0, 1.5, 0.5, 1.0), id="where it starts"),
    ],
)
@pytest.mark.parametrize("reset", ["zero", "late-zero"])
def test_potentials_by_hand(floor, potentials, reset, tmp_path):
    network = integrators(tmp_path, floor, reset=reset)
    ours = evaluate(network, EVENTS, potentials=True).potential["if1"][0, 1:, 0]
    compared = len(potentials)
    if reset == "late-zero":
        # The potentials above are those of an immediate reset, so compare up to the first spike. Without a spike, the
        # last one is left out.
        compared = next((i + 1 for i, v in enumerate(potentials) if v > 1), len(potentials) - 1)
    np.testing.assert_array_equal(ours[:compared], potentials[:compared])


@pytest.mark.parametrize("reset", ["zero", "subtract"])
def test_populations_of_different_floors_are_on_different_cores(reset, tmp_path):
    network = integrators(tmp_path, -1.0, thresholds=(1.0, 5.0), reset=reset)
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8)
    vmin_of_population = {
        q.population.name: set(q.neuron.vmin.tolist()) for q in levels.quantized.populations
    }
    assert len(vmin_of_population["if1"]) == len(vmin_of_population["if2"]) == 1
    assert vmin_of_population["if1"] != vmin_of_population["if2"]
    cores = levels.program.cores
    assert sorted(core.vmin for core in cores) == sorted(
        v for limits in vmin_of_population.values() for v in limits
    )
    for name, limits in vmin_of_population.items():
        (vmin,) = limits
        # A core's voltage ends at 1 - 2^k: 1 - vmin is a power of two.
        assert 1 - vmin == 1 << (1 - vmin).bit_length() - 1
        scale = levels.quantized.population(name).scale
        np.testing.assert_allclose(vmin / scale, -1.0, rtol=1e-2)


def test_thresholds_that_differ_share_one_floor(tmp_path):
    node = nir.IF(r=np.ones(3), v_threshold=np.array([1.0, 1.7, 3.1]), v_reset=np.zeros(3))
    weights = nir.Linear(np.array([[0.5], [-0.75], [1.0]]))
    network = load_graph(chain((1,), ("fc", weights), ("if", node)), tmp_path, floor=-0.7)
    (q,) = lower(network, hw.chip("loihi-sim"), weight_bits=8).quantized.populations
    assert len(set(q.neuron.vmin.tolist())) == 1
    np.testing.assert_allclose(q.neuron.vmin / q.scale, -0.7, rtol=1e-2)
    np.testing.assert_allclose(64 * q.neuron.threshold / q.scale, [1.0, 1.7, 3.1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("floor", "expected", "limit"),
    [("one-threshold", "-1", f"{-(2**18 - 1) / 2**18:.7g}"), ("at-rest", "0", "0")],
)
@pytest.mark.parametrize("reset", ["zero", "subtract"])
def test_the_report_states_the_floor_and_explains_every_difference(
    reset, floor, expected, limit, tmp_path
):
    name = f"iaf-{reset}-{floor}"
    compiled = lc.compile(network_of(name, tmp_path), events=events_of(name))
    message = (
        f"Potentials of '1' and '3' stop falling at {expected} from where they start (--floor), on the chip at {limit}: "
        "a core's voltage ends below at 1 - 2^k. What stops there is counted among the clips."
    )
    assert message in compiled.report["assumptions"]
    assert compiled.report["error_budget"]["unexplained_spikes"] == 0
    registers = compiled.report["margins"]["registers"]
    assert all(0 <= use["share_v"] <= 1 for use in registers.values())


@pytest.mark.slow
def test_levels_show_the_floor(tmp_path):
    levels = lower(integrators(tmp_path, -1.0), hw.chip("loihi-sim"), weight_bits=8)
    assert "refractory 1, floor -1" in network_text(levels.network)
    assert "refractory 1, vmin -262143" in quantized_text(levels.quantized)
    soft = lower(integrators(tmp_path, -1.0, reset="subtract"), hw.chip("loihi-sim"), weight_bits=8)
    assert "a spike takes 1, floor -1" in network_text(soft.network)
    assert ", vmin -" in quantized_text(soft.quantized)


def net_of_one_layer(folder: Path) -> Path:
    """Write a lava-dl network of one layer, and return its path."""
    path = folder / "model.net"
    write_net(
        path, [{"type": "input", "shape": [2]}, dense(np.random.default_rng(1), outs=2, ins=2)]
    )
    return path


def readout_of_leaks(folder, **options):
    """Load a graph whose only neurons are a readout."""
    leak = nir.LI(tau=np.full(2, 1e-3), r=np.ones(2), v_leak=np.zeros(2))
    return load_graph(chain((2,), ("fc", nir.Linear(np.eye(2))), ("li", leak)), folder, **options)


REFUSED = [
    pytest.param(
        lambda folder: integrators(folder, 0.5),
        "model 'graph.nir', node 'if1': the floor is above v_reset (0.5 against 0). "
        "Give a --floor of 0 or below.",
        id="above the reset",
    ),
    pytest.param(
        lambda folder: integrators(folder, float("nan")),
        "floor: the floor must be a finite number (nan). Give the lowest potential.",
        id="not a number",
    ),
    pytest.param(
        lambda folder: readout_of_leaks(folder, floor=-1.0),
        "model 'graph.nir', --floor: no neuron of this graph has a potential that a floor would hold. "
        "Leave it out.",
        id="nothing but a readout",
    ),
    pytest.param(
        lambda folder: lower(integrators(folder, -1e6), hw.chip("loihi-sim"), weight_bits=8),
        "population 'if1': no scale holds both the threshold and the floor of the potential (a floor of -1e+06 "
        "thresholds would move by 8.69e+05). Use a floor nearer to the threshold, or thresholds that differ less.",
        id="out of reach of the register",
    ),
    pytest.param(
        lambda folder: exchange_file(
            "nir", lower(integrators(folder, -1.0), hw.chip("loihi-sim"), weight_bits=8).quantized
        ),
        "--emit nir, population 'if1': the format cannot hold a floor of the potential. "
        "Emit another kind.",
        id="a graph of NIR",
    ),
    pytest.param(
        lambda folder: exchange_file(
            "net", lower(integrators(folder, -1.0), hw.chip("loihi-sim"), weight_bits=8).quantized
        ),
        "--emit net, population 'if1': the format cannot hold a floor of the potential. "
        "Emit another kind.",
        id="a network of lava-dl",
    ),
    pytest.param(
        lambda folder: lc.load(net_of_one_layer(folder), floor=-1.0),
        "model 'model.net': floor was given, but the neurons of a lava-dl network have none. "
        "Leave floor out.",
        id="a file of lava-dl",
    ),
]


@pytest.mark.parametrize(("refused", "message"), REFUSED)
def test_a_floor_that_cannot_be_held_is_refused(refused, message, tmp_path):
    with pytest.raises(LocsnnError) as caught:
        refused(tmp_path)
    assert str(caught.value) == message


@pytest.mark.parametrize("value", ["zero", "late-zero", "subtract", "late-subtract", "none"])
def test_the_stop_proof_holds_with_a_floor(value, tmp_path):
    network = integrators(tmp_path, -0.5, reset=value)
    program = lower(replace(network, steps=8), hw.chip("loihi-sim"), weight_bits=8).program
    stops = stop_when_proven(program, EVENTS)
    np.testing.assert_array_equal(stops.prediction, stops.final)
