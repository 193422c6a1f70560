"""Every spiking architecture that can be trained: torch against the float reference, and its program against its integers.

They are compared spike by spike on random recordings, with random weights under which every population spikes.
"""

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
"""Architectures whose outputs spike and that a mesh of cores holds; ``test_window_network.py``, ``test_hybrid_window.py``
and ``test_train_for_xylo.py`` test the others."""
TAXELS = 39
"""Touch-sensitive points of a NeuTouch fingertip, numbered from 1; each has a channel for each of two polarities."""
BACKWARDS = ",".join(str(taxel) for taxel in range(TAXELS, 0, -1))


def trained(
    name: str, fingertips: int = 1, *, order: str = "loop", graph: str = "manual"
) -> TouchModel:
    """Return a small torch network of an architecture with random weights, in float64."""
    structure = ARCHITECTURES[name]
    order_name, taxels = None, None
    if "location" in structure.branches:
        order_name, taxels = location_order(order, neutouch())
    graph_parameters = None
    if structure.graph:
        edges = taxel_graph(graph, neutouch(), neighbours=3, nearer_mm=3.0)
        graph_parameters = GraphParameters(graph, edges, features=4, step_features=3)
    # So large that neurons spike without training.
    initial_scale = 40.0 if structure.neurons == "srm" else 6.0
    description = NetworkDescription(
        name,
        InputLayout(neutouch(fingertips), steps=STEPS, step_seconds=0.02),
        classes=5,
        hidden=9,
        graph=graph_parameters,
        location_order=order_name,
        location_taxels=taxels,
    )
    return build_network(description, seed=3, initial_scale=initial_scale).double()


def recordings(fingertips: int, samples: int = 3) -> np.ndarray:
    """Return random recordings (samples, steps, channels)."""
    rng = np.random.default_rng(fingertips)
    channels = 2 * TAXELS * fingertips
    return (rng.random((samples, STEPS, channels)) < 0.2).astype(np.uint8)


def checkpoint(model: TouchModel) -> Checkpoint:
    """Return the checkpoint of an untrained model."""
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
    pytest.param("hybrid-lif", 2, {"order": BACKWARDS}, id="hybrid-lif, an order by taxel numbers"),
    *(
        pytest.param("tactile-sgnet", 1, {"graph": graph}, id=f"tactile-sgnet, {graph}")
        for graph in ("nearest", "tree")
    ),
]


@pytest.mark.parametrize(("name", "fingertips", "options"), CASES)
def test_the_float_reference_spikes_as_torch_does(
    name: str, fingertips: int, options: dict[str, str]
) -> None:
    model = trained(name, fingertips, **options)
    played = recordings(fingertips)
    torch_input = torch.from_numpy(played).double()
    reference = evaluate(network_of(checkpoint(model)), played)
    for population, spikes in model(torch_input).items():
        assert spikes.sum() > 0
        assert np.array_equal(reference.spikes[population], spikes.detach().numpy()), population
    assert np.array_equal(reference.scores, model.counts(torch_input).detach().numpy())


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
        spikes = expected.spikes[population.name]
        assert spikes.any()
        assert np.array_equal(result.spikes[population.name], spikes), population.name


@pytest.mark.parametrize("name", ["tactile-snn-lif", "tactile-sgnet", "hybrid-graph"])
def test_integrate_and_fire_neurons_are_one_compartment_each(name: str) -> None:
    levels = lower(network_of(checkpoint(trained(name))), hw.chip("loihi-sim"), weight_bits=8)
    assert levels.quantized.strategy == "native"
    neurons = sum(population.size for population in levels.network.populations)
    assert sum(core.compartments for core in levels.program.cores) == neurons
    # The current keeps nothing, and the potential 0.2: 4096 * 0.8 is 3276.8.
    for population in levels.quantized.populations:
        assert int(population.neuron.decay_u[0]) == 4096
        assert int(population.neuron.decay_v[0]) == 3277


@pytest.mark.minutes
@pytest.mark.parametrize("fingertips", [1, 2])
@pytest.mark.parametrize(("name", "cores"), [("tactile-sgnet", 13), ("hybrid-graph", 27)])
def test_graph_networks_of_the_published_size_fit_a_chip(
    name: str, cores: int, fingertips: int
) -> None:
    order_name, taxels = None, None
    if name == "hybrid-graph":
        order_name, taxels = "loop", tuple(range(1, TAXELS + 1))
    edges = taxel_graph("manual", neutouch(), neighbours=3, nearer_mm=3.0)
    description = NetworkDescription(
        name,
        InputLayout(neutouch(fingertips), steps=325, step_seconds=0.02),
        classes=36,
        hidden=128,
        graph=GraphParameters("manual", edges),
        location_order=order_name,
        location_taxels=taxels,
    )
    network = network_of(checkpoint(build_network(description, initial_scale=4.0)))
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8, rounding=FINE)
    compartments = sum(core.compartments for core in levels.program.cores)
    assert compartments == sum(population.size for population in network.populations)
    assert len(levels.program.cores) == cores


@pytest.mark.parametrize("name", ["gru-mlp", "cnn-3d"])
def test_conventional_networks_are_refused(name: str) -> None:
    with pytest.raises(TargetError) as caught:
        network_of(checkpoint(trained(name)))
    assert str(caught.value) == (
        f"model 'model': a {name!r} has no spiking neurons, so no chip program can be made of it. "
        "Train a spiking network; for this one, only operations are counted."
    )
