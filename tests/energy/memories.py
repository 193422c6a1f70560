"""Memories of the core as macros: what each may be made of, what that costs, and its SystemVerilog."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from liberty import Macro

DEEPEST, WIDEST = 64, 4


@dataclass(frozen=True)
class Shape:
    """A memory as the core sees it. ``ports``: 1 where it is written only between recordings."""

    name: str
    words: int
    bits: int
    ports: int


@dataclass(frozen=True)
class Choice:
    """A memory made of macros: ``banks`` times a row of ``macros`` side by side; ``pack`` words lie in a row."""

    shape: Shape
    macros: tuple[Macro, ...]
    banks: int
    pack: int

    @property
    def rows(self) -> int:
        """Rows of a bank."""
        return self.macros[0].words

    @property
    def area(self) -> float:
        """Square micrometres."""
        return self.banks * sum(m.area for m in self.macros)

    @property
    def leakage_nw(self) -> float:
        """Nanowatts, as the files give them."""
        return self.banks * sum(m.leakage_nw for m in self.macros)

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
        """Say what it is."""
        row = " + ".join(f"{m.ports}P {m.words}x{m.bits}" for m in self.macros)
        return f"{self.banks} x ({row})" + (f", {self.pack} words a row" if self.pack > 1 else "")


def shapes(sizes: Mapping[str, int], names: Collection[str]) -> list[Shape]:
    """Return the memories of ``locsnn_core`` for its parameters, those that have ``names``."""
    log = {name: (value - 1).bit_length() for name, value in sizes.items()}
    number, entry = log["compartments"], log["entries"]
    known = [
        Shape("axons", sizes["axons"], 2 * log["synapses"], 1),
        Shape("synapses", sizes["synapses"], number + log["slots"] + 12, 1),
        Shape("charges", sizes["slots"] * sizes["compartments"], sizes["charge"], 2),
        Shape("states", sizes["compartments"], 54, 2),
        Shape("leaks", sizes["compartments"], 48, 1),
        Shape("fires", sizes["compartments"], 38 + number + entry, 1),
        Shape("sums", sizes["compartments"], sizes["join"], 2),
        Shape("places", sizes["compartments"], number, 2),
        Shape("tallies", sizes["entries"], 24, 2),
        Shape("bitmap", sizes["bitmap"], 32, 2),
        Shape("visit_list", sizes["visits"], 24 + log["bitmap"] + log["axons"], 1),
        Shape("phases", 512, 24, 1),
        Shape("weights", 64, 33, 1),
    ]
    missing = set(names) - {shape.name for shape in known}
    assert not missing, f"memories of no known shape: {missing}"
    return [shape for shape in known if shape.name in names]


def choices(shape: Shape, macros: Sequence[Macro], used: int | None = None) -> Iterator[Choice]:
    """Yield what a memory may be made of; ``used``: the words that programs need, all by default."""
    fitting = [m for m in macros if m.ports == shape.ports]
    for depth in sorted({m.words for m in fitting}):
        here = sorted((m for m in fitting if m.words == depth), key=lambda m: -m.bits)
        for pack in (1, 2, 4) if shape.ports == 1 else (1,):
            for row in _rows(here, pack * shape.bits):
                banks = -(-(used or shape.words) // (pack * depth))
                if banks <= DEEPEST:
                    yield Choice(shape, row, banks, pack)


def _rows(macros: Sequence[Macro], bits: int, most: int = WIDEST) -> Iterator[tuple[Macro, ...]]:
    """Yield rows of macros that hold so many bits and no macro too many."""
    if bits <= 0:
        yield ()
        return
    for index, macro in enumerate(macros if most else ()):
        for rest in _rows(macros[index:], bits - macro.bits, most - 1):
            yield (macro, *rest)


def verilog(choice: Choice) -> str:
    """Return module ``memory_<name>``: the ports of ``memory``, banks of macros behind them.

    With several words a row, the row that was read last is not read again: the macros still show it.
    """
    shape, pack = choice.shape, choice.pack
    address = max((shape.words - 1).bit_length(), 1)
    packed, low = (pack - 1).bit_length(), (choice.rows - 1).bit_length()
    low = min(low, address - packed)
    bank_bits = address - packed - low
    row_bits = sum(m.bits for m in choice.macros)
    lines = [
        f"module memory_{shape.name} (input logic clk, write, read,",
        f"    input logic [{address - 1}:0] write_address, read_address, input logic [{shape.bits - 1}:0] write_data,",
        f"    output logic [{shape.bits - 1}:0] read_data);",
    ]
    row = address - packed
    if shape.ports == 1:
        lines += [f"    wire [{address - 1}:0] address = write ? write_address : read_address;"]
    else:
        lines += [f"    wire [{address - 1}:0] address = read_address;"]
    lines += [f"    wire [{row - 1}:0] line = address[{address - 1}:{packed}];"]
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
            f"        if (read) place <= address[{packed - 1}:0];",
            "    end",
        ]
    elif bank_bits:
        lines += [last, "    wire access = read;", "    always_ff @(posedge clk) if (access) last <= line;"]
    else:
        lines += ["    wire access = read;"]
    lines += [f"    wire [{row_bits - 1}:0] shown[0:{choice.banks - 1}];"]
    mask = "" if pack == 1 else f"address[{packed - 1}:0]"
    for bank in range(choice.banks):
        hit = f"line[{row - 1}:{low}] == {bank_bits}'d{bank}" if bank_bits else "1'b1"
        written = f"write_address[{address - 1}:{low}] == {bank_bits}'d{bank}" if bank_bits and pack == 1 else hit
        at = 0
        for index, macro in enumerate(choice.macros):
            depth = (macro.words - 1).bit_length()
            need = min(depth, low)
            pad = f"{{{{{depth - need}{{1'b0}}}}, " if depth > need else "{"
            data, bm = [], []
            for bit in range(at, at + macro.bits):
                word, inside = divmod(bit, shape.bits)
                data.append(f"write_data[{inside}]" if word < pack else "1'b0")
                bm.append("1'b0" if word >= pack else f"{mask} == {packed}'d{word}" if pack > 1 else "1'b1")
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
    bank = f"last[{row - 1}:{low}]" if bank_bits else ""
    terms = [
        (f"({{{row_bits}{{{bank} == {bank_bits}'d{b}}}}} & shown[{b}])" if bank_bits else f"shown[{b}]")
        for b in range(choice.banks)
    ]
    lines += [f"    wire [{row_bits - 1}:0] found = " + "\n        | ".join(terms) + ";"]
    words = [f"found[{(w + 1) * shape.bits - 1}:{w * shape.bits}]" for w in range(pack)]
    if pack == 1:
        lines += [f"    assign read_data = {words[0]};"]
    else:
        picked = " | ".join(f"({{{shape.bits}{{place == {packed}'d{w}}}}} & {word})" for w, word in enumerate(words))
        lines += [f"    assign read_data = {picked};"]
    return "\n".join([*lines, "endmodule\n"])


def stub(macro: Macro) -> str:
    """Return the ports of a macro, without what is inside; pins of its self test are left out (tied)."""
    a, d = (macro.words - 1).bit_length() - 1, macro.bits - 1
    ports = []
    for port in "AB"[: macro.ports]:
        ports += [f"input {port}_CLK, {port}_MEN, {port}_WEN, {port}_REN", f"input [{a}:0] {port}_ADDR"]
        ports += [f"input [{d}:0] {port}_DIN"] + ([f"input [{d}:0] {port}_BM"] if "_bm_" in macro.name else [])
        ports += [f"output [{d}:0] {port}_DOUT"]
    return f"(* blackbox *) module {macro.name} ({', '.join(ports)}); endmodule\n"
