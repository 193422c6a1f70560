"""What an access of an array of latches costs, and its area: mapped to cells by itself and played to, like the core."""

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

CYCLES, LANES = 160, 32


@dataclass(frozen=True)
class Costs:
    """Square micrometres of one copy, nanowatts, nanoseconds of the longest path; picojoules at the upper end."""

    area: float
    leakage_nw: float
    ns: float
    read_pj: float
    write_pj: float
    idle_pj: float


def measure(files: "runs.Library", made: Latches) -> Costs:
    """Return what an array costs, from words that are read and written at random."""
    text = "".join([GATE, *modules(made).values(), verilog(made)])
    named = hashlib.sha256(text.encode()).hexdigest()[:8]
    folder = (
        runs.KEPT
        / "latches"
        / f"{made.shape.name}-{made.shape.bits}-{len(made.banks)}x{made.rows}-{named}"
    )
    kept = folder / "costs.json"
    if not kept.exists():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "array.sv").write_text(text)
        netlist.synthesise_module(
            folder, f"memory_{made.shape.name}", [folder / "array.sv"], files.folder / runs.CELLS
        )
        found = gates.circuit(
            netlist.load(folder / "netlist.json", f"memory_{made.shape.name}"), files.cells, {}
        )
        kept.write_text(json.dumps(vars(_measure(files, made, found))))
    return Costs(**json.loads(kept.read_text()))


def _measure(files: "runs.Library", made: Latches, found: gates.Circuit) -> Costs:
    cells = files.cells
    area = sum(cells[i.type].area for i in found.netlist.instances)
    times = timing.analyse(found, cells, {}, timing.Blocks(files.group, found, cells))
    pj = {}
    for name, reads, writes in (("idle", 0.0, 0.0), ("read", 1.0, 0.0), ("write", 0.0, 1.0)):
        toggles = play(found, cells, made, reads, writes)
        columns = toggles.sum(axis=1)[:, None]
        spent = picojoules.measure(
            found, cells, {}, times, columns, np.array([CYCLES * LANES]), np.zeros((0, 2, 1)), True
        )
        pj[name] = float(spent.total[0]) / (CYCLES * LANES)
    leakage = sum(cells[i.type].leakage_nw for i in found.netlist.instances)
    return Costs(
        area, leakage, times.worst, pj["read"] - pj["idle"], pj["write"] - pj["idle"], pj["idle"]
    )


def play(
    found: gates.Circuit, cells: dict, made: Latches, reads: float, writes: float
) -> np.ndarray:
    """Return transitions by net and lane: a share of cycles reads and one writes, after all words were written."""
    number = {clock: k for k, clock in enumerate(found.gates)}
    lines = []
    for instance in found.order:
        cell = cells[instance.type]
        q = found.at(instance, cell.outputs[0])
        if cell.kind == "latch":
            d, k = found.at(instance, "D"), number[found.at(instance, "GATE")]
            lines.append(f" if t[{k}]: v[{q}] = v[{d}] & t[{k}] | v[{q}] & ~t[{k}]")
        else:
            function = cell.pins[cell.outputs[0]].function
            names = {p: f"v[{found.at(instance, p)}]" for p in cell.inputs}
            text = {"0": "0", "1": "ones"}.get(function) or gates.expression(function, names)
            lines.append(f" v[{q}] = ({text}) & ones")
    ticks = [" & ".join(f"v[{n}]" for n in gates.enable(found, clock)) for clock in number]
    scope: dict = {}
    pieces = [lines[i : i + 2000] for i in range(0, len(lines), 2000)]
    for k, piece in enumerate(pieces):
        exec(f"def logic{k}(v, t, ones):\n" + "\n".join(piece), scope)
    exec("def ticks(v):\n return [" + ", ".join(ticks) + "]", scope)
    ones, rng = (1 << LANES) - 1, np.random.default_rng(0)
    v, t = [0] * found.nets, [0] * len(number)
    v[1] = ones
    count = np.zeros((found.nets, 1), dtype=np.int64)
    clocks = list(number)
    held = np.array(made.shape.held)
    before = list(v)
    for cycle in range(-len(held) - 2, CYCLES):
        filling = cycle < -2
        a = np.full(LANES, held[cycle + 2]) if filling else rng.choice(held, LANES)
        b = rng.choice(held, LANES)
        data = rng.integers(0, 2, (made.shape.bits, LANES))
        wanted = 1.0 if filling else 0.0 if cycle < 0 else writes
        values = {
            "write": rng.random((1, LANES)) < wanted,
            "read": rng.random((1, LANES)) < (reads if cycle >= 0 else 0),
        }
        if wanted:
            values |= {
                "write_address": _bits(a, len(found.port("write_address"))),
                "write_data": data,
            }
        if reads:
            values |= {"read_address": _bits(b, len(found.port("read_address")))}
        for name, bits in values.items():
            for net, row in zip(found.port(name), bits, strict=True):
                v[net] = int(
                    np.packbits(row.astype(np.uint8), bitorder="little").view(np.uint32)[0]
                )
        for k in range(len(pieces)):
            scope[f"logic{k}"](v, t, ones)
        t = scope["ticks"](v)
        if cycle >= 0:
            for net, (x, y) in enumerate(zip(v, before, strict=True)):
                if x != y:
                    count[net] += (x ^ y).bit_count()
            for clock, on in zip(clocks, t, strict=True):
                count[clock] += on.bit_count()
        before = list(v)
        following = []
        for flop in found.flops:
            clock = found.at(flop, "CLK")
            d, q = v[found.at(flop, "D")], v[found.at(flop, "Q")]
            on = t[number[clock]] if clock in number else ones
            following.append((found.at(flop, "Q"), d & on | q & ~on))
        for net, value in following:
            v[net] = value
    return count


def _bits(values: np.ndarray, width: int) -> np.ndarray:
    return values[None, :] >> np.arange(width)[:, None] & 1
