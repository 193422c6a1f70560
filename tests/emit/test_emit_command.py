"""``--emit`` end to end on an example hybrid: every file read back and equal to its program's simulation."""

from __future__ import annotations

import json
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import yaml

import hw_model as hw
from locsnn_compile.cli.compile import main
from locsnn_compile.emitters import EMITTERS
from tests.support import emitted_bench as bench
from tests.support.vcd_values import read_vcd, values_by_step

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid.pt"
CHOSEN = 1
PROGRAM_KINDS = [
    emitter.kind
    for emitter in EMITTERS
    if emitter.shows_recording and emitter.of_chip is None and emitter.kind != "lava"
] + [
    "graphml",
    "dot",
]


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Return the folder of a build with every kind of file about the program, and the simulation of the recording that it is of."""
    folder = tmp_path_factory.mktemp("emit")
    r = np.random.default_rng(0)
    recordings = (r.random((2, 78, 120)) < 0.1).astype(np.uint8)
    np.save(folder / "few.npy", recordings)
    options = f"--quiet --recording {CHOSEN} --strategy dendrite --probe time_output[3] --probe location_hidden[0:2]"
    arguments = [
        MODEL,
        "--events",
        folder / "few.npy",
        "-o",
        folder / "out",
        *options.split(),
        "--emit",
        *PROGRAM_KINDS,
    ]
    assert main([str(argument) for argument in arguments]) == 0
    program = hw.load_program(folder / "out")
    return (
        folder / "out",
        program,
        hw.simulate(program, recordings[CHOSEN].T, probe=("spikes", "u", "v", "activity")),
    )


@pytest.mark.slow
def test_vectors_hold_the_simulation_and_the_bench_finds_it(build):
    folder, program, result = build
    vectors = bench.Vectors(folder / "vectors")
    assert vectors.manifest["recording"] == "recording 1 of few.npy"
    for core, entry in zip(program.cores, vectors.manifest["cores"], strict=True):
        expected = bench.expected(vectors, entry)
        v = np.array([row[2] for row in expected])
        for piece in core.slices:
            of_group = result.v[piece.group][:, piece.start : piece.stop]
            assert np.array_equal(v[:, piece.offset : piece.offset + piece.size], of_group)
        assert bench.run_cores(vectors, [entry]) == {entry["number"]: expected}
    assert result.counts.spikes > 500


@pytest.mark.slow
def test_waveforms_show_the_probed_neurons(build):
    folder, _, result = build
    paths, end = read_vcd((folder / "waves.vcd").read_bytes())
    assert end == 250 + 78
    shown = {path.rsplit(".", 1)[0] for path in paths if path.count(".") > 1}
    compartments = ("{}", "{}_dendrite", "{}_refractory")
    neurons = [
        ("time", "time_output", 3),
        ("location", "location_hidden", 0),
        ("location", "location_hidden", 1),
    ]
    assert shown == {
        f"{phase}.{name.format(group)}.n{i}" for phase, group, i in neurons for name in compartments
    }
    v = values_by_step(paths["location.location_hidden_dendrite.n1.v"], 250, 78)
    assert v == result.v["location_hidden/dendrite"][:, 1].tolist()


def test_the_timeline_is_as_long_as_the_latency(build):
    folder, program, result = build
    events = json.loads((folder / "trace.json").read_text())["traceEvents"]
    activity = {phase: found[0] for phase, found in result.activity.items()}
    profile = program.chip.profile(program.chip.default_profile)
    total_us = hw.latency(program, activity, profile).total_ns / 1000
    assert max(e["ts"] + e.get("dur", 0) for e in events) == pytest.approx(total_us, abs=1e-4)


def test_the_graph_has_every_synapse(build):
    folder, program, _ = build
    graph = nx.read_graphml(folder / "program.graphml")
    assert sum(data.get("synapses", 0) for *_, data in graph.edges(data=True)) == sum(
        len(core.axons.target) for core in program.cores
    )
    assert (folder / "program.dot").read_text().startswith('digraph "objects-hybrid" {')


def test_joined_compartments_are_played_back_to_sanafe(build):
    folder, _, result = build
    expected = yaml.safe_load((folder / "sanafe/expected.yaml").read_text())["phases"]
    assert [(phase["phase"], phase["neurons"]) for phase in expected] == [
        ("time", "replayed"),
        ("location", "replayed"),
    ]
    for phase in expected:
        assert phase["counts"]["spikes"] == result.counts_by_phase[phase["phase"]].synaptic_ops
