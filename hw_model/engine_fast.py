"""The fast engine: one compiled, event-driven loop over a phase flattened to arrays. The same integers, always."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt

from hw_model.fixed_point import DECAY_BITS, DECAY_ONE, IntArray, effective_weight
from hw_model.program import ChipProgram
from hw_model.trace import EVENTS, ByteArray, Kind, PhaseInput, PhaseTrace, Window

REGISTERS: tuple[Kind, ...] = ("u", "v", "potential")


def run_phase(program: ChipProgram, phase: str, played: PhaseInput, windows: dict[Kind, Window]) -> PhaseTrace:
    """Run one recording through one phase; keep of the registers what the windows ask for."""
    flat = flatten(program, phase)
    lines = np.concatenate([played.lines[item.name] for item in program.inputs_of(phase)], axis=1)
    steps, n = played.steps, len(flat.decay_u)
    rows, event_line = np.nonzero(lines)
    event_start = np.searchsorted(rows, np.arange(steps + 1))
    spikes = np.zeros((steps, n), dtype=np.uint8)
    active = np.zeros((steps, flat.cores), dtype=np.int64)
    events = np.zeros((len(EVENTS), n), dtype=np.int64)
    unasked = Window(np.empty(0, dtype=np.int64), 0, 0)
    u, v, potential = (windows.get(kind, unasked) for kind in REGISTERS)
    u_kept, v_kept, potential_kept = u.empty(), v.empty(), potential.empty()
    _run(
        flat.decay_u, flat.decay_v, flat.threshold, flat.bias, flat.refractory, flat.vmin, flat.vmax, flat.spiking,
        flat.parent, flat.core, flat.list_start, flat.target, flat.weight, flat.delay,
        event_start, event_line, flat.lines,
        1 << program.chip.registers.charge_bits, 1 << program.chip.registers.current_bits,
        np.zeros((int(flat.delay.max(initial=0)) + 2, n), dtype=np.int64),
        spikes, active, events,
        u.columns, u.start, u_kept, v.columns, v.start, v_kept, potential.columns, potential.start, potential_kept,
    )  # fmt: skip
    kept = dict(zip(REGISTERS, (u_kept, v_kept, potential_kept), strict=True))
    return PhaseTrace(spikes, active, events, {kind: kept[kind] for kind in windows})


@dataclass(frozen=True, eq=False)
class FlatPhase:
    """A phase without cores: compartment parameters (n,), and synapses by source.

    Sources are the ``lines`` input lines, then the compartments; the synapses of source s are rows
    ``list_start[s]..list_start[s + 1]``.
    """

    lines: int
    cores: int
    decay_u: IntArray
    decay_v: IntArray
    threshold: IntArray
    bias: IntArray
    refractory: IntArray
    vmin: IntArray
    vmax: IntArray
    spiking: npt.NDArray[np.bool_]
    parent: IntArray
    core: IntArray
    list_start: IntArray
    target: IntArray
    weight: IntArray
    delay: IntArray


@lru_cache(maxsize=8)
def flatten(program: ChipProgram, phase: str) -> FlatPhase:
    """Follow every axon to its synapse list and lay the lists out by source. Programs are hashed by identity."""
    cores = program.cores_of(phase)
    first = np.full(len(program.cores), -1, dtype=np.int64)
    count = 0
    for core in cores:
        first[core.number] = count
        count += core.compartments

    inputs = program.inputs_of(phase)
    line_first = np.cumsum([0, *(item.size for item in inputs)])
    lines = int(line_first[-1])
    routes = [program.route_of(item.name) for item in inputs]
    source = np.concatenate(
        [r.line + at for r, at in zip(routes, line_first[:-1], strict=True)]
        + [core.axons.out_compartment + first[core.number] + lines for core in cores]
    )
    to_core = np.concatenate([r.core for r in routes] + [core.axons.out_core for core in cores])
    to_axon = np.concatenate([r.axon for r in routes] + [core.axons.out_axon for core in cores])

    columns = []
    for core in cores:
        axons = core.axons
        source_of_axon = np.full(axons.input_axons, -1, dtype=np.int64)
        mine = to_core == core.number
        source_of_axon[to_axon[mine]] = source[mine]
        exponents = np.array([form.exponent for form in axons.formats], dtype=np.int64)
        weight = effective_weight(axons.mantissa, exponents[axons.format_index])
        by_synapse = np.repeat(source_of_axon, np.diff(axons.list_start))
        columns.append((by_synapse, axons.target + first[core.number], weight, axons.delay))
    by_synapse, target, weight, delay = (np.concatenate(column) for column in zip(*columns, strict=True))
    order = np.argsort(by_synapse, kind="stable")
    parents = [np.where(core.parent < 0, -1, core.parent + first[core.number]) for core in cores]
    sizes = [core.compartments for core in cores]
    return FlatPhase(
        lines=lines,
        cores=len(cores),
        decay_u=np.concatenate([core.setting("decay_u") for core in cores]),
        decay_v=np.concatenate([core.setting("decay_v") for core in cores]),
        threshold=np.concatenate([core.threshold_voltage for core in cores]),
        bias=np.concatenate([core.bias for core in cores]),
        refractory=np.concatenate([core.setting("refractory") for core in cores]),
        vmin=np.repeat([core.vmin for core in cores], sizes),
        vmax=np.repeat([core.vmax for core in cores], sizes),
        spiking=np.concatenate([core.setting("joined") == 0 for core in cores]),
        parent=np.concatenate(parents),
        core=np.repeat(np.arange(len(cores)), sizes),
        list_start=np.searchsorted(by_synapse[order], np.arange(lines + count + 1)),
        target=target[order],
        weight=weight[order],
        delay=delay[order],
    )


@numba.njit(cache=True, nogil=True, inline="always")  # type: ignore[untyped-decorator]
def _decay(x: int, d: int) -> int:
    """Return sign(x) * ((|x| * (4096 - d)) >> 12)."""
    left = (abs(x) * (DECAY_ONE - d)) >> DECAY_BITS
    return left if x >= 0 else -left


@numba.njit(cache=True, nogil=True, inline="always")  # type: ignore[untyped-decorator]
def _wrap(x: int, half: int) -> int:
    """Return x in two's complement of range -half..half - 1."""
    return ((x + half) & (2 * half - 1)) - half


@numba.njit(cache=True, nogil=True, inline="always")  # type: ignore[untyped-decorator]
def _keep(register: IntArray, columns: IntArray, row: int, kept: IntArray) -> None:
    """Copy the columns of a register to a row of what is kept, if that has such a row."""
    if 0 <= row < len(kept):
        for j in range(len(columns)):
            kept[row, j] = register[columns[j]]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _run(
    decay_u: IntArray, decay_v: IntArray, threshold: IntArray, bias: IntArray, refractory: IntArray, vmin: IntArray,
    vmax: IntArray, spiking: npt.NDArray[np.bool_], parent: IntArray, core: IntArray, list_start: IntArray,
    target: IntArray, weight: IntArray, delay: IntArray, event_start: IntArray, event_line: IntArray, lines: int,
    charge_half: int, current_half: int, slots: IntArray, spikes: ByteArray, active: IntArray, events: IntArray,
    u_columns: IntArray, u_start: int, u_kept: IntArray, v_columns: IntArray, v_start: int, v_kept: IntArray,
    potential_columns: IntArray, potential_start: int, potential_kept: IntArray,
) -> None:  # fmt: skip
    """Fill the output arrays; ``slots`` (longest delay + 2, n) starts at zero, what is not asked for has no rows."""
    steps, n = spikes.shape
    u = np.zeros(n, dtype=np.int64)
    v = np.zeros(n, dtype=np.int64)
    joined = np.zeros(n, dtype=np.int64)
    blocked = np.zeros(n, dtype=np.int64)
    potential = np.zeros(n, dtype=np.int64)
    for step in range(steps):
        slot = slots[step % len(slots)]
        for i in range(n):
            arrived, passed = slot[i], joined[i]
            slot[i] = 0
            joined[i] = 0
            if arrived != 0 or u[i] != 0 or v[i] != 0 or bias[i] != 0 or passed != 0:
                active[step, core[i]] += 1
            q = _wrap(arrived, charge_half)
            events[0, i] += q != arrived
            current = _decay(u[i], decay_u[i]) + q
            u[i] = _wrap(current, current_half)
            events[1, i] += u[i] != current
            potential[i] = 0
            if blocked[i] > 0:
                blocked[i] -= 1
                v[i] = 0
            else:
                drive = u[i] + bias[i]
                wrapped = _wrap(drive, current_half)
                events[1, i] += wrapped != drive
                unclipped = _decay(v[i], decay_v[i]) + wrapped + passed
                v[i] = min(max(unclipped, vmin[i]), vmax[i])
                potential[i] = v[i]
                events[2, i] += v[i] != unclipped
                if spiking[i] and v[i] > threshold[i]:
                    spikes[step, i] = 1
                    v[i] = 0
                    blocked[i] = refractory[i] - 1
            if parent[i] >= 0:
                joined[parent[i]] += v[i]
        _keep(u, u_columns, step - u_start, u_kept)
        _keep(v, v_columns, step - v_start, v_kept)
        _keep(potential, potential_columns, step - potential_start, potential_kept)

        for i in range(n):
            if spikes[step, i]:
                for k in range(list_start[lines + i], list_start[lines + i + 1]):
                    slots[(step + 1 + delay[k]) % len(slots), target[k]] += weight[k]
        for event in range(event_start[step], event_start[step + 1]):
            line = event_line[event]
            for k in range(list_start[line], list_start[line + 1]):
                slots[(step + 1 + delay[k]) % len(slots), target[k]] += weight[k]
