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


@dataclass(frozen=True)
class _Address:
    """How an address is divided, from its low end: the word in the row, the row in the bank, the bank.

    ``word_bits``, ``row_bits``, ``bank_bits``: the bits of each.
    """

    bits: int
    word_bits: int
    row_bits: int

    @classmethod
    def of(cls, choice: Choice) -> "_Address":
        """Return the division for a choice; a small memory may need fewer rows than its macros have."""
        bits = choice.shape.address
        word_bits = (choice.pack - 1).bit_length()
        rows = (choice.rows - 1).bit_length()
        return cls(bits, word_bits, min(rows, bits - word_bits))

    @property
    def bank_bits(self) -> int:
        """Bits that choose the bank."""
        return self.bits - self.word_bits - self.row_bits

    @property
    def line_bits(self) -> int:
        """Bits of bank and row together, called the line."""
        return self.bits - self.word_bits

    def is_bank(self, signal: str, bank: int) -> str:
        """Return the condition that the line in a signal lies in a bank."""
        if not self.bank_bits:
            return "1'b1"
        return f"{signal}[{self.line_bits - 1}:{self.row_bits}] == {self.bank_bits}'d{bank}"


def verilog(choice: Choice) -> str:
    """Return module ``memory_<name>``: the ports of ``memory``, banks of macros behind them.

    With several words a row, the row that was read last is not read again: the macros still show it. Masks, which reach
    every macro, stand still while nothing is written.
    """
    if choice.waits:
        return _waiting(choice)
    address = _Address.of(choice)
    row_bits = sum(macro.bits for macro in choice.macros)
    lines = [
        choice.shape.ports_text,
        *_access(choice, address),
        f"    wire [{row_bits - 1}:0] shown[0:{choice.banks - 1}];",
    ]
    for bank in range(choice.banks):
        first_bit = 0
        for index, macro in enumerate(choice.macros):
            lines += _instance(choice, address, bank, index, first_bit)
            first_bit += macro.bits
    return "\n".join([*lines, *_picked_word(choice, address, row_bits), "endmodule\n"])


def _access(choice: Choice, address: _Address) -> list[str]:
    """Return the signals that say which line is accessed, and whether it has to be read at all."""
    at = f"read_address[{address.bits - 1}:0]"
    if choice.shape.ports == 1:
        at = f"write ? write_address[{address.bits - 1}:0] : {at}"
    lines = [
        f"    wire [{address.bits - 1}:0] at = {at};",
        f"    wire [{address.line_bits - 1}:0] line = at[{address.bits - 1}:{address.word_bits}];",
    ]
    last = f"    logic [{address.line_bits - 1}:0] last;"
    if choice.pack > 1:
        return [
            *lines,
            last,
            f"    logic kept; logic [{address.word_bits - 1}:0] place;",
            "    wire again = kept && line == last;",
            "    wire access = read && !write && !again;",
            "    always_ff @(posedge clk) begin",
            "        if (write) kept <= 0; else if (access) kept <= 1;",
            "        if (access) last <= line;",
            f"        if (read) place <= at[{address.word_bits - 1}:0];",
            "    end",
        ]
    if address.bank_bits:
        return [
            *lines,
            last,
            "    wire access = read;",
            "    always_ff @(posedge clk) if (access) last <= line;",
        ]
    return [*lines, "    wire access = read;"]


def _instance(
    choice: Choice, address: _Address, bank: int, index: int, first_bit: int
) -> list[str]:
    """Return the instance of a macro: number ``index`` in the row of a bank, with the row's bits from ``first_bit`` on.

    Bits of the row beyond the packed words stay 0.
    """
    shape, pack, macro = choice.shape, choice.pack, choice.macros[index]
    stored = shape.stored
    hit = address.is_bank("line", bank)
    # A packed memory is written by one port, where `line` is that of the write.
    written = hit
    if address.bank_bits and pack == 1:
        written = (
            f"write_address[{address.bits - 1}:{address.row_bits}] == {address.bank_bits}'d{bank}"
        )
    depth = (macro.words - 1).bit_length()
    need = min(depth, address.row_bits)
    pad = f"{{{{{depth - need}{{1'b0}}}}, " if depth > need else "{"
    data, bit_masks = [], []
    for bit in range(first_bit, first_bit + macro.bits):
        word, inside = divmod(bit, len(stored))
        is_spare = word >= pack
        data.append("1'b0" if is_spare else f"write_data[{stored[inside]}]")
        if is_spare:
            bit_masks.append("1'b0")
        elif pack > 1:
            place = f"at[{address.word_bits - 1}:0] == {address.word_bits}'d{word}"
            bit_masks.append(f"write && {place}")
        else:
            bit_masks.append("1'b1")
    data_in, masks = ", ".join(reversed(data)), ", ".join(reversed(bit_masks))
    shown = f"shown[{bank}][{first_bit + macro.bits - 1}:{first_bit}]"
    name = f"bank{bank}_{index}"
    has_masks = "_bm_" in macro.name
    if shape.ports == 1:
        return [
            f"    {macro.name} {name} (.A_CLK(clk), .A_MEN((access || write) && {hit}), .A_WEN(write),",
            f"        .A_REN(!write), .A_ADDR({pad}line[{need - 1}:0]}}), .A_DIN({{{data_in}}}),"
            + (f" .A_BM({{{masks}}})," if has_masks else ""),
            f"        .A_DOUT({shown}));",
        ]
    # Port A reads and port B writes.
    ones = f"{{{macro.bits}{{1'b1}}}}"
    return [
        f"    {macro.name} {name} (.A_CLK(clk), .A_MEN(access && {hit}), .A_WEN(1'b0), .A_REN(1'b1),",
        f"        .A_ADDR({pad}line[{need - 1}:0]}}), .A_DIN({{{macro.bits}{{1'b0}}}}),"
        + (f" .A_BM({ones}), .B_BM({ones})," if has_masks else ""),
        f"        .A_DOUT({shown}), .B_CLK(clk), .B_MEN(write && {written}), .B_WEN(1'b1), .B_REN(1'b0),",
        f"        .B_ADDR({pad}write_address[{need - 1}:0]}}), .B_DIN({{{data_in}}}), .B_DOUT());",
    ]


def _picked_word(choice: Choice, address: _Address, row_bits: int) -> list[str]:
    """Return what picks the word that was read: by ANDs and ORs its bank, then its place in the row."""
    shape = choice.shape
    stored = shape.stored
    bits = len(stored)
    terms = []
    for bank in range(choice.banks):
        term = f"shown[{bank}]"
        if address.bank_bits:
            term = f"({{{row_bits}{{{address.is_bank('last', bank)}}}}} & {term})"
        terms.append(term)
    words = [f"found[{(word + 1) * bits - 1}:{word * bits}]" for word in range(choice.pack)]
    picked = words[0]
    if choice.pack > 1:
        picked = " | ".join(
            f"({{{bits}{{place == {address.word_bits}'d{number}}}}} & {word})"
            for number, word in enumerate(words)
        )
    # Bits that are 0 in every program are not stored.
    shown_bits = [
        f"picked[{stored.index(bit)}]" if bit in stored else "1'b0"
        for bit in reversed(range(shape.bits))
    ]
    return [
        f"    wire [{row_bits - 1}:0] found = " + "\n        | ".join(terms) + ";",
        f"    wire [{bits - 1}:0] picked;",
        f"    assign picked = {picked};",
        f"    assign read_data = {{{', '.join(shown_bits)}}};",
    ]


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
