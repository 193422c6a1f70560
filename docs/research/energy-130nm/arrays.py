"""What an access of an array of latches costs, and its area.

The library prices macros, but an array of latches has no file there. So each array is synthesised alone, simulated cycle by
cycle with random reads and writes, and its transitions are priced as those of the core are (:mod:`picojoules`). The search for
a plan of memories (:mod:`plans`) compares the result with macros; it is kept in a file, because synthesis takes minutes.
"""

import hashlib
import json
from dataclasses import dataclass

import gates
import netlist
import numpy as np
import picojoules
import runs
import timing
from latches import GATE, Latches, modules, verilog

CYCLES = 160
"""Cycles that are counted. Chosen by hand."""
LANES = 32
"""Independent random runs at once, one per bit of the integers that :func:`play` computes with."""


@dataclass(frozen=True)
class Costs:
    """What one copy of an array costs.

    ``area``: square micrometres. ``ns``: of the longest path. ``read_pj`` and ``write_pj``: what a cycle with an access takes
    more than a cycle without; ``idle_pj``: a cycle without. Picojoules are those of the upper end: with wires and clock tree.
    """

    area: float
    leakage_nw: float
    ns: float
    read_pj: float
    write_pj: float
    idle_pj: float


def measure(files: "runs.Library", array: Latches) -> Costs:
    """Return what an array costs, from words that are read and written at random; from the kept file if there is one."""
    # The hash of its text is in the folder's name, so an array that is generated differently is measured again.
    text = "".join([GATE, *modules(array).values(), verilog(array)])
    text_hash = hashlib.sha256(text.encode()).hexdigest()[:8]
    folder = (
        runs.KEPT
        / "latches"
        / f"{array.shape.name}-{array.shape.bits}-{len(array.banks)}x{array.rows}-{text_hash}"
    )
    costs_file = folder / "costs.json"
    if not costs_file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "array.sv").write_text(text)
        netlist.synthesise_module(
            folder, f"memory_{array.shape.name}", [folder / "array.sv"], files.folder / runs.CELLS
        )
        circuit = gates.circuit(
            netlist.load(folder / "netlist.json", f"memory_{array.shape.name}"), files.cells, {}
        )
        costs_file.write_text(json.dumps(vars(_measure(files, array, circuit))))
    return Costs(**json.loads(costs_file.read_text()))


def _measure(files: "runs.Library", array: Latches, circuit: gates.Circuit) -> Costs:
    cells = files.cells
    area = sum(cells[instance.type].area for instance in circuit.netlist.instances)
    timings = timing.analyse(circuit, cells, {}, timing.Blocks(files.group, circuit, cells))
    pj = {}
    for name, reads, writes in (("idle", 0.0, 0.0), ("read", 1.0, 0.0), ("write", 0.0, 1.0)):
        toggles = play(circuit, cells, array, reads, writes)
        toggles_of_net = toggles.sum(axis=1)[:, None]
        energy = picojoules.measure(
            circuit,
            cells,
            macros={},
            timing=timings,
            toggles=toggles_of_net,
            cycles=np.array([CYCLES * LANES]),
            accesses=np.zeros((0, 2, 1)),
            tree=True,
        )
        pj[name] = float(energy.total[0]) / (CYCLES * LANES)
    leakage = sum(cells[instance.type].leakage_nw for instance in circuit.netlist.instances)
    return Costs(
        area, leakage, timings.worst, pj["read"] - pj["idle"], pj["write"] - pj["idle"], pj["idle"]
    )


def play(
    circuit: gates.Circuit, cells: dict, array: Latches, reads: float, writes: float
) -> np.ndarray:
    """Return transitions by net, (nets, 1), of :data:`CYCLES` cycles in all lanes together.

    ``reads`` and ``writes``: the share of cycles that read or write a random word. All words are written first, uncounted.
    Like the core's simulator (:mod:`gates`) this one is generated from the netlist: ``v[net]`` is an integer with a bit per
    lane, and ``t[gate]`` the lanes whose gated clock ticks. Here it is Python, as an array is small.
    """
    gate_number = {clock: index for index, clock in enumerate(circuit.gates)}
    lines = []
    for instance in circuit.order:
        cell = cells[instance.type]
        output_net = circuit.at(instance, cell.outputs[0])
        if cell.kind == "latch":
            # A latch takes its data while its gate is open, and else keeps its value.
            data_net, index = circuit.at(instance, "D"), gate_number[circuit.at(instance, "GATE")]
            lines.append(
                f" if t[{index}]: v[{output_net}] = v[{data_net}] & t[{index}] | v[{output_net}] & ~t[{index}]"
            )
        else:
            function = cell.pins[cell.outputs[0]].function
            net_of_pin = {p: f"v[{circuit.at(instance, p)}]" for p in cell.inputs}
            constant = {"0": "0", "1": "ones"}.get(function) or gates.expression(
                function, net_of_pin
            )
            # An inversion of Python also sets all higher bits.
            lines.append(f" v[{output_net}] = ({constant}) & ones")
    ticks = [" & ".join(f"v[{n}]" for n in gates.enable(circuit, clock)) for clock in gate_number]
    scope: dict = {}
    # Functions of 2,000 lines: Python compiles a single long one far more slowly.
    pieces = [lines[i : i + 2000] for i in range(0, len(lines), 2000)]
    for index, piece in enumerate(pieces):
        exec(f"def logic{index}(v, t, ones):\n" + "\n".join(piece), scope)
    exec("def ticks(v):\n return [" + ", ".join(ticks) + "]", scope)
    ones, random = (1 << LANES) - 1, np.random.default_rng(0)
    v, ticking = [0] * circuit.nets, [0] * len(gate_number)
    v[1] = ones  # net 1 is the constant 1
    transitions = np.zeros((circuit.nets, 1), dtype=np.int64)
    clocks = list(gate_number)
    addresses = np.array(array.shape.held)
    values_before = list(v)
    # Cycles before 0 are not counted: every word is written once, then two cycles pass without an access, since what is
    # written reaches its row a cycle later.
    for cycle in range(-len(addresses) - 2, CYCLES):
        filling = cycle < -2
        write_addresses = (
            np.full(LANES, addresses[cycle + 2]) if filling else random.choice(addresses, LANES)
        )
        read_addresses = random.choice(addresses, LANES)
        words = random.integers(0, 2, (array.shape.bits, LANES))
        write_share = 1.0 if filling else 0.0 if cycle < 0 else writes
        values = {
            "write": random.random((1, LANES)) < write_share,
            "read": random.random((1, LANES)) < (reads if cycle >= 0 else 0),
        }
        # In runs without writes (or reads) the lines for them stand still: what they toggle belongs to an access.
        if write_share:
            values |= {
                "write_address": _bits(write_addresses, len(circuit.port("write_address"))),
                "write_data": words,
            }
        if reads:
            values |= {"read_address": _bits(read_addresses, len(circuit.port("read_address")))}
        for name, bits in values.items():
            for net, row in zip(circuit.port(name), bits, strict=True):
                v[net] = int(
                    np.packbits(row.astype(np.uint8), bitorder="little").view(np.uint32)[0]
                )
        for index in range(len(pieces)):
            scope[f"logic{index}"](v, ticking, ones)
        ticking = scope["ticks"](v)
        if cycle >= 0:
            for net, (after, previous) in enumerate(zip(v, values_before, strict=True)):
                if after != previous:
                    transitions[net] += (after ^ previous).bit_count()
            for clock, lanes_on in zip(clocks, ticking, strict=True):
                transitions[clock] += lanes_on.bit_count()
        # Flip-flops take their data together, after the logic has settled: hence two loops.
        values_before = list(v)
        next_outputs = []
        for flop in circuit.flops:
            clock = circuit.at(flop, "CLK")
            data_net, output_net = v[circuit.at(flop, "D")], v[circuit.at(flop, "Q")]
            lanes_on = ticking[gate_number[clock]] if clock in gate_number else ones
            next_outputs.append(
                (circuit.at(flop, "Q"), data_net & lanes_on | output_net & ~lanes_on)
            )
        for net, value in next_outputs:
            v[net] = value
    return transitions


def _bits(values: np.ndarray, width: int) -> np.ndarray:
    """Return the bits of numbers, the lowest first, (width, numbers)."""
    return values[None, :] >> np.arange(width)[:, None] & 1
