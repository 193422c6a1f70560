"""A network lists exactly the assumptions that were needed to read its file.

Each file leaves known facts open, so the expected sentences are written out here.
"""

import json

import nir
import numpy as np
import pytest
import torch

import locsnn_compile as lc
from hw_model import chip
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.passes.quantize import quantize
from tests.support.nir_graphs import chain, graphs, lif, linear
from tests.support.slayer_files import LOIHI, write

GRAPHS = graphs()
RNG = np.random.default_rng(0)
# The sentences of the assumptions.
STEP = (
    "The NIR graph does not say how long a step is: its constants were read in steps of 0.0001 s, the convention "
    "(--dt)."
)
RESET = "The NIR graph does not say how a spike resets: its potential goes to v_reset at once (--reset zero)."
TS_UNIT = (
    "The Ts of the YAML, 1, was read as milliseconds, which SLAYER does not say (--step-seconds)."
)
EULER = "The NIR graph does not say how its equations become steps: by Euler's method (--discretisation euler)."


def saved(graph, tmp_path):
    """Write a NIR graph, and return its path."""
    nir.write(tmp_path / "graph.nir", graph)
    return tmp_path / "graph.nir"


THRESHOLDS = chain((3,), ("w", linear(RNG, outs=2, ins=3)), ("out", nir.Threshold(np.ones(2))))
INTEGRATORS = chain(
    (3,),
    ("w", linear(RNG, outs=2, ins=3)),
    ("out", nir.IF(np.ones(2), np.ones(2), v_reset=np.zeros(2))),
)
IDLE = nir.NIRGraph(
    THRESHOLDS.nodes | {"more": linear(RNG, outs=5, ins=2)},
    [*THRESHOLDS.edges, ("out", "more")],
    type_check=False,
)
LEAKY = chain((3,), ("w", linear(RNG, outs=2, ins=3)), ("out", lif(RNG, 2)))


@pytest.mark.parametrize(
    ("graph", "options", "expected"),
    [
        pytest.param(LEAKY, {}, (STEP, RESET, EULER), id="all"),
        pytest.param(LEAKY, {"dt": 1e-3}, (RESET, EULER), id="the step is given"),
        pytest.param(
            LEAKY,
            {"reset": "zero"},
            (STEP, EULER),
            id="the reset is given, though it is the usual one",
        ),
        pytest.param(
            LEAKY, {"discretisation": "hold"}, (STEP, RESET), id="the discretisation is given"
        ),
        pytest.param(
            LEAKY, {"dt": 1e-3, "reset": "zero", "discretisation": "euler"}, (), id="none"
        ),
        pytest.param(INTEGRATORS, {}, (STEP, RESET), id="nothing to discretise"),
        pytest.param(THRESHOLDS, {}, (), id="nothing of it matters"),
        pytest.param(
            IDLE,
            {},
            ("The weights of 'more' feed no node and were left out.",),
            id="weights lead nowhere",
        ),
    ],
)
def test_a_nir_graph_has_a_sentence_for_each_open_fact_that_matters(
    graph, options, expected, tmp_path
):
    assert lc.load(saved(graph, tmp_path), **options).assumptions == expected


@pytest.mark.parametrize("dt", [None, 2e-4])
def test_the_step_of_a_graphs_constants_is_not_that_of_recordings(dt, tmp_path):
    network = lc.load(saved(LEAKY, tmp_path), dt=dt)
    assert network.stated_step_seconds is None
    assert (network.recordings.step_seconds, network.recordings.origin) == (None, "made up")


@pytest.mark.parametrize("dt", [None, 2e-4])
def test_an_unknown_step_is_not_written_into_a_file(dt, tmp_path):
    network = lc.load(saved(LEAKY, tmp_path), dt=dt)
    (tmp_path / "again.nir").write_bytes(exchange_file("nir", quantize(network, chip("loihi-sim"))))
    written_again = lc.load(tmp_path / "again.nir")
    assert written_again.origin.metadata.get("dt") == dt
    assert written_again.stated_step_seconds is None
    np.testing.assert_array_equal(
        written_again.populations[0].neuron.decay_v, network.populations[0].neuron.decay_v
    )


def weights(outputs, inputs):
    """Random weights (outs, ins), of which most excite."""
    return RNG.normal(1, 2, (outputs, inputs))


TAILS = "The reference has the tails of its kernels, which slayerPytorch cuts in training (--kernels full)."


@pytest.mark.parametrize(
    ("layers_by_name", "options", "description", "expected"),
    [
        pytest.param({"fc1": weights(3, 6)}, {}, {}, (TAILS,), id="tails"),
        pytest.param({"fc1": weights(3, 6)}, {"kernels": "full"}, {}, (), id="tails asked for"),
        pytest.param({"fc1": weights(3, 6)}, {}, {"neuron": LOIHI}, (), id="no tails"),
        pytest.param(
            {"location1": weights(3, 40)},
            {},
            {"neuron": LOIHI},
            (
                "The description has no location_order: taxels are visited in the order loop.",
                "No layer along time says how many channels there are: 156, those of two fingertips.",
            ),
            id="location alone",
        ),
        pytest.param(
            {"location1": weights(3, 40), "fc1": weights(3, 156)},
            {},
            {"neuron": LOIHI, "location_order": "arch"},
            (
                "The checkpoint does not say which layers run, nor over what: all were taken by their names and order, "
                "time=fc1, location=location1 (--branches).",
            ),
            id="order and channels said",
        ),
        pytest.param(
            {"fc1": weights(4, 6), "fc2": weights(3, 4)},
            {},
            {"neuron": LOIHI, "extra": {"delay.delay": torch.tensor([0.0, 1.2, 2.9, 70.0])}},
            (
                "The checkpoint does not say which layers run, nor over what: all were taken by their names and order, "
                "time=fc1,fc2 (--branches).",
                "Delays 'delay.delay' are used for layer 'fc1', the first with as many outputs.",
                "Delays 'delay.delay' above 62 steps were cut to 62.",
            ),
            id="delays",
        ),
    ],
)
def test_a_slayer_checkpoint_has_a_sentence_for_each_open_fact(
    layers_by_name, options, description, expected, tmp_path
):
    assumptions = lc.load(*write(tmp_path, layers_by_name, **description), **options).assumptions
    assert assumptions == (*expected, TS_UNIT)


@pytest.mark.parametrize(
    ("options", "recorded_seconds", "unit_is_assumed"),
    [
        pytest.param([], 0.06, True, id="Ts 1 read as milliseconds"),
        pytest.param(["--step-seconds", "0.02"], 1.2, False, id="bins of 20 ms"),
    ],
)
def test_step_seconds_says_how_long_a_step_of_a_slayer_description_lasts(
    options, recorded_seconds, unit_is_assumed, tmp_path
):
    """A recording of 60 steps lasts 60 times the length of a step."""
    layers = {"fc1": RNG.normal(0, 0.5, (4, 78)), "fc2": RNG.normal(0, 2, (3, 4))}
    model, config = write(tmp_path, layers, steps=60)
    arguments = [str(model), "--config", str(config), *options, "-o", str(tmp_path / "out")]
    assert compile_main([*arguments, "--quiet"]) == 0
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["latency"]["recording_ns"] == pytest.approx(1e9 * recorded_seconds)
    assert (TS_UNIT in report["assumptions"]) == unit_is_assumed
