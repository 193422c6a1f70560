"""``--emit lava``: a script that plays the program with Lava and compares it, and programs that it refuses.

Here the script runs with a stand-in for Lava. That the stand-in does what Lava 0.10.0 does is checked in
``test_recorded_lava.py``. Planted faults of the emitter must be noticed.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.emitters import bench_files
from locsnn_compile.errors import InputError
from tests.support.emitter_faults import FAULTS
from tests.support.lava_folders import (
    arrays_of,
    cases,
    differences,
    play_file,
    run_script,
    stand_in_script,
    write_folder,
    write_stand_in,
)
from tests.support.lava_programs import edge_cases, random_case, steered_case

SEEDS = range(12)
"""Seeds of the random programs."""
OTHER = "or emit another kind."
"""The end of most errors."""


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of packages with the stand-in for Lava."""
    return write_stand_in(tmp_path_factory.mktemp("packages"))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Emitted folders of random programs and of those at the edges, by name."""
    top = tmp_path_factory.mktemp("lava")
    return {name: write_folder(top / name, case) for name, case in cases(SEEDS).items()}


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The emitted script as a module, with the stand-in in the place of Lava."""
    return stand_in_script(tmp_path_factory.mktemp("script"))


@pytest.mark.slow
def test_every_spike_and_register_is_that_of_the_program(script, folders):
    for name, folder in folders.items():
        played = play_file(script, folder / "network.npz")
        assert differences(played, arrays_of(folder / "expected.npz")) == 0, name


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_emitter_is_noticed(fault, script, folders, tmp_path):
    """In at least one of the programs."""

    def is_noticed(folder: Path) -> bool:
        arrays = FAULTS[fault](arrays_of(folder / "network.npz"))
        np.savez(tmp_path / "network.npz", **arrays)
        played = play_file(script, tmp_path / "network.npz")
        return differences(played, arrays_of(folder / "expected.npz")) > 0

    assert any(map(is_noticed, folders.values()))


def test_the_script_says_how_many_values_are_equal(folders, packages):
    run = run_script(folders["edge-0"], packages)
    assert run.stderr == ""
    assert run.stdout == (
        "time, h, 3 neurons: 13 spikes expected, 0 differ; last u and v: 0 differ\n"
        "lava fixed_pt: 66 values compared, 0 differ\n"
    )
    assert run.returncode == 0


def test_the_script_ends_with_3_where_spikes_differ(packages, tmp_path):
    folder = write_folder(tmp_path / "lava", edge_cases()["v at the threshold"])
    expected = arrays_of(folder / "expected.npz")
    expected["run0/neurons0/spikes"] = 1 - expected["run0/neurons0/spikes"]
    np.savez(folder / "expected.npz", **expected)
    run = run_script(folder, packages)
    assert run.stdout.splitlines()[-1] == "lava fixed_pt: 66 values compared, 60 differ"
    assert run.returncode == 3


def test_a_population_is_split_by_threshold_and_decays(tmp_path):
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    line = builder.add_input("x", 1)
    thresholds = np.array([5, 9, 5, 9])
    decays = np.array([100, 100, 200, 100])
    neurons = builder.add_compartments("h", 4, decay_u=decays, threshold=thresholds)
    builder.connect(line, neurons, np.full((4, 1), 20))
    folder = write_folder(tmp_path / "lava", (builder.build(), np.ones((5, 1), np.uint8)))
    arrays = arrays_of(folder / "network.npz")
    # Lava's decay is one less: its neurons lose 1 part of 4096 more than `du` says.
    processes = [
        tuple(arrays[f"run0/neurons{k}/{name}"].tolist() for name in ("index", "du", "vth"))
        for k in range(3)
    ]
    assert processes == [([0], 99, 5), ([1, 3], 99, 9), ([2], 199, 5)]


def test_delays_longer_than_a_byte_are_written_as_they_are(script, tmp_path):
    """A user's chip may have them; those of ours have delays of at most 62 steps."""
    chip = hw.chip("loihi-sim")
    longest = 300
    registers = replace(chip.registers, delay_max=longest)
    builder = hw.ProgramBuilder(replace(chip, registers=registers))
    line = builder.add_input("x", 1)
    neurons = builder.add_compartments("h", 2, decay_u=100, decay_v=50, threshold=100)
    builder.connect(line, neurons, [[200], [200]], delay=[[255], [longest]])
    spikes = np.zeros((longest + 10, 1), dtype=np.uint8)
    spikes[0] = 1
    folder = write_folder(tmp_path / "lava", (builder.build(), spikes))
    arrays = arrays_of(folder / "network.npz")
    assert arrays["run0/synapses0/delays"].tolist() == [[255], [longest]]
    expected = arrays_of(folder / "expected.npz")
    assert expected["run0/neurons0/spikes"].any(axis=0).all()
    assert differences(play_file(script, folder / "network.npz"), expected) == 0


def test_equal_input_gives_equal_bytes():
    program, spikes = random_case(0)
    assert bench_files(program, ["lava"], spikes) == bench_files(program, ["lava"], spikes)


def program_with(exponent: int = 0, **settings: int) -> hw.ChipProgram:
    """Return a program of one neuron with usual parameters, except those in ``settings``."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    line = builder.add_input("x", 1)
    usual = {"decay_u": 100, "decay_v": 50, "threshold": 900}
    neuron = builder.add_compartments("h", 1, **usual | settings)
    builder.connect(line, neuron, [[200]], exponent=exponent)
    return builder.build()


def joined_program() -> hw.ChipProgram:
    """Return a program with a dendrite that is joined to a soma."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    line = builder.add_input("x", 1)
    soma = builder.add_compartments("soma", 1, decay_u=100, threshold=900)
    dendrite = builder.add_compartments("d", 1, decay_u=100, threshold=900, joined_to=soma)
    builder.connect(line, dendrite, [[200]])
    return builder.build()


def wrapping_program() -> hw.ChipProgram:
    """Return a program whose current wraps after a few spikes, since it hardly decays."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    line = builder.add_input("x", 1)
    neuron = builder.add_compartments("h", 1, decay_u=1, threshold=900)
    builder.connect(line, neuron, [[254]], exponent=7)
    return builder.build()


ONES = np.ones((8, 1), dtype=np.uint8)
"""A recording with a spike in every step."""
# By what is refused: a program, or a function that makes it, with a recording, and the error.
REFUSED = {
    "joined compartments": (
        (joined_program, ONES),
        "population 'd': Lava has no joined compartments (parent 1). "
        "Compile with --strategy reset, or emit another kind.",
    ),
    "a refractory period": (
        (lambda: program_with(refractory=3), ONES),
        "population 'h': Lava's fixed-point neuron has no refractory period (refractory 3). "
        f"Give its neurons a refractory of 1, {OTHER}",
    ),
    "a lasting current": (
        (lambda: program_with(decay_u=0), ONES),
        "population 'h': Lava's currents lose at least 1 part of 4096 in a step (decay_u 0). "
        f"Give its neurons a current that fades, {OTHER}",
    ),
    "a memoryless soma": (
        (lambda: program_with(decay_v=4096), ONES),
        "population 'h': Lava's potentials lose at most 4095 parts of 4096 in a step "
        f"(decay_v 4096). Give its neurons a potential that lasts, {OTHER}",
    ),
    "a floor": (
        (lambda: program_with(vmin=0), ONES),
        "population 'h': Lava clips potentials at -8388607 alone (vmin 0). "
        f"Give its neurons a vmin of -8388607, {OTHER}",
    ),
    "a ceiling": (
        (lambda: program_with(vmax=2**21 - 1), ONES),
        "population 'h': Lava clips potentials at 8388607 alone (vmax 2097151). "
        f"Give its neurons a vmax of 8388607, {OTHER}",
    ),
    "a negative exponent": (
        (lambda: program_with(exponent=-2), ONES),
        "synapses onto 'h': Lava rounds with a negative exponent in another way (exponent -2). "
        f"Scale weights, biases and thresholds up, {OTHER}",
    ),
    "wraps in the recording": (
        (wrapping_program, ONES),
        "population 'h': registers wrap in this recording, and Lava's wrap in another way "
        f"(1 wrap). Show another one by --recording, {OTHER}",
    ),
    "the lowest current": (
        steered_case(-(2**23)),
        "population 'h': a current has the one value of this recording that Lava turns round "
        f"(u = -8388608). Show another one by --recording, {OTHER}",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_lava_plays_otherwise_is_refused_by_name(name):
    (program, spikes), message = REFUSED[name]
    with pytest.raises(InputError) as error:
        bench_files(program() if callable(program) else program, ["lava"], spikes)
    assert str(error.value) == f"--emit lava, {message}"


def test_a_program_that_wraps_is_written_for_a_recording_in_which_it_does_not():
    # In 3 steps, the current does not wrap yet.
    files = bench_files(wrapping_program(), ["lava"], ONES[:3])
    assert sorted(files) == ["lava/expected.npz", "lava/network.npz", "lava/network.py"]
