"""Neurons and pooling of state dicts as NIR nodes: each class with its options, parameters worked out by hand.

Time constants are counted in steps. With ``r = tau``, a spike adds its whole weight to a potential.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from hw_model.errors import InputError
from hw_model.io.records import RecordReader
from locsnn_compile.frontends.nir.neurons import Reading
from locsnn_compile.frontends.torch_layers.chain import Chain
from locsnn_compile.frontends.torch_layers.layers import LAYERS
from locsnn_compile.frontends.torch_layers.neurons import NEURON_TYPES

TYPES = LAYERS | NEURON_TYPES


def added(kind: str, options: dict, tensors: dict | None = None) -> Chain:
    """Return a chain to which a layer ``n`` was added, with the tensors of the layer in its state dict."""
    named = {f"n.{key}": np.array(value) for key, value in (tensors or {}).items()}
    chain = Chain("model 'net.pt'", named, axes=3)
    RecordReader("config").record(TYPES[kind], options).add_to(chain, "n")
    return chain


def euler(reset: str, rule: str = ">") -> Reading:
    """Return a reading by Euler's method, without a floor."""
    return Reading(dt=1.0, discretisation="euler", reset=reset, rule=rule)


def held(reset: str, floor: float | None = None) -> Reading:
    """Return a reading whose input is held during a step; a potential at the threshold spikes."""
    return Reading(dt=1.0, discretisation="hold", reset=reset, floor=floor, rule=">=")


ENDS = {"v_threshold": 1.0, "v_reset": 0.0}
LEAKY = {"tau": 4.0, "r": 4.0, "v_leak": 0.0} | ENDS
SYNAPTIC = {"tau_syn": 2.0, "tau_mem": 4.0, "r": 4.0, "w_in": 2.0, "v_leak": 0.0} | ENDS
SINABS_LIF = {"tau": 2.0, "r": 1.0, "v_leak": 0.0} | ENDS
UNDIVIDED = 1 / (1 - math.exp(-1 / 2))
"""What undoes the factor 1 - exp(-1 / tau) of an input that is held, for a tau of 2."""

NEURONS = {
    "snntorch.Leaky": ({"beta": 0.75}, "LIF", LEAKY, euler("late-subtract")),
    "snntorch.Leaky to zero": ({"beta": 0.75, "threshold": 2.0, "reset_mechanism": "zero"}, "LIF", LEAKY | {"v_threshold": 2.0}, euler("zero")),
    "snntorch.Leaky, at once": ({"beta": 0.75, "reset_delay": False}, "LIF", LEAKY, euler("subtract")),
    "snntorch.Leaky without reset": ({"beta": 0.75, "reset_mechanism": "none"}, "LIF", LEAKY, euler("none")),
    "snntorch.Synaptic": ({"alpha": 0.5, "beta": 0.75}, "CubaLIF", SYNAPTIC, euler("late-subtract")),
    "snntorch.Synaptic to zero": ({"alpha": 0.5, "beta": 0.75, "reset_mechanism": "zero"}, "CubaLIF", SYNAPTIC, euler("late-zero")),
    "spikingjelly.IFNode": ({}, "IF", {"r": 1.0} | ENDS, euler("zero", ">=")),
    "spikingjelly.LIFNode": ({"tau": 4.0}, "LIF", LEAKY | {"r": 1.0}, euler("zero", ">=")),
    "spikingjelly.LIFNode with whole inputs": ({"tau": 4.0, "decay_input": False, "v_reset": None}, "LIF", LEAKY, euler("subtract", ">=")),
    "norse.LIFBoxCell": ({"dt": 0.5, "tau_mem_inv": 0.5}, "LIF", LEAKY | {"r": 1.0}, euler("zero")),
    "sinabs.IAF": ({"min_v_mem": -1.0}, "IF", {"r": 1.0} | ENDS, held("subtract", -1.0)),
    "sinabs.LIF": ({"tau_mem": 2.0, "reset_fn": "MembraneReset"}, "LIF", SINABS_LIF, held("zero")),
    "sinabs.LIF with whole inputs": ({"tau_mem": 2.0, "norm_input": False}, "LIF", SINABS_LIF | {"r": UNDIVIDED}, held("subtract")),
}  # fmt: skip
"""By the name of the class, and what is special: its options, and the kind, parameters and reading of the node."""


@pytest.mark.parametrize("case", NEURONS)
def test_the_node_and_the_reading_of_neurons(case):
    options, kind, parameters, reading = NEURONS[case]
    chain = added(case.partition(" ")[0].rstrip(","), options)
    node = chain.nodes["n"]
    assert (node.kind, chain.readings["n"]) == (kind, reading)
    numbers = {name: float(value) for name, value in node.parameters.items()}
    assert numbers == pytest.approx(parameters, rel=1e-15)
    assert (chain.last, chain.spiking) == ("n", True)


def test_a_parametric_time_constant_is_that_of_a_sigmoid():
    """A w of 0 has the sigmoid 1 / 2, and so a time constant of 2."""
    node = added("spikingjelly.ParametricLIFNode", {}, {"w": 0.0}).nodes["n"]
    assert (float(node.parameters["tau"]), float(node.parameters["r"])) == (2.0, 1.0)


@pytest.mark.parametrize(
    ("number", "reset"), [(0, "late-subtract"), (1, "zero"), (2, "none")], ids=["0", "1", "2"]
)
def test_a_state_dict_gives_the_reset_by_its_number(number, reset):
    tensors = {"beta": 0.75, "reset_mechanism_val": number}
    assert added("snntorch.Leaky", {}, tensors).readings["n"] == euler(reset)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"beta": 0.75, "reset_mechanism": "half"}, "model 'net.pt', layer 'n', reset_mechanism: 'half' is not known. Choose one of: none, subtract, zero."),
        ({"beta": 1.5}, "config: beta: it must be a number from 0 to 1 (got 1.5). Correct it."),
        ({}, "model 'net.pt', layer 'n', beta: it is missing. Add it."),
    ],
    ids=["an unknown reset", "a share above 1", "no share"],
)  # fmt: skip
def test_options_of_neurons_that_are_refused(options, message):
    with pytest.raises(InputError) as error:
        added("snntorch.Leaky", options)
    assert str(error.value) == message


@pytest.mark.parametrize("kind", ["AvgPool2d", "SumPool2d"])
def test_pooling_becomes_a_node_of_its_own(kind):
    """Its stride is its kernel unless it is given."""
    chain = added(kind, {"kernel_size": [2, 3], "padding": 1})
    node = chain.nodes["n"]
    assert node.kind == kind
    parameters = {name: np.array(value).tolist() for name, value in node.parameters.items()}
    assert parameters == {"kernel_size": [2, 3], "stride": [2, 3], "padding": [1]}
    assert (chain.last, chain.spiking) == ("n", False)
