"""Chip files: those that ship, a user's own, every mistake with its whole message, and memory at the largest numbers."""

import math
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import yaml

import hw_model as hw
from hw_model.description.chip import parse_chip
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.vectors.vectors import vectors_files
from tests.support.register_units import FORGETS_AT_ONCE

DOCUMENT = yaml.safe_load(hw.chip("loihi-sim").document)


def changed(path, value):
    """Return the text of loihi-sim with one value changed, or removed with None."""
    document = yaml.safe_load(hw.chip("loihi-sim").document)
    place = document
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return yaml.safe_dump(document)


# Sizes of an open core that a chip file may have, except `slots`, which is too small for the delays of loihi-sim.
CORE = {
    "axons": 1024, "synapses": 16384, "compartments": 512, "slots": 32, "charge": 18, "join": 28, "bitmap": 1024,
    "visits": 256, "entries": 128,
}  # fmt: skip


def on_core(sizes):
    """Return loihi-sim as an open core of other sizes, without profiles."""
    document = {**DOCUMENT, "open_core": CORE | sizes}
    return yaml.safe_dump({key: value for key, value in document.items() if key != "profiles"})


def test_loihi_sim_has_the_sizes_of_its_file():
    chip = hw.chip("loihi-sim")
    assert (chip.registers.voltage_max, chip.registers.slots, chip.cores, chip.mesh.tiles) == (
        8388607,
        64,
        128,
        32,
    )
    assert hw.chip_names() == (
        "ecp5-25f",
        "ecp5-85f",
        "ice40up5k",
        "locsnn-130nm",
        "loihi-sim",
        "tiny-sim",
    )


def test_the_small_chip_has_the_registers_of_the_large_one():
    tiny = hw.chip("tiny-sim")
    loihi = hw.chip("loihi-sim")
    assert tiny.registers == loihi.registers
    assert (tiny.cores, tiny.limits.compartments_per_core, tiny.mesh.tiles) == (16, 64, 4)
    assert tiny.hops(0, 15) == (1, 1)


def test_a_copy_of_a_chip_that_ships_is_the_same_chip(tmp_path, capsys):
    for name in hw.chip_names():
        path = tmp_path / f"{name}.yaml"
        path.write_text(hw.chip(name).document)
        assert hw.chip(path) == hw.chip(name)


def test_a_users_chip_file_is_read(tmp_path):
    path = tmp_path / "board.yaml"
    path.write_text(changed(["chips"], 4))
    assert hw.chip(path).cores == 512


def test_numbers_with_an_exponent_and_no_point_are_numbers(tmp_path):
    """YAML 1.1 takes ``1e-1`` for text and ``1.0e-1`` for a number; a person means the number."""
    path = tmp_path / "fast.yaml"
    text = hw.chip("tiny-sim").document
    path.write_text(
        text.replace("clock_ghz: 0.1 ", "clock_ghz: 1e-1").replace(
            "synaptic_ops: 10.0", "synaptic_ops: 1E1"
        )
    )
    assert path.read_text() != text
    assert hw.chip(path).clock_ghz == 0.1
    assert hw.chip(path).profiles == hw.chip("tiny-sim").profiles


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (changed(["limits", "cores_per_chip"], None), "my.yaml: limits: the key 'cores_per_chip' is missing. Add it."),
        (changed(["limits", "core_per_chip"], 3), "my.yaml: limits: unknown key 'core_per_chip'. Did you mean 'cores_per_chip'?"),
        (changed(["mesh", "rows"], "four"), "my.yaml: mesh.rows: it must be a whole number from 1 to 65536 (got 'four'). Correct it."),
        (changed(["mesh", "rows"], 0), "my.yaml: mesh.rows: it must be a whole number from 1 to 65536 (got 0). Correct it."),
        (changed(["clock_ghz"], -1.0), "my.yaml: clock_ghz: it must be a number above 0 (got -1.0). Correct it."),
        (
            changed(["profiles", "sanafe", "energy_pj", "spike"], 1.0),
            "my.yaml: profiles.sanafe: energy_pj: 'spike' is not counted. Did you mean 'spikes'?",
        ),
        (changed(["profiles"], {}), "my.yaml: profiles: only an open core may have no energy profile. Give at least one."),
        (changed(["profiles"], None), "my.yaml: profiles: only an open core may have no energy profile. Give at least one."),
        (on_core({}), "my.yaml: open_core: slots and compartments must be powers of two, and slots at least delay_max and 2 (32 slots against 64, 512 compartments). Correct it."),
        (on_core({"slots": 96}), "my.yaml: open_core: slots and compartments must be powers of two, and slots at least delay_max and 2 (96 slots against 64, 512 compartments). Correct it."),
        (on_core({"slots": 64, "compartments": 500}), "my.yaml: open_core: slots and compartments must be powers of two, and slots at least delay_max and 2 (64 slots against 64, 500 compartments). Correct it."),
        (on_core({"slots": 64, "compartments": 500, "places": 200}), "my.yaml: open_core: slots and places must be powers of two, and slots at least delay_max and 2 (64 slots against 64, 200 places). Correct it."),
        (on_core({"slots": 64, "sums": 24}), "my.yaml: open_core: sums must be a power of two (got 24). Correct it."),
        (on_core({"slots": 64, "word": 12}), "my.yaml: open_core: word must be a power of two (got 12). Correct it."),
        (on_core({"slots": 64, "phase_words": 24}), "my.yaml: open_core: phase_words must be a power of two (got 24). Correct it."),
        (on_core({"slots": 64, "charge": 15}), "my.yaml: open_core.charge: it must be a whole number from 16 to 64 (got 15). Correct it."),
        (changed(["profile"], {}), "my.yaml: unknown key 'profile'. Did you mean 'profiles'?"),
        (changed(["registers", "voltage_bit"], 3), "my.yaml: registers: unknown key 'voltage_bit'. Did you mean 'voltage_bits'?"),
        (changed(["profiles", "sanafe", "time_ns", "hop_x"], 1.0), "my.yaml: profiles.sanafe: time_ns: 'hop_x' is not counted. Did you mean 'hops_x'?"),
        (changed(["profiles", "sanafe", "barrier_ns", "one_tile"], None), "my.yaml: profiles.sanafe.barrier_ns: the key 'one_tile' is missing. Add it."),
        (changed(["limits"], [1]), "my.yaml: limits: it must be a mapping of names (got list). Correct it."),
        (changed(["name"], ""), "my.yaml: name: it must be text of 1 to 500 characters (got ''). Correct it."),
        (changed(["name"], 3), "my.yaml: name: it must be text of 1 to 500 characters (got 3). Put it in quotes."),
        (changed(["chips"], 1.5), "my.yaml: chips: it must be a whole number from 1 to 1048576 (got 1.5). Correct it."),
        (changed(["chips"], True), "my.yaml: chips: it must be a whole number from 1 to 1048576 (got True). Correct it."),
        (changed(["clock_ghz"], math.nan), "my.yaml: clock_ghz: it must be a number above 0 (got nan). Correct it."),
        (changed(["clock_ghz"], 0.0), "my.yaml: clock_ghz: it must be a number above 0 (got 0.0). Correct it."),
        (changed(["registers", "voltage_bits"], 41), "my.yaml: registers.voltage_bits: it must be a whole number from 9 to 40 (got 41). Correct it."),
        (changed(["registers", "charge_bits"], 10**12), "my.yaml: registers.charge_bits: it must be a whole number from 9 to 40 (got 1000000000000). Correct it."),
        (changed(["registers", "delay_max"], 10**9), "my.yaml: registers.delay_max: it must be a whole number from 0 to 65534 (got 1000000000). Correct it."),
        (changed(["chips"], 10**6), "my.yaml: chips: the board is too large (128000000 cores against 1048576). Correct it."),
        (
            changed(["synapse_memory", "run_length"], 10**11),
            "my.yaml: synapse_memory.run_length: it must be a whole number from 1 to 65536 (got 100000000000). Correct it.",
        ),
        (
            changed(["synapse_memory", "word_bits"], 10**15),
            "my.yaml: synapse_memory.word_bits: it must be a whole number from 1 to 4096 (got 1000000000000000). Correct it.",
        ),
        (changed(["chips"], 10**400), "my.yaml: chips: it must be a whole number from 1 to 1048576 (got 1000000000000000000000000000000000000000000000000000000000000000000000000000). Correct it."),
        (changed(["clock_ghz"], math.inf), "my.yaml: clock_ghz: it must be a number above 0 (got inf). Correct it."),
        (
            changed(["mesh", "rows"], 5),
            "my.yaml: mesh: its tiles and the cores of a chip disagree (8 x 5 tiles of 4 against cores_per_chip 128). "
            "Make them equal.",
        ),
        ("name: a\nchips: 1\nname: b\n", "my.yaml: the key 'name' is given twice, again at line 3. Keep one."),
        ("", "my.yaml: it must be a mapping of names (got None). Correct it."),
        ("name: &a [*a]", "my.yaml: aliases are not read (line 1). Write the value out."),
        ("{" * 2000, "my.yaml: it is nested too deeply (more than 50 levels). Correct its brackets."),
        ("[1, 2", "my.yaml: it is not YAML at line 2. Compare it with a chip that ships."),
        ("- 1", "my.yaml: it must be a mapping of names (got list). Correct it."),
        ("!!python/object/apply:os.system [id]", "my.yaml: it is not YAML at line 1. Compare it with a chip that ships."),
    ],
    ids=[
        *("missing", "unknown", "text", "zero", "negative", "uncounted", "no profile", "no profiles"),
        *("few slots", "odd slots", "odd compartments", "odd places", "odd sums", "odd word", "odd phases", "few bits", "near a section", "near a width"),
        *("near a time", "missing below", "list for section", "no name", "number for name", "fraction", "truth", "nan"),
        *("no clock", "too wide", "absurdly wide", "too late", "too many", "long runs"),
        *("wide words", "boards", "endless clock", "tiles", "twice", "empty", "cyclic", "deep"),
        *("broken", "list", "code"),
    ],
)  # fmt: skip
def test_mistakes_in_chip_files_are_refused_with_their_way_out(tmp_path, text, message):
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(hw.InputError) as caught:
        hw.chip(path)
    assert str(caught.value) == message


WHOLE_NUMBERS = [
    pytest.param(section, key, value, id=key)
    for section in ("registers", "limits", "synapse_memory")
    for key, value in DOCUMENT[section].items()
]


def largest_allowed(section, key):
    """Return the largest number that a chip file may have there, as the message for a larger one says."""
    with pytest.raises(hw.InputError) as caught:
        parse_chip(changed([section, key], 2**39), "my.yaml")
    assert str(caught.value).startswith(
        f"my.yaml: {section}.{key}: it must be a whole number from "
    )
    return int(re.search(r"to (\d+) \(", str(caught.value))[1])


@pytest.mark.slow
@pytest.mark.parametrize(("section", "key", "value"), WHOLE_NUMBERS)
def test_memory_does_not_grow_with_a_number_of_the_chip_file(section, key, value):
    """Simulating and writing test vectors takes less than 64 MB with the largest value of any one number.

    Memory that grew with such a number would exceed it by far.
    """
    most = largest_allowed(section, key)
    document = yaml.safe_load(changed([section, key], most))
    if key != "run_header_bits":
        document["synapse_memory"]["run_header_bits"] += (
            40  # so that the header of a list holds larger numbers
        )
    if key == "cores_per_chip":
        document["mesh"] = {"columns": most, "rows": 1, "cores_per_tile": 1}
    use_everything(document)  # loops are compiled, which takes memory of its own
    tracemalloc.start()
    fast, slow = use_everything(document)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert fast.counts == slow.counts
    assert fast.counts.spikes > 0
    assert peak < 64e6
    assert most >= value


def use_everything(document):
    """Parse a chip, build a small recurrent program, simulate it with both engines, and make its test vectors."""
    chip = parse_chip(yaml.safe_dump(document), "my.yaml")
    b = hw.ProgramBuilder(chip)
    x = b.add_input("x", 3)
    h = b.add_compartments("h", 5, decay_u=FORGETS_AT_ONCE, decay_v=100, threshold=1)
    b.connect(x, h, np.full((5, 3), 30))
    b.connect(h, h, np.eye(5, dtype=int) * 20, delay=min(3, chip.registers.delay_max))
    program = b.build()
    spikes = np.ones((20, 3), dtype=np.uint8)
    fast, slow = (
        hw.simulate(program, spikes, engine=name, skip=False) for name in ("fast", "reference")
    )
    vectors_files(play_recording(program, spikes))
    return fast, slow


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("loihi-sin", "target 'loihi-sin': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml."),
        ("ulx3s-25f", "target 'ulx3s-25f': it is a board of ecp5-25f. Give the target ecp5-25f."),
        ("tpu", "target 'tpu': no chip of this name ships. Choose one of: ecp5-25f, ecp5-85f, ice40up5k, locsnn-130nm, loihi-sim, tiny-sim. A chip file of your own ends in .yaml."),
        ("gone.yaml", "gone.yaml: it cannot be read (No such file or directory). Give the path of a chip YAML file."),
    ],
    ids=["near miss", "board", "far off", "no file"],
)  # fmt: skip
def test_unknown_targets_are_refused_with_a_near_name(name, message):
    with pytest.raises(hw.InputError) as caught:
        hw.chip(name)
    assert str(caught.value) == message


def test_cores_fill_tiles_row_by_row_and_chips_lie_side_by_side():
    """Two chips of 3 columns and 2 rows, with two cores per tile."""
    chip = hw.chip("loihi-sim")
    board = replace(
        chip,
        chips=2,
        mesh=replace(chip.mesh, columns=3, rows=2, cores_per_tile=2),
        limits=replace(chip.limits, cores_per_chip=12),
    )
    tiles = [board.tile_of(slot) for slot in range(0, board.cores, 2)]
    first_chip = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    assert tiles == [*first_chip, *[(column + 3, row) for column, row in first_chip]]
    assert board.tile_of(23) == board.tile_of(22)
    assert board.hops(0, 23) == (5, 1)
