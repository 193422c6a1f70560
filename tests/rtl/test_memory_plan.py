"""The plan of memories of a program: the cheapest by hand, every bit in one place, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import pytest
from plan_check import check
from shipped import example_files, model_file

import hw_model as hw
from hw_model.description.open_core import Macro
from hw_model.errors import InputError
from hw_model.rtl.device import on_core
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.memory_needs import arrays_of, reads_without_repeats
from hw_model.rtl.memory_plan import Array, Piece, plan
from locsnn_compile.cli.compile import main as compile_main

CHIP = hw.chip("locsnn-130nm")
MACROS = {
    "small": Macro(16, 8, 100.0, 1.0, 2.0, 1),
    "wide": Macro(16, 16, 150.0, 1.5, 3.0, 1),
    "deep": Macro(64, 8, 250.0, 3.0, 6.0, 1),
    "pair": Macro(16, 8, 300.0, 1.0, 2.0, 2),
}


@pytest.mark.parametrize(
    ("array", "price", "row", "banks", "pack", "area", "energy"),
    [
        pytest.param(
            Array("a", 64, 8, 1, {1: 100.0}),
            0.0,
            ("small",),
            4,
            1,
            400,
            100,
            id="energy: shallow banks",
        ),
        pytest.param(
            Array("a", 64, 8, 1, {1: 100.0}), 9.0, ("deep",), 1, 1, 250, 300, id="area: a deep one"
        ),
        pytest.param(
            Array("a", 32, 8, 1, {1: 100.0, 2: 50.0}),
            0.0,
            ("wide",),
            1,
            2,
            150,
            75,
            id="words in order: two in a row",
        ),
        pytest.param(
            Array("a", 16, 20, 1, {1: 10.0}),
            0.0,
            ("wide", "small"),
            1,
            1,
            250,
            25,
            id="side by side",
        ),
        pytest.param(
            Array("a", 16, 8, 2, {1: 10.0}, 10.0),
            9.0,
            ("pair",),
            1,
            1,
            300,
            30,
            id="read and written",
        ),
        pytest.param(
            Array("a", 32, 8, 2, {1: 10.0}, 10.0, halves=2),
            9.0,
            ("small",),
            2,
            1,
            200,
            30,
            id="even and odd banks",
        ),
        pytest.param(
            Array("a", 16, 8, 1, {1: 10.0}, copies=3), 0.0, ("small",), 1, 1, 300, 10, id="copies"
        ),
    ],
)
def test_the_cheapest_plan(array, price, row, banks, pack, area, energy):
    (planned,) = plan([array], MACROS, price)
    assert (planned.row, planned.banks, planned.pack) == (row, banks, pack)
    assert (planned.area_um2, planned.energy_pj) == (area, energy)
    check(list(planned.pieces()), [array], MACROS)


def test_words_of_even_and_odd_banks_alternate():
    (planned,) = plan([Array("a", 40, 8, 2, {1: 10.0}, 10.0, halves=2)], MACROS, 9.0)
    assert [(piece.first, piece.every, piece.rows) for piece in planned.pieces()] == [
        (0, 2, 16),
        (1, 2, 16),
        (32, 2, 16),
        (33, 2, 16),
    ]


def test_an_array_that_no_macros_hold_is_refused():
    with pytest.raises(InputError) as caught:
        plan([Array("a", 64, 100, 1, {1: 1.0})], MACROS)
    assert str(caught.value) == "memory 'a': no macros hold it. Give wider macros or more ports."


PIECE = Piece("a", 1, "small", 0, 1, 16, 1, 0, 8)


@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        pytest.param(
            [PIECE],
            "memory 'a': the plan is too small (0 hold bit 0 of word 16). Add macros.",
            id="words are left out",
        ),
        pytest.param(
            [replace(PIECE, bits=7), replace(PIECE, first=16)],
            "memory 'a': the plan is too small (0 hold bit 7 of word 0). Add macros.",
            id="a bit is left out",
        ),
        pytest.param(
            [PIECE, replace(PIECE, first=15)],
            "memory 'a': the plan is too small (0 hold bit 0 of word 31). Add macros.",
            id="banks are shifted",
        ),
        pytest.param(
            [PIECE, replace(PIECE, first=15), replace(PIECE, first=16)],
            "memory 'a': macros of the plan overlap (2 hold bit 0 of word 15). Give every bit one place.",
            id="banks overlap",
        ),
        pytest.param(
            [PIECE, replace(PIECE, macro="huge", first=16)],
            "memory 'a': no macro 'huge' holds its part (16 rows of 8 bits). Name another.",
            id="no such macro",
        ),
        pytest.param(
            [replace(PIECE, rows=32)],
            "memory 'a': no macro 'small' holds its part (32 rows of 8 bits). Name another.",
            id="a macro that is too shallow",
        ),
        pytest.param(
            [replace(PIECE, memory="b")],
            "memory 'b': the core has no such memory. Leave it out.",
            id="no such memory",
        ),
    ],
)  # fmt: skip
def test_a_wrong_plan_is_refused_by_name(pieces, message):
    with pytest.raises(InputError) as caught:
        check(pieces, [Array("a", 32, 8, 1, {1: 1.0})], MACROS)
    assert str(caught.value) == message


@pytest.mark.slow
def test_every_bit_of_a_shipped_program_has_one_place(tmp_path):
    model = str(model_file("objects-hybrid-loihi"))
    assert compile_main([model, "--target", "loihi-sim", "-o", str(tmp_path), "--quiet"]) == 0
    program = hw.load_program(tmp_path)
    assert CHIP.open_core is not None
    core = on_core(program, 250, CHIP)
    arrays = arrays_of(core, CHIP.open_core, hw.Counts(synaptic_ops=1000, neuron_updates=1000))
    pieces = [piece for made in plan(arrays, CHIP.macros) for piece in made.pieces()]
    check(pieces, arrays, CHIP.macros)
    for index, piece in enumerate(pieces):
        with pytest.raises(InputError, match=f"memory '{piece.memory}': the plan is too small"):
            check(pieces[:index] + pieces[index + 1 :], arrays, CHIP.macros)


@pytest.mark.slow
def test_the_folder_of_a_chip_has_the_plan(tmp_path):
    model = str(model_file("objects-hybrid-loihi"))
    events = str(example_files("objects-hybrid")[0])
    given = [
        "--target",
        "locsnn-130nm",
        "--events",
        events,
        "--emit",
        "rtl",
        "--quiet",
        "-o",
        str(tmp_path),
    ]
    assert compile_main([model, *given]) == 0
    head, *rows = (tmp_path / "rtl" / "memories.csv").read_text().splitlines()
    assert (
        head
        == "memory,copies,macro,first word,words to the next row,rows,words in a row,first bit,bits"
    )
    assert {row.split(",")[0] for row in rows} >= {
        "axons",
        "synapses",
        "charges",
        "states",
        "leaks_same",
        "fires_own",
    }
    assert [row for row in rows if row.startswith("charges")] == [
        "charges,2,latches 256x16,0,1,256,1,0,16"
    ]


def test_shared_words_that_repeat_are_not_read_again():
    core = program_on_core(8)
    # Every other compartment is of a kind; a phase without compartments reads nothing.
    assert reads_without_repeats(core, CHIP.open_core, "leaks", 0) == 2 * 10
    assert reads_without_repeats(core, CHIP.open_core, "leaks", 1) == 0


def program_on_core(compartments: int) -> CoreProgram:
    """Return compartments of two kinds in turn, which take ten steps."""
    b = hw.ProgramBuilder(hw.chip("loihi-sim"), name="turns")
    x = b.add_input("x", 1)
    y = b.add_compartments("y", compartments, decay_u=[100, 200] * (compartments // 2), threshold=4)
    b.connect(x, y, [[2]] * compartments)
    b.read_out(y)
    core = CoreProgram(b.build(), 10)
    core.ends.append(core.ends[-1])
    core.phases = (*core.phases, core.phases[0])
    return core
