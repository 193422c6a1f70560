"""Memories of a plan, macros and latches behind the ports of the core: they behave like the memories of the core."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import latches
import liberty
import memories
import netlist
import numpy as np
import plans
import pytest
import repeats
import runs
import traffic
from latches import Latches
from plan_check import check

import hw_model as hw
from hw_model.errors import InputError
from hw_model.rtl.comparison import compare
from hw_model.rtl.simulators import sources

NEEDS_ICARUS = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)


def macro(words: int, bits: int, ports: int, mask: bool = True) -> liberty.Macro:
    """Return a macro that nobody makes."""
    name = f"MADE_{ports}P_{words}x{bits}{'_bm_' if mask else ''}"
    return liberty.Macro(name, words, bits, ports, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, {})


def model(one: liberty.Macro) -> str:
    """Return how a macro behaves: what is read stays at its output."""
    text = (
        memories.stub(one)
        .replace("(* blackbox *) ", "")
        .replace(" endmodule\n", "\n")
        .replace("output [", "output reg [")
    )
    body = f"reg [{one.bits - 1}:0] words[0:{one.words - 1}];\n"
    for port in "AB"[: one.ports]:
        mask = f"{port}_BM" if "_bm_" in one.name else f"{{{one.bits}{{1'b1}}}}"
        body += (
            f"always @(posedge {port}_CLK) if ({port}_MEN) begin\n"
            f"if ({port}_WEN) words[{port}_ADDR] <= ({port}_DIN & {mask}) | (words[{port}_ADDR] & ~{mask});\n"
            f"else if ({port}_REN) {port}_DOUT <= words[{port}_ADDR];\nend\n"
        )
    return f"{text}{body}endmodule\n"


WRAPPED = [
    memories.Choice(memories.Shape("plain", 64, 10, 2), (macro(64, 10, 2),), 1, 1),
    memories.Choice(
        memories.Shape("banks", 60, 10, 2), (macro(16, 8, 2), macro(16, 4, 2, mask=False)), 4, 1
    ),
    memories.Choice(memories.Shape("shallow", 8, 5, 1), (macro(16, 8, 1),), 1, 1),
    memories.Choice(memories.Shape("pairs", 64, 9, 1), (macro(16, 16, 1), macro(16, 8, 1)), 2, 2),
    memories.Choice(memories.Shape("fours", 50, 7, 1), (macro(8, 32, 1),), 2, 4),
    Latches(memories.Shape("latches", 64, 10, 2), 16),
    Latches(memories.Shape("few", 50, 3, 2, used=50), 64),
    Latches(memories.Shape("loaded", 8, 5, 1), 8),
]


def modules(*made: memories.Choice | Latches) -> str:
    """Return the memory of the core, the modules of others, and how macros and gates behave."""
    used = {one for choice in made if isinstance(choice, memories.Choice) for one in choice.macros}
    arrays = netlist.memories_sv(made).replace(latches.GATE, latches.MODEL)
    return (runs.ROOT / "hw_model/rtl/memory.sv").read_text() + "".join(map(model, used)) + arrays


def played(folder: Path, text: str) -> list[str]:
    """Return the words that a bench says."""
    (folder / "bench.sv").write_text(text)
    subprocess.run(
        ["iverilog", "-g2012", "-s", "bench", "-o", "bench", "bench.sv"], cwd=folder, check=True
    )
    return subprocess.run(
        ["vvp", "-n", "bench"], cwd=folder, check=True, capture_output=True, text=True
    ).stdout.split()


@NEEDS_ICARUS
@pytest.mark.parametrize("choice", WRAPPED, ids=lambda choice: choice.shape.name)
def test_a_memory_of_a_plan_behaves_as_the_memory_of_the_core(choice, tmp_path):
    shape = choice.shape
    bench = BENCH.format(
        name=shape.name, bits=shape.bits, words=max(shape.held) + 1, depth=shape.words,
        address=(shape.words - 1).bit_length(), ports=shape.ports,
    )  # fmt: skip
    assert played(tmp_path, modules(choice) + bench) == ["0", "differ"]


@NEEDS_ICARUS
@pytest.mark.parametrize("late", [8, 9, 10, 11])
def test_banks_of_one_port_alternate_between_reads_and_writes_of_a_sweep(late, tmp_path):
    shape = memories.Shape("states", 64, 10, 2)
    choice = memories.Choice(shape, (macro(16, 8, 1), macro(16, 4, 1, mask=False)), 4, 1)
    assert choice.waits
    assert played(tmp_path, modules(choice) + SWEEP.replace("LATE", str(late))) == ["0", "differ"]


@NEEDS_ICARUS
@pytest.mark.parametrize("banks", [1, 4])
def test_marks_of_a_memory_of_one_port_wait_for_reads(banks, tmp_path):
    choice = memories.Choice(
        memories.Shape("bitmap", 64, 10, 2),
        (macro(64 // banks, 8, 1), macro(64 // banks, 4, 1)),
        banks,
        1,
    )
    assert choice.waits
    text = modules(choice)
    assert played(tmp_path, text + MARKS) == ["0", "differ"]
    for part in ("if (wait_now || waiting) waiting <=", "&& !clash"):
        assert part in text
        assert (
            int(
                played(
                    tmp_path,
                    text.replace(part, "if (0) waiting <=" * part.startswith("if")) + MARKS,
                )[0]
            )
            > 0
        )


@NEEDS_ICARUS
def test_words_that_repeat_are_not_read_again_and_come_out_the_same(tmp_path):
    split = repeats.Split(memories.Shape("leaks", 64, 10, 1), (1, 6, 7, 9))
    parts = (
        memories.Choice(memories.Shape("leaks_same", 32, 6, 1, 2), (macro(16, 8, 1),), 2, 1),
        memories.Choice(memories.Shape("leaks_own", 64, 4, 1), (macro(32, 8, 1),), 1, 2),
        Latches(memories.Shape("leaks_flags", 2, 32, 2), 2),
    )
    text = modules(*parts) + repeats.verilog(split)
    differ, _, skipped, _ = played(tmp_path, text + CONSTANTS)
    assert differ == "0"
    assert int(skipped) > 1000
    for part in (" && earlier == write_data", " && read_address == coming"):
        assert part in text
        assert int(played(tmp_path, text.replace(part, "") + CONSTANTS)[0]) > 0


PLANNED = [
    memories.Choice(memories.Shape("pairs", 64, 9, 1), (macro(16, 16, 1), macro(16, 8, 1)), 2, 2),
    memories.Choice(memories.Shape("states", 64, 10, 2), (macro(16, 8, 1), macro(16, 4, 1)), 4, 1),
    Latches(memories.Shape("charges", 64, 10, 2, copies=2, used=13, period=32), 8),
]


def test_the_plan_of_the_gate_level_core_is_checked(monkeypatch):
    files = runs.Library(Path("none"))
    monkeypatch.setattr(
        runs.Library,
        "macros",
        {one.name: one for choice in PLANNED[:2] for one in choice.macros},
        raising=True,
    )
    pieces, known = plans.pieces_of(PLANNED), plans.checked_by(files, PLANNED)
    check(pieces, *known)
    for at, piece in enumerate(pieces):
        with pytest.raises(InputError, match=f"memory '{piece.memory}': the plan is too small"):
            check(pieces[:at] + pieces[at + 1 :], *known)
        with pytest.raises(
            InputError, match=f"memory '{piece.memory}': macros of the plan overlap"
        ):
            check([*pieces, piece], *known)
    (few,) = [replace(one, bits=one.bits - 1) for one in pieces[-1:]]
    with pytest.raises(InputError) as caught:
        check([*pieces[:-1], few], *known)
    assert str(caught.value) == (
        "memory 'charges': the plan is too small (0 hold bit 9 of word 21). Add macros."
    )


def families() -> tuple[hw.ChipProgram, np.ndarray]:
    """Five compartments with two dendrites each: their sums lie behind the first words."""
    r = np.random.default_rng(3)
    b = hw.ProgramBuilder(hw.chip("loihi-sim"), name="families")
    x = b.add_input("x", 4)
    y = b.add_compartments("y", 5, decay_u=400, decay_v=300, threshold=90)
    for name in ("one", "other"):
        part = b.add_compartments(
            f"y/{name}", 5, decay_u=390, decay_v=300, threshold=90, joined_to=y
        )
        b.connect(x, part, 2 * r.integers(-30, 60, (5, 4)), delay=3 * (name == "one"))
    b.read_out(y)
    return b.build(), (r.random((2, 30, 4)) < 0.4).astype(np.uint8)


def with_memories(core: runs.Core, done: dict[str, traffic.Memory]) -> dict[str, str]:
    """Return the SystemVerilog of a core by file, with memories of macros that nobody makes, or of latches."""
    made = runs.Library(Path("none"))
    chosen = [plans.options(made, memory, core)[-1] for memory in done.values()]
    texts = {
        path.name: netlist.with_memories(path.read_text()) for path in netlist.parts(netlist.CORE)
    }
    texts["locsnn_core.sv"] = traffic.set_in(texts["locsnn_core.sv"], core.saving)
    memory = modules(*chosen) + "".join(map(repeats.verilog, repeats.splits(core.sizes)))
    # Registers of a plan begin with anything, and are right once their memory is cleaned.
    memory = re.sub(r"(logic waiting|streak|put);", r"\1 = 0;", memory)
    return {**sources(), **texts, "memory.sv": memory}


@pytest.mark.minutes
@NEEDS_ICARUS
def test_a_core_with_memories_of_a_plan_plays_like_the_simulator(monkeypatch):
    macros = [macro(*one) for one in ((64, 32, 1), (64, 32, 2), (1024, 32, 1), (1024, 32, 2))]
    monkeypatch.setattr(runs.Library, "macros", {one.name: one for one in macros})
    program, recordings = families()
    mapped, core = runs.holding(program, recordings.shape[1])
    done = repeats.parts_of(runs.counted_for(program, recordings, core), mapped, core.sizes)
    found = compare(program, recordings, with_memories(core, done), "icarus", sizes=core.sizes)
    assert (found["mismatches"], found["cycle_mismatches"]) == (0, 0)
    # The fault that a larger network had at gate level: words for as many sums as there are parents, from the first on.
    few = replace(core, held={**core.held, "sums": 5})
    assert (
        compare(program, recordings, with_memories(few, done), "icarus", sizes=core.sizes)[
            "mismatches"
        ]
        > 0
    )
    made = plans.options(runs.Library(Path("none")), done["sums"], few)[-1]
    with pytest.raises(InputError) as caught:
        plans.refuse_too_few(made.shape, done["sums"])
    wanted = "memory 'sums': the plan does not make a word that something is read from (word 10 of 5). Hold more words."
    assert str(caught.value) == wanted


BENCH = """
module bench;
    logic clk = 0, write = 0, read = 0;
    logic [{address}-1:0] write_address = 0, read_address = 0;
    logic [{bits}-1:0] write_data = 0;
    wire [{bits}-1:0] wanted, found;
    integer i, differ = 0, seen = 0;
    always #5 clk = !clk;
    memory #(.WIDTH({bits}), .DEPTH({depth})) core (.clk, .write, .write_address, .write_data, .read, .read_address, .read_data(wanted));
    memory_{name} made (.clk, .write, .read, .write_address, .read_address, .write_data, .read_data(found));
    initial begin
        for (i = 0; i < 5000; i = i + 1) begin
            @(negedge clk);
            if (seen != 0 && wanted !== found) differ = differ + 1;
            write = i < {words} || (i % 97 > 80 && $urandom % 2);
            // A memory of one port is never read while it is written; a word is never read in the cycle of its writing.
            read = i >= {words} && $urandom % 4 != 0 && !({ports} == 1 && write);
            write_address = i < {words} ? i : $urandom % {words};
            read_address = $urandom % 3 ? (read_address + 1) % {words} : $urandom % {words};
            if (read_address == write_address) read_address = (read_address + 1) % {words};
            write_data = $urandom;
            if (read) seen = 1;
        end
        $display("%0d differ", differ);
        $finish;
    end
endmodule
"""
SWEEP = """
module bench;
    logic clk = 0, write = 0, read = 0;
    logic [5:0] write_address = 0, read_address = 0;
    logic [9:0] write_data;
    wire [9:0] wanted, found;
    integer differ = 0, sweep, k, first, last;
    always #5 clk = !clk;
    memory #(.WIDTH(10), .DEPTH(64)) core (.clk, .write, .write_address, .write_data, .read, .read_address, .read_data(wanted));
    memory_states made (.clk, .write, .read, .write_address, .read_address, .write_data, .read_data(found));
    initial begin
        made.waiting = 0;
        for (sweep = 0; sweep < 400; sweep = sweep + 1) begin
            first = sweep < 4 ? 0 : $urandom % 64;
            last = sweep < 4 ? 64 : first + 1 + $urandom % (64 - first);
            for (k = first; k < last + LATE + 2; k = k + 1) begin
                @(negedge clk);
                if (sweep > 3 && wanted !== found) differ = differ + 1;
                read = k < last;
                if (read) read_address = k;
                write = k >= first + LATE && k < last + LATE && (sweep < 4 || $urandom % 3 != 0);
                if (write) {write_address, write_data} = {6'(k - LATE), 10'($urandom)};
            end
        end
        $display("%0d differ", differ);
        $finish;
    end
endmodule
"""
MARKS = """
module bench;
    logic clk = 0, write = 0, read = 0, marks = 0, marked = 0;
    logic [5:0] write_address = 0, read_address = 0, place = 0;
    logic [9:0] write_data = 0, word = 0;
    wire [9:0] wanted, found;
    integer differ = 0, i;
    always #5 clk = !clk;
    memory #(.WIDTH(10), .DEPTH(64)) core (.clk, .write, .write_address, .write_data, .read, .read_address, .read_data(wanted));
    memory_bitmap made (.clk, .write, .read, .write_address, .read_address, .write_data, .read_data(found));
    initial begin
        made.waiting = 0;
        for (i = 0; i < 5000; i = i + 1) begin
            @(negedge clk);
            if (i > 66 && wanted !== found) differ = differ + 1;
            // Swept, then marked: read, and two cycles later written, a word in every other cycle; then read only.
            {write, write_address, write_data} = i < 64 ? {1'b1, 6'(i), 10'd0} : {marked, place, word};
            {marked, place, word} = {marks, read_address, found | 10'd1 << $urandom % 10};
            marks = i > 65 && i % 1000 < 800 && !read && $urandom % 4 != 0;
            read = marks || (i > 65 && i % 1000 > 804 && $urandom % 2);
            if (read) read_address = read_address + 1 + $urandom % 62;
        end
        $display("%0d differ", differ);
        $finish;
    end
endmodule
"""
CONSTANTS = """
module bench;
    logic clk = 0, write = 0, read = 0;
    logic [5:0] write_address = 0, read_address = 0;
    logic [9:0] write_data = 0;
    wire [9:0] wanted, found;
    integer differ = 0, sweep, k, first, last, seen = 0, skipped = 0;
    always #5 clk = !clk;
    memory #(.WIDTH(10), .DEPTH(64)) core (.clk, .write, .write_address, .write_data, .read, .read_address, .read_data(wanted));
    memory_leaks made (.clk, .write, .read, .write_address, .read_address, .write_data, .read_data(found));
    always @(posedge clk) if (made.again) skipped = skipped + 1;
    initial begin
        {made.repeats.streak, made.repeats.put} = 0;
        for (sweep = 0; sweep < 600; sweep = sweep + 1) begin
            first = sweep % 50 == 0 ? 0 : $urandom % 60;
            last = sweep % 50 == 0 ? 64 : first + 1 + $urandom % (64 - first);
            for (k = first; k < last; k = k + 1) begin
                @(negedge clk);
                if (seen != 0 && wanted !== found) differ = differ + 1;
                write = sweep % 50 == 0;
                read = !write && (sweep % 7 != 3 || $urandom % 4 != 0);
                if (read) begin
                    read_address = sweep % 11 == 5 ? $urandom : k;
                    seen = 1;
                end
                if (write) begin
                    write_address = k;
                    write_data = $urandom % 4 == 0 ? $urandom : (k % 2 ? 5 : 900);
                end
                if (!write && !read && sweep % 3 == 0) begin
                    write = 1;
                    {write_address, write_data} = $urandom;
                end
            end
            @(negedge clk);
            if (seen != 0 && wanted !== found) differ = differ + 1;
            {read, write} = 0;
        end
        $display("%0d differ %0d skipped", differ, skipped);
        $finish;
    end
endmodule
"""


def test_a_row_holds_every_word_and_no_macro_too_many():
    some = [macro(16, 8, 1), macro(16, 16, 1), macro(64, 8, 1)]
    found = list(memories.choices(memories.Shape("x", 40, 12, 1), some))
    assert found
    for choice in found:
        bits = [m.bits for m in choice.macros]
        assert sum(bits) >= 12 * choice.pack > sum(bits) - min(bits)
        assert (
            choice.banks * choice.rows * choice.pack
            >= 40
            > (choice.banks - 1) * choice.rows * choice.pack
        )
