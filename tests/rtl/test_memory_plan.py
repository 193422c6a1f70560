"""Plans of the macros that the memories of a core are made of.

The cheapest plans are computed by hand. That a plan holds every bit of every word once is checked by `plan_check.py` of the
study of energy, which works out anew what each macro holds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import pytest
from plan_check import check
from shipped import example_files, model_file

import hw_model as hw
from hw_model.description.open_core import Macro
from hw_model.errors import InputError
from hw_model.rtl.device import on_core
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.memory_needs import arrays_of, reads_without_repeats
from hw_model.rtl.memory_plan import WIDEST, Array, Piece, plan
from locsnn_compile.cli.compile import main as compile_main

CHIP = hw.chip("locsnn-130nm")
STEPS = 250
"""Of the recordings of `objects-hybrid`."""
MACROS = {
    "small": Macro(words=16, bits=8, ports=1, area=100.0, read_pj=1.0, write_pj=2.0),
    "wide": Macro(words=16, bits=16, ports=1, area=150.0, read_pj=1.5, write_pj=3.0),
    "deep": Macro(words=64, bits=8, ports=1, area=250.0, read_pj=3.0, write_pj=6.0),
    "pair": Macro(words=16, bits=8, ports=2, area=300.0, read_pj=1.0, write_pj=2.0),
}
"""Invented macros, with figures that are easy to add up. `pair` has a pair of ports."""
ENERGY_ONLY = 0.0
AREA_FIRST = 9.0
"""Prices of area, in picojoules per square micrometre: with the second, area decides in all cases here."""


def array(words: int, bits: int, ports: int = 1, **more) -> Array:
    """Return a memory `a` that is read 100 times in a recording, unless other figures are given.

    `rows[k]` are the reads of a memory whose rows hold `k` words each: words that are read in order need fewer.
    """
    return Array("a", words, bits, ports, **{"rows": {1: 100.0}, **more})


class Expected(NamedTuple):
    """A plan, computed by hand: macros side by side in a row, and such rows (banks) one below the other.

    A row holds `pack` words. `area_um2` and `energy_pj` are of all copies of the memory.
    """

    row: tuple[str, ...]
    banks: int
    area_um2: float
    energy_pj: float
    pack: int = 1


@pytest.mark.parametrize(
    ("memory", "price", "expected"),
    [
        pytest.param(
            array(words=64, bits=8),
            ENERGY_ONLY,
            Expected(row=("small",), banks=4, area_um2=4 * 100, energy_pj=100 * 1.0),
            id="energy: shallow banks",
        ),
        pytest.param(
            array(words=64, bits=8),
            AREA_FIRST,
            Expected(row=("deep",), banks=1, area_um2=250, energy_pj=100 * 3.0),
            id="area: a deep one",
        ),
        pytest.param(
            array(words=32, bits=8, rows={1: 100.0, 2: 50.0}),
            ENERGY_ONLY,
            Expected(row=("wide",), banks=1, pack=2, area_um2=150, energy_pj=50 * 1.5),
            id="words in order: two in a row, half the reads",
        ),
        pytest.param(
            array(words=16, bits=20, rows={1: 10.0}),
            ENERGY_ONLY,
            Expected(row=("wide", "small"), banks=1, area_um2=250, energy_pj=10 * (1.5 + 1.0)),
            id="side by side",
        ),
        pytest.param(
            array(words=16, bits=8, ports=2, rows={1: 10.0}, writes=10.0),
            AREA_FIRST,
            Expected(row=("pair",), banks=1, area_um2=300, energy_pj=10 * 1.0 + 10 * 2.0),
            id="read and written",
        ),
        # With even and odd words in banks of their own (`halves`), two macros of one port replace one of two ports.
        pytest.param(
            array(words=32, bits=8, ports=2, rows={1: 10.0}, writes=10.0, halves=2),
            AREA_FIRST,
            Expected(row=("small",), banks=2, area_um2=2 * 100, energy_pj=10 * 1.0 + 10 * 2.0),
            id="even and odd banks",
        ),
        # Reads and writes of an array are those of all its copies together.
        pytest.param(
            array(words=16, bits=8, rows={1: 10.0}, copies=3),
            ENERGY_ONLY,
            Expected(row=("small",), banks=1, area_um2=3 * 100, energy_pj=10 * 1.0),
            id="copies: three times the area, once the energy",
        ),
    ],
)
def test_the_cheapest_plan(memory, price, expected):
    (planned,) = plan([memory], MACROS, price)
    found = Expected(planned.row, planned.banks, planned.area_um2, planned.energy_pj, planned.pack)
    assert found == expected
    check(list(planned.pieces()), [memory], MACROS)


def test_words_of_even_and_odd_banks_alternate():
    """40 words take four banks of 16: even and odd words below 32, then even and odd words from 32 on."""
    memory = array(words=40, bits=8, ports=2, rows={1: 10.0}, writes=10.0, halves=2)
    (planned,) = plan([memory], MACROS, AREA_FIRST)
    assert [(piece.first, piece.every, piece.rows) for piece in planned.pieces()] == [
        (0, 2, 16),
        (1, 2, 16),
        (32, 2, 16),
        (33, 2, 16),
    ]


def test_an_array_that_no_macros_hold_is_refused():
    # A row has at most four macros side by side (`WIDEST`).
    widest_row_bits = WIDEST * max(macro.bits for macro in MACROS.values())
    with pytest.raises(InputError) as caught:
        plan([array(words=64, bits=widest_row_bits + 1)], MACROS)
    assert str(caught.value) == "memory 'a': no macros hold it. Give wider macros or more ports."


MEMORY = array(words=32, bits=8)
"""Two banks of the macro `small` hold it."""
FIRST_BANK = Piece(
    memory="a", copies=1, macro="small", first=0, every=1, rows=16, pack=1, bit=0, bits=8
)


@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        pytest.param(
            [FIRST_BANK],
            "memory 'a': the plan is too small (0 hold bit 0 of word 16). Add macros.",
            id="words are left out",
        ),
        pytest.param(
            [replace(FIRST_BANK, bits=7), replace(FIRST_BANK, first=16)],
            "memory 'a': the plan is too small (0 hold bit 7 of word 0). Add macros.",
            id="a bit is left out",
        ),
        pytest.param(
            [FIRST_BANK, replace(FIRST_BANK, first=15)],
            "memory 'a': the plan is too small (0 hold bit 0 of word 31). Add macros.",
            id="banks are shifted",
        ),
        pytest.param(
            [FIRST_BANK, replace(FIRST_BANK, first=15), replace(FIRST_BANK, first=16)],
            "memory 'a': macros of the plan overlap (2 hold bit 0 of word 15). Give every bit one place.",
            id="banks overlap",
        ),
        pytest.param(
            [FIRST_BANK, replace(FIRST_BANK, macro="huge", first=16)],
            "memory 'a': no macro 'huge' holds its part (16 rows of 8 bits). Name another.",
            id="no such macro",
        ),
        pytest.param(
            [replace(FIRST_BANK, rows=32)],
            "memory 'a': no macro 'small' holds its part (32 rows of 8 bits). Name another.",
            id="a macro that is too shallow",
        ),
        pytest.param(
            [replace(FIRST_BANK, memory="b")],
            "memory 'b': the core has no such memory. Leave it out.",
            id="no such memory",
        ),
    ],
)  # fmt: skip
def test_a_wrong_plan_is_refused_by_name(pieces, message):
    with pytest.raises(InputError) as caught:
        check(pieces, [MEMORY], MACROS)
    assert str(caught.value) == message


@pytest.mark.slow
def test_every_bit_of_a_shipped_program_has_one_place(tmp_path):
    model = str(model_file("objects-hybrid-loihi"))
    assert compile_main([model, "--target", "loihi-sim", "-o", str(tmp_path), "--quiet"]) == 0
    program = hw.load_program(tmp_path)
    assert CHIP.open_core is not None
    core = on_core(program, STEPS, CHIP)
    # Any counts will do: what macros hold does not depend on them.
    arrays = arrays_of(core, CHIP.open_core, hw.Counts(synaptic_ops=1000, neuron_updates=1000))
    pieces = [piece for made in plan(arrays, CHIP.macros) for piece in made.pieces()]
    check(pieces, arrays, CHIP.macros)
    # No piece is superfluous: without it, bits have no place.
    for index, piece in enumerate(pieces):
        with pytest.raises(InputError, match=f"memory '{piece.memory}': the plan is too small"):
            check(pieces[:index] + pieces[index + 1 :], arrays, CHIP.macros)


@pytest.mark.slow
def test_the_folder_of_a_chip_has_the_plan(tmp_path):
    model = str(model_file("objects-hybrid-loihi"))
    events = str(example_files("objects-hybrid")[0])
    target = ["--target", "locsnn-130nm", "--events", events]
    output = ["--emit", "rtl", "--quiet", "-o", str(tmp_path)]
    assert compile_main([model, *target, *output]) == 0
    head, *rows = (tmp_path / "rtl" / "memories.csv").read_text().splitlines()
    assert (
        head
        == "memory,copies,macro,first word,words to the next row,rows,words in a row,first bit,bits"
    )
    # Constants of compartments are in two groups, `leaks` and `fires`. Compartments of one kind share the words of
    # `leaks_same` and `fires_same`; `fires_own` has the fields in which they differ.
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
    core = two_kinds_in_turn(compartments=8, steps=10)
    # Constants lie in two halves, for even and odd compartments, and each half keeps showing its last word. Here all
    # even compartments are of one kind and all odd ones of the other, so each half is read once in each step.
    reads_per_step = 2
    assert reads_without_repeats(core, CHIP.open_core, "leaks", phase=0) == reads_per_step * 10
    # A phase without compartments reads nothing.
    assert reads_without_repeats(core, CHIP.open_core, "leaks", phase=1) == 0


def two_kinds_in_turn(compartments: int, steps: int) -> CoreProgram:
    """Return a program whose compartments are of two kinds in turn (two decays), with a second phase that is empty."""
    b = hw.ProgramBuilder(hw.chip("loihi-sim"), name="turns")
    x = b.add_input("x", 1)
    y = b.add_compartments("y", compartments, decay_u=[100, 200] * (compartments // 2), threshold=4)
    b.connect(x, y, [[2]] * compartments)
    b.read_out(y)
    core = CoreProgram(b.build(), steps)
    # The second phase ends at the number of a compartment at which it begins, so it has none.
    core.ends.append(core.ends[-1])
    core.phases = (*core.phases, core.phases[0])
    return core
