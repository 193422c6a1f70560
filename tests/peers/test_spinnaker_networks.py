"""Shipped networks on SpiNNaker: recordings in the machine code, and the emitted script on a virtual board."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from make_environments import python_of, why_missing
from recorded_sets import SETS, few_recordings, shipped_network

import locsnn_compile as lc
from hw_model.spinnaker.network import SpinnakerNetwork
from hw_model.spinnaker.playing import play_recording
from hw_model.spinnaker.program import SpinnakerProgram
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.emitters import ShownRecording
from tests.spinnaker.record_machine import ask_machine
from tests.support.machine_files import differences, values_of
from tests.support.random_spinnaker import PHASE, Case

pytestmark = pytest.mark.peers


@pytest.fixture(scope="module")
def python() -> Path:
    reason = why_missing("spinnaker")
    if reason:
        pytest.skip(f"sPyNNaker: {reason}")
    return python_of("spinnaker")


def compiled_for_spinnaker(model: str) -> tuple[lc.CompiledSpinnaker, Recordings]:
    """Return a shipped network on SpiNNaker, and some recordings of its set."""
    recordings = few_recordings(model)
    return lc.compile(shipped_network(model), "spinnaker1", events=recordings), recordings


def of_phase(network: SpinnakerNetwork, phase: str) -> SpinnakerNetwork:
    """Return a network of one phase, which the files for the machine code hold."""
    return SpinnakerNetwork(
        phases=tuple(replace(each, name=PHASE) for each in network.phases if each.name == phase),
        inputs=tuple(replace(each, phase=PHASE) for each in network.inputs_of(phase)),
        populations=tuple(replace(each, phase=PHASE) for each in network.populations_of(phase)),
        projections=network.projections_of(phase),
    )


def runs(program: SpinnakerProgram, recordings: Recordings) -> Iterator[tuple[Case, object]]:
    """Yield every phase of every recording as a case, and what our engine makes of it."""
    networks = {
        phase.name: of_phase(program.network, phase.name) for phase in program.network.phases
    }
    for recording in recordings.spikes:
        for phase, run in play_recording(program, recording).items():
            network = networks[phase]
            sources = network.lines_of(PHASE) + network.neurons_of(PHASE)
            on_time = np.zeros((len(run.rows), sources), dtype=np.int64)
            yield Case(network, run.rows, on_time), run.result


@pytest.mark.parametrize("model", SETS)
def test_recordings_play_as_in_the_machine_code(model, python, tmp_path):
    compiled, recordings = compiled_for_spinnaker(model)
    values = 0
    spikes = 0
    for case, result in runs(compiled.program, recordings):
        (witness,) = ask_machine(python, [case], tmp_path)
        assert differences(case, result, witness) == {}
        values += values_of(witness)
        spikes += int(witness["fired"].sum())
    played = f"{len(recordings)} recordings, {values:,} values, 0 differ ({spikes:,} spikes)"
    print(f"\nmachine code of sPyNNaker: {model}, {played}")
    assert spikes > 0


@pytest.mark.parametrize("model", SETS)
def test_the_emitted_script_maps_the_network_on_a_virtual_board(model, python, tmp_path):
    compiled, recordings = compiled_for_spinnaker(model)
    files = compiled.files(["pynn"], ShownRecording(recordings.spikes[0]))
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    run = subprocess.run(
        [str(python), str(tmp_path / "spinnaker" / "network.py"), "--virtual"],
        env={"HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
        timeout=1800,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    mapped = [line for line in run.stdout.splitlines() if line.startswith("phase ")]
    assert mapped == [
        f"phase {phase.name}: mapped on a virtual board of 48 chips"
        for phase in compiled.program.network.phases
    ]
    print(f"\nsPyNNaker: {model}, {', '.join(mapped)}")
