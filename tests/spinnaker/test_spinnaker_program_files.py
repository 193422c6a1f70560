"""Programs for SpiNNaker on disk: what is written is read back unchanged, and damage is refused, naming what is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hw_model.errors import InputError
from hw_model.mapping.graph import MAX_LINES, MAX_STEPS, Input, Phase, Readout
from hw_model.spinnaker.chips import spinnaker_chip
from hw_model.spinnaker.files import load_spinnaker, save_spinnaker, spinnaker_files
from hw_model.spinnaker.playing import play_program
from hw_model.spinnaker.program import SpinnakerProgram
from tests.support.edited_programs import replace_array, replace_text
from tests.support.random_spinnaker import random_case
from tests.support.small_spinnaker import Synapse, network, population, projection

CHIP = spinnaker_chip("spinnaker1")


def small_program() -> SpinnakerProgram:
    """Return a program of two phases, the second transposed, with a value in every optional field but the times."""
    lines = Input("lines", size=3, phase="run", stream="touches")
    turned = Input("turned", size=4, phase="walk", stream="touches", positions=np.array([0, 2, 1]))
    walk = population("walkers", phase="walk", size=2, potential_unit=0.25)
    both_phases = network(
        phases=(Phase("run", "time", steps=None), Phase("walk", "location", steps=3)),
        inputs=(lines, turned),
        populations=(population(size=2), walk),
        projections=(
            projection(
                Synapse(source=0, target=0, weight=1000, delay=1),
                Synapse(source=2, target=1, weight=65535, delay=8),
            ),
            projection(
                Synapse(source=0, target=1, weight=3, delay=2),
                source="turned",
                target="walkers",
                receptor="inhibitory",
            ),
        ),
    )
    return SpinnakerProgram(
        name="small",
        chip=CHIP,
        network=both_phases,
        readout=Readout(("cells", "walkers"), (1.0, 0.5), potentials_from=(None, 2), tie_class=1),
        step_seconds=0.01,
        event_threshold=1,
        polarities=1,
        columns=3,
        channel_order="pyx",
        class_names=("soft", "hard"),
        provenance={"model": "by hand"},
    )


def test_a_loaded_program_is_the_saved_one(tmp_path):
    program = small_program()
    save_spinnaker(program, tmp_path)
    loaded = load_spinnaker(tmp_path)
    assert spinnaker_files(loaded) == spinnaker_files(program)
    assert loaded.readout == program.readout
    recordings = (np.random.default_rng(0).random((2, 6, 3)) < 0.5).astype(np.uint8)
    played = play_program(program, recordings)
    played_after_loading = play_program(loaded, recordings)
    assert np.array_equal(played.scores, played_after_loading.scores)
    assert played.counts == played_after_loading.counts


@pytest.mark.parametrize("seed", range(4))
def test_random_networks_are_read_back_as_they_were(seed, tmp_path):
    saved = random_case(seed).network
    save_spinnaker(SpinnakerProgram("random", CHIP, saved), tmp_path)
    loaded = load_spinnaker(tmp_path).network
    for old, new in zip(saved.projections, loaded.projections, strict=True):
        assert np.array_equal(old.weight, new.weight)
        assert np.array_equal(old.delay, new.delay)
    for old, new in zip(saved.populations, loaded.populations, strict=True):
        assert all(map(np.array_equal, old.parameters, new.parameters))


def test_programs_of_all_families_have_as_many_lines_and_steps(tmp_path):
    widest = network(
        phases=(Phase("run", "time", MAX_STEPS),),
        inputs=(Input(name="lines", size=MAX_LINES, phase="run", stream="touches"),),
    )
    readout = Readout(("cells",), (1.0,))
    program = replace(small_program(), network=widest, readout=readout, class_names=None)
    save_spinnaker(program, tmp_path)
    loaded = load_spinnaker(tmp_path).network
    assert (loaded.inputs[0].size, loaded.phases[0].steps) == (10_000_000, 10_000_000)


@pytest.fixture
def saved(tmp_path) -> Path:
    """The folder of a saved program."""
    save_spinnaker(small_program(), tmp_path)
    return tmp_path


def swapped(folder: Path) -> None:
    """Replace the arrays by those of another program."""
    other = replace(small_program(), network=network(), readout=None, class_names=None)
    (folder / "program.npz").write_bytes(spinnaker_files(other)["program.npz"])


# By what is wrong: the damage done to a saved program, and the error.
DAMAGE = {
    "arrays of another program": (
        swapped,
        "program.npz: the checksum differs: it is damaged, or of another program. Compile again.",
    ),
    "another version": (
        lambda folder: replace_text(folder, "version: 1", "version: 2"),
        "program.yaml: the program has another format version (2 against 1). Compile it again, or "
        "use the release that wrote it.",
    ),
    "another kind": (
        lambda folder: replace_text(folder, "locsnn-spinnaker-program", "locsnn-xylo-program"),
        "program.yaml: this is a program of another kind (locsnn-xylo-program against "
        "locsnn-spinnaker-program). Play it with `locsnn run`.",
    ),
    "an unknown chip": (
        lambda folder: replace_text(folder, "target: spinnaker1", "target: spinnaker9"),
        "target 'spinnaker9': no SpiNNaker of this name ships. Did you mean 'spinnaker1'?",
    ),
    "an array too much": (
        lambda folder: replace_array(folder, "population9/tau_m", np.array([1])),
        "program.npz: it holds arrays without a meaning (population9/tau_m). Compile again.",
    ),
    "a weight too large": (
        lambda folder: replace_array(folder, "projection0/weight", np.array([1, 65536])),
        "projection 'lines' -> 'cells', excitatory, weight: a core cannot hold it (65536 against "
        "0..65535). Correct it.",
    ),
    "a visit beyond the phase": (
        lambda folder: replace_array(folder, "input1/positions", np.array([0, 3, 1])),
        "input 'turned': its visits do not fit its lines, or the steps of its phase. Compile again.",
    ),
    "an axis that does not exist": (
        lambda folder: replace_text(folder, "axis: location", "axis: depth"),
        "program.yaml: phases.axis: 'depth' is not known. Choose one of: location, time.",
    ),
    "no potential unit": (
        lambda folder: replace_text(folder, "potential_unit: 0.25", "potential_unit: 0"),
        "program.yaml: populations.potential_unit: it must be a number above 0 (got 0). Compile again.",
    ),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGE.values(), ids=DAMAGE)
def test_damaged_files_are_refused_by_what_is_wrong(saved, damage, message):
    damage(saved)
    with pytest.raises(InputError) as caught:
        load_spinnaker(saved)
    assert str(caught.value) == message


def test_an_edited_file_is_refused_until_its_checksum_is_removed(saved):
    path = saved / "program.yaml"
    path.write_text(path.read_text().replace("tie_class: 1", "tie_class: 0"))
    with pytest.raises(InputError, match="it was edited, or is damaged"):
        load_spinnaker(saved)
    # This changes nothing but removes the checksum.
    replace_text(saved, "tie_class: 0", "tie_class: 0")
    assert load_spinnaker(saved).readout.tie_class == 0
