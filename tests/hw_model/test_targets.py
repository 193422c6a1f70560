"""Targets: each kind of chip answers what the compiler asks, and no other room asks a chip for its kind."""

import ast
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

import hw_model as hw
from hw_model.targets import TARGETS, target_of
from hw_model.targets.families import FAMILIES, MESHES, XYLOS, chip_named, family_of
from hw_model.targets.mesh import MeshTarget
from hw_model.targets.open_core import OpenCoreTarget
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL

ROOT = Path(__file__).parents[2]
ROOMS_OF_THE_CORE = ("hw_model/description/", "hw_model/rtl/", "hw_model/targets/")
MESH = ("loihi-sim", "tiny-sim")


def program_on(chip):
    """Return a program on two cores of the mesh: three compartments driven by one channel, and one driven by them."""
    limits = replace(chip.limits, compartments_per_core=3)
    b = hw.ProgramBuilder(replace(chip, limits=limits))
    x = b.add_input("x", 1)
    h = b.add_compartments("h", 3, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=10)
    y = b.add_compartments("y", 1, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=10)
    b.connect(x, h, [[20]] * 3)
    b.connect(h, y, [[2, 4, 6]])
    b.read_out(y)
    return b.build()


@pytest.mark.parametrize("name", hw.chip_names())
def test_every_chip_that_ships_is_of_one_kind(name):
    chip = hw.chip(name)
    kind = MeshTarget if name in MESH else OpenCoreTarget
    assert type(target_of(chip)) is kind
    assert target_of(chip).chip is chip
    assert kind in TARGETS


class Abilities(NamedTuple):
    """What a target says that it can do."""

    joins: bool
    timed: bool
    has_mesh: bool
    times_cores: bool


ON_A_MESH = Abilities(joins=True, timed=True, has_mesh=True, times_cores=True)
OPEN_CORE = Abilities(joins=True, timed=True, has_mesh=False, times_cores=False)
ABILITIES = {
    "loihi-sim": ON_A_MESH,
    "tiny-sim": ON_A_MESH,
    "ecp5-25f": OPEN_CORE,
    "ecp5-85f": OPEN_CORE,
    "ice40up5k": OPEN_CORE._replace(joins=False),
    "locsnn-130nm": OPEN_CORE,
}


@pytest.mark.parametrize(("name", "abilities"), ABILITIES.items(), ids=ABILITIES)
def test_targets_say_what_they_can_do(name, abilities):
    target = target_of(hw.chip(name))
    answers = Abilities(target.joins, target.timed, target.has_mesh, target.times_cores)
    assert answers == abilities


def test_a_mesh_without_times_of_operations_is_not_timed():
    chip = hw.chip("loihi-sim")
    priced = replace(chip.costs, time_ns={})
    assert not target_of(replace(chip, profiles={"free": priced})).timed


def test_a_program_takes_its_cores_of_a_mesh():
    program = program_on(hw.chip("loihi-sim"))
    target = target_of(program.chip)
    assert target.cores_used(program) == len(program.cores) == 2
    uses = target.limits_used(program, rows=4)
    assert uses["cores"] == (2, 128)
    assert uses["compartments"] == (3, 3)
    assert uses["axons_in"] == (3, 4096)


def test_a_program_takes_the_one_open_core_whatever_it_calls_cores():
    program = program_on(hw.chip("ecp5-25f"))
    target = target_of(program.chip)
    assert len(program.cores) == 2
    assert target.cores_used(program) == 1
    uses = target.limits_used(program, rows=4)
    assert "cores" not in uses
    assert uses["compartments"] == (4, program.chip.open_core.compartments)


def test_a_program_too_large_for_an_open_core_is_refused_and_a_larger_one_named():
    b = hw.ProgramBuilder(hw.chip("ecp5-85f"))
    h = b.add_compartments("h", 400, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=10)
    b.connect(b.add_input("x", 1), h, [[20]] * 400)
    b.read_out(h)
    program = b.build()
    target_of(program.chip).check_fits(program, rows=4)
    with pytest.raises(hw.TargetError) as caught:
        target_of(hw.chip("ice40up5k")).check_fits(program, rows=4)
    assert str(caught.value) == (
        "program 'program': the open core of ice40up5k is too small in 'compartments' "
        "(400 against 256). Use the device ecp5-85f."
    )


@pytest.mark.slow
def test_only_the_rooms_of_the_core_ask_whether_a_chip_is_one():
    asking = []
    for package in ("hw_model", "locsnn_compile"):
        for path in (ROOT / package).rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            nodes = ast.walk(ast.parse(path.read_text()))
            asks = any(
                isinstance(node, ast.Attribute) and node.attr == "open_core" for node in nodes
            )
            if asks and not name.startswith(ROOMS_OF_THE_CORE):
                asking.append(name)
    assert asking == []


@pytest.mark.parametrize(
    ("name", "family"),
    [
        ("loihi-sim", MESHES),
        ("ice40up5k", MESHES),
        ("xylo-imu", XYLOS),
        ("unknown", MESHES),
    ],
)
def test_the_name_of_a_chip_says_its_family(name, family):
    assert family_of(name) is family


def test_every_chip_that_ships_is_found_by_its_name():
    for family in FAMILIES:
        for name in family.names():
            assert chip_named(name).name == name
            assert family.document(name).startswith("#") or "name:" in family.document(name)
            assert family.lines(name).startswith(f"{name}: ")


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        (
            "tiny-sim",
            "1 chip of 16 cores; a core holds 64 compartments, 512 input axons, "
            "1024 synapse words\n  energy profiles: ",
        ),
        (
            "ice40up5k",
            "a program may have 256 compartments, 512 sources of spikes, 16384 synapses, 2 slots; "
            "cycles are exact, energy is not known",
        ),
    ],
)
def test_a_target_describes_its_limits_in_words(name, lines):
    assert target_of(hw.chip(name)).in_words.startswith(lines)
