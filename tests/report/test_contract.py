"""What others rely on: the keys of report.json on every chip, files of a build, signatures, options and exit codes.

Keys that only some chips have are here as well: an open core has no mesh and, unless it is made of cells, no energies.
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
"""The type of each value; of a mapping, the keys that it holds."""
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
"""What is null in the report of each chip that ships, whatever the network."""
FILES = {"program.yaml", "program.npz", "report.json", "report.md", "report.html"}


def departures(keys, found, null, path=""):
    """Yield each key that is missing, or whose value has another type; those of ``null`` must be None."""
    for key, wanted in keys.items():
        where = f"{path}{key}"
        if key not in found:
            yield f"{where} is missing"
        elif where in null:
            if found[key] is not None:
                yield f"{where} is not null"
        elif isinstance(wanted, dict):
            yield from departures(wanted, found[key], null, f"{where}.")
        elif not isinstance(found[key], wanted) or isinstance(found[key], bool):
            yield f"{where} is {found[key]!r}"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A network of touch that every chip holds."""
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
    """The folder of a build for a chip, with gates on energy and time, and the exit code."""
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
    known = target not in {"ecp5-25f", "ecp5-85f", "ice40up5k"}
    assert (energy["passed"], energy["measured"] is not None, code) == (
        known,
        known,
        0 if known else 3,
    )
    assert latency["passed"]


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("match.samples", None, "match.samples is None"),
        ("energy.per_sample_pj", "1", "energy.per_sample_pj is '1'"),
        ("resources.cores", True, "resources.cores is True"),
        ("energy.profile", "davies2018", "energy.profile is not null"),
        ("skipped.steps", ..., "skipped.steps is missing"),
    ],
    ids=["null", "text", "truth", "not null", "missing"],
)
def test_departures_are_found(build, path, value, said):
    _, folder, _ = build
    report = json.loads((folder / "report.json").read_text())
    *above, last = path.split(".")
    held = reduce(dict.__getitem__, above, report)
    if value is ...:
        del held[last]
    else:
        held[last] = value
    null = NO_ENERGY + NO_MESH if said.endswith("not null") else ()
    assert said in list(departures(KEYS, report, null))


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
"""Functions with their first parameters. Where weight bits are None, they are the chip's widest: 8 on all that ship."""


@pytest.mark.parametrize(
    ("function", "wanted"), SIGNATURES, ids=[f.__qualname__ for f, _ in SIGNATURES]
)
def test_public_functions_keep_their_first_parameters(function, wanted):
    def text(parameter):
        return (
            parameter.name
            if parameter.default is parameter.empty
            else f"{parameter.name}={parameter.default!r}"
        )

    found = [text(parameter) for parameter in inspect.signature(function).parameters.values()]
    assert ", ".join(found[: wanted.count(", ") + 1]) == wanted


def test_eight_bits_are_what_no_bits_mean_on_chips_that_ship(model):
    network = lc.load(model)
    for name in hw.chip_names():
        assert hw.chip(name).registers.weight_bits[-1] == 8, name
    assert (
        lc.compile(network, diagnosis=False).files()
        == lc.compile(network, weight_bits=8, diagnosis=False).files()
    )
