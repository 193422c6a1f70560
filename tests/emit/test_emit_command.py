"""``--emit`` from the command line: the files of a shipped network are read back and agree with the simulation.

The other modules of this folder test each kind of file in detail, on small programs.
"""

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
CHANNELS = 78
STEPS = 250
"""The size of the network; its location branch steps over the channels."""
CHOSEN = 1
"""The recording that the files show."""
PROGRAM_KINDS = [
    emitter.kind
    for emitter in EMITTERS
    if emitter.shows_recording and emitter.of_chip is None and emitter.kind != "lava"
] + [
    "graphml",
    "dot",
]
"""The kinds of files about the program; Lava cannot hold this one."""


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """The folder of a build with every kind of file about the program, the program, and its simulation."""
    folder = tmp_path_factory.mktemp("emit")
    r = np.random.default_rng(0)
    # (recordings, channels, steps); silence follows after the 120 steps.
    recordings = (r.random((2, CHANNELS, 120)) < 0.1).astype(np.uint8)
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
    result = hw.simulate(program, recordings[CHOSEN].T, probe=("spikes", "u", "v", "activity"))
    return folder / "out", program, result


@pytest.mark.slow
def test_vectors_hold_the_simulation_and_a_bench_computes_the_same(build):
    folder, program, result = build
    vectors = bench.Vectors(folder / "vectors")
    assert vectors.manifest["recording"] == "recording 1 of few.npy"
    for core, entry in zip(program.cores, vectors.manifest["cores"], strict=True):
        expected = bench.expected(vectors, entry)
        v = np.array([row[2] for row in expected])
        for core_slice in core.slices:
            simulated = result.v[core_slice.group][:, core_slice.start : core_slice.stop]
            in_file = v[:, core_slice.offset : core_slice.offset + core_slice.size]
            assert np.array_equal(in_file, simulated)
        assert bench.run_cores(vectors, [entry]) == {entry["number"]: expected}
    # A silent network would prove little.
    assert result.counts.spikes > 500


@pytest.mark.slow
def test_waveforms_show_the_probed_neurons(build):
    folder, _, result = build
    paths, end = read_vcd((folder / "waves.vcd").read_bytes())
    assert end == STEPS + CHANNELS
    shown = {path.rsplit(".", 1)[0] for path in paths if path.count(".") > 1}
    # A neuron is a soma with two dendrites.
    compartments = ("{}", "{}_dendrite", "{}_refractory")
    neurons = [
        ("time", "time_output", 3),
        ("location", "location_hidden", 0),
        ("location", "location_hidden", 1),
    ]
    assert shown == {
        f"{phase}.{name.format(group)}.n{i}" for phase, group, i in neurons for name in compartments
    }
    v = values_by_step(paths["location.location_hidden_dendrite.n1.v"], STEPS, CHANNELS)
    assert v == result.v["location_hidden/dendrite"][:, 1].tolist()


def test_the_timeline_is_as_long_as_the_latency(build):
    folder, program, result = build
    events = json.loads((folder / "trace.json").read_text())["traceEvents"]
    activity = {phase: activities[0] for phase, activities in result.activity.items()}
    profile = program.chip.profile(program.chip.default_profile)
    total_us = hw.latency(program, activity, profile).total_ns / 1000
    end_us = max(event["ts"] + event.get("dur", 0) for event in events)
    # Times of 328 steps are rounded to 1e-7 us each.
    assert end_us == pytest.approx(total_us, abs=1e-4)


def test_the_graph_has_every_synapse(build):
    folder, program, _ = build
    graph = nx.read_graphml(folder / "program.graphml")
    synapses = sum(data.get("synapses", 0) for *_, data in graph.edges(data=True))
    assert synapses == sum(len(core.axons.target) for core in program.cores)
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
