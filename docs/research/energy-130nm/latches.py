"""Small memories as arrays of latches: their SystemVerilog, which yosys maps to the library's cells.

For a few words, latches take less energy than the smallest macro of the process. A word is a row of latches behind a clock gate
of its own; rows lie in banks. Data and address reach only the bank that is used, and a word is read by one select line through
ANDs and ORs, so that nothing else changes.

    cycle 0   address and data arrive; the gates of array, bank and row take their enables
    cycle 1   data wait in a register while the row is open, in the first half of the cycle: it can be read from now on

What is read comes in the next cycle, or at once: an array needs no clock for it.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from memories import Shape

from hw_model.rtl.memory_plan import Array, Piece

GATE = """module latch_gate (input logic clk, input logic enable, output logic gated);
    sg13g2_lgcp_1 cell_ (.CLK(clk), .GATE(enable), .GCLK(gated));
endmodule
"""
MODEL = """module latch_gate (input logic clk, input logic enable, output logic gated);
    logic open;
    always_latch if (!clk) open = enable;
    assign gated = clk && open;
endmodule
"""
"""The gate as the library has it, and how it behaves."""


HIGH = 2
"""Bits of an address that choose a bank within a group."""
GROUP = 1 << HIGH
"""Banks of a group. A memory with more banks has groups of them, so that a write toggles the wires of one group only."""


@dataclass(frozen=True)
class Latches:
    """A memory of latches: banks of ``depth`` rows, one word in each. More than four banks lie in groups of four."""

    shape: Shape
    depth: int

    @property
    def banks(self) -> list[int]:
        """Return the banks that hold words, by the upper bits of their addresses."""
        return sorted({word // self.depth for word in self.shape.held})

    @property
    def groups(self) -> dict[int, list[int]]:
        """Return the banks of every group, numbered within it; empty if the banks are not in groups."""
        if len(self.banks) <= GROUP:
            return {}
        banks_of_group: dict[int, list[int]] = {}
        for number in self.banks:
            banks_of_group.setdefault(number // GROUP, []).append(number % GROUP)
        return banks_of_group

    @property
    def rows(self) -> int:
        """Rows of a bank; a memory of fewer words has fewer."""
        return min(self.depth, self.shape.words)

    @property
    def low(self) -> int:
        """Bits of an address within a bank; at least one, as SystemVerilog has no vector of width 0."""
        return max((self.rows - 1).bit_length(), 1)

    @property
    def module(self) -> str:
        """Return the name of the module of a bank."""
        return f"latches_{self.rows}x{self.shape.bits}"

    @property
    def text(self) -> str:
        """Describe the array in the notation of plans: copies x (rows x bits)."""
        return f"{self.shape.copies * len(self.banks)} x ({self.rows}x{self.shape.bits} latches)"


def array_of(array: Latches) -> Array:
    """Return the memory as the check of plans takes it: the words that are made, one after the other."""
    return Array(array.shape.name, len(array.shape.held), array.shape.bits, 2, {1: 0.0})


def pieces_of(array: Latches) -> Iterator[Piece]:
    """Yield the banks of one copy as the check of plans takes them: each a macro of the rows that hold a word."""
    words_of_bank = Counter(word // array.depth for word in array.shape.held)
    first_word, bits = 0, array.shape.bits
    for number in array.banks:
        yield Piece(
            memory=array.shape.name,
            copies=array.shape.copies,
            macro=array.module,
            first=first_word,
            every=1,
            rows=words_of_bank[number],
            pack=1,
            bit=0,
            bits=bits,
        )
        first_word += words_of_bank[number]


def modules(array: Latches) -> dict[str, str]:
    """Return the text of the modules that the memory is made of, by name: a bank, and groups of banks, with the same ports."""
    text_of_module = {array.module: bank(array.rows, array.shape.bits)}
    for banks in array.groups.values():
        name = _group(array, banks)
        parts = {number: array.module for number in banks}
        lines = [
            _head(name, array.low + HIGH, array.shape.bits),
            *_parts(parts, array, array.low, HIGH),
        ]
        text_of_module[name] = "\n".join([*lines, "endmodule\n"])
    return text_of_module


def _group(array: Latches, banks: list[int]) -> str:
    """Return the name of the module of a group with these banks."""
    return f"{array.module}_of_{''.join(map(str, banks))}"


def _head(name: str, address: int, bits: int) -> str:
    """Return the ports of a bank or a group, and the signals that reach into it: they stay 0 while it is not used."""
    return (
        f"module {name} (input logic clk, write, open, read, input logic [{address - 1}:0] write_row, read_row,\n"
        f"    input logic [{bits - 1}:0] data, output logic [{bits - 1}:0] found);\n"
        "    wire writing;\n"
        "    latch_gate gate (.clk, .enable(write), .gated(writing));\n"
        f"    wire [{address - 1}:0] to = write_row & {{{address}{{write}}}}, from = read_row & {{{address}{{read}}}};\n"
        f"    wire [{bits - 1}:0] given = data & {{{bits}{{open}}}};"
    )


def _parts(parts: dict[int, str], array: Latches, low: int, high: int) -> list[str]:
    """Return instances of modules by the ``high`` bits of an address above its ``low`` ones."""
    bits = array.shape.bits
    lines = [f"    logic [{max(high, 1) - 1}:0] opened;"]
    if high:
        lines.append(f"    always_ff @(posedge writing) opened <= to[{low + high - 1}:{low}];")
    for number, module in parts.items():
        names = ("opened", f"to[{low + high - 1}:{low}]", f"from[{low + high - 1}:{low}]")
        opened, write, read = (f"{name} == {high}'d{number}" if high else "1'b1" for name in names)
        lines += [
            f"    wire [{bits - 1}:0] found{number};",
            f"    {module} part{number} (.clk(writing), .write(write && {write}), .open({opened}), .read(read && {read}),",
            f"        .write_row(to[{low - 1}:0]), .read_row(from[{low - 1}:0]), .data(given), .found(found{number}));",
        ]
    return [*lines, "    assign found = " + " | ".join(f"found{number}" for number in parts) + ";"]


def bank(rows: int, bits: int) -> str:
    """Return the module of a bank."""
    low = max((rows - 1).bit_length(), 1)
    lines = [_head(f"latches_{rows}x{bits}", low, bits)]
    for row in range(rows):
        lines += [
            f"    wire gated{row}; logic [{bits - 1}:0] word{row};",
            f"    latch_gate gate{row} (.clk(writing), .enable(write && to == {row}), .gated(gated{row}));",
            f"    always_latch if (gated{row}) word{row} = given;",
        ]
    terms = [f"({{{bits}{{read && from == {row}}}}} & word{row})" for row in range(rows)]
    return "\n".join(
        [*lines, "    assign found = " + "\n        | ".join(terms) + ";", "endmodule\n"]
    )


def verilog(array: Latches) -> str:
    """Return module ``memory_<name>``: the ports of module ``memory`` of the core, with banks, or groups of banks, behind them."""
    shape, groups = array.shape, array.groups
    modules_of_groups = {number: _group(array, banks) for number, banks in groups.items()}
    low = array.low + HIGH if groups else array.low
    lines = [
        shape.ports_text,
        "    wire writing;",
        "    latch_gate gate (.clk, .enable(write), .gated(writing));",
        f"    logic [{shape.bits - 1}:0] given;",
        f"    wire [{shape.bits - 1}:0] found;",
        f"    wire [{shape.address - 1}:0] to = write_address[{shape.address - 1}:0], from = read_address[{shape.address - 1}:0];",
        "    always_ff @(posedge writing) given <= write_data;",
        *_parts(
            modules_of_groups or dict.fromkeys(array.banks, array.module),
            array,
            low,
            max(shape.address - low, 0),
        ),
        "    assign read_data = found;"
        if shape.at_once
        else "    always_ff @(posedge clk) if (read) read_data <= found;",
        "endmodule\n",
    ]
    return "\n".join(lines)
