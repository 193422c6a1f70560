"""Memories of constants that compartments share: a word that equals the last but one is not read again.

Many compartments have equal constants, and those of a neuron alternate. Words are read in order; even and odd words lie in
memories of their own, which keep showing what was read last. So a word that equals the word two before needs no read. A latch
for each word, its *flag*, says whether it repeats; the first two of 32 words are always read, so that groups of 32 words may be
written in any order.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from memories import Shape
from traffic import Memory

from hw_model.rtl.images import CoreProgram, Sizes, layouts
from hw_model.rtl.memory_needs import NOT_SHARED as OWN_FIELDS
from hw_model.rtl.memory_needs import WORDS_PER_FLAGS, own_bits, reads_without_repeats

SAME, OWN, FLAGS = "_same", "_own", "_flags"
PLACE = (WORDS_PER_FLAGS - 1).bit_length()
"""Bits of an address that choose a flag in a word of flags."""


@dataclass(frozen=True)
class Split:
    """A memory in two parts: the bits in ``own``, which differ between compartments and are always read, and all others."""

    shape: Shape
    own: tuple[int, ...]

    @property
    def parts(self) -> dict[str, list[int]]:
        """Return the bits of each part by its name."""
        same = [bit for bit in range(self.shape.bits) if bit not in self.own]
        return {self.shape.name + SAME: same} | (
            {self.shape.name + OWN: [*self.own]} if self.own else {}
        )


def splits(sizes: Sizes) -> list[Split]:
    """Return the memories that are split."""
    return [
        Split(
            Shape(name, sizes.compartments, layouts(sizes)[name].width, 1),
            tuple(own_bits(name, sizes)),
        )
        for name in OWN_FIELDS
    ]


def parts_of(traffic: Mapping[str, Memory], core: CoreProgram, sizes: Sizes) -> dict[str, Memory]:
    """Return the memories of the core, those of constants in parts, with the accesses of a recording to each."""
    memories = dict(traffic)
    for split in splits(sizes):
        memory = memories.pop(split.shape.name)
        for name, bits in split.parts.items():
            part_memory = replace(memory, name=name, bits=len(bits))
            if name.endswith(SAME):
                reads = sum(
                    reads_without_repeats(core, sizes, split.shape.name, phase)
                    for phase in range(len(core.phases))
                )
                part_memory = replace(
                    part_memory,
                    words=memory.words // 2,
                    copies=2,
                    reads=reads,
                    rows=dict.fromkeys(memory.rows, reads),
                    single=False,
                    seen=tuple(-(-word // 2) for word in memory.seen),
                )
            memories[name] = part_memory
        # A word of flags is read for each half. Its writes are next to nothing, but not 0: it needs a port of its own for them.
        flags, flag_reads = split.shape.name + FLAGS, memory.reads * 2 / WORDS_PER_FLAGS
        words = memory.words // WORDS_PER_FLAGS
        memories[flags] = Memory(
            flags,
            words,
            WORDS_PER_FLAGS,
            copies=1,
            reads=flag_reads,
            writes=1e-9,
            rows=dict.fromkeys(memory.rows, flag_reads),
            single=False,
        )
    return memories


def verilog(split: Split) -> str:
    """Return module ``memory_<name>``, made of the modules of its parts, and module ``repeats_<name>`` with the flags."""
    shape, top = split.shape, split.shape.address - 1
    lines, from_part = [shape.ports_text], {}
    for name, bits in split.parts.items():
        last = len(bits) - 1
        data = f".write_data({{{', '.join(f'write_data[{bit}]' for bit in reversed(bits))}}})"
        from_part |= {bit: f"of_{name}[{at}]" for at, bit in enumerate(bits)}
        lines.append(f"    wire [{last}:0] of_{name};")
        if name.endswith(SAME):
            lines += [
                "    wire again;",
                "    logic odd;",
                f"    wire [{last}:0] shown0, shown1;",
                "    always_ff @(posedge clk) if (read) odd <= read_address[0];",
                f"    repeats_{shape.name} repeats (.clk, .write, .read, .write_address, .read_address, {data}, .again);",
                f"    assign of_{name} = odd ? shown1 : shown0;",
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
                f"    memory_{name} {name} (.clk, .write, .read, {address}, {data}, .read_data(of_{name}));"
            )
    shown = ", ".join(from_part[bit] for bit in reversed(range(shape.bits)))
    lines.append(f"    assign read_data = {{{shown}}};")
    return "\n".join([*lines, "endmodule", ""]) + REPEATS.format(
        name=shape.name, flags=shape.name + FLAGS, top=top, last=shape.bits - len(split.own) - 1,
        word=WORDS_PER_FLAGS - 1, low=PLACE - 1, bits=PLACE,
    )  # fmt: skip


# Writing: a word equals the last but one if both belong to the same run of addresses; the flags of 32 words are collected and
# written as one word. Reading: a repeat is skipped only after two reads in a row at following addresses (`streak`), because only
# then the memories show the words of the two addresses before.
REPEATS = """\
module repeats_{name} (input logic clk, write, read, input logic [{top}:0] write_address, read_address,
    input logic [{last}:0] write_data, output logic again);
    logic [{last}:0] previous, earlier;
    logic [{top}:0] following, row, coming;
    logic [{word}:0] flags;
    logic [1:0] streak;
    logic put, second;
    wire in_order = write_address == following && write_address[{low}:0] != 0;
    wire equal = in_order && second && earlier == write_data;
    always_ff @(posedge clk) begin
        put <= write;
        if (write) begin
            {{earlier, previous, following, row}} <= {{previous, write_data, write_address + 1'b1, write_address}};
            second <= in_order;
            flags <= (in_order ? flags : 0) | ({{{word}'b0, equal}} << write_address[{low}:0]);
        end
        if (write) streak <= 0; else if (read) streak <= read_address != coming ? 1 : streak == 0 ? 1 : 2;
        if (read) coming <= read_address + 1'b1;
    end
    wire sequel = streak == 2 && read_address == coming && read_address[{low}:1] != 0;
    wire [{word}:0] same;
    memory_{flags} {flags} (.clk, .write(put), .write_address(row[{top}:{bits}]), .write_data(flags),
        .read(read && !sequel), .read_address(read_address[{top}:{bits}]), .read_data(same));
    assign again = read && sequel && same[read_address[{low}:0]];
endmodule
"""
