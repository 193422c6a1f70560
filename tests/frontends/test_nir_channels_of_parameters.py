"""Parameters with one number per channel, (C, 1, 1), hold for every neuron of an image (C, H, W).

The expected spikes are those of the equations, stepped by ``tests/support/nir_forward.py``.
"""

import nir
import numpy as np
import pytest

from locsnn_compile.errors import InputError
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_forward import run
from tests.support.nir_graphs import DT, chain, cuba, lif, load_graph

RNG = np.random.default_rng(4)
CONV = nir.Conv2d(
    input_shape=(8, 8),
    weight=RNG.normal(0.05, 0.3, (4, 2, 3, 3)),
    stride=1,
    padding=1,
    dilation=1,
    groups=1,
    bias=RNG.normal(0, 0.1, 4),
)
BEHIND_IMAGES = {
    "LIF": [("n", lif(RNG, 4, 1, 1))],
    "CubaLIF": [("n", cuba(RNG, 4, 1, 1))],
    "Threshold": [("n", nir.Threshold(RNG.uniform(0.2, 0.8, (4, 1, 1))))],
    "Scale": [("s", nir.Scale(RNG.uniform(0.5, 1.5, (4, 1, 1)))), ("n", lif(RNG, 4, 8, 8))],
    "rows": [("n", lif(RNG, 1, 8, 1))],
}


@pytest.mark.parametrize("nodes", BEHIND_IMAGES.values(), ids=BEHIND_IMAGES)
def test_numbers_of_a_channel_are_those_of_its_neurons(nodes, tmp_path):
    graph = chain((2, 8, 8), ("conv", CONV), *nodes)
    events = (RNG.random((30, 2, 8, 8)) < 0.3).astype(np.uint8)
    expected = run(graph, events, DT)["n"].reshape(30, -1)
    spikes = evaluate(load_graph(graph, tmp_path), events.reshape(1, 30, -1)).spikes["n"][0]
    assert expected.sum() > 100
    assert np.array_equal(spikes[1:], expected[:-1])


def test_numbers_of_other_channels_are_refused(tmp_path):
    with pytest.raises(InputError) as refused:
        load_graph(chain((2, 8, 8), ("conv", CONV), ("n", lif(RNG, 3, 1, 1))), tmp_path)
    assert str(refused.value) == (
        "model 'graph.nir', node 'n': its parameters do not fit its input "
        "((3, 1, 1) against (4, 8, 8)). Give one number per neuron."
    )
