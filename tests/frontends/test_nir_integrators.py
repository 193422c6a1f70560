"""What a spike adds to an IF node: its weight with r = 1, else r * dt times its weight, which an assumption states.

The expected steps are worked out by hand.
"""

import nir
import numpy as np
import pytest

from locsnn_compile.errors import InputError
from locsnn_compile.reference.evaluate import evaluate
from tests.support.nir_graphs import chain, load_graph

WEIGHT = 0.0625
"""A sixteenth of the threshold: the 17th input passes it, which acts in step 17."""


def integrators(*resistances: float) -> nir.NIRGraph:
    """Return IF neurons of threshold 1 with these r, each behind the one input."""
    size = len(resistances)
    ones = np.ones(size)
    neuron = nir.IF(r=np.array(resistances), v_threshold=ones, v_reset=0 * ones)
    return chain((1,), ("w", nir.Linear(np.full((size, 1), WEIGHT))), ("n", neuron))


def first_spike_steps(network) -> list[int | None]:
    """Return the first spike of each neuron if the input spikes in every step; None for no spike in 40 steps."""
    spikes = evaluate(network, np.ones((1, 40, 1), np.uint8)).spikes["n"][0]
    return [int(np.flatnonzero(row)[0]) if row.any() else None for row in spikes.T]


@pytest.mark.parametrize("dt", [None, 1e-4, 1.0], ids=["no step is given", "1e-4", "1"])
def test_with_r_1_a_spike_adds_its_weight(dt, tmp_path):
    network = load_graph(integrators(1.0), tmp_path, dt=dt)
    assert first_spike_steps(network) == [17]
    assert not [sentence for sentence in network.assumptions if "IF node" in sentence]


@pytest.mark.parametrize("r", [1.001, 2.0])
def test_another_r_is_refused_without_a_step(r, tmp_path):
    with pytest.raises(InputError) as refused:
        load_graph(integrators(1.0, r), tmp_path, dt=None)
    assert str(refused.value) == (
        "model 'graph.nir', node 'n': r is neither 1 nor 1 / dt, so what a spike adds is not known "
        f"(r {r:g}). Give --dt: a spike then adds r * dt times its weight."
    )


def test_with_a_step_the_equation_holds_and_an_assumption_lists_the_neurons(tmp_path):
    """r * dt is 0.5 in the second neuron: it needs 33 inputs of 0.03125 to pass 1."""
    network = load_graph(integrators(1.0, 500.0, 2.0, 2.0, 1000.0), tmp_path, dt=1e-3)
    assert first_spike_steps(network) == [17, 33, None, None, 17]
    (sentence,) = [sentence for sentence in network.assumptions if "IF node" in sentence]
    assert sentence == (
        "In IF node 'n', a spike adds its whole weight where r is 1 (neuron 0), 0.002 of its weight "
        "(r * dt) where r is 2 (2 neurons), 0.5 of its weight (r * dt) where r is 500 (neuron 1), "
        "1 of its weight (r * dt) where r is 1000 (neuron 4)."
    )


def test_r_of_one_over_the_step_needs_no_assumption(tmp_path):
    network = load_graph(integrators(1000.0), tmp_path, dt=1e-3)
    assert first_spike_steps(network) == [17]
    assert not [sentence for sentence in network.assumptions if "IF node" in sentence]
