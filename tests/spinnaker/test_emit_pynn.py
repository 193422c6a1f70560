"""``--emit pynn``: a script that plays the program with sPyNNaker and compares every spike and potential.

Here it runs with a stand-in for sPyNNaker (``pynn_stand_in.py``), which plays by our plain engine. That the stand-in
takes what sPyNNaker takes was checked by mapping emitted networks with sPyNNaker itself.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.arithmetic.spinnaker_inverse import shift_for
from hw_model.mapping.graph import Readout
from hw_model.spinnaker.chips import spinnaker_chip
from hw_model.spinnaker.program import SpinnakerProgram
from locsnn_compile.api import recordings_for
from locsnn_compile.backends.pynn.folder import expected_sums, pynn_folder
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.spinnaker.compile import quantize_for
from locsnn_compile.spinnaker.grid import grid_of
from locsnn_compile.spinnaker.lower import lower_to_spinnaker
from tests.support.small_spinnaker_graphs import cells, graph, synapses

CHIP = spinnaker_chip("spinnaker1")
STAND_IN = Path(__file__).with_name("pynn_stand_in.py")
STEPS = 40
LINES = 6
NEURONS = 3
VALUES = STEPS * NEURONS
"""How many spikes, or potentials, the script compares."""


def small_program(*, read: bool = False) -> SpinnakerProgram:
    """Return lines with weights of both signs and several delays onto neurons, whose potentials may be ``read`` out."""
    random = np.random.default_rng(5)
    weights = random.integers(-60, 128, (NEURONS, LINES)) * 2
    part = synapses(weights, delay=np.arange(np.count_nonzero(weights)) % 4)
    readout = Readout(("cells",), (1.0,), potentials_from=2) if read else None
    group = cells(NEURONS, threshold=200, refractory=3)
    small = graph(part, lines=LINES, groups=(group,), readout=readout)
    return SpinnakerProgram("small", CHIP, lower_to_spinnaker(small, CHIP).network, readout)


def recording() -> np.ndarray:
    """Return a random recording (steps, lines)."""
    return (np.random.default_rng(6).random((STEPS, LINES)) < 0.3).astype(np.uint8)


def written(folder: Path, program: SpinnakerProgram) -> Path:
    """Write the emitted files, and return the folder of the script."""
    for name, content in pynn_folder(program, recording()).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder / "spinnaker"


def run(folder: Path, *options: str, fault: int = 0) -> subprocess.CompletedProcess[str]:
    """Run the script with the stand-in, which hides ``fault`` spikes from it, and with an empty provenance reader."""
    packages = folder.parent / "packages" / "pyNN"
    packages.mkdir(parents=True, exist_ok=True)
    (packages / "__init__.py").touch()
    (packages / "spiNNaker.py").write_text(f"FAULT = {fault}\n" + STAND_IN.read_text())
    provenance = folder.parent / "packages/spinn_front_end_common/interface/provenance"
    provenance.mkdir(parents=True, exist_ok=True)
    (provenance / "__init__.py").write_text(
        "class ProvenanceReader:\n"
        "    def __enter__(self): return self\n"
        "    def __exit__(self, *_): pass\n"
        "    def run_query(self, query, names): return [(0,)]\n"
    )
    paths = [str(packages.parent), str(Path.cwd())]
    environment = {"PYTHONPATH": ":".join(paths), "HOME": str(folder.parent)}
    command = [sys.executable, "network.py", *options]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("read", [False, True])
def test_the_script_finds_every_spike_and_potential_equal(tmp_path, read):
    result = run(written(tmp_path, small_program(read=read)))
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    if read:
        assert lines[:2] == [
            f"cells: 0 spikes expected, 0 of {VALUES} spikes differ",
            f"cells: 0 of {VALUES} potentials differ",
        ]
    else:
        assert lines[0].endswith(f" spikes expected, 0 of {VALUES} spikes differ")
        assert not lines[0].startswith("cells: 0 ")
    assert lines[-4:] == [
        "  Times_synaptic_weights_have_saturated: 0",
        "  Late spikes: 0",
        "  Skipped synapses: 0",
        "every spike is equal",
    ]
    assert result.returncode == 0


def test_a_spike_that_differs_ends_with_3(tmp_path):
    result = run(written(tmp_path, small_program()), fault=1)
    assert result.stdout.splitlines()[-1] == "1 values differ"
    assert result.returncode == 3


def test_a_virtual_board_maps_and_runs_nothing(tmp_path):
    folder = written(tmp_path, small_program())
    result = run(folder, "--virtual")
    assert result.stdout == "phase time: mapped on a virtual board of 48 chips\n"
    assert result.returncode == 0
    assert {path.name for path in folder.iterdir()} == {
        "network.py",
        "network.npz",
        "expected.npz",
    }


def test_equal_programs_give_equal_bytes():
    first, second = (pynn_folder(small_program(), recording()) for _ in range(2))
    assert first == second


@pytest.mark.slow
def test_both_phases_of_a_shipped_network_tell_spynnaker_sums_that_give_its_shifts():
    network = lc.load("examples/models/objects-best.pt")
    recordings = recordings_for(network, events=None)
    graph_of = lower_neurons(quantize_for(CHIP, network, recordings), grid_of(CHIP))
    lowered = lower_to_spinnaker(graph_of, CHIP).network
    for population in lowered.populations:
        sums = expected_sums(lowered, population)
        assert tuple(map(shift_for, sums)) == population.shifts
