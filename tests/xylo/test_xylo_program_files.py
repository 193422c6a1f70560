"""Programs for a Xylo on disk: what is written is read back unchanged, and damage is refused, naming what is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.graph import Readout
from hw_model.targets.programs import load_any_program
from hw_model.xylo.chips import xylo_chip
from hw_model.xylo.files import load_xylo, save_xylo, xylo_files
from hw_model.xylo.playing import play_program
from hw_model.xylo.program import NamedPart, XyloProgram
from tests.support.edited_programs import replace_array, replace_text
from tests.support.random_xylo import random_xylo
from tests.support.small_xylo_networks import memoryless_network, touches


def random_program(seed: int) -> tuple[XyloProgram, np.ndarray]:
    """Return a random network as a program with a value in most optional fields, and rows of events for it."""
    network, events = random_xylo(seed)
    outputs = network.outputs.size
    program = XyloProgram(
        name=f"random {seed}",
        chip=xylo_chip("xylo-audio3"),
        network=network,
        hidden=(NamedPart("hidden", network.hidden.size),),
        readout=Readout(("classes",), (2.0,), tie_class=outputs - 1),
        steps=len(events),
        step_seconds=0.01,
        event_threshold=1,
        polarities=1,
        columns=4,
        channel_order="pyx",
        class_names=tuple(f"class {number}" for number in range(outputs)),
        start="first",
        time_unit="ms",
        provenance={"model": "random"},
    )
    return program, events


@pytest.mark.parametrize("seed", range(20))
def test_a_loaded_program_is_the_saved_one(seed, tmp_path):
    program, events = random_program(seed)
    save_xylo(program, tmp_path)
    loaded = load_xylo(tmp_path)
    assert xylo_files(loaded) == xylo_files(program)
    played = play_program(program, events[None])
    played_after_loading = play_program(loaded, events[None])
    assert np.array_equal(played.spikes["hidden"], played_after_loading.spikes["hidden"])
    assert played.counts == played_after_loading.counts
    assert loaded.class_names == program.class_names
    assert loaded.readout == program.readout
    assert load_any_program(tmp_path).name == program.name


@pytest.fixture
def saved(tmp_path) -> Path:
    """The folder of a saved program: 7 hidden neurons and an output."""
    program, _ = random_program(2)
    save_xylo(program, tmp_path)
    return tmp_path


def swapped(folder: Path) -> None:
    """Replace the arrays by those of another program."""
    program, _ = random_program(3)
    (folder / "program.npz").write_bytes(xylo_files(program)["program.npz"])


# By what is wrong: the damage done to a saved program, and the error.
DAMAGE = {
    "no arrays": (
        lambda folder: (folder / "program.npz").unlink(),
        "program '{folder}', program.npz: it cannot be read (No such file or directory). Give the "
        "folder that the compiler wrote.",
    ),
    "arrays of another program": (
        swapped,
        "program.npz: the checksum differs: it is damaged, or of another program. Compile again.",
    ),
    "edited": (
        lambda folder: (folder / "program.yaml").write_text(
            (folder / "program.yaml").read_text().replace("random 2", "random 3")
        ),
        "program.yaml: its checksum differs: it was edited, or is damaged. Compile again or, to "
        "play it as edited, remove its last line.",
    ),
    "another version": (
        lambda folder: replace_text(folder, "version: 1", "version: 2"),
        "program.yaml: the program has another format version (2 against 1). Compile it again, or "
        "use the release that wrote it.",
    ),
    "another chip": (
        lambda folder: replace_text(folder, "xylo-audio3", "xylo-audio9"),
        "target 'xylo-audio9': no Xylo of this name ships. Did you mean 'xylo-audio3'?",
    ),
    "an unknown entry": (
        lambda folder: replace_text(folder, "outputs:", "output: x\noutputs:"),
        "program.yaml: unknown key 'output'. Did you mean 'outputs'?",
    ),
    "a missing entry": (
        lambda folder: replace_text(folder, "outputs: classes\n", ""),
        "program.yaml: the key 'outputs' is missing. Compile again.",
    ),
    "a shift beyond the chip's": (
        lambda folder: replace_text(folder, "shift_in: ", "shift_in: 9"),
        "program.yaml: shift_in: it must be a whole number from 0 to 15 (got 93). Compile again.",
    ),
    "a start that is no time": (
        lambda folder: replace_text(folder, "start: first", "start: never"),
        "program.yaml: start: it must be a number of seconds, or 'first' (got 'never'). Compile "
        "again.",
    ),
    "an unknown unit of time": (
        lambda folder: replace_text(folder, "time_unit: ms", "time_unit: days"),
        "program.yaml: time_unit: 'days' is not known. Choose one of: ms, ns, s, us.",
    ),
    "a name for other neurons": (
        lambda folder: replace_text(folder, "  size: ", "  size: 1"),
        "program 'random 2': the names of its hidden neurons do not fit (17 against 7). Name "
        "each of them once.",
    ),
    "an array too few": (
        lambda folder: replace_array(folder, "hidden/threshold", array=None),
        "program.yaml: its entries do not make a program. Compile again.",
    ),
    "an array without a meaning": (
        lambda folder: replace_array(folder, "hidden/tau", np.zeros(1, np.int64)),
        "program.npz: it holds arrays without a meaning (hidden/tau). Compile again.",
    ),
    "an array of floats": (
        lambda folder: replace_array(folder, "hidden/threshold", np.ones(7)),
        "program.yaml: its entries do not make a program. Compile again.",
    ),
    "weights of 9 bits": (
        lambda folder: replace_array(folder, "weights_out", np.full((7, 1), 128)),
        "weights_out: the chip cannot hold it (128 against -128..127). Give a value in this range.",
    ),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_refused_by_name(damage, saved):
    harm, message = DAMAGE[damage]
    harm(saved)
    with pytest.raises(hw.InputError) as error:
        load_xylo(saved)
    assert str(error.value) == message.format(folder=saved)


def test_a_truncated_file_is_refused(saved):
    path = saved / "program.yaml"
    # Somewhere within the first entries.
    path.write_text(path.read_text()[:100])
    with pytest.raises(hw.InputError):
        load_xylo(saved)


def test_programs_of_the_other_arithmetic_are_named(saved, tmp_path_factory):
    with pytest.raises(hw.InputError) as error:
        hw.load_program(saved)
    assert str(error.value) == (
        "program.yaml: this is a program of another kind (locsnn-xylo-program against "
        "locsnn-program). Play it with `locsnn run`."
    )
    other = tmp_path_factory.mktemp("mesh")
    builder = hw.ProgramBuilder(hw.chip("tiny-sim"), name="mesh")
    neurons = builder.add_compartments("neurons", 1, threshold=1)
    builder.connect(builder.add_input("touch", 1), neurons, [[2]])
    builder.build().save(other)
    with pytest.raises(hw.InputError) as error:
        load_xylo(other)
    assert str(error.value) == (
        "program.yaml: this is a program of another kind (locsnn-program against "
        "locsnn-xylo-program). Play it with `locsnn run`."
    )
    assert isinstance(load_any_program(other), hw.ChipProgram)


def test_a_compiled_model_saves_its_program_and_its_reports(tmp_path):
    compiled = lc.compile(memoryless_network(), target="xylo-imu", events=touches())
    compiled.save(tmp_path / "build")
    names = {path.name for path in (tmp_path / "build").iterdir()}
    assert names == {"program.yaml", "program.npz", "report.json", "report.md", "report.html"}
    loaded = load_xylo(tmp_path / "build")
    assert xylo_files(loaded) == xylo_files(compiled.program)
    entries = yaml.safe_load((tmp_path / "build/program.yaml").read_text())
    assert entries["provenance"] == {"model": "small", "model_sha256": "", "strategy": "native"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param(
            {"hidden": (NamedPart("classes", 7),)},
            "program 'random 2': names of neurons repeat, or its readout is not of the outputs. "
            "Give each population a name of its own.",
            id="names",
        ),
        pytest.param(
            {"readout": Readout(("classes",), (1.0,), tie_class=7)},
            "program 'random 2': the class of its ties is not one of its outputs (7 against 0..0). "
            "Give one of them.",
            id="tie class",
        ),
        pytest.param(
            {"class_names": ("one", "two")},
            "program 'random 2': its class names do not fit its outputs (2 against 1). Give one "
            "for each output.",
            id="class names",
        ),
    ],
)
def test_a_program_that_contradicts_itself_is_refused(changes, message):
    program, _ = random_program(2)
    with pytest.raises(hw.InputError) as error:
        replace(program, **changes)
    assert str(error.value) == message


def test_recordings_must_fit_the_inputs():
    program, _ = random_program(2)
    with pytest.raises(hw.InputError) as error:
        play_program(program, np.zeros((1, 5, 99)))
    assert str(error.value) == (
        f"program 'random 2': they do not fit ((1, 5, 99) against (batch, steps, "
        f"{program.inputs})). Give recordings of its inputs."
    )
