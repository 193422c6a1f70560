"""Memories of constants that compartments share: a word that equals the last but one is not read again.

Words are swept in order, even and odd ones lie in memories of their own, and these keep showing what was read last. A
latch for each word says whether it repeats the last but one; of sixteen words the first two are always read, so that words
may be written in any order.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from memories import Shape
from traffic import Memory

from hw_model.rtl.images import CoreProgram, Sizes, layouts
from hw_model.rtl.memory_needs import SHARED, repeats

SAME, OWN, FLAGS = "_same", "_own", "_flags"


@dataclass(frozen=True)
class Split:
    """A memory in parts: the first ``shared`` bits repeat, the others are read as they are."""

    shape: Shape
    shared: int

    @property
    def parts(self) -> list[tuple[str, int, int]]:
        """Return name, first bit and end of each part."""
        name, bits = self.shape.name, self.shape.bits
        return [(name + SAME, 0, self.shared), *([(name + OWN, self.shared, bits)] if self.shared < bits else [])]


def splits(sizes: Sizes) -> list[Split]:
    """Return the memories that are split."""
    found = []
    for name, count in SHARED.items():
        layout = layouts(sizes)[name]
        shared = sum(field.width for field in layout.fields[:count])
        found.append(Split(Shape(name, sizes.compartments, layout.width, 1), shared))
    return found


def parts_of(traffic: Mapping[str, Memory], core: CoreProgram, sizes: Sizes) -> dict[str, Memory]:
    """Return the memories of the core after splitting, with what a recording does to each."""
    found = dict(traffic)
    for split in splits(sizes):
        memory = found.pop(split.shape.name)
        for name, low, high in split.parts:
            part = replace(memory, name=name, bits=high - low)
            if name.endswith(SAME):
                reads = sum(repeats(core, sizes, split.shape.name, phase) for phase in range(len(core.phases)))
                part = replace(
                    part,
                    words=memory.words // 2,
                    copies=2,
                    reads=reads,
                    rows=dict.fromkeys(memory.rows, reads),
                    single=False,
                )
            found[name] = part
        flags, many = split.shape.name + FLAGS, memory.reads / 8
        found[flags] = Memory(flags, memory.words // 16, 16, 1, many, 1e-9, dict.fromkeys(memory.rows, many), False)
    return found


def verilog(split: Split) -> str:
    """Return module ``memory_<name>``, made of modules of its parts, and what tells which words repeat."""
    shape, top = split.shape, split.shape.address - 1
    lines = [shape.ports_text]
    for name, low, high in split.parts:
        data = f".write_data(write_data[{high - 1}:{low}])"
        if name.endswith(SAME):
            lines += [
                "    wire again;",
                "    logic odd;",
                f"    wire [{high - 1}:0] shown0, shown1;",
                "    always_ff @(posedge clk) if (read) odd <= read_address[0];",
                f"    repeats_{shape.name} repeats (.clk, .write, .read, .write_address, .read_address, {data}, .again);",
                f"    assign read_data[{high - 1}:{low}] = odd ? shown1 : shown0;",
            ]
            lines += [
                f"    memory_{name} {name}{half} (.clk, .write(write && write_address[0] == 1'd{half}), {data},\n"
                f"        .read(read && !again && read_address[0] == 1'd{half}), .write_address(write_address[{top}:1]),\n"
                f"        .read_address(read_address[{top}:1]), .read_data(shown{half}));"
                for half in (0, 1)
            ]
        else:
            address = ".address" if shape.single else ".write_address, .read_address"
            lines.append(
                f"    memory_{name} {name} (.clk, .write, .read, {address}, {data}, .read_data(read_data[{high - 1}:{low}]));"
            )
    return "\n".join([*lines, "endmodule", ""]) + REPEATS.format(
        name=shape.name, flags=shape.name + FLAGS, top=top, bits=split.shared, last=split.shared - 1
    )


REPEATS = """\
module repeats_{name} (input logic clk, write, read, input logic [{top}:0] write_address, read_address,
    input logic [{last}:0] write_data, output logic again);
    logic [{last}:0] previous, earlier;
    logic [{top}:0] following, row, coming;
    logic [15:0] flags;
    logic [1:0] streak;
    logic put, second;
    wire in_order = write_address == following && write_address[3:0] != 0;
    wire equal = in_order && second && earlier == write_data;
    always_ff @(posedge clk) begin
        put <= write;
        if (write) begin
            {{earlier, previous, following, row}} <= {{previous, write_data, write_address + 1'b1, write_address}};
            second <= in_order;
            flags <= (in_order ? flags : 16'b0) | ({{15'b0, equal}} << write_address[3:0]);
        end
        if (write) streak <= 0; else if (read) streak <= read_address != coming ? 1 : streak == 0 ? 1 : 2;
        if (read) coming <= read_address + 1'b1;
    end
    wire sequel = streak == 2 && read_address == coming && read_address[3:1] != 0;
    wire [15:0] same;
    memory_{flags} {flags} (.clk, .write(put), .write_address(row[{top}:4]), .write_data(flags),
        .read(read && !sequel), .read_address(read_address[{top}:4]), .read_data(same));
    assign again = read && sequel && same[read_address[3:0]];
endmodule
"""
