"""The core's memories and the accesses of a recording to each, counted in a simulation of its SystemVerilog with Verilator.

``memory.sv`` is replaced by a version that counts and prints its counts in the end; the search for a plan of memories
(:mod:`plans`) multiplies them with energies of macros.
"""

import json
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hw_model as hw
from hw_model.rtl.cosimulation import words_of
from hw_model.rtl.images import CoreProgram, Sizes
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.simulators import built, command_of, run_tool, sources

PACKS = (2, 4, 8)
"""Words of a memory that a plan may pack into a row."""
# rows2, rows4 and rows8 count reads that leave the row of the read before, for each of PACKS. The last $write lists the addresses
# of words that are read with something in them, as spans: the first address of each and the one after it, in turn.
COUNTING = """
module single_port #(parameter integer WIDTH = 8, parameter integer DEPTH = 16) (
    input logic clk, write, read, input logic [$clog2(DEPTH)-1:0] address,
    input logic [WIDTH-1:0] write_data, output logic [WIDTH-1:0] read_data);
    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH), .SINGLE(1)) only (
        .clk, .write, .read(read && !write), .write_address(address), .read_address(address), .write_data, .read_data);
endmodule
module memory_at_once #(parameter integer WIDTH = 8, parameter integer DEPTH = 16) (
    input logic clk, write, read, input logic [$clog2(DEPTH)-1:0] write_address, read_address,
    input logic [WIDTH-1:0] write_data, output logic [WIDTH-1:0] read_data);
    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH), .AT_ONCE(1)) only (
        .clk, .write, .read, .write_address, .read_address, .write_data, .read_data());
    assign read_data = only.words[read_address];
endmodule
module memory #(parameter integer WIDTH = 8, parameter integer DEPTH = 16, parameter integer SINGLE = 0, AT_ONCE = 0) (
    input logic clk, write, read, input logic [$clog2(DEPTH)-1:0] write_address, read_address,
    input logic [WIDTH-1:0] write_data, output logic [WIDTH-1:0] read_data);
    logic [WIDTH-1:0] words[0:DEPTH-1];
    bit seen[0:DEPTH-1];
    longint reads = 0, writes = 0, loads = 0, rows2 = 0, rows4 = 0, rows8 = 0, last = -1;
    always_ff @(posedge clk) begin
        if (write) begin
            words[write_address] <= write_data;
            if (reads == 0) loads <= loads + 1; else writes <= writes + 1;
        end
        if (read) begin
            read_data <= words[read_address];
            if (words[read_address] != 0) seen[read_address] <= 1;
            reads <= reads + 1;
            if (last < 0 || last / 2 != longint'(read_address) / 2) rows2 <= rows2 + 1;
            if (last < 0 || last / 4 != longint'(read_address) / 4) rows4 <= rows4 + 1;
            if (last < 0 || last / 8 != longint'(read_address) / 8) rows8 <= rows8 + 1;
            last <= longint'(read_address);
        end
    end
    final begin
        $write("memory {\\"name\\": \\"%m\\", \\"bits\\": %0d, \\"words\\": %0d, \\"reads\\": %0d, \\"writes\\": %0d, \\"rows2\\": %0d, \\"rows4\\": %0d, \\"rows8\\": %0d, \\"single\\": %0d, \\"at_once\\": %0d, \\"seen\\": [",
               WIDTH, DEPTH, reads, writes, rows2, rows4, rows8, SINGLE, AT_ONCE);
        for (int i = 0; i <= DEPTH; i++) if ((i < DEPTH && seen[i]) != (i > 0 && seen[i-1])) $write("%0d, ", i);
        $display("-1]}");
    end
endmodule
"""
"""``memory.sv`` that counts. What is written before the first read is loaded or cleaned, and not counted."""


@dataclass(frozen=True)
class Memory:
    """A memory of the core, and its accesses per recording, of all copies together.

    ``rows[k]``: reads of another row of ``k`` words than the read before. ``ports``: 1 if it is written only while a program is
    loaded. ``single``: it has one address for reads and writes. ``at_once``: it answers in the cycle in which it is read.
    ``seen``: spans of addresses at which something other than 0 was read: the first of each and the one after it, in turn.
    """

    name: str
    words: int
    bits: int
    copies: int
    reads: float
    writes: float
    rows: dict[int, float]
    single: bool
    at_once: bool = False
    seen: tuple[int, ...] = ()

    @property
    def ports(self) -> int:
        """The number of ports that it needs."""
        return 2 if self.writes else 1


def set_in(text: str, parameters: Mapping[str, int]) -> str:
    """Return the text of a module with other default values of parameters."""
    for name, value in parameters.items():
        text, found = re.subn(rf"(parameter integer {name.upper()} = )\d+", rf"\g<1>{value}", text)
        assert found == 1, name
    return text


def count(
    program: hw.ChipProgram, recordings: np.ndarray, sizes: Sizes, saving: Mapping[str, int]
) -> list[Memory]:
    """Return the memories of a core of these sizes, with mean accesses over recordings (batch, steps, channels).

    ``saving``: further parameters of the core.
    """
    core, texts = CoreProgram(program, recordings.shape[1], sizes=sizes), sources()
    changed = {"locsnn_core.sv": set_in(texts["locsnn_core.sv"], saving), "single_port.sv": "", "memory_at_once.sv": "",
               "memory.sv": COUNTING}  # fmt: skip
    binary = built("verilator", sizes, {**texts, **changed})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "load").write_bytes(hex_words(core.load_words(sizes)))
        (folder / "words").write_text(
            "".join(f"{word:x}\n" for counts in recordings for word in words_of(core, counts))
        )
        text = run_tool(command_of(binary), folder, "the open core")
    copies_of_memory: dict[str, list[dict]] = {}
    for line in text.splitlines():
        if line.startswith("memory "):
            counts = json.loads(line[7:])
            name = counts["name"].removesuffix(".only").split(".")[-1]
            copies_of_memory.setdefault(name, []).append(counts)
    recording_count = len(recordings)
    return [
        Memory(
            name, copies[0]["words"], copies[0]["bits"], len(copies), sum(c["reads"] for c in copies) / recording_count,
            sum(c["writes"] for c in copies) / recording_count, {k: sum(c[f"rows{k}"] for c in copies) / recording_count for k in PACKS},
            bool(copies[0]["single"]), bool(copies[0]["at_once"]), tuple(at for c in copies for at in c["seen"][:-1]),
        )
        for name, copies in sorted(copies_of_memory.items())
    ]  # fmt: skip
