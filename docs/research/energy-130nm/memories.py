"""Memories of the core as macros: what each may be made of, what that costs, and its SystemVerilog.

The core asks for memories of any width and depth; the process has a few sizes of macros. A memory is made of *banks*, each a
row of macros side by side whose bits hold one word of the memory, or several packed into one. :mod:`plans` chooses.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from liberty import Macro

from hw_model.rtl.memory_plan import Array, Made, Piece, ways

HALVES = {"states": 2, "bitmap": 1}
"""Memories that are read and written in the same cycle, for which macros of one port are enough, since a write may wait for a
read; and into how many groups their banks are divided (states: even and odd words).

States are read and some cycles later written in order: while an even word is read an odd one is written. Words of the
bitmap are read in every other cycle at most while some are written.
"""


@dataclass(frozen=True)
class Shape:
    """A memory as the core sees it.

    ``ports``: 1 if it is written only between recordings, else 2. ``copies``: how many of it the core has.
    ``used``, ``period``: of every ``period`` words, the first ``used`` hold something; the others are not made. 0: all.
    ``zero``: bits that are 0 in every program that fits.
    ``single``: it has one address, to read or to write. ``at_once``: it shows a word in the cycle in which it is read.
    """

    name: str
    words: int
    bits: int
    ports: int
    copies: int = 1
    used: int = 0
    period: int = 0
    zero: tuple[int, ...] = ()
    single: bool = False
    at_once: bool = False

    @property
    def stored(self) -> list[int]:
        """Bits of a word that are kept."""
        return [bit for bit in range(self.bits) if bit not in self.zero]

    @property
    def address(self) -> int:
        """Bits of an address that tell words apart."""
        return max((self.words - 1).bit_length(), 1)

    @property
    def ports_text(self) -> str:
        """Return the head of its module in SystemVerilog."""
        last = max((self.words - 1).bit_length(), 1) - 1
        names = "address" if self.single else "write_address, read_address"
        both = (
            f"\n    wire [{last}:0] write_address = address, read_address = address;"
            if self.single
            else ""
        )
        return (
            f"module memory_{self.name} (input logic clk, write, read,\n"
            f"    input logic [{last}:0] {names}, input logic [{self.bits - 1}:0] write_data,\n"
            f"    output logic [{self.bits - 1}:0] read_data);{both}"
        )

    @property
    def held(self) -> list[int]:
        """Addresses of the words that are made."""
        period = self.period or self.words
        return [word for word in range(self.words) if word % period < (self.used or period)]


@dataclass(frozen=True)
class Choice:
    """A memory made of macros: ``banks`` rows of ``macros`` side by side; ``pack`` words of the memory lie in a word of the row."""

    shape: Shape
    macros: tuple[Macro, ...]
    banks: int
    pack: int

    @property
    def waits(self) -> bool:
        """Whether macros of one port serve reads and writes, see :data:`HALVES`."""
        return self.shape.ports == 2 and self.macros[0].ports == 1

    @property
    def rows(self) -> int:
        """Rows of a bank."""
        return self.macros[0].words

    @property
    def area(self) -> float:
        """Square micrometres."""
        return self.shape.copies * self.banks * sum(m.area for m in self.macros)

    @property
    def leakage_nw(self) -> float:
        """Nanowatts, as the files give them."""
        return self.shape.copies * self.banks * sum(m.leakage_nw for m in self.macros)

    @property
    def read_pj(self) -> float:
        """Picojoules of reading a row."""
        return sum(m.read_pj for m in self.macros)

    @property
    def write_pj(self) -> float:
        """Picojoules of writing a word."""
        return sum(m.write_pj for m in self.macros)

    @property
    def text(self) -> str:
        """Describe the choice in the notation of plans: banks of all copies x (the macros of a row)."""
        row = " + ".join(f"{m.ports}P {m.words}x{m.bits}" for m in self.macros)
        return f"{self.shape.copies * self.banks} x ({row})" + (
            f", {self.pack} words a row" if self.pack > 1 else ""
        )


def array_of(shape: Shape) -> Array:
    """Return a memory as the search and the check of plans know it."""
    bank_groups = HALVES.get(shape.name, 0)
    return Array(
        shape.name,
        max(shape.held) + 1,
        len(shape.stored),
        shape.ports,
        {1: 0.0},
        halves=bank_groups,
    )


def pieces_of(choice: Choice) -> Iterator[Piece]:
    """Yield the macros of one copy, as the check of plans takes them."""
    names, parts = (
        tuple(macro.name for macro in choice.macros),
        HALVES[choice.shape.name] if choice.waits else 1,
    )
    yield from Made(
        array_of(choice.shape), names, choice.macros, choice.banks, choice.pack, parts
    ).pieces()


def choices(shape: Shape, macros: Sequence[Macro]) -> Iterator[Choice]:
    """Yield what a memory may be made of."""
    array = array_of(shape)
    ports = {shape.ports, 1} if array.halves else {shape.ports}
    for way in ways(array, {macro.name: macro for macro in macros if macro.ports in ports}):
        yield Choice(shape, way.macros, way.banks, way.pack)


def verilog(choice: Choice) -> str:
    """Return module ``memory_<name>``: the ports of ``memory``, banks of macros behind them.

    With several words a row, the row that was read last is not read again: the macros still show it. Masks, which reach
    every macro, stand still while nothing is written.
    """
    if choice.waits:
        return _waiting(choice)
    shape, pack = choice.shape, choice.pack
    stored = shape.stored
    bits = len(stored)
    address = shape.address
    # An address is, from its high end: the bank, the row in it (`low` bits) and the word in the row (`packed` bits).
    packed, low = (pack - 1).bit_length(), (choice.rows - 1).bit_length()
    low = min(low, address - packed)
    bank_bits = address - packed - low
    row_bits = sum(m.bits for m in choice.macros)
    lines = [shape.ports_text]
    row = address - packed
    if shape.ports == 1:
        lines += [
            f"    wire [{address - 1}:0] at = write ? write_address[{address - 1}:0] : read_address[{address - 1}:0];"
        ]
    else:
        lines += [f"    wire [{address - 1}:0] at = read_address[{address - 1}:0];"]
    lines += [f"    wire [{row - 1}:0] line = at[{address - 1}:{packed}];"]
    last = f"    logic [{row - 1}:0] last;"
    if pack > 1:
        lines += [
            last,
            f"    logic kept; logic [{packed - 1}:0] place;",
            "    wire again = kept && line == last;",
            "    wire access = read && !write && !again;",
            "    always_ff @(posedge clk) begin",
            "        if (write) kept <= 0; else if (access) kept <= 1;",
            "        if (access) last <= line;",
            f"        if (read) place <= at[{packed - 1}:0];",
            "    end",
        ]
    elif bank_bits:
        lines += [
            last,
            "    wire access = read;",
            "    always_ff @(posedge clk) if (access) last <= line;",
        ]
    else:
        lines += ["    wire access = read;"]
    # Each macro gets the bits at:at+macro.bits of the row. Bits beyond the packed words stay 0.
    lines += [f"    wire [{row_bits - 1}:0] shown[0:{choice.banks - 1}];"]
    mask = "" if pack == 1 else f"at[{packed - 1}:0]"
    for bank in range(choice.banks):
        hit = f"line[{row - 1}:{low}] == {bank_bits}'d{bank}" if bank_bits else "1'b1"
        written = (
            f"write_address[{address - 1}:{low}] == {bank_bits}'d{bank}"
            if bank_bits and pack == 1
            else hit
        )
        at = 0
        for index, macro in enumerate(choice.macros):
            depth = (macro.words - 1).bit_length()
            need = min(depth, low)
            pad = f"{{{{{depth - need}{{1'b0}}}}, " if depth > need else "{"
            data, bm = [], []
            for bit in range(at, at + macro.bits):
                word, inside = divmod(bit, bits)
                data.append(f"write_data[{stored[inside]}]" if word < pack else "1'b0")
                bm.append(
                    "1'b0"
                    if word >= pack
                    else f"write && {mask} == {packed}'d{word}"
                    if pack > 1
                    else "1'b1"
                )
            din, bms = ", ".join(reversed(data)), ", ".join(reversed(bm))
            shown = f"shown[{bank}][{at + macro.bits - 1}:{at}]"
            name = f"bank{bank}_{index}"
            masked = "_bm_" in macro.name
            if shape.ports == 1:
                lines += [
                    f"    {macro.name} {name} (.A_CLK(clk), .A_MEN((access || write) && {hit}), .A_WEN(write),",
                    f"        .A_REN(!write), .A_ADDR({pad}line[{need - 1}:0]}}), .A_DIN({{{din}}}),"
                    + (f" .A_BM({{{bms}}})," if masked else ""),
                    f"        .A_DOUT({shown}));",
                ]
            else:
                ones = "{" + f"{macro.bits}" + "{1'b1}}"
                lines += [
                    f"    {macro.name} {name} (.A_CLK(clk), .A_MEN(access && {hit}), .A_WEN(1'b0), .A_REN(1'b1),",
                    f"        .A_ADDR({pad}line[{need - 1}:0]}}), .A_DIN({{{macro.bits}{{1'b0}}}}),"
                    + (f" .A_BM({ones}), .B_BM({ones})," if masked else ""),
                    f"        .A_DOUT({shown}), .B_CLK(clk), .B_MEN(write && {written}), .B_WEN(1'b1), .B_REN(1'b0),",
                    f"        .B_ADDR({pad}write_address[{need - 1}:0]}}), .B_DIN({{{din}}}), .B_DOUT());",
                ]
            at += macro.bits
    # Banks are combined by ANDs and ORs with the bank that was read last; then the word is picked out of its row.
    bank = f"last[{row - 1}:{low}]" if bank_bits else ""
    terms = [
        (
            f"({{{row_bits}{{{bank} == {bank_bits}'d{b}}}}} & shown[{b}])"
            if bank_bits
            else f"shown[{b}]"
        )
        for b in range(choice.banks)
    ]
    lines += [f"    wire [{row_bits - 1}:0] found = " + "\n        | ".join(terms) + ";"]
    words = [f"found[{(w + 1) * bits - 1}:{w * bits}]" for w in range(pack)]
    lines += [f"    wire [{bits - 1}:0] picked;"]
    if pack == 1:
        lines += [f"    assign picked = {words[0]};"]
    else:
        picked = " | ".join(
            f"({{{bits}{{place == {packed}'d{w}}}}} & {word})" for w, word in enumerate(words)
        )
        lines += [f"    assign picked = {picked};"]
    shown_bits = [
        f"picked[{stored.index(bit)}]" if bit in stored else "1'b0"
        for bit in reversed(range(shape.bits))
    ]
    lines += [f"    assign read_data = {{{', '.join(shown_bits)}}};"]
    return "\n".join([*lines, "endmodule\n"])


def _waiting(choice: Choice) -> str:
    """Return a memory of two ports made of banks of one port, in one group or with even and odd words apart.

    A write waits while the banks of its group are read, which takes a cycle at most. It reaches only the bank that keeps it.
    """
    shape, halves = choice.shape, HALVES[choice.shape.name]
    bits, address = shape.bits, shape.address
    row_bits, depth = sum(m.bits for m in choice.macros), (choice.rows - 1).bit_length()
    first = halves - 1  # bits of an address that choose the group: 0, or 1 for even and odd
    low = min(depth, address - first)
    high, top = address - first - low, address - 1
    lines = [
        shape.ports_text,
        f"    wire [{top}:0] from = read_address[{top}:0], to = write_address[{top}:0];",
        "    logic waiting;",
        f"    logic [{top}:0] waiting_address, last;",
        f"    logic [{bits - 1}:0] waiting_data;",
        f"    wire [{top}:0] target = waiting ? waiting_address : to;",
        f"    wire [{row_bits - 1}:0] data = {{{{{row_bits - bits + 1}{{1'b0}}}}, waiting ? waiting_data : write_data}};",
        f"    wire clash = read{' && from[0] == target[0]' * first};",
        "    wire put = (waiting || write) && !clash;",
        "    wire wait_now = write && (waiting || clash);",
        "    always_ff @(posedge clk) begin",
        "        if (wait_now || waiting) waiting <= wait_now || clash;",
        "        if (wait_now) {waiting_address, waiting_data} <= {to, write_data};",
        "        if (read) last <= from;",
        "    end",
        f"    wire [{row_bits - 1}:0] shown[0:{choice.banks - 1}];",
    ]
    terms = []
    for bank in range(choice.banks):
        number, half = divmod(bank, halves)
        # Conditions for this bank: it holds the word that is read, that is written, and that was read last.
        conditions = ["1'b1"] * 3
        for at, name in enumerate(("from", "target", "last")):
            conditions[at] += f" && {name}[0] == 1'd{half}" * first
            if high:
                conditions[at] += f" && {name}[{top}:{low + first}] == {high}'d{number}"
        lines += [
            f"    wire reads{bank} = read && {conditions[0]}, puts{bank} = put && {conditions[1]};",
            f"    wire [{low - 1}:0] row{bank} = puts{bank} ? target[{low + first - 1}:{first}] : from[{low + first - 1}:{first}];",
            f"    wire [{row_bits - 1}:0] given{bank} = data & {{{row_bits}{{puts{bank}}}}};",
        ]
        terms.append(f"({{{bits}{{{conditions[2]}}}}} & shown[{bank}][{bits - 1}:0])")
        at = 0
        for index, macro in enumerate(choice.macros):
            pad = f"{{{{{depth - low}{{1'b0}}}}, " if depth > low else "{"
            mask = f" .A_BM({{{macro.bits}{{1'b1}}}})," if "_bm_" in macro.name else ""
            span = f"[{at + macro.bits - 1}:{at}]"
            lines += [
                f"    {macro.name} bank{bank}_{index} (.A_CLK(clk), .A_MEN(reads{bank} || puts{bank}), .A_WEN(puts{bank}),",
                f"        .A_REN(!puts{bank}), .A_ADDR({pad}row{bank}}}), .A_DIN(given{bank}{span}),{mask} .A_DOUT(shown[{bank}]{span}));",
            ]
            at += macro.bits
    return "\n".join(
        [*lines, "    assign read_data = " + "\n        | ".join(terms) + ";", "endmodule\n"]
    )


def stub(macro: Macro) -> str:
    """Return the ports of a macro, without what is inside; pins of its self test are left out (tied)."""
    a, d = (macro.words - 1).bit_length() - 1, macro.bits - 1
    ports = []
    for port in "AB"[: macro.ports]:
        ports += [
            f"input {port}_CLK, {port}_MEN, {port}_WEN, {port}_REN",
            f"input [{a}:0] {port}_ADDR",
        ]
        ports += [f"input [{d}:0] {port}_DIN"] + (
            [f"input [{d}:0] {port}_BM"] if "_bm_" in macro.name else []
        )
        ports += [f"output [{d}:0] {port}_DOUT"]
    return f"(* blackbox *) module {macro.name} ({', '.join(ports)}); endmodule\n"
