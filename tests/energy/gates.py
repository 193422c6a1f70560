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
    logic = [i for i in netlist.instances if i.type in cells and cells[i.type].kind == "logic"]
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
        for pin in cells[instance.type].inputs:
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
    return {name: int(re.findall(rf"\b{name} = (\d)", core)[0]) for name in ("ROW", "UPDATE", "SPIKES")}


def source(found: Circuit, cells: Mapping[str, Cell], macros: Mapping[str, Macro], states: Mapping[str, int]) -> str:
    """Return the simulator in C++; ``states``: those of the sequencer."""
    statements = []
    for instance in found.order:
        cell = cells[instance.type]
        names = {pin: f"v[{found.at(instance, pin)}]" for pin in cell.inputs}
        for pin in cell.outputs:
            if instance.pins.get(pin):
                constant = {"0": "0ull", "1": "~0ull"}.get(cell.pins[pin].function)
                value = constant or expression(cell.pins[pin].function, names)
                statements.append(f"v[{found.at(instance, pin)}]={value};")
    logic = _function("logic", statements)
    # The net of a gated clock changes whenever it ticks.
    ticking = []
    for clock in found.gates:
        on = "&".join(f"v[{n}]" for n in enable(found, clock))
        ticking.append(f"v[{clock}]=p[{clock}]^({on});")
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
        for port in "AB"[: macro.ports]:
            depth = (macro.words - 1).bit_length()
            nets = [found.at(instance, f"{port}_{pin}") for pin in ("MEN", "WEN", "REN")]
            nets += [found.at(instance, f"{port}_ADDR", b) for b in range(depth)]
            data = [found.at(instance, f"{port}_DIN", b) for b in range(macro.bits)]
            masks = [found.at(instance, f"{port}_BM", b) for b in range(macro.bits)] if "_bm_" in macro.name else []
            outs = [
                found.at(instance, f"{port}_DOUT", b) if instance.pins.get(f"{port}_DOUT") else -1
                for b in range(macro.bits)
            ]
            masks = masks or [1] * macro.bits
            ports.append(
                f"{{{number},{macro.words},{macro.bits},{depth},{int(macro.ports == 1)},"
                f"{{{','.join(map(str, nets[:3]))}}},{{{','.join(map(str, nets[3:]))}}},"
                f"{{{','.join(map(str, data))}}},{{{','.join(map(str, masks))}}},{{{','.join(map(str, outs))}}}}}"
            )
        table.append(macro.words * (1 if macro.ports == 1 else LANES))
    constants = {
        "NETS": found.nets, "FLOPS": len(found.flops), "PORTS": len(ports), "MEMORIES": len(found.memories),
        "LANES": LANES, **states,
    }  # fmt: skip
    head = "".join(f"#define {name} {value}\n" for name, value in constants.items())
    head += _HEAD
    arrays = "static const Port ports[PORTS]={" + ",\n".join(ports) + "};\n"
    arrays += f"static const int sizes[MEMORIES]={{{','.join(map(str, table))}}};\n"
    names = ("clk", "reset", "load_valid", "load_memory", "load_address", "load_data", "in_valid", "in_ready", "in_kind",
             "in_channel", "answer_valid", "answer_ready", "answer_class", "answer_synapses", "answer_updates",
             "answer_spikes", "probe_valid", "probe_compartment", "probe_u", "probe_v", "probe_fired")  # fmt: skip
    for name in names:
        nets = found.port(name)
        arrays += (
            f"static const int n_{name}[]={{{','.join(map(str, nets))}}}; static const int w_{name}={len(nets)};\n"
        )
    state = [found.net[bit] for bit in found.netlist.named["state"]]
    arrays += f"static const int n_state[]={{{','.join(map(str, state))}}};\n"
    return head + arrays + logic + _BODY


def _function(name: str, statements: Sequence[str]) -> str:
    """Return a function in pieces that compile fast."""
    chunks = [statements[i : i + 200] for i in range(0, len(statements), 200)]
    pieces = "".join(
        f'__attribute__((noinline,optimize("O1"))) static void {name}{k}(){{{chr(10).join(chunk)}}}\n'
        for k, chunk in enumerate(chunks)
    )
    return pieces + f"static void {name}(){{" + "".join(f"{name}{k}();" for k in range(len(chunks))) + "}\n"


_HEAD = r"""
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>
typedef uint64_t word;
alignas(64) static word v[NETS+8], p[NETS+8];
static word f[FLOPS];
struct Port { int memory, words, bits, depth, shared; int control[3]; int address[13]; int data[64]; int mask[64]; int out[64]; };
"""

_BODY = r"""
static word* store[MEMORIES];
static uint32_t accesses[PORTS][2][3][LANES];
enum { LOW = 6, HIGH = 21 };
alignas(64) static word low[LOW][NETS+8];
static word high[HIGH][NETS+8];
alignas(64) static uint64_t sums[3][NETS+8];
static int pending = 0;
static void flush() {
    for (int n = 0; n < NETS; n++) {
        word carry = 0;
        for (int k = 0; k < LOW; k++) {
            word a = high[k][n], b = low[k][n];
            high[k][n] = a ^ b ^ carry; carry = (a & b) | (carry & (a ^ b)); low[k][n] = 0;
        }
        for (int k = LOW; k < HIGH && carry; k++) { word t = high[k][n] & carry; high[k][n] ^= carry; carry = t; }
    }
    pending = 0;
}
__attribute__((optimize("O3"))) static void count_lanes(word live) {
    word *a = low[0], *b = low[1], *d = low[2], *e = low[3], *g = low[4], *h = low[5];
    for (int n = 0; n < NETS; n++) {
        word x = (v[n] ^ p[n]) & live, t;
        t = a[n] & x; a[n] ^= x; x = t;
        t = b[n] & x; b[n] ^= x; x = t;
        t = d[n] & x; d[n] ^= x; x = t;
        t = e[n] & x; e[n] ^= x; x = t;
        t = g[n] & x; g[n] ^= x; x = t;
        h[n] ^= x;
    }
    if (++pending == 63) flush();
}
static void count_classes(const word* cls) {
    for (int n = 0; n < NETS; n++) {
        const word x = v[n] ^ p[n];
        if (!x) continue;
        for (int c = 0; c < 3; c++) sums[c][n] += __builtin_popcountll(x & cls[c]);
    }
}
static void transpose(word* a) {
    word m = 0x00000000FFFFFFFFull;
    for (int j = 32; j; j >>= 1, m ^= m << j)
        for (int k = 0; k < 64; k = (k + j + 1) & ~j) { word t = ((a[k] >> j) ^ a[k + j]) & m; a[k] ^= t << j; a[k + j] ^= t; }
}
static void gather(const int* nets, int n, word* lanes) {
    for (int b = 0; b < 64; b++) lanes[b] = b < n ? v[nets[b]] : 0;
    transpose(lanes);
}
struct Shown { int port; word lanes, value[64]; };
static std::vector<Shown> shown;
static void access(const word* cls) {
    static word address[64], data[64], mask[64];
    shown.clear();
    for (int k = 0; k < PORTS; k++) {
        const Port& q = ports[k];
        const word on = v[q.control[0]], writes = on & v[q.control[1]], reads = on & v[q.control[2]] & ~writes;
        if (!on) continue;
        gather(q.address, q.depth, address);
        word* at = store[q.memory];
        if (reads) {
            Shown s; s.port = k; s.lanes = reads;
            memset(s.value, 0, sizeof s.value);
            for (word left = reads; left; left &= left - 1) {
                int l = __builtin_ctzll(left);
                s.value[l] = q.shared ? at[address[l]] : at[address[l] * LANES + l];
            }
            transpose(s.value);
            shown.push_back(s);
        }
        for (int c = 0; c < 3; c++) {
            for (word left = reads & cls[c]; left; left &= left - 1) accesses[k][0][c][__builtin_ctzll(left)]++;
            for (word left = writes & cls[c]; left; left &= left - 1) accesses[k][1][c][__builtin_ctzll(left)]++;
        }
    }
    for (int k = 0; k < PORTS; k++) {
        const Port& q = ports[k];
        const word writes = v[q.control[0]] & v[q.control[1]];
        if (!writes) continue;
        gather(q.address, q.depth, address);
        gather(q.data, q.bits, data);
        gather(q.mask, q.bits, mask);
        word* at = store[q.memory];
        for (word left = writes; left; left &= left - 1) {
            int l = __builtin_ctzll(left);
            word* place = q.shared ? at + address[l] : at + address[l] * LANES + l;
            *place = (*place & ~mask[l]) | (data[l] & mask[l]);
        }
    }
}
static void show() {
    for (auto& s : shown) for (int b = 0; b < ports[s.port].bits; b++) {
        int n = ports[s.port].out[b];
        if (n >= 0) v[n] = (v[n] & ~s.lanes) | (s.value[b] & s.lanes);
    }
}
static void put(const int* nets, int n, word value) { for (int b = 0; b < n; b++) v[nets[b]] = (value >> b & 1) ? ~0ull : 0; }
int main(int argc, char** argv) {
    const long most = argc > 1 ? atol(argv[1]) : 1000000;
    const int dump = argc > 2 ? atoi(argv[2]) : 0, by_class = argc > 3 ? atoi(argv[3]) : 0;
    for (int m = 0; m < MEMORIES; m++) store[m] = (word*)calloc(sizes[m], sizeof(word));
    std::vector<std::vector<uint32_t>> words(LANES);
    FILE* g = fopen("words.bin", "rb");
    uint32_t pair[2];
    while (fread(pair, 4, 2, g) == 2) words[pair[0]].push_back(pair[1]);
    fclose(g);
    word used = 0;
    for (int l = 0; l < LANES; l++) if (words[l].size()) used |= 1ull << l;
    v[1] = ~0ull;
    std::vector<word> load;  // three words a row: data low, data high, address and memory
    g = fopen("load.bin", "rb");
    word row[3];
    while (fread(row, 8, 3, g) == 3) load.insert(load.end(), row, row + 3);
    fclose(g);
    FILE* probes = dump ? fopen("probes.bin", "wb") : 0;
    const word none[3] = {0, 0, 0};
    v[n_answer_ready[0]] = ~0ull;
    size_t at_load = 0;
    std::vector<size_t> at(LANES, 0);
    word finished = ~used, begun = 0;
    uint32_t cycles[LANES][3] = {}, first[LANES] = {}, answered[LANES] = {}, winner[LANES] = {}, synapses[LANES] = {}, spikes[LANES] = {};
    for (long cycle = 0; cycle < most && ~finished; cycle++) {
        v[n_reset[0]] = cycle < 4 ? ~0ull : 0;
        bool loading = cycle >= 4 && at_load < load.size();
        v[n_load_valid[0]] = loading ? ~0ull : 0;
        if (loading) {
            for (int b = 0; b < w_load_data; b++) v[n_load_data[b]] = (load[at_load + b / 64] >> (b % 64) & 1) ? ~0ull : 0;
            put(n_load_address, w_load_address, load[at_load + 2]);
            put(n_load_memory, w_load_memory, load[at_load + 2] >> 24);
            at_load += 3;
        }
        bool playing = cycle >= 4 && !loading;
        if (playing) {
            word valid = 0, kind[2] = {0, 0}, channel[64] = {};
            for (int l = 0; l < LANES; l++) if (at[l] < words[l].size()) {
                uint32_t w = words[l][at[l]];
                valid |= 1ull << l; kind[0] |= (word)(w >> 16 & 1) << l; kind[1] |= (word)(w >> 17 & 1) << l; channel[l] = w & 0xffff;
            }
            transpose(channel);
            // A host that has nothing to say leaves its lines as they are.
            v[n_in_valid[0]] = valid;
            for (int b = 0; b < 2; b++) v[n_in_kind[b]] = (v[n_in_kind[b]] & ~valid) | (kind[b] & valid);
            for (int b = 0; b < 16; b++) v[n_in_channel[b]] = (v[n_in_channel[b]] & ~valid) | (channel[b] & valid);
        }
        logic();
        word s0 = v[n_state[0]], s1 = v[n_state[1]], s2 = v[n_state[2]];
#define IS(k) (((k) & 1 ? s0 : ~s0) & ((k) & 2 ? s1 : ~s1) & ((k) & 4 ? s2 : ~s2))
        word update = IS(UPDATE), deliver = IS(ROW) | IS(SPIKES);
        word live = playing ? ~finished : 0;
        word cls[3] = {deliver & live, update & live, ~deliver & ~update & live};
        ticking();
        if (playing && by_class) count_classes(cls);
        if (playing && !by_class) count_lanes(live);
        memcpy(p, v, sizeof v);
        for (int c = 0; c < 3; c++) for (word left = cls[c]; left; left &= left - 1) cycles[__builtin_ctzll(left)][c]++;
        if (playing) {
            word taken = v[n_in_valid[0]] & v[n_in_ready[0]];
            for (word left = taken; left; left &= left - 1) {
                int l = __builtin_ctzll(left);
                if (!(begun >> l & 1)) first[l] = cycle;
                at[l]++;
            }
            begun |= taken;
            if (probes && (v[n_probe_valid[0]] & live)) {
                static word u[64], w[64], number[64];
                gather(n_probe_u, 24, u); gather(n_probe_v, 24, w); gather(n_probe_compartment, w_probe_compartment, number);
                for (word left = v[n_probe_valid[0]] & live; left; left &= left - 1) {
                    int l = __builtin_ctzll(left);
                    uint32_t one[5] = {(uint32_t)l, (uint32_t)number[l], (uint32_t)u[l], (uint32_t)w[l], (uint32_t)(v[n_probe_fired[0]] >> l & 1)};
                    fwrite(one, 4, 5, probes);
                }
            }
            word over = v[n_answer_valid[0]] & ~finished;
            if (over) {
                static word a[64], b[64], c[64];
                gather(n_answer_class, 16, a); gather(n_answer_synapses, 32, b); gather(n_answer_spikes, 32, c);
                for (word left = over; left; left &= left - 1) {
                    int l = __builtin_ctzll(left);
                    answered[l] = cycle - first[l]; winner[l] = a[l]; synapses[l] = b[l]; spikes[l] = c[l];
                }
                finished |= over;
            }
        }
        access(cls);
        follow();
        show();
        commit();
    }
    flush();
    if (probes) fclose(probes);
    g = fopen("answers.txt", "w");
    for (int l = 0; l < LANES; l++) if (used >> l & 1)
        fprintf(g, "%d %u %u %u %u %u %u %u\n", l, winner[l], answered[l], synapses[l], spikes[l], cycles[l][0], cycles[l][1], cycles[l][2]);
    fclose(g);
    g = fopen("accesses.bin", "wb"); fwrite(accesses, sizeof accesses, 1, g); fclose(g);
    g = fopen("toggles.bin", "wb");
    std::vector<uint32_t> out(LANES);
    if (by_class) for (int c = 0; c < 3; c++) fwrite(sums[c], 8, NETS, g);
    else for (int n = 0; n < NETS; n++) {
        word plane[64] = {};
        for (int k = 0; k < HIGH; k++) plane[k] = high[k][n];
        transpose(plane);
        for (int l = 0; l < LANES; l++) out[l] = plane[l];
        fwrite(out.data(), 4, LANES, g);
    }
    fclose(g);
    return (~finished) ? 3 : 0;
}
"""


@dataclass
class Activity:
    """What happened: ``toggles`` (nets, recordings), or (nets, classes) of all recordings together.

    ``accesses`` (ports, read or write, classes, recordings).

    ``answers`` (recordings, 7): class, cycles from the first word, synapses, spikes, cycles by class. ``probes``: every
    update, (rows, 5): recording, compartment, u, v, fired.
    """

    toggles: np.ndarray
    accesses: np.ndarray
    answers: np.ndarray
    probes: np.ndarray | None


def build(folder: Path, text: str) -> Path:
    """Compile the simulator."""
    (folder / "gates.cpp").write_text(text)
    binary = folder / "gates"
    subprocess.run(["g++", "-O2", "-march=native", "-o", str(binary), "gates.cpp"], cwd=folder, check=True)
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
        [str(binary.resolve()), "2000000", str(int(probes)), str(int(by_class))], cwd=folder, check=False
    )
    assert done.returncode == 0, "recordings without an answer"
    count = len(words)
    if by_class:
        toggles = np.fromfile(folder / "toggles.bin", dtype=np.uint64).reshape(3, found.nets).T.astype(np.int64)
    else:
        toggles = (
            np.fromfile(folder / "toggles.bin", dtype=np.uint32).reshape(found.nets, LANES)[:, :count].astype(np.int64)
        )
    accesses = np.fromfile(folder / "accesses.bin", dtype=np.uint32).reshape(-1, 2, 3, LANES)[..., :count]
    answers = np.loadtxt(folder / "answers.txt", dtype=np.int64, ndmin=2)[:, 1:]
    raw = np.fromfile(folder / "probes.bin", dtype=np.uint32).reshape(-1, 5) if probes else None
    return Activity(toggles, accesses, answers, raw)
