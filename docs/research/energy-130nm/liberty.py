"""Read Liberty files: standard cells with pins, functions, capacitances, and tables of energy and delay; and memory macros.

A library is a tree of groups, ``name (arguments) { attributes; groups }``. :func:`read` gives the tree, :func:`cells` and
:func:`macro` take from it what timing and energy need. Units are those of the files: ns, pF, pJ, µm2, nW.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

_TOKEN = re.compile(r'"((?:[^"\\]|\\.)*)"|([\w.+\-!*&|^]+(?:\[[\d:]+\])?)|([(){};:,])', re.DOTALL)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@dataclass
class Group:
    """``name (arguments) { attributes; groups }``.

    ``values``: simple attributes, ``name : value;``; one that comes several times keeps the last value.
    ``complex``: attributes with arguments, ``name (a, b);``, all of them. ``lines``: the line of each attribute.
    """

    name: str
    arguments: tuple[str, ...]
    line: int
    values: dict[str, str] = field(default_factory=dict)
    complex: dict[str, list[tuple[str, ...]]] = field(default_factory=dict)
    groups: list["Group"] = field(default_factory=list)
    lines: dict[str, int] = field(default_factory=dict)

    def all(self, name: str) -> Iterator["Group"]:
        """Yield the groups of a name."""
        return (group for group in self.groups if group.name == name)

    def number(self, name: str, default: float = 0.0) -> float:
        """Return an attribute as a number."""
        return float(self.values.get(name, default))


def read(path: Path) -> Group:
    """Return the library of a file."""
    # Comments and continued lines are replaced by as many line ends as they have, so that line numbers stay right.
    text = _COMMENT.sub(lambda found: "\n" * found.group().count("\n"), path.read_text("utf-8"))
    text = text.replace("\\\n", " \n")
    tokens, line, position = [], 1, 0
    for match in _TOKEN.finditer(text):
        line += text.count("\n", position, match.start())
        position = match.start()
        quoted, word, punctuation = match.groups()
        tokens.append(
            (quoted if quoted is not None else word or punctuation, punctuation is not None, line)
        )
    root = Group("", (), line=0)
    _read_into(root, tokens, 0)
    return root.groups[0]


def _read_into(group: Group, tokens: list[tuple[str, bool, int]], at: int) -> int:
    """Read attributes and groups from token ``at`` on into a group; return the token after its closing brace.

    A token is its text, whether it is punctuation, and its line.
    """
    while at < len(tokens):
        text, punctuation, line = tokens[at]
        if punctuation:
            at += 1
            if text == "}":
                return at
            continue
        next_mark = tokens[at + 1][0] if at + 1 < len(tokens) and tokens[at + 1][1] else ""
        if next_mark == ":":
            end = at + 2
            parts = []
            # A value ends at ";" or, in files that leave it out, at the end of the line.
            while not (tokens[end][1] and tokens[end][0] in ";}") and (
                not parts or tokens[end][2] == line
            ):
                parts.append(tokens[end][0])
                end += 1
            group.values[text] = " ".join(parts)
            group.lines[text] = line
            at = end
        elif next_mark == "(":
            end = at + 2
            arguments = []
            while tokens[end][0] != ")" or not tokens[end][1]:
                if not tokens[end][1]:
                    arguments.append(tokens[end][0])
                end += 1
            at = end + 1
            if at < len(tokens) and tokens[at][1] and tokens[at][0] == "{":
                inner_group = Group(text, tuple(arguments), line)
                group.groups.append(inner_group)
                at = _read_into(inner_group, tokens, at + 1)
            else:
                group.complex.setdefault(text, []).append(tuple(arguments))
                group.lines[text] = line
        else:
            at += 1
    return at


def numbers(text: tuple[str, ...]) -> np.ndarray:
    """Return the numbers of lists in quotes, such as ``"0.1, 0.2"``, one after the other."""
    return np.array([float(x) for part in text for x in part.replace(",", " ").split()])


@dataclass
class Table:
    """Values over one or two indices (often input transition and load), linear in between; beyond its ends, the end's value."""

    index_1: np.ndarray
    index_2: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, group: Group) -> "Table":
        """Return the table of a group such as ``cell_rise``; a scalar has one value."""
        first, second = (
            numbers(group.complex.get(name, [("0",)])[0]) for name in ("index_1", "index_2")
        )
        return cls(
            first, second, numbers(group.complex["values"][0]).reshape(len(first), len(second))
        )

    def at(self, x: float, y: float = 0.0) -> float:
        """Return the value at an input transition and a load."""
        (i, a), (j, b) = _place(self.index_1, x), _place(self.index_2, y)
        v = self.values
        if len(self.index_1) == 1:
            return (
                float(v[0, j] * (1 - b) + v[0, j + 1] * b)
                if len(self.index_2) > 1
                else float(v[0, 0])
            )
        if len(self.index_2) == 1:
            return float(v[i, 0] * (1 - a) + v[i + 1, 0] * a)
        low = v[i, j] * (1 - b) + v[i, j + 1] * b
        high = v[i + 1, j] * (1 - b) + v[i + 1, j + 1] * b
        return float(low * (1 - a) + high * a)


def _place(index: np.ndarray, x: float) -> tuple[int, float]:
    """Return the interval of an index that x lies in, and how far into it, 0 to 1."""
    if len(index) == 1:
        return 0, 0.0
    i = int(np.clip(np.searchsorted(index, x) - 1, 0, len(index) - 2))
    return i, float(np.clip((x - index[i]) / (index[i + 1] - index[i]), 0.0, 1.0))


@dataclass
class Arc:
    """A group of tables between two pins: the delay or transition time of an output, or the energy that a transition takes.

    ``related``: the input pin that causes it. ``kind``: its ``timing_type``. ``tables``: for the rising and the falling edge.
    ``when``: the condition on other pins, or empty.
    """

    related: str
    kind: str
    tables: list[Table]
    when: str

    def worst(self, x: float, y: float) -> float:
        """Return the larger of rise and fall."""
        return max(table.at(x, y) for table in self.tables)

    def mean(self, x: float, y: float) -> float:
        """Return the mean of rise and fall: half of what a pair of transitions takes."""
        return sum(table.at(x, y) for table in self.tables) / max(len(self.tables), 1)


@dataclass
class Pin:
    """A pin: its capacitance in picofarads, and for outputs its function and arcs; ``setup`` (ns) for inputs of flip-flops."""

    name: str
    direction: str
    capacitance: float
    function: str
    power: list[Arc]
    delays: list[Arc]
    transitions: list[Arc]
    setup: float = 0.0


@dataclass
class Cell:
    """A standard cell: area in square micrometres, leakage in nanowatts.

    ``kind``: ``ff``, ``latch``, ``gate`` (an integrated clock gate) or ``logic``. ``line``: where it begins in the file.
    """

    name: str
    area: float
    leakage_nw: float
    pins: dict[str, Pin]
    kind: str
    line: int

    @cached_property
    def inputs(self) -> list[str]:
        """Names of input pins."""
        return [pin.name for pin in self.pins.values() if pin.direction == "input"]

    @cached_property
    def outputs(self) -> list[str]:
        """Names of output pins."""
        return [pin.name for pin in self.pins.values() if pin.direction == "output"]


def cells(library: Group) -> dict[str, Cell]:
    """Return the standard cells by name."""
    cell_of_name = {}
    for group in library.all("cell"):
        kind = (
            "ff"
            if any(group.all("ff"))
            else "gate"
            if "clock_gating_integrated_cell" in group.values
            else ""
        )
        kind = kind or ("latch" if any(group.all("latch")) else "logic")
        pins = {pin.arguments[0]: _pin(pin) for pin in group.all("pin")}
        name = group.arguments[0]
        cell_of_name[name] = Cell(
            name,
            group.number("area"),
            group.number("cell_leakage_power")
            / 1e3,  # picowatts in this file, nanowatts in those of macros
            pins,
            kind,
            group.line,
        )
    return cell_of_name


def _pin(group: Group) -> Pin:
    timing = list(group.all("timing"))
    delays = [
        t for t in timing if not any(t.all("rise_constraint")) and not any(t.all("fall_constraint"))
    ]
    setups = [t for t in timing if t.values.get("timing_type", "").startswith("setup")]
    setup = max((float(Table.of(g).values[0].max()) for t in setups for g in t.groups), default=0.0)
    return Pin(
        group.arguments[0],
        group.values.get("direction", "internal"),
        group.number("capacitance"),
        group.values.get("function", group.values.get("state_function", "")),
        [_arc(g, ("rise_power", "fall_power")) for g in group.all("internal_power")],
        [_arc(t, ("cell_rise", "cell_fall")) for t in delays],
        [_arc(t, ("rise_transition", "fall_transition")) for t in delays],
        setup,
    )


def _arc(group: Group, names: tuple[str, str]) -> Arc:
    tables = [Table.of(g) for name in names for g in group.all(name)]
    values = group.values
    return Arc(
        values.get("related_pin", ""),
        values.get("timing_type", "combinational"),
        tables,
        values.get("when", ""),
    )


@dataclass(frozen=True)
class Macro:
    """A memory macro.

    ``area``: square micrometres. ``read_pj`` and ``write_pj``: picojoules of an access. ``output_ns``: from the clock to its
    output. ``input_pf``: of an input pin. ``toggle_pj``: picojoules of a transition of an input, by the pin's name at port A.
    ``lines``: where its figures stand in ``file``. ``banks``: the most banks that a memory may have of it; 512 is no limit.
    """

    name: str
    words: int
    bits: int
    ports: int
    area: float
    read_pj: float
    write_pj: float
    leakage_nw: float
    output_ns: float
    input_pf: float
    setup_ns: float
    toggle_pj: dict[str, float] = field(hash=False, compare=False)
    file: str = ""
    lines: dict[str, int] = field(default_factory=dict, hash=False, compare=False)
    banks: int = 512


def macro(path: Path) -> Macro:
    """Return the macro of a file, with the lines that its figures stand in. Figures are those of port A."""
    library = read(path)
    (cell,) = library.all("cell")
    words, bits = map(int, re.findall(r"_(\d+)x(\d+)_", path.name)[0])
    pins = {g.arguments[0]: g for g in (*cell.all("pin"), *cell.all("bus"))}
    clock = pins["A_CLK"]
    # Energy of an access is listed at the clock pin, by which enables (memory, write, read) are set.
    access = {
        "".join(arc.values.get("when", "").split()): arc for arc in clock.all("internal_power")
    }
    read_arc, write_arc = access["A_MEN&!A_WEN&A_REN"], access["A_MEN&A_WEN&!A_REN"]
    access_pj = {
        name: Table.of(next(arc.all("rise_power"))).at(0)
        for name, arc in (("r", read_arc), ("w", write_arc))
    }
    output_timing = next(pins["A_DOUT"].all("timing"))
    slowest_ns = max(
        Table.of(next(output_timing.all(edge))).values[0].max()
        for edge in ("cell_rise", "cell_fall")
    )
    toggles = {}
    for name in ("A_ADDR", "A_DIN", "A_MEN", "A_WEN", "A_REN"):
        first_bit = next(pins[name].all("pin"), pins[name]) if name in ("A_DIN",) else pins[name]
        groups_with_power = [
            g
            for g in (first_bit, *pins[name].all("pin"), pins[name])
            if any(g.all("internal_power"))
        ]
        power_arcs = (
            [
                _arc(g, ("rise_power", "fall_power"))
                for g in groups_with_power[0].all("internal_power")
            ]
            if groups_with_power
            else []
        )
        toggles[name] = (
            float(np.mean([arc.mean(0, 0) for arc in power_arcs])) if power_arcs else 0.0
        )
    name = cell.arguments[0]
    return Macro(
        name, words, bits, 2 if "_2P_" in name else 1, cell.number("area"), access_pj["r"], access_pj["w"],
        cell.number("cell_leakage_power"), float(slowest_ns), pins["A_ADDR"].number("capacitance"),
        max(_setup(pins[name]) for name in ("A_ADDR", "A_DIN", "A_MEN")), toggles, path.name,
        {"area": cell.lines["area"], "read": read_arc.line, "write": write_arc.line,
         "leakage": cell.lines["cell_leakage_power"]},
    )  # fmt: skip


def _setup(pin: Group) -> float:
    """Return the longest setup time of a pin at transitions of 0.1 ns."""
    timing = [
        t for t in (*pin.all("timing"), *(t for p in pin.all("pin") for t in p.all("timing")))
    ]
    setups = [t for t in timing if t.values.get("timing_type") == "setup_rising"]
    return max((Table.of(g).at(0.1, 0.1) for t in setups for g in t.groups), default=0.0)


def macros(folder: Path) -> list[Macro]:
    """Return all macros of a folder."""
    return [macro(path) for path in sorted(folder.glob("RM_*.lib"))]
