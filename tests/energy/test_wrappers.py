"""Memories made of macros or latches behave like the memories of the core (memory.sv).

The study of energy puts each memory of a plan behind the ports of memory.sv: macros side by side
and in banks, latches, memories of one port that delay writes, and constants that are not read again
if they repeat. Icarus Verilog plays each next to memory.sv in a bench, which counts in how many
cycles they show different words. At the end a whole core plays with such memories.
"""

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
    """Return an invented macro, as area, energies and times do not matter here.

    ``mask``: whether single bits can be written.
    """
    name = f"MADE_{ports}P_{words}x{bits}{'_bm_' if mask else ''}"
    return liberty.Macro(
        name,
        words=words,
        bits=bits,
        ports=ports,
        area=1.0,
        read_pj=1.0,
        write_pj=1.0,
        leakage_nw=1.0,
        output_ns=1.0,
        input_pf=0.0,
        setup_ns=0.0,
        toggle_pj={},
    )


def model(macro: liberty.Macro) -> str:
    """Return the SystemVerilog of a macro: a word that was read stays at its output."""
    text = (
        memories.stub(macro)
        .replace("(* blackbox *) ", "")
        .replace(" endmodule\n", "\n")
        .replace("output [", "output reg [")
    )
    body = f"reg [{macro.bits - 1}:0] words[0:{macro.words - 1}];\n"
    for port in "AB"[: macro.ports]:
        mask = f"{port}_BM" if "_bm_" in macro.name else f"{{{macro.bits}{{1'b1}}}}"
        body += (
            f"always @(posedge {port}_CLK) if ({port}_MEN) begin\n"
            f"if ({port}_WEN) words[{port}_ADDR] <= ({port}_DIN & {mask}) | (words[{port}_ADDR] & ~{mask});\n"
            f"else if ({port}_REN) {port}_DOUT <= words[{port}_ADDR];\nend\n"
        )
    return f"{text}{body}endmodule\n"


# A shape is a memory as the core sees it. A choice makes it of `banks` rows of macros side by side, with `pack` words in a
# row, and latches of banks with `depth` words each.
WRAPPED = [
    memories.Choice(
        memories.Shape("plain", words=64, bits=10, ports=2),
        (macro(words=64, bits=10, ports=2),),
        banks=1,
        pack=1,
    ),
    memories.Choice(
        memories.Shape("banks", words=60, bits=10, ports=2),
        (macro(words=16, bits=8, ports=2), macro(words=16, bits=4, ports=2, mask=False)),
        banks=4,
        pack=1,
    ),
    memories.Choice(
        memories.Shape("shallow", words=8, bits=5, ports=1),
        (macro(words=16, bits=8, ports=1),),
        banks=1,
        pack=1,
    ),
    memories.Choice(
        memories.Shape("pairs", words=64, bits=9, ports=1),
        (macro(words=16, bits=16, ports=1), macro(words=16, bits=8, ports=1)),
        banks=2,
        pack=2,
    ),
    memories.Choice(
        memories.Shape("fours", words=50, bits=7, ports=1),
        (macro(words=8, bits=32, ports=1),),
        banks=2,
        pack=4,
    ),
    Latches(memories.Shape("latches", words=64, bits=10, ports=2), depth=16),
    Latches(memories.Shape("few", words=50, bits=3, ports=2, used=50), depth=64),
    Latches(memories.Shape("loaded", words=8, bits=5, ports=1), depth=8),
]


def modules(*choices: memories.Choice | Latches) -> str:
    """Return the SystemVerilog of memory.sv, of the chosen memories, and of the macros and gates
    that they are made of."""
    macros = set()
    for choice in choices:
        if isinstance(choice, memories.Choice):
            macros |= set(choice.macros)
    wrappers = netlist.memories_sv(choices).replace(latches.GATE, latches.MODEL)
    return (
        (runs.ROOT / "hw_model/rtl/memory.sv").read_text() + "".join(map(model, macros)) + wrappers
    )


def played(folder: Path, text: str) -> list[str]:
    """Play a bench, and return the words that it prints: first, in how many cycles the two memories
    differ."""
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
@pytest.mark.parametrize("cycles_late", [8, 9, 10, 11])
def test_banks_of_one_port_alternate_between_reads_and_writes_of_a_sweep(cycles_late, tmp_path):
    """A word is read, and written so many cycles later, while later words are read.

    An even and an odd number of cycles: writes fall in the banks that are read, or in the others.
    """
    shape = memories.Shape("states", words=64, bits=10, ports=2)
    choice = memories.Choice(
        shape,
        (macro(words=16, bits=8, ports=1), macro(words=16, bits=4, ports=1, mask=False)),
        banks=4,
        pack=1,
    )
    assert choice.waits
    assert played(tmp_path, modules(choice) + SWEEP.replace("LATE", str(cycles_late))) == [
        "0",
        "differ",
    ]


@NEEDS_ICARUS
@pytest.mark.parametrize("banks", [1, 4])
def test_marks_of_a_memory_of_one_port_wait_for_reads(banks, tmp_path):
    choice = memories.Choice(
        memories.Shape("bitmap", words=64, bits=10, ports=2),
        (macro(words=64 // banks, bits=8, ports=1), macro(words=64 // banks, bits=4, ports=1)),
        banks=banks,
        pack=1,
    )
    assert choice.waits
    text = modules(choice)
    assert played(tmp_path, text + MARKS) == ["0", "differ"]
    # Without the logic that makes a write wait for a read, the bench finds cycles that differ.
    for part, without in (
        ("if (wait_now || waiting) waiting <=", "if (0) waiting <="),
        ("&& !clash", ""),
    ):
        assert part in text
        differ, _ = played(tmp_path, text.replace(part, without) + MARKS)
        assert int(differ) > 0


@NEEDS_ICARUS
def test_words_that_repeat_are_not_read_again_and_come_out_the_same(tmp_path):
    # Bits `own` differ between compartments; the other six mostly repeat, and lie in halves for even and odd words.
    split = repeats.Split(memories.Shape("leaks", words=64, bits=10, ports=1), own=(1, 6, 7, 9))
    parts = (
        memories.Choice(
            memories.Shape("leaks_same", words=32, bits=6, ports=1, copies=2),
            (macro(words=16, bits=8, ports=1),),
            banks=2,
            pack=1,
        ),
        memories.Choice(
            memories.Shape("leaks_own", words=64, bits=4, ports=1),
            (macro(words=32, bits=8, ports=1),),
            banks=1,
            pack=2,
        ),
        Latches(memories.Shape("leaks_flags", words=2, bits=32, ports=2), depth=2),
    )
    text = modules(*parts) + repeats.verilog(split)
    differ, _, skipped, _ = played(tmp_path, text + CONSTANTS)
    assert differ == "0"
    assert int(skipped) > 1000  # reads that were saved
    # Without a condition of a saved read, words come out wrong.
    for part in (" && earlier == write_data", " && read_address == coming"):
        assert part in text
        assert int(played(tmp_path, text.replace(part, "") + CONSTANTS)[0]) > 0


PLANNED = [
    memories.Choice(
        memories.Shape("pairs", words=64, bits=9, ports=1),
        (macro(words=16, bits=16, ports=1), macro(words=16, bits=8, ports=1)),
        banks=2,
        pack=2,
    ),
    memories.Choice(
        memories.Shape("states", words=64, bits=10, ports=2),
        (macro(words=16, bits=8, ports=1), macro(words=16, bits=4, ports=1)),
        banks=4,
        pack=1,
    ),
    Latches(
        memories.Shape("charges", words=64, bits=10, ports=2, copies=2, used=13, period=32), depth=8
    ),
]


def test_the_plan_of_the_gate_level_core_is_checked(monkeypatch):
    files = runs.Library(Path("none"))
    monkeypatch.setattr(
        runs.Library,
        "macros",
        {macro.name: macro for choice in PLANNED[:2] for macro in choice.macros},
        raising=True,
    )
    pieces = plans.pieces_of(PLANNED)
    arrays, macros = plans.checked_by(files, PLANNED)
    check(pieces, arrays, macros)
    for number, piece in enumerate(pieces):
        without = pieces[:number] + pieces[number + 1 :]
        with pytest.raises(InputError, match=f"memory '{piece.memory}': the plan is too small"):
            check(without, arrays, macros)
        with pytest.raises(
            InputError, match=f"memory '{piece.memory}': macros of the plan overlap"
        ):
            check([*pieces, piece], arrays, macros)
    *others, last = pieces
    with pytest.raises(InputError) as caught:
        check([*others, replace(last, bits=last.bits - 1)], arrays, macros)
    assert str(caught.value) == (
        "memory 'charges': the plan is too small (0 hold bit 9 of word 21). Add macros."
    )


def families() -> tuple[hw.ChipProgram, np.ndarray]:
    """Return a program of five compartments with two dendrites each, and recordings.

    Parents are numbered after their dendrites, so their sums do not lie in the first words of the
    memory.
    """
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


def with_memories(core: runs.Core, accesses: dict[str, traffic.Memory]) -> dict[str, str]:
    """Return the SystemVerilog of a core by file, with its memories made of invented macros, or of
    latches."""
    library = runs.Library(Path("none"))
    chosen = [plans.options(library, memory, core)[-1] for memory in accesses.values()]
    texts = {
        path.name: netlist.with_memories(path.read_text()) for path in netlist.parts(netlist.CORE)
    }
    texts["locsnn_core.sv"] = traffic.set_in(texts["locsnn_core.sv"], core.saving)
    memory = modules(*chosen) + "".join(map(repeats.verilog, repeats.splits(core.sizes)))
    # A simulator would begin with unknown registers, which stay unknown. On a chip they begin with
    # some value, and are right once their memory has been cleaned.
    memory = re.sub(r"(logic waiting|streak|put);", r"\1 = 0;", memory)
    return {**sources(), **texts, "memory.sv": memory}


@pytest.mark.minutes
@NEEDS_ICARUS
def test_a_core_with_memories_of_a_plan_plays_like_the_simulator(monkeypatch):
    macros = [macro(words=words, bits=32, ports=ports) for words in (64, 1024) for ports in (1, 2)]
    by_name = {invented.name: invented for invented in macros}
    monkeypatch.setattr(runs.Library, "macros", by_name)
    program, recordings = families()
    mapped, core = runs.holding(program, recordings.shape[1])
    accesses = repeats.parts_of(runs.counted_for(program, recordings, core), mapped, core.sizes)
    texts = with_memories(core, accesses)
    comparison = compare(program, recordings, texts, "icarus", sizes=core.sizes)
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0)
    # A plan must not make just as many words for sums as there are parents: they do not lie in the
    # first words.
    parents = 5
    few = replace(core, held={**core.held, "sums": parents})
    texts = with_memories(few, accesses)
    comparison = compare(program, recordings, texts, "icarus", sizes=core.sizes)
    assert comparison["mismatches"] > 0
    too_small = plans.options(runs.Library(Path("none")), accesses["sums"], few)[-1]
    with pytest.raises(InputError) as caught:
        plans.refuse_too_few(too_small.shape, accesses["sums"])
    assert str(caught.value) == (
        "memory 'sums': the plan does not make a word that something is read from (word 10 of 5). "
        "Hold more words."
    )


# Benches. `core` is memory.sv and `made` a memory of a plan; both get the same writes and reads,
# and `differ` counts the cycles in which they show different words. This one writes every word,
# then reads and writes at random.
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
# Sweeps as of the memory of states: words are read in order, and each is written LATE cycles after
# it was read, or not at all.
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
# Marks as in the buffer of events: a word is read, and written two cycles later with one bit more.
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
# Sweeps as of the memories of constants, whose words mostly equal the word two before; some reads
# are out of order. `skipped` counts the reads that were saved.
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
    macros = [
        macro(words=16, bits=8, ports=1),
        macro(words=16, bits=16, ports=1),
        macro(words=64, bits=8, ports=1),
    ]
    words, bits = 40, 12
    choices = list(memories.choices(memories.Shape("x", words=words, bits=bits, ports=1), macros))
    assert choices
    for choice in choices:
        macro_bits = [macro.bits for macro in choice.macros]
        assert sum(macro_bits) >= bits * choice.pack > sum(macro_bits) - min(macro_bits)
        words_of_bank = choice.rows * choice.pack
        assert choice.banks * words_of_bank >= words > (choice.banks - 1) * words_of_bank
