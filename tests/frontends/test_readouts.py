"""Readout neurons never spike; the predicted class is that of the largest potential, in the reference and on the chip.

The expected potentials are those of the equations (``tests/support/nir_forward.py``).
"""

import nir
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.net_files import dense, neuron, write_net
from tests.support.nir_forward import run
from tests.support.nir_graphs import DT, chain, lif, linear, load_graph

RNG = np.random.default_rng(31)
TAU, ONES = RNG.uniform(4e-3, 2e-2, 5), np.ones(5)
READOUTS = {
    "LI": nir.LI(tau=TAU, r=TAU / DT, v_leak=0 * ONES),
    "CubaLI": nir.CubaLI(tau_syn=TAU / 2, tau_mem=TAU, r=TAU / DT, v_leak=0 * ONES, w_in=2 * ONES),
    "LI at rest off 0": nir.LI(tau=TAU, r=TAU / DT, v_leak=RNG.normal(0, 0.5, 5)),
}
EVENTS = (RNG.random((12, 60, 10)) < RNG.uniform(0, 1, (12, 1, 10)) ** 2).astype(np.uint8)


def graph(kind):
    """Return a graph of 10 inputs and 12 LIF neurons, whose readout has 5 neurons of a kind."""
    return chain(
        (10,),
        ("fc", linear(RNG, outs=12, ins=10)),
        ("lif", lif(RNG, 12)),
        ("w", linear(RNG, outs=5, ins=12)),
        ("read", READOUTS[kind]),
    )


@pytest.mark.parametrize("kind", READOUTS)
def test_the_class_is_that_of_the_largest_potential_of_the_equations(kind, tmp_path):
    nir_graph = graph(kind)
    network = load_graph(nir_graph, tmp_path)
    # On the chip, the readout is two steps behind, so the last two steps of a recording do not reach it.
    expected = [run(nir_graph, events[:-2], DT)["read"].max(axis=0).argmax() for events in EVENTS]
    assert network.readout.potentials_from == 2
    ours = evaluate(network, EVENTS)
    np.testing.assert_array_equal(ours.prediction, expected)
    assert len(set(expected)) > 1
    assert ours.spikes["read"].sum() == 0


@pytest.mark.parametrize("kind", ["LI", "CubaLI"])
def test_the_chip_predicts_the_same_class_in_both_engines_and_from_a_file(kind, tmp_path):
    compiled = lc.compile(load_graph(graph(kind), tmp_path), events=EVENTS)
    assert compiled.match.prediction_agreement >= 0.9
    compiled.program.save(tmp_path / "program")
    predicted = compiled.match.chip_prediction
    for program in (compiled.program, hw.load_program(tmp_path / "program")):
        for engine in ("fast", "reference"):
            result = hw.simulate(program, EVENTS, engine=engine, probe=("potential",))
            np.testing.assert_array_equal(result.prediction, predicted)
            np.testing.assert_array_equal(
                result.scores, result.potential["read"][:, 2:].max(axis=1)
            )
    over_time = compiled.report["over_time"]
    assert over_time["right"]["together"][-1] == 1.0
    assert over_time["proven_stop"]["steps"] <= over_time["proven_stop"]["all_steps"] == 60


def test_neurons_of_a_readout_share_a_scale(tmp_path):
    compiled = lc.compile(load_graph(graph("LI"), tmp_path), events=EVENTS, diagnosis=False)
    assert len(set(compiled.levels.quantized.population("read").scale.tolist())) == 1


def test_potentials_start_at_rest(tmp_path):
    nir_graph = graph("LI at rest off 0")
    network = load_graph(nir_graph, tmp_path)
    ours = evaluate(network, EVENTS[:1], potentials=True).potential["read"][0, 2:]
    np.testing.assert_allclose(ours, run(nir_graph, EVENTS[0], DT)["read"][:-2], atol=1e-9)


def test_the_last_layer_of_a_lava_dl_file_that_never_spikes_is_a_readout(tmp_path):
    layers = [
        dense(RNG, outs=12, ins=10),
        dense(RNG, outs=5, ins=12, neuron=neuron(threshold=2**18 - 1)),
    ]
    write_net(tmp_path / "model.net", layers)
    compiled = lc.compile(lc.load(tmp_path / "model.net"), events=EVENTS, diagnosis=False)
    assert compiled.network.readout.potentials_from == 2
    assert compiled.match.prediction_agreement == 1
    assert len(set(compiled.match.chip_prediction.tolist())) > 1


def test_a_readout_without_leak_is_refused(tmp_path):
    endless = nir.LI(tau=np.full(5, np.inf), r=np.full(5, np.inf), v_leak=0 * ONES)
    with pytest.raises(lc.InputError) as caught:
        load_graph(chain((10,), ("w", linear(RNG, outs=5, ins=10)), ("read", endless)), tmp_path)
    message = "model 'graph.nir', node 'read': a readout without leak overflows every register. Give it a tau."
    assert str(caught.value) == message


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["LI", "CubaLI"])
def test_sessions_and_stops_predict_by_potentials(kind, tmp_path):
    program = lc.compile(load_graph(graph(kind), tmp_path), events=EVENTS, diagnosis=False).program
    result = hw.simulate(program, EVENTS, probe=("potential",))
    session = hw.Session(program)
    for recording, potential, prediction in zip(
        EVENTS, result.potential["read"], result.prediction, strict=True
    ):
        session.reset()
        rows = [session.push(row) for row in recording]
        # Potentials count from step 2 on; step 30 stands for any later one.
        assert rows[1].scores.tolist() == [[0] * 5]
        assert rows[2].scores.tolist() == [potential[2].tolist()]
        assert rows[30].potential["read"].tolist() == [potential[2:31].max(axis=0).tolist()]
        assert rows[-1].prediction == prediction
        assert rows[-1].spikes == {}
    proven = hw.stop_when_proven(program, EVENTS)
    assert np.array_equal(proven.prediction, result.prediction)
    margin = hw.calibrate_margin(program, EVENTS, 1.0)
    stops = hw.stop_at_margin(program, EVENTS, margin)
    assert np.array_equal(stops.prediction, stops.final)
    assert stops.steps.mean() < 60
    assert stops.counts.synaptic_ops < stops.all_counts.synaptic_ops


# What a simulation is asked to keep, while the readout needs all potentials of the outputs.
PROBES = {
    "both registers": ("v", "potential"),
    "rows before those that decide": ("v", hw.Probe("potential", None, range(2))),
    "another population": (hw.Probe("potential", ("lif",)),),
    "a few rows of the outputs": (hw.Probe("potential", ("read",), range(3, 5)),),
}


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["fast", "reference"])
@pytest.mark.parametrize("probes", PROBES.values(), ids=PROBES)
def test_probes_and_readout_are_kept_side_by_side(probes, engine, tmp_path):
    program = lc.compile(load_graph(graph("LI"), tmp_path), events=EVENTS, diagnosis=False).program
    plain = hw.simulate(program, EVENTS, engine=engine)
    all_potentials = hw.simulate(program, EVENTS, probe=("potential",), engine=engine).potential
    ours = hw.simulate(program, EVENTS, probe=probes, engine=engine)
    assert np.array_equal(ours.scores, plain.scores)
    expected = probes[-1] if isinstance(probes[-1], hw.Probe) else hw.Probe("potential")
    rows = (
        slice(None) if expected.steps is None else slice(expected.steps.start, expected.steps.stop)
    )
    assert sorted(ours.potential) == sorted(expected.populations or program.populations)
    assert all(
        np.array_equal(ours.potential[name], all_potentials[name][:, rows])
        for name in ours.potential
    )
