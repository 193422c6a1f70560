"""A netlist simulated gate by gate, 64 recordings at a time: bit i of a machine word belongs to recording i (its *lane*).

:func:`source` generates the simulator as C++ from the netlist and the functions of the liberty file, around the main loop in
``gates.cpp``. Logic is sorted by levels and has no delays: a net changes at most once per cycle, so what a real circuit does
before it settles (glitches) is not counted. Every transition of every net is counted, by recording or by what the core was
doing (:data:`CLASSES`); :mod:`picojoules` multiplies the counts with energies.
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
MOST_CYCLES = 2_000_000
"""After so many, the simulator gives up. A recording of the largest network takes about 200,000."""
CLASSES = ("deliver", "update", "other")
"""Cycles of delivering spikes, of updating compartments, and all others (cleaning, readout, answer)."""


@dataclass
class Circuit:
    """A netlist whose nets are numbered, and whose instances are sorted by kind.

    ``net``: the number of each net of the netlist; 0 and 1 are the constants. ``order``: logic and latches, each after the
    instances that it depends on. ``gates``: the clock gate of each gated clock, by the number of the clock's net.
    ``driver``: the instance and pin that drive a net, by its number.
    """

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
    # The first free number is that of different numbers so far: "0", "x" and "z" share number 0.
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
    # Sort by levels: an instance is ready once all instances that drive its inputs are in the order. Flip-flops and memories
    # are no part of this, because their outputs change only at the end of a cycle.
    waiting = {id(i): 0 for i in logic}
    readers_of: dict[int, list[Instance]] = {}
    driver_in_logic = {n: i for n, (i, _) in driver.items() if id(i) in waiting}
    for instance in logic:
        for pin in followed(cells[instance.type]):
            input_net = net[instance.pins[pin][0]]
            if input_net in driver_in_logic:
                waiting[id(instance)] += 1
                readers_of.setdefault(input_net, []).append(instance)
    ready = [i for i in logic if not waiting[id(i)]]
    order = []
    while ready:
        next_ready = []
        for instance in ready:
            order.append(instance)
            for pin in cells[instance.type].outputs:
                for bit in instance.pins.get(pin, []):
                    for reader in readers_of.get(net[bit], []):
                        waiting[id(reader)] -= 1
                        if not waiting[id(reader)]:
                            next_ready.append(reader)
        ready = next_ready
    assert len(order) == len(logic), "a loop of logic"
    gate_of_clock = {net[g.pins["GCLK"][0]]: g for g in gates}
    return Circuit(netlist, net, order, flops, memories, gate_of_clock, driver)


def followed(cell: Cell) -> list[str]:
    """Return the pins whose value an output has within a cycle: of a latch, its data."""
    return ["D"] if cell.kind == "latch" else cell.inputs


def enable(found: Circuit, clock: int) -> list[int]:
    """Return the nets that must be 1 for a clock to tick; an empty list for a clock that always ticks.

    Gates may follow each other, so the conditions of the clock before the gate are added.
    """
    gate = found.gates.get(clock)
    return [] if gate is None else [found.at(gate, "GATE"), *enable(found, found.at(gate, "CLK"))]


def expression(function: str, names: Mapping[str, str]) -> str:
    """Return a liberty function (``!``, ``*`` and ``+`` for not, and, or) in C, with nets for its pins."""
    text = function.replace("!", "~").replace("*", "&").replace("+", "|")
    return re.sub(r"[A-Za-z_]\w*", lambda found: names[found.group()], text)


def states_of(core: str) -> dict[str, int]:
    """Return the numbers of the sequencer's states in which spikes are delivered or compartments updated.

    They are read from the text of ``locsnn_core.sv``. ``gates.cpp`` tells by them to which of :data:`CLASSES` a cycle belongs.
    """
    return {
        name: int(re.findall(rf"\b{name} = (\d)", core)[0]) for name in ("ROW", "UPDATE", "SPIKES")
    }


def source(
    found: Circuit,
    cells: Mapping[str, Cell],
    macros: Mapping[str, Macro],
    states: Mapping[str, int],
) -> str:
    """Return the simulator in C++; ``states``: those of :func:`states_of`.

    In the generated text ``v[net]`` is the value of a net, ``p[net]`` its value a cycle ago, ``t[gate]`` whether a gated clock
    ticks, and ``f[flop]`` what a flip-flop takes next. A cycle calls ``logic``, ``ticking``, ``follow`` and ``commit``.
    """
    before_circuit, after_circuit = (
        (Path(__file__).parent / "gates.cpp")
        .read_text()
        .split("// The circuit: ports, nets and logic.\n")
    )
    ports, store_words = _memory_ports(found, macros)
    constants = {
        "NETS": found.nets, "FLOPS": len(found.flops), "PORTS": len(ports), "MEMORIES": len(found.memories),
        "GATES": len(found.gates), "LANES": LANES, **states,
    }  # fmt: skip
    defines = "".join(f"#define {name} {value}\n" for name, value in constants.items())
    tables = "static const Port ports[PORTS]={" + ",\n".join(ports) + "};\n"
    tables += f"static const int sizes[MEMORIES]={{{','.join(map(str, store_words))}}};\n"
    return "".join(
        (
            defines,
            before_circuit,
            tables,
            _net_tables(found),
            _logic(found, cells),
            _clock_gates(found),
            _flip_flops(found),
            after_circuit,
        )
    )


def _gate_numbers(found: Circuit) -> dict[int, int]:
    """Return the index in ``t`` of each gated clock, by its net."""
    return {clock: index for index, clock in enumerate(found.gates)}


def _logic(found: Circuit, cells: Mapping[str, Cell]) -> str:
    """Return the function that computes all logic and latches, in their order."""
    gate_number = _gate_numbers(found)
    statements = []
    for instance in found.order:
        cell = cells[instance.type]
        if cell.kind == "latch":
            # It follows its data if its gate opened at the last edge.
            output = found.at(instance, "Q")
            data = found.at(instance, "D")
            gate = gate_number[found.at(instance, "GATE")]
            statements.append(f"v[{output}]=(v[{data}]&t[{gate}])|(v[{output}]&~t[{gate}]);")
            continue
        net_of_pin = {pin: f"v[{found.at(instance, pin)}]" for pin in cell.inputs}
        for pin in cell.outputs:
            if instance.pins.get(pin):
                constant = {"0": "0ull", "1": "~0ull"}.get(cell.pins[pin].function)
                value = constant or expression(cell.pins[pin].function, net_of_pin)
                statements.append(f"v[{found.at(instance, pin)}]={value};")
    return _function("logic", statements)


def _clock_gates(found: Circuit) -> str:
    """Return the function that says which gated clocks tick."""
    statements = []
    for clock, gate in _gate_numbers(found).items():
        enabled = "&".join(f"v[{net}]" for net in enable(found, clock))
        # The net of a gated clock changes whenever it ticks, so that ticks are counted as its transitions.
        statements.append(f"t[{gate}]={enabled};v[{clock}]=p[{clock}]^t[{gate}];")
    return _function("ticking", statements)


def _flip_flops(found: Circuit) -> str:
    """Return the functions that compute what all flip-flops take, and that let them take it.

    They are two, because a flip-flop may read the output of another one as it was before the edge.
    """
    take, commit = [], []
    for index, flop in enumerate(found.flops):
        data, output = found.at(flop, "D"), found.at(flop, "Q")
        value = f"v[{data}]"
        enable_nets = enable(found, found.at(flop, "CLK"))
        if enable_nets:
            enabled = "&".join(f"v[{net}]" for net in enable_nets)
            value = f"(v[{data}]&({enabled}))|(v[{output}]&~({enabled}))"
        take.append(f"f[{index}]={value};")
        commit.append(f"v[{output}]=f[{index}];")
        if flop.pins.get("Q_N"):
            commit.append(f"v[{found.at(flop, 'Q_N')}]=~f[{index}];")
    return _function("follow", take) + _function("commit", commit)


def _memory_ports(found: Circuit, macros: Mapping[str, Macro]) -> tuple[list[str], list[int]]:
    """Return a ``Port`` of ``gates.cpp`` for each port of each macro, and the words that each macro is stored in."""
    gate_number = _gate_numbers(found)
    ports, store_words = [], []
    for memory, instance in enumerate(found.memories):
        macro = macros[instance.type]
        name = instance.name.replace("\\", "").split(".")[-2]
        # A memory that is only written while it is loaded holds the same for all recordings, so it is stored once.
        shared = macro.ports == 1 and name not in HALVES
        for port in "AB"[: macro.ports]:
            depth = (macro.words - 1).bit_length()
            clock = gate_number.get(found.at(instance, f"{port}_CLK"), -1)
            control = [found.at(instance, f"{port}_{pin}") for pin in ("MEN", "WEN", "REN")]
            address = [found.at(instance, f"{port}_ADDR", bit) for bit in range(depth)]
            data = [found.at(instance, f"{port}_DIN", bit) for bit in range(macro.bits)]
            masks = [1] * macro.bits  # net 1 is the constant 1: every bit is written
            if "_bm_" in macro.name:
                masks = [found.at(instance, f"{port}_BM", bit) for bit in range(macro.bits)]
            outputs = [-1] * macro.bits  # nobody reads this port
            if instance.pins.get(f"{port}_DOUT"):
                outputs = [found.at(instance, f"{port}_DOUT", bit) for bit in range(macro.bits)]
            numbers = f"{memory},{macro.words},{macro.bits},{depth},{int(shared)},{clock}"
            nets = ",".join(
                f"{{{','.join(map(str, row))}}}" for row in (control, address, data, masks, outputs)
            )
            ports.append(f"{{{numbers},{nets}}}")
        store_words.append(macro.words * (1 if shared else LANES))
    return ports, store_words


PORTS = (
    "clk", "reset", "load_valid", "load_memory", "load_address", "load_data", "in_valid", "in_ready", "in_kind",
    "in_channel", "answer_valid", "answer_ready", "answer_class", "answer_synapses", "answer_updates",
    "answer_spikes", "probe_valid", "probe_compartment", "probe_u", "probe_v", "probe_fired",
)  # fmt: skip
"""Ports of the core that ``gates.cpp`` drives or reads."""


def _net_tables(found: Circuit) -> str:
    """Return the nets of each port, ``n_PORT``, and its width, ``w_PORT``; and the nets of the sequencer's state."""
    text = ""
    for name in PORTS:
        nets = found.port(name)
        text += f"static const int n_{name}[]={{{','.join(map(str, nets))}}}; static const int w_{name}={len(nets)};\n"
    state = [found.net[bit] for bit in found.netlist.named["state"]]
    return text + f"static const int n_state[]={{{','.join(map(str, state))}}};\n"


def _function(name: str, statements: Sequence[str]) -> str:
    """Return a C++ function without arguments, in pieces of 200 statements: a compiler takes far longer for a single long one."""
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
    """What happened in a netlist while it played recordings.

    ``toggles``: transitions, (nets, recordings), or (nets, classes) of all recordings together.
    ``accesses``: (ports, read or write, classes, recordings).
    ``answers``: (recordings, 7): class, cycles from the first word, synapses, spikes, cycles by class.
    ``probes``: every update, (rows, 5): recording, compartment, u, v, fired.
    ``whole``: the activity that this is a part of, with the first and the end of its recordings there.
    """

    toggles: np.ndarray
    accesses: np.ndarray
    answers: np.ndarray
    probes: np.ndarray | None
    whole: "tuple[Activity, int, int] | None" = None

    def part(self, begin: int, end: int) -> "Activity":
        """Return the activity of some of the recordings, which are then numbered from 0."""
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
    """Play recordings, at most 64, and return what happened.

    ``load``: the words that load a program into the core, (rows, 160) of bits; ``words``: the words of every recording.
    ``probes``: record every update. ``by_class``: count transitions by class of cycle instead of by recording.
    """
    assert len(words) <= LANES
    # gates.cpp reads a row as three words of 64 bits.
    packed = np.zeros((len(load), 192), dtype=np.uint8)
    packed[:, : load.shape[1]] = load
    np.packbits(packed, axis=1, bitorder="little").tofile(folder / "load.bin")
    lane_words = [
        (lane, word) for lane, recording_words in enumerate(words) for word in recording_words
    ]
    np.array(lane_words, dtype=np.uint32).tofile(folder / "words.bin")
    process = subprocess.run(
        [str(binary.resolve()), str(MOST_CYCLES), str(int(probes)), str(int(by_class))],
        cwd=folder,
        check=False,
    )
    assert process.returncode == 0, "recordings without an answer"
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
    probe_rows = (
        np.fromfile(folder / "probes.bin", dtype=np.uint32).reshape(-1, 5) if probes else None
    )
    return Activity(toggles, accesses, answers, probe_rows)
