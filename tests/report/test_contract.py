"""The contract with those who read builds and call the package: it must not change by accident.

It consists of the keys of report.json and their types for every shipped chip, the files of a build, exit codes of gates,
and the first parameters of public functions. All are written out here, independently of the code.

Keys are null where a chip cannot have them: an open core has no mesh and, unless it is made of standard cells, no
energies.
"""

from __future__ import annotations

import inspect
import json
from functools import reduce

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.compile import main
from locsnn_compile.data.sensor import neutouch
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.description import InputLayout, NetworkDescription

NUMBER = (int, float)
NONE = type(None)
OPERATIONS = ("synaptic_ops", "neuron_updates", "spikes", "input_events", "transpose_events")
UNPRICED = ("ecp5-25f", "ecp5-85f", "ice40up5k")
"""Devices, for which no power model is public."""
KEYS = {
    "schema": str,
    "model": {"name": str, "sha256": str, "members": list},
    "target": str,
    "strategy": str,
    "weight_bits": int,
    "match": {
        **dict.fromkeys(("samples", "spike_mismatches", "reference_spikes", "wraps", "clips"), int),
        "events_source": str,
        "prediction_agreement": (float, NONE),
        "spike_agreement": (float, NONE),
        "first_divergence": (dict, NONE),
        "tied_predictions": int,
        "helper_neurons": dict,
        "by_population": dict,
    },
    "accuracy": (dict, NONE),
    "operations": {"per_sample": dict.fromkeys(OPERATIONS, NUMBER), "by_branch": {"time": dict}},
    "energy": {"profile": str, "per_sample_pj": NUMBER, "breakdown_pj": dict, "not_included": list},
    "latency": {
        "per_sample_ns": NUMBER,
        "per_sample_cycles": int,
        "critical_core": int,
        "basis": str,
    },
    "resources": {
        **dict.fromkeys(
            ("cores", "compartments", "synapses", "synapse_bits", "axons_in", "axons_out"), int
        ),
        "limits": dict,
    },
    "ann_comparison": {
        name: dict.fromkeys(("operations", "ratio", "chip_ratio"), (*NUMBER, NONE))
        for name in ("cnn-3d", "gru-mlp")
    },
    "skipped": {
        **dict.fromkeys(("steps", "events_dropped"), NUMBER),
        **dict.fromkeys(("synapses_pruned", "compartments_pruned"), int),
    },
    "assumptions": list,
    "gates": list,
    "input": {"aligned_steps": NUMBER},
}
"""The keys of report.json, with the type of each value; for a mapping, the keys that it must have."""
NO_MESH = ("latency.critical_core",)
NO_ENERGY = tuple(
    f"energy.{key}" for key in ("profile", "per_sample_pj", "breakdown_pj", "not_included")
)
NULL = {
    "loihi-sim": (),
    "tiny-sim": (),
    "ecp5-25f": NO_MESH + NO_ENERGY,
    "ecp5-85f": NO_MESH + NO_ENERGY,
    "ice40up5k": NO_MESH + NO_ENERGY,
    "locsnn-130nm": NO_MESH,
}
"""The keys that are null in the report of each shipped chip, whatever the network."""
FILES = {"program.yaml", "program.npz", "report.json", "report.md", "report.html"}


def departures(keys, document, null, path=""):
    """Yield each key of ``keys`` that is missing in a document, or whose value has another type.

    The values of keys in ``null`` must be None. ``path`` begins the names of all keys.
    """
    for key, expected in keys.items():
        name = f"{path}{key}"
        if key not in document:
            yield f"{name} is missing"
        elif name in null:
            if document[key] is not None:
                yield f"{name} is not null"
        elif isinstance(expected, dict):
            yield from departures(expected, document[key], null, f"{name}.")
        # True is an int to Python, but not a number to a reader of JSON.
        elif not isinstance(document[key], expected) or isinstance(document[key], bool):
            yield f"{name} is {document[key]!r}"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The checkpoint of a network with random weights that is small enough for every chip."""
    layout = InputLayout(neutouch(1), steps=40, step_seconds=0.02)
    description = NetworkDescription("tactile-snn", layout, classes=3, hidden=6, name="small")
    r = np.random.default_rng(0)
    weights = {
        name: r.normal(0.5, 2.0, shape).astype(np.float32)
        for name, shape in description.weight_shapes.items()
    }
    path = tmp_path_factory.mktemp("model") / "small.pt"
    Checkpoint(description, weights).save(path)
    return path


@pytest.fixture(scope="module", params=NULL)
def build(request, model, tmp_path_factory):
    """The name of a chip, the folder of a build for it with gates on energy and time, and the exit code of the build."""
    folder = tmp_path_factory.mktemp("build")
    bounds = "--max-energy-nj", "1e6", "--max-latency-us", "1e6"
    code = main([str(model), "--target", request.param, "-o", str(folder), "--quiet", *bounds])
    return request.param, folder, code


def test_every_chip_that_ships_is_here():
    assert sorted(hw.chip_names()) == sorted(NULL)


@pytest.mark.slow
def test_a_report_has_the_keys_that_others_read(build):
    target, folder, _ = build
    report = json.loads((folder / "report.json").read_text())
    assert list(departures(KEYS, report, NULL[target])) == []
    assert report["target"] == target
    assert {path.name for path in folder.iterdir()} == FILES


@pytest.mark.slow
def test_a_gate_on_an_energy_that_is_not_known_fails(build):
    target, folder, code = build
    energy, latency = json.loads((folder / "report.json").read_text())["gates"]
    assert set(energy) == set(latency) == {"name", "bound", "measured", "passed"}
    is_known = target not in UNPRICED
    assert energy["passed"] == is_known
    assert (energy["measured"] is not None) == is_known
    assert code == (0 if is_known else 3)
    assert latency["passed"]


@pytest.mark.parametrize(
    ("path", "value", "departure"),
    [
        ("match.samples", None, "match.samples is None"),
        ("energy.per_sample_pj", "1", "energy.per_sample_pj is '1'"),
        ("resources.cores", True, "resources.cores is True"),
        ("energy.profile", "davies2018", "energy.profile is not null"),
        ("skipped.steps", ..., "skipped.steps is missing"),
    ],
    ids=["null", "text", "truth", "not null", "missing"],
)
def test_a_planted_departure_is_found(build, path, value, departure):
    """The value ``...`` stands for a key that is taken out."""
    _, folder, _ = build
    report = json.loads((folder / "report.json").read_text())
    *outer_keys, last_key = path.split(".")
    entry = reduce(dict.__getitem__, outer_keys, report)
    if value is ...:
        del entry[last_key]
    else:
        entry[last_key] = value
    null = NO_ENERGY + NO_MESH if departure.endswith("not null") else ()
    assert departure in list(departures(KEYS, report, null))


SIGNATURES = [
    (lc.load, "model, config=None, dt=None"),
    (lc.compile, "network, target='loihi-sim', strategy='auto', weight_bits=None, events=None"),
    (lc.verify, "compiled, events, labels=None"),
    (lc.train, "recordings, config=None"),
    (hw.chip, "name_or_path"),
    (hw.ProgramBuilder.add_input, "self, name, size"),
    (
        hw.ProgramBuilder.add_compartments,
        "self, name, size, decay_u=0, decay_v=0, threshold, bias=0, refractory=1, vmin=None, vmax=None",
    ),
    (
        hw.ProgramBuilder.connect,
        "self, source, target, weights, exponent=0, delay=0, weight_bits=None, sign_mode='mixed'",
    ),
    (hw.ProgramBuilder.build, "self"),
    (hw.simulate, "program, spikes, steps=None, engine='fast', probe=('spikes',)"),
    (hw.ChipProgram.save, "self, folder"),
    (hw.load_program, "folder"),
]
"""Public functions with their first parameters; more may follow."""


@pytest.mark.parametrize(
    ("function", "first_parameters"), SIGNATURES, ids=[f.__qualname__ for f, _ in SIGNATURES]
)
def test_public_functions_keep_their_first_parameters(function, first_parameters):
    def text(parameter):
        if parameter.default is parameter.empty:
            return parameter.name
        return f"{parameter.name}={parameter.default!r}"

    parameters = [text(parameter) for parameter in inspect.signature(function).parameters.values()]
    number = first_parameters.count(", ") + 1
    assert ", ".join(parameters[:number]) == first_parameters


def test_without_a_width_weights_have_eight_bits_on_every_shipped_chip(model):
    """Where ``weight_bits`` is None, weights are as wide as the chip allows."""
    network = lc.load(model)
    for name in hw.chip_names():
        assert hw.chip(name).registers.weight_bits[-1] == 8, name
    usual = lc.compile(network, diagnosis=False)
    eight_bits = lc.compile(network, weight_bits=8, diagnosis=False)
    assert usual.files() == eight_bits.files()
