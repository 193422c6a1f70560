"""Chip files: the one that ships, and every way to get one's own wrong."""

import pytest
import yaml

import hw_model as hw

DOCUMENT = yaml.safe_load(hw.chip("loihi-sim").document)


def changed(path, value):
    document = yaml.safe_load(hw.chip("loihi-sim").document)
    place = document
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return yaml.safe_dump(document)


def test_the_chip_that_ships():
    chip = hw.chip("loihi-sim")
    assert (chip.registers.voltage_max, chip.registers.slots, chip.cores, chip.mesh.tiles) == (8388607, 64, 128, 32)
    assert hw.chip_names() == ("loihi-sim",)


def test_a_chip_file_of_ones_own(tmp_path):
    path = tmp_path / "board.yaml"
    path.write_text(changed(["chips"], 4))
    assert hw.chip(path).cores == 512


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (changed(["limits", "cores_per_chip"], None), "my.yaml: limits: the key 'cores_per_chip' is missing. Add it."),
        (changed(["limits", "core_per_chip"], 3), "my.yaml: limits: unknown key 'core_per_chip'. Did you mean 'cores_per_chip'?"),
        (changed(["mesh", "rows"], "four"), "my.yaml: rows: 'four' is not a whole number from 0 up. Correct it."),
        (changed(["mesh", "rows"], 0), "my.yaml: rows: 0 leaves nothing to place on. Give at least 1."),
        (changed(["clock_ghz"], -1.0), "my.yaml: clock_ghz: -1.0 is not a number from 0 up. Correct it."),
        (
            changed(["profiles", "sanafe", "energy_pj", "spike"], 1.0),
            "my.yaml: energy_pj: 'spike' is not counted. Did you mean 'spikes'?",
        ),
        (changed(["profiles"], {}), "my.yaml: profiles: no energy profile is given. Give at least one."),
        ("[1, 2", "my.yaml: the chip file is not YAML at line 1. Compare it with a chip that ships."),
        ("- 1", "my.yaml: chip: not a mapping of names. Compare it with a chip that ships."),
        ("!!python/object/apply:os.system [id]", "my.yaml: the chip file is not YAML at line 1. Compare it with a chip that ships."),
    ],
    ids=["missing", "unknown", "text", "zero", "negative", "uncounted", "no profile", "broken", "list", "code"],
)  # fmt: skip
def test_chip_files_that_are_refused(tmp_path, text, message):
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(hw.InputError) as caught:
        hw.chip(path)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("loihi-sin", "target 'loihi-sin': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml."),
        ("tpu", "target 'tpu': no chip of this name ships. Choose one of: loihi-sim. A chip file of your own ends in .yaml."),
        ("gone.yaml", "gone.yaml: the chip file cannot be read: No such file or directory. Give the path of a chip YAML file."),
    ],
    ids=["near miss", "far off", "no file"],
)  # fmt: skip
def test_unknown_targets(name, message):
    with pytest.raises(hw.InputError) as caught:
        hw.chip(name)
    assert str(caught.value) == message
