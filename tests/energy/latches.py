"""Small memories as arrays of latches: their SystemVerilog, which yosys maps to the library's cells.

A word is a row of latches behind a gate of its own; rows lie in banks. Data and address reach only the bank that is used,
and a word is read by one select line through ANDs and ORs, so that nothing else changes.

    cycle 0   address and data arrive; the gates of array, bank and row take their enables
    cycle 1   data wait in a register while the row is open, in the first half of the cycle: it can be read from now on
"""

from dataclasses import dataclass

from memories import Shape

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


@dataclass(frozen=True)
class Latches:
    """A memory of latches: banks of ``depth`` rows, one word in each."""

    shape: Shape
    depth: int

    @property
    def banks(self) -> list[int]:
        """Return the banks that hold words, by the upper bits of their addresses."""
        return sorted({word // self.depth for word in self.shape.held})

    @property
    def rows(self) -> int:
        """Rows of a bank; a memory of fewer words has fewer."""
        return min(self.depth, self.shape.fold or self.shape.words)

    @property
    def module(self) -> str:
        """Return the name of the module of a bank."""
        return f"latches_{self.rows}x{self.shape.bits}"

    @property
    def text(self) -> str:
        """Say what it is."""
        return f"{self.shape.copies * len(self.banks)} x ({self.rows}x{self.shape.bits} latches)"


def bank(rows: int, bits: int) -> str:
    """Return the module of a bank."""
    low = max((rows - 1).bit_length(), 1)
    lines = [
        f"module latches_{rows}x{bits} (input logic clk, write, open, read, input logic [{low - 1}:0] write_row, read_row,",
        f"    input logic [{bits - 1}:0] data, output logic [{bits - 1}:0] found);",
        "    wire writing;",
        "    latch_gate gate (.clk, .enable(write), .gated(writing));",
        f"    wire [{low - 1}:0] to = write_row & {{{low}{{write}}}}, from = read_row & {{{low}{{read}}}};",
        f"    wire [{bits - 1}:0] given = data & {{{bits}{{open}}}};",
    ]
    for row in range(rows):
        lines += [
            f"    wire gated{row}; logic [{bits - 1}:0] word{row};",
            f"    latch_gate gate{row} (.clk(writing), .enable(write && to == {row}), .gated(gated{row}));",
            f"    always_latch if (gated{row}) word{row} = given;",
        ]
    terms = [f"({{{bits}{{read && from == {row}}}}} & word{row})" for row in range(rows)]
    return "\n".join([*lines, "    assign found = " + "\n        | ".join(terms) + ";", "endmodule\n"])


def verilog(made: Latches) -> str:
    """Return module ``memory_<name>``: the ports of ``memory``, banks of latches behind them."""
    shape = made.shape
    address, low = shape.address, max((made.rows - 1).bit_length(), 1)
    high = address - low
    lines = [
        shape.ports_text,
        "    wire writing;",
        "    latch_gate gate (.clk, .enable(write), .gated(writing));",
        f"    logic [{shape.bits - 1}:0] data;",
        f"    logic [{max(high, 1) - 1}:0] opened;",
        "    always_ff @(posedge writing) begin",
        "        data <= write_data;",
    ]
    hits = {}
    lines += [f"        opened <= write_address[{address - 1}:{low}];"] if high else []
    lines.append("    end")
    for k, number in enumerate(made.banks):
        hits[k] = [
            f"{name}_address[{address - 1}:{low}] == {high}'d{number}" if high else "1'b1" for name in ("write", "read")
        ]
    for k in hits:
        write, read = hits[k]
        opened = f"opened == {high}'d{made.banks[k]}" if high else "1'b1"
        lines += [
            f"    wire [{shape.bits - 1}:0] found{k};",
            f"    {made.module} bank{k} (.clk(writing), .write(write && {write}), .open({opened}), .read(read && {read}),",
            f"        .write_row(write_address[{low - 1}:0]), .read_row(read_address[{low - 1}:0]), .data, .found(found{k}));",
        ]
    found = " | ".join(f"found{k}" for k in hits)
    lines += [f"    always_ff @(posedge clk) if (read) read_data <= {found};", "endmodule\n"]
    return "\n".join(lines)
