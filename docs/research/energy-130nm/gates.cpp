// The main loop of the gate-level simulator. gates.py writes #defines before this file, and in place of the line below that begins
// "The circuit" it writes the tables of ports and nets and the functions logic(), ticking(), follow() and commit().
//
// A word holds one net for 64 recordings: bit l is recording l (its lane). So all recordings run in lockstep, and a lane that
// has its answer is left out of the counts (`live`).
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>
typedef uint64_t word;
alignas(64) static word v[NETS+8], p[NETS+8];  // nets now, and in the cycle before; 8 more for vectors at the end
static word f[FLOPS], t[GATES+1];              // what flip-flops take next; which gated clocks tick
// A port of a memory macro, with the nets of its pins; clock -1: it is not gated. shared: all lanes read the same words.
struct Port { int memory, words, bits, depth, shared, clock; int control[3]; int address[13]; int data[64]; int mask[64]; int out[64]; };
// The circuit: ports, nets and logic.
static word* store[MEMORIES];
static uint32_t accesses[PORTS][2][3][LANES];
// Transitions by lane are counted by bits: plane k of a counter holds bit k of the counts of 64 lanes. A cycle adds a word to
// counters of LOW bits, which full adders of words do in a few operations. Before these can overflow, after 2^LOW - 1 = 63
// cycles, they are added to counters of HIGH bits (2^21 is more than the 2,000,000 cycles that a run may take).
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
// Counts transitions of all lanes together, by class of the cycle.
static void count_classes(const word* cls) {
    for (int n = 0; n < NETS; n++) {
        const word x = v[n] ^ p[n];
        if (!x) continue;
        for (int c = 0; c < 3; c++) sums[c][n] += __builtin_popcountll(x & cls[c]);
    }
}
// Transposes a matrix of 64 x 64 bits in place (Hacker's Delight, 7-3): from a word per net to a word per lane, or back.
static void transpose(word* a) {
    word m = 0x00000000FFFFFFFFull;
    for (int j = 32; j; j >>= 1, m ^= m << j)
        for (int k = 0; k < 64; k = (k + j + 1) & ~j) { word t = ((a[k] >> j) ^ a[k + j]) & m; a[k] ^= t << j; a[k + j] ^= t; }
}
// The number that n nets show, lowest bit first, of every lane.
static void gather(const int* nets, int n, word* lanes) {
    for (int b = 0; b < 64; b++) lanes[b] = b < n ? v[nets[b]] : 0;
    transpose(lanes);
}
// What a read puts on the outputs of a port; show() does it after the flip-flops have taken their data, as a macro answers
// after the clock edge.
struct Shown { int port; word lanes, value[64]; };
static std::vector<Shown> shown;
// Where the clock of a macro stands still, nothing is read or written.
static word ticks(const Port& q) { return q.clock < 0 ? ~0ull : t[q.clock]; }
// Reads, then writes, of all macros. All ports read before any writes, so a read gives what a word held before the edge.
static void access(const word* cls) {
    static word address[64], data[64], mask[64];
    shown.clear();
    for (int k = 0; k < PORTS; k++) {
        const Port& q = ports[k];
        const word on = v[q.control[0]] & ticks(q), writes = on & v[q.control[1]], reads = on & v[q.control[2]] & ~writes;
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
        const word writes = v[q.control[0]] & v[q.control[1]] & ticks(q);
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
// The same number on the nets of a port in all lanes.
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
    // A run: four cycles of reset, then all load words, the same in all lanes, then the recordings.
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
        // The logic settles; the state of the sequencer then says what kind of cycle this is (classes of gates.py).
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
        // The clock edge: memories are accessed and flip-flops take their data, both as nets were before the edge.
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
    return (~finished) ? 3 : 0;  // 3: a recording has no answer
}
