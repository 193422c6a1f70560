"""Chip files of users: a file's keys decide its family, mistakes are named, and programs carry the chip with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.targets.families import chip_named, family_of
from hw_model.targets.programs import load_any_program
from hw_model.xylo.chips import XyloChip

STEPS = 6
"""The steps of recordings."""


def chip_file(folder: Path, shipped: str, **changes: object) -> str:
    """Write the file of a chip that ships, named ``own`` and with changes, and return its path.

    A change to None leaves the key out.
    """
    document = yaml.safe_load(family_of(shipped).document(shipped)) | {"name": "own"} | changes
    path = folder / "own.yaml"
    entries = {key: value for key, value in document.items() if value is not None}
    path.write_text(yaml.safe_dump(entries))
    return str(path)


@pytest.mark.parametrize(
    ("shipped", "kind"),
    [("tiny-sim", hw.Chip), ("xylo-audio3", XyloChip), ("spinnaker1", SpinnakerChip)],
)
def test_a_chip_file_is_read_by_its_family(shipped, kind, tmp_path):
    chip = chip_named(chip_file(tmp_path, shipped))
    assert isinstance(chip, kind)
    assert chip.name == "own"


# By mistake: the chip whose file is changed, with the changes, and the error.
REFUSED = {
    "a key that a Xylo lacks": (
        {"shipped": "xylo-audio3", "cores": 3},
        "own.yaml: unknown key 'cores'. Did you mean 'notes'?",
    ),
    "a missing key of a Xylo": (
        {"shipped": "xylo-audio3", "hidden": None},
        "own.yaml: the key 'hidden' is missing. Add it.",
    ),
    "a missing key of a SpiNNaker": (
        {"shipped": "spinnaker1", "ring_bits": None},
        "own.yaml: the key 'ring_bits' is missing. Add it.",
    ),
    "three currents": (
        {"shipped": "xylo-audio3", "states": 3},
        "own.yaml: states: it must be a whole number from 1 to 2 (got 3). Correct it.",
    ),
    "a simulator that is code": (
        {"shipped": "xylo-audio3", "simulator": 'x"; import os'},
        "own.yaml: simulator: it must be text that is a module's name (got 'x\"; import os'). "
        "Correct it.",
    ),
    "a name of two lines": (
        {"shipped": "spinnaker1", "name": "a\nb"},
        "own.yaml: name: it must be text of 1 to 100 letters that can be printed (got 'a\\nb'). "
        "Correct it.",
    ),
}


@pytest.mark.parametrize("mistake", REFUSED)
def test_mistakes_are_named(mistake, tmp_path):
    arguments, message = REFUSED[mistake]
    with pytest.raises(hw.InputError) as error:
        chip_named(chip_file(tmp_path, **arguments))
    assert str(error.value) == message


def test_a_file_that_is_no_mapping_is_refused(tmp_path):
    (tmp_path / "own.yaml").write_text("- 3\n")
    with pytest.raises(hw.InputError) as error:
        chip_named(tmp_path / "own.yaml")
    assert str(error.value) == ("own.yaml: it must be a mapping of names (got list). Correct it.")


def network_for(shipped: str) -> lc.Network:
    """Return two layers of two neurons behind two lines, with neurons of a kind that the chip has."""
    parameters = {"decay_u": 0.5, "decay_v": 0.5, "threshold": 1.0}
    if shipped.startswith("xylo"):
        # On a Xylo, a spike subtracts the threshold; the decayed threshold, in the next step.
        neurons: lc.SoftCuba | lc.Cuba = lc.SoftCuba.of(2, drop=0.5, **parameters)
    else:
        neurons = lc.Cuba.of(2, **parameters)
    return lc.Network(
        name="pair",
        channels=2,
        steps=STEPS,
        views=(lc.InputView("touch", "time", 2),),
        populations=(
            lc.Population("hidden", "time", 2, neurons),
            lc.Population("scores", "time", 2, neurons),
        ),
        projections=(
            lc.Projection("touch", "hidden", np.diag([1.2, 0.25])),
            lc.Projection("hidden", "scores", np.diag([1.2, 1.2])),
        ),
        readout=lc.Readout(("scores",), (1.0,)),
        step_seconds=1e-3,
    )


@pytest.mark.parametrize(
    ("shipped", "changes"),
    [
        pytest.param("xylo-audio3", {}, id="a Xylo"),
        pytest.param("xylo-audio3", {"name": "xylo-audio3", "hidden": 7}, id="a Xylo of that name"),
        pytest.param("spinnaker1", {}, id="a SpiNNaker"),
    ],
)
def test_a_program_carries_a_chip_that_does_not_ship(shipped, changes, tmp_path):
    target = chip_file(tmp_path, shipped, **changes)
    events = np.ones((1, STEPS, 2), np.uint8)
    compiled = lc.compile(network_for(shipped), target=target, events=events)
    compiled.save(tmp_path / "build")
    # The program can be played although the chip file is gone.
    Path(target).unlink()
    assert load_any_program(tmp_path / "build").chip == compiled.program.chip
    compiled.save(tmp_path / "again")
    first, second = (tmp_path / name / "program.yaml" for name in ("build", "again"))
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("shipped", ["xylo-audio3", "spinnaker1"])
def test_a_program_for_a_chip_that_ships_does_not_carry_it(shipped, tmp_path):
    events = np.ones((1, STEPS, 2), np.uint8)
    lc.compile(network_for(shipped), target=shipped, events=events).save(tmp_path)
    assert "chip" not in yaml.safe_load((tmp_path / "program.yaml").read_text())


def test_a_network_is_trained_for_a_xylo_of_the_user(tmp_path):
    target = chip_file(tmp_path, "xylo-audio3", hidden=5)
    events = np.random.default_rng(3).integers(0, 2, (8, STEPS, 2)).astype(np.uint8)
    labels = np.arange(8) % 2
    options = {"target": target, "channels": 2, "epochs": 1}
    trained = lc.train(events, options | {"hidden": 5}, labels=labels)
    assert trained.xylo is not None
    assert trained.xylo.target == "own"
    compiled = lc.compile(lc.load(trained), target=target, events=events, labels=labels)
    assert compiled.program.chip.hidden == 5
    with pytest.raises(lc.TargetError) as error:
        lc.train(events, options | {"hidden": 6}, labels=labels)
    assert str(error.value) == (
        "target 'own': too many hidden neurons (6 against 5). Give fewer (--hidden)."
    )
