"""Every spiking network that can be trained: its float reference, and its program, spike by spike on random recordings."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import hw_model as hw
from locsnn_compile.data.orders import location_order
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.data.taxel_graph import taxel_graph
from locsnn_compile.errors import TargetError
from locsnn_compile.frontends.checkpoint import network_of
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription
from locsnn_compile.models.graph_and_windows import GraphParameters
from locsnn_compile.models.networks import build_network
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.passes.rounding.task import FINE
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate

STEPS = 24
SPIKING = [
    name
    for name, a in ARCHITECTURES.items()
    if a.spiking and not a.window_branch and a.neurons != "xylo"
]
"""All whose outputs spike and that a mesh of cores holds; ``test_window_network.py``, ``test_hybrid_window.py`` and
``test_train_for_xylo.py`` have the others."""
BACKWARDS = ",".join(str(taxel) for taxel in range(39, 0, -1))


def trained(
    name: str, fingertips: int = 1, *, order: str = "loop", graph: str = "manual"
) -> TouchModel:
    """A network with random weights under which every population spikes, in float64."""
    structure = ARCHITECTURES[name]
    order_name, taxels = (
        location_order(order, neutouch()) if "location" in structure.branches else (None, None)
    )
    edges = taxel_graph(graph, neutouch(), neighbours=3, nearer_mm=3.0)
    description = NetworkDescription(
        name,
        InputLayout(neutouch(fingertips), steps=STEPS, step_seconds=0.02),
        classes=5,
        hidden=9,
        graph=GraphParameters(graph, edges, features=4, step_features=3)
        if structure.graph
        else None,
        location_order=order_name,
        location_taxels=taxels,
    )
    return build_network(
        description, seed=3, initial_scale=40.0 if structure.neurons == "srm" else 6.0
    ).double()


def recordings(fingertips: int, samples: int = 3) -> np.ndarray:
    rng = np.random.default_rng(fingertips)
    return (rng.random((samples, STEPS, 78 * fingertips)) < 0.2).astype(np.uint8)


def checkpoint(model: TouchModel) -> Checkpoint:
    """The checkpoint of an untrained model."""
    return Checkpoint(
        model.description, model.weights(), recordings=None, training={}, sha256="0" * 64
    )


CASES = [
    *(
        pytest.param(name, fingertips, {}, id=f"{name}, {fingertips}")
        for name in SPIKING
        for fingertips in (1, 2)
    ),
    *(
        pytest.param("hybrid", 1, {"order": order}, id=f"hybrid, {order}")
        for order in ("arch", "whorl")
    ),
    pytest.param("hybrid-lif", 2, {"order": BACKWARDS}, id="hybrid-lif, an order of one's own"),
    *(
        pytest.param("tactile-sgnet", 1, {"graph": graph}, id=f"tactile-sgnet, {graph}")
        for graph in ("nearest", "tree")
    ),
]


@pytest.mark.parametrize(("name", "fingertips", "options"), CASES)
def test_the_float_reference_spikes_as_torch_does(
    name: str, fingertips: int, options: dict[str, str]
) -> None:
    model, played = trained(name, fingertips, **options), recordings(fingertips)
    in_torch = model(torch.from_numpy(played).double())
    found = evaluate(network_of(checkpoint(model)), played)
    for population, spikes in in_torch.items():
        assert spikes.sum() > 0
        assert np.array_equal(found.spikes[population], spikes.detach().numpy()), population
    assert np.array_equal(
        found.scores, model.counts(torch.from_numpy(played).double()).detach().numpy()
    )


@pytest.mark.parametrize(("name", "fingertips", "options"), CASES)
def test_the_program_spikes_as_its_integers_say(
    name: str, fingertips: int, options: dict[str, str]
) -> None:
    network = network_of(checkpoint(trained(name, fingertips, **options)))
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8, rounding=FINE)
    played = recordings(fingertips)
    expected = evaluate(levels.quantized.on_grid(), played)
    result = hw.simulate(levels.program, played)
    for population in network.populations:
        assert expected.spikes[population.name].any()
        assert np.array_equal(result.spikes[population.name], expected.spikes[population.name]), (
            population.name
        )


@pytest.mark.parametrize("name", ["tactile-snn-lif", "tactile-sgnet", "hybrid-graph"])
def test_integrate_and_fire_neurons_are_one_compartment_each(name: str) -> None:
    levels = lower(network_of(checkpoint(trained(name))), hw.chip("loihi-sim"), weight_bits=8)
    assert levels.quantized.strategy == "native"
    neurons = sum(population.size for population in levels.network.populations)
    assert sum(core.compartments for core in levels.program.cores) == neurons
    decays = {
        (int(n.decay_u[0]), int(n.decay_v[0]))
        for n in (q.neuron for q in levels.quantized.populations)
    }
    assert decays == {(4096, 3277)}


@pytest.mark.minutes
@pytest.mark.parametrize("fingertips", [1, 2])
@pytest.mark.parametrize(("name", "cores"), [("tactile-sgnet", 13), ("hybrid-graph", 27)])
def test_graph_networks_of_the_published_size_fit_a_chip(
    name: str, cores: int, fingertips: int
) -> None:
    order = ("loop", tuple(range(1, 40))) if name == "hybrid-graph" else (None, None)
    description = NetworkDescription(
        name,
        InputLayout(neutouch(fingertips), steps=325, step_seconds=0.02),
        classes=36,
        hidden=128,
        graph=GraphParameters(
            "manual", taxel_graph("manual", neutouch(), neighbours=3, nearer_mm=3.0)
        ),
        location_order=order[0],
        location_taxels=order[1],
    )
    network = network_of(checkpoint(build_network(description, initial_scale=4.0)))
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8, rounding=FINE)
    assert sum(core.compartments for core in levels.program.cores) == sum(
        p.size for p in network.populations
    )
    assert len(levels.program.cores) == cores


@pytest.mark.parametrize("name", ["gru-mlp", "cnn-3d"])
def test_artificial_networks_are_not_compiled(name: str) -> None:
    with pytest.raises(TargetError) as caught:
        network_of(checkpoint(trained(name)))
    assert str(caught.value) == (
        f"model 'model': a {name!r} has no spiking neurons, so no chip program can be made of it. "
        "Train a spiking network; for this one, only operations are counted."
    )
