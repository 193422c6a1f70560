"""A netlist simulated gate by gate, 64 recordings at a time: a bit of a machine word is a recording.

Made as C++ from the functions of the liberty file, levelised and without delays: a net changes at most once per cycle, so
what a real circuit does before it settles (glitches) is not in it. Every transition of every net is counted, by
recording and by what the core was doing (:data:`CLASSES`).
"""

import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from liberty import Cell, Macro
from memories import HALVES
from netlist import Instance, Netlist

LANES = 64
CLASSES = ("deliver", "update", "other")
"""Cycles of delivering spikes, of updating compartments, and all others (cleaning, readout, answer)."""


@dataclass
class Circuit:
    """Instances of a netlist in numbers: ``net[bit]`` its index, 0 and 1 are constants; ``order``: logic, sorted."""

    netlist: Netlist
    net: dict[int | str, int]
    order: list[Instance]
    flops: list[Instance]
    memories: list[Instance]
    gates: dict[int, Instance]
    driver: dict[int, tuple[Instance, str]]

    @property
    def nets(self) -> int:
        """Nets, constants included."""
        return max(self.net.values()) + 1

    def at(self, instance: Instance, pin: str, bit: int = 0) -> int:
        """Return the net at a pin; what is not connected is constant 0."""
        bits = instance.pins.get(pin, [])
        return self.net[bits[bit]] if bit < len(bits) else 0

    def port(self, name: str) -> list[int]:
        """Return the nets of a port of the core."""
        return [self.net[bit] for bit in self.netlist.ports[name][1]]


def circuit(netlist: Netlist, cells: Mapping[str, Cell], macros: Mapping[str, Macro]) -> Circuit:
    """Sort the logic of a netlist by levels."""
    net: dict[int | str, int] = {"0": 0, "x": 0, "z": 0, "1": 1}
    for _, bits in netlist.ports.values():
        for bit in bits:
            net.setdefault(bit, len(set(net.values())))
    count = max(net.values()) + 1
    driver: dict[int, tuple[Instance, str]] = {}
    for instance in netlist.instances:
        for bits in instance.pins.values():
            for bit in bits:
                if bit not in net:
                    net[bit] = count
                    count += 1
    logic = [
        i for i in netlist.instances if i.type in cells and cells[i.type].kind in ("logic", "latch")
    ]
    flops = [i for i in netlist.instances if i.type in cells and cells[i.type].kind == "ff"]
    gates = [i for i in netlist.instances if i.type in cells and cells[i.type].kind == "gate"]
    memories = [i for i in netlist.instances if i.type in macros]
    assert len(logic) + len(flops) + len(memories) + len(gates) == len(netlist.instances)
    for instance in (*logic, *flops, *gates):
        for pin in cells[instance.type].outputs:
            for bit in instance.pins.get(pin, []):
                driver[net[bit]] = (instance, pin)
    for instance in memories:
        for port in "AB"[: macros[instance.type].ports]:
            for bit in instance.pins.get(f"{port}_DOUT", []):
                driver[net[bit]] = (instance, f"{port}_DOUT")
    waiting = {id(i): 0 for i in logic}
    users: dict[int, list[Instance]] = {}
    made_by = {n: i for n, (i, _) in driver.items() if id(i) in waiting}
    for instance in logic:
        for pin in followed(cells[instance.type]):
            at = net[instance.pins[pin][0]]
            if at in made_by:
                waiting[id(instance)] += 1
                users.setdefault(at, []).append(instance)
    ready = [i for i in logic if not waiting[id(i)]]
    order = []
    while ready:
        following = []
        for instance in ready:
            order.append(instance)
            for pin in cells[instance.type].outputs:
                for bit in instance.pins.get(pin, []):
                    for user in users.get(net[bit], []):
                        waiting[id(user)] -= 1
                        if not waiting[id(user)]:
                            following.append(user)
        ready = following
    assert len(order) == len(logic), "a loop of logic"
    by_output = {net[g.pins["GCLK"][0]]: g for g in gates}
    return Circuit(netlist, net, order, flops, memories, by_output, driver)


def followed(cell: Cell) -> list[str]:
    """Return the pins whose value an output has within a cycle: of a latch, its data."""
    return ["D"] if cell.kind == "latch" else cell.inputs


def enable(found: Circuit, clock: int) -> list[int]:
    """Return the nets that must be 1 for a clock to tick; none: always."""
    gate = found.gates.get(clock)
    return [] if gate is None else [found.at(gate, "GATE"), *enable(found, found.at(gate, "CLK"))]


def expression(function: str, names: Mapping[str, str]) -> str:
    """Return a liberty function in C, with nets for its pins."""
    text = function.replace("!", "~").replace("*", "&").replace("+", "|")
    return re.sub(r"[A-Za-z_]\w*", lambda found: names[found.group()], text)


def states_of(core: str) -> dict[str, int]:
    """Return the numbers of the sequencer's states, from the text of ``locsnn_core.sv``."""
    return {
        name: int(re.findall(rf"\b{name} = (\d)", core)[0]) for name in ("ROW", "UPDATE", "SPIKES")
    }


def source(
    found: Circuit,
    cells: Mapping[str, Cell],
    macros: Mapping[str, Macro],
    states: Mapping[str, int],
) -> str:
    """Return the simulator in C++; ``states``: those of the sequencer."""
    before, after = (
        (Path(__file__).parent / "gates.cpp")
        .read_text()
        .split("// The circuit: ports, nets and logic.\n")
    )
    statements = []
    number_of = {clock: k for k, clock in enumerate(found.gates)}
    for instance in found.order:
        cell = cells[instance.type]
        if cell.kind == "latch":
            # It follows its data where its gate opened at the last edge.
            q, d, open_ = (
                found.at(instance, "Q"),
                found.at(instance, "D"),
                number_of[found.at(instance, "GATE")],
            )
            statements.append(f"v[{q}]=(v[{d}]&t[{open_}])|(v[{q}]&~t[{open_}]);")
            continue
        names = {pin: f"v[{found.at(instance, pin)}]" for pin in cell.inputs}
        for pin in cell.outputs:
            if instance.pins.get(pin):
                constant = {"0": "0ull", "1": "~0ull"}.get(cell.pins[pin].function)
                value = constant or expression(cell.pins[pin].function, names)
                statements.append(f"v[{found.at(instance, pin)}]={value};")
    logic = _function("logic", statements)
    # The net of a gated clock changes whenever it ticks.
    ticking = []
    for clock, k in number_of.items():
        on = "&".join(f"v[{n}]" for n in enable(found, clock))
        ticking.append(f"t[{k}]={on};v[{clock}]=p[{clock}]^t[{k}];")
    logic += _function("ticking", ticking)
    following, commit = [], []
    for k, flop in enumerate(found.flops):
        clocks = enable(found, found.at(flop, "CLK"))
        d, q = found.at(flop, "D"), found.at(flop, "Q")
        value = f"v[{d}]"
        if clocks:
            on = "&".join(f"v[{n}]" for n in clocks)
            value = f"(v[{d}]&({on}))|(v[{q}]&~({on}))"
        following.append(f"f[{k}]={value};")
        commit.append(f"v[{q}]=f[{k}];")
        if flop.pins.get("Q_N"):
            commit.append(f"v[{found.at(flop, 'Q_N')}]=~f[{k}];")
    logic += _function("follow", following) + _function("commit", commit)
    ports = []
    table = []
    for number, instance in enumerate(found.memories):
        macro = macros[instance.type]
        # What is only loaded is the same for all recordings.
        shared = macro.ports == 1 and instance.name.replace("\\", "").split(".")[-2] not in HALVES
        for port in "AB"[: macro.ports]:
            depth = (macro.words - 1).bit_length()
            clock = number_of.get(found.at(instance, f"{port}_CLK"), -1)
            nets = [found.at(instance, f"{port}_{pin}") for pin in ("MEN", "WEN", "REN")]
            nets += [found.at(instance, f"{port}_ADDR", b) for b in range(depth)]
            data = [found.at(instance, f"{port}_DIN", b) for b in range(macro.bits)]
            masks = (
                [found.at(instance, f"{port}_BM", b) for b in range(macro.bits)]
                if "_bm_" in macro.name
                else []
            )
            outs = [
                found.at(instance, f"{port}_DOUT", b) if instance.pins.get(f"{port}_DOUT") else -1
                for b in range(macro.bits)
            ]
            masks = masks or [1] * macro.bits
            ports.append(
                f"{{{number},{macro.words},{macro.bits},{depth},{int(shared)},{clock},"
                f"{{{','.join(map(str, nets[:3]))}}},{{{','.join(map(str, nets[3:]))}}},"
                f"{{{','.join(map(str, data))}}},{{{','.join(map(str, masks))}}},{{{','.join(map(str, outs))}}}}}"
            )
        table.append(macro.words * (1 if shared else LANES))
    constants = {
        "NETS": found.nets, "FLOPS": len(found.flops), "PORTS": len(ports), "MEMORIES": len(found.memories),
        "GATES": len(found.gates), "LANES": LANES, **states,
    }  # fmt: skip
    head = "".join(f"#define {name} {value}\n" for name, value in constants.items())
    head += before
    arrays = "static const Port ports[PORTS]={" + ",\n".join(ports) + "};\n"
    arrays += f"static const int sizes[MEMORIES]={{{','.join(map(str, table))}}};\n"
    names = ("clk", "reset", "load_valid", "load_memory", "load_address", "load_data", "in_valid", "in_ready", "in_kind",
             "in_channel", "answer_valid", "answer_ready", "answer_class", "answer_synapses", "answer_updates",
             "answer_spikes", "probe_valid", "probe_compartment", "probe_u", "probe_v", "probe_fired")  # fmt: skip
    for name in names:
        nets = found.port(name)
        arrays += f"static const int n_{name}[]={{{','.join(map(str, nets))}}}; static const int w_{name}={len(nets)};\n"
    state = [found.net[bit] for bit in found.netlist.named["state"]]
    arrays += f"static const int n_state[]={{{','.join(map(str, state))}}};\n"
    return head + arrays + logic + after


def _function(name: str, statements: Sequence[str]) -> str:
    """Return a function in pieces that compile fast."""
    chunks = [statements[i : i + 200] for i in range(0, len(statements), 200)]
    pieces = "".join(
        f'__attribute__((noinline,optimize("O1"))) static void {name}{k}(){{{chr(10).join(chunk)}}}\n'
        for k, chunk in enumerate(chunks)
    )
    return (
        pieces
        + f"static void {name}(){{"
        + "".join(f"{name}{k}();" for k in range(len(chunks)))
        + "}\n"
    )


@dataclass
class Activity:
    """What happened: ``toggles`` (nets, recordings), or (nets, classes) of all recordings together.

    ``accesses`` (ports, read or write, classes, recordings).

    ``answers`` (recordings, 7): class, cycles from the first word, synapses, spikes, cycles by class. ``probes``: every
    update, (rows, 5): recording, compartment, u, v, fired. ``whole``: what this is a part of, from here to there.
    """

    toggles: np.ndarray
    accesses: np.ndarray
    answers: np.ndarray
    probes: np.ndarray | None
    whole: "tuple[Activity, int, int] | None" = None

    def part(self, begin: int, end: int) -> "Activity":
        """Return what some of the recordings did; they are counted from 0 again."""
        probes = None
        if self.probes is not None:
            mine = (self.probes[:, 0] >= begin) & (self.probes[:, 0] < end)
            probes = self.probes[mine] - np.array([begin, 0, 0, 0, 0], dtype=np.uint32)
        toggles, accesses, answers = (
            self.toggles[:, begin:end],
            self.accesses[..., begin:end],
            self.answers[begin:end],
        )
        return Activity(toggles, accesses, answers, probes, (self, begin, end))


def build(folder: Path, text: str) -> Path:
    """Compile the simulator."""
    (folder / "gates.cpp").write_text(text)
    binary = folder / "gates"
    subprocess.run(
        ["g++", "-O2", "-march=native", "-o", str(binary), "gates.cpp"], cwd=folder, check=True
    )
    return binary


def play(
    folder: Path, binary: Path, load: np.ndarray, words: Sequence[Sequence[int]], found: Circuit, probes: bool = False,
    by_class: bool = False,
) -> Activity:  # fmt: skip
    """Play recordings, at most 64: load words (rows, 160) as bits, and the words of every recording."""
    assert len(words) <= LANES
    packed = np.zeros((len(load), 192), dtype=np.uint8)
    packed[:, : load.shape[1]] = load
    np.packbits(packed, axis=1, bitorder="little").tofile(folder / "load.bin")
    pairs = [(lane, word) for lane, one in enumerate(words) for word in one]
    np.array(pairs, dtype=np.uint32).tofile(folder / "words.bin")
    done = subprocess.run(
        [str(binary.resolve()), "2000000", str(int(probes)), str(int(by_class))],
        cwd=folder,
        check=False,
    )
    assert done.returncode == 0, "recordings without an answer"
    count = len(words)
    if by_class:
        toggles = (
            np.fromfile(folder / "toggles.bin", dtype=np.uint64)
            .reshape(3, found.nets)
            .T.astype(np.int64)
        )
    else:
        toggles = (
            np.fromfile(folder / "toggles.bin", dtype=np.uint32)
            .reshape(found.nets, LANES)[:, :count]
            .astype(np.int64)
        )
    accesses = np.fromfile(folder / "accesses.bin", dtype=np.uint32).reshape(-1, 2, 3, LANES)[
        ..., :count
    ]
    answers = np.loadtxt(folder / "answers.txt", dtype=np.int64, ndmin=2)[:, 1:]
    raw = np.fromfile(folder / "probes.bin", dtype=np.uint32).reshape(-1, 5) if probes else None
    return Activity(toggles, accesses, answers, raw)
