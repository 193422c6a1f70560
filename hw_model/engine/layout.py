"""How the fast engine sees a phase: chunks of compartments, bundles, blocks, nodes and links.

A *chunk* is :data:`LANES` compartments that are updated together, in vectors; a group fills the chunks of its *node*,
and starts anew on every core. A chunk's *slots* are its places in the accumulators. Chunks that add their voltages into
one another, children first, make a *bundle*. A *block* is a strongly connected part of the groups: blocks can be run
one after the other over many steps, and only within a block that feeds itself must steps be taken one by one. A *link*
holds the synapses from one node - an input, or a group - to one group, as a dense matrix of weights where that is
quicker, else as lists.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import networkx as nx
import numpy as np
import numpy.typing as npt

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_SHIFT, IntArray
from hw_model.program.chip_program import ChipProgram

Int32Array = npt.NDArray[np.int32]
Lanes = npt.NDArray[np.int32] | npt.NDArray[np.int64]

LANES = 16
"""Compartments of a chunk: 32-bit numbers of one or two vector registers."""
FIELDS = 15
KEEP_U, KEEP_V, THRESHOLD, BIAS, REFRACTORY, VMIN, VMAX = range(7)
U, V, POTENTIAL, BLOCKED, JOINED = range(7, 12)
CHARGE_WRAPS, CURRENT_WRAPS, VOLTAGE_CLIPS = range(12, FIELDS)
"""Registers of a compartment: seven parameters, the state with what its children add, and a count of each event."""
CACHE_LINE = 64
"""Bytes."""

DENSE_SHARE = 0.25
"""A link with at least this share of all pairs is a matrix: adding zeros in a row is cheaper than following a list."""
DENSE_MOST = 1 << 27
"""Entries of the largest matrix, 256 MiB."""


def aligned(shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return zeros that begin where a cache line does: a vector that lies across two lines is loaded at half speed."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.zeros(size + CACHE_LINE, dtype=np.uint8)
    start = -room.ctypes.data % CACHE_LINE
    return room[start : start + size].view(dtype).reshape(shape)


class Widths(NamedTuple):
    """Where registers wrap: q, in units of 64, and u lie within ``-half..half - 1``."""

    half_charge: int
    half_current: int


USUAL_WIDTHS = Widths(1 << (21 - WEIGHT_SHIFT), 1 << 23)
"""Those of the chips that ship: loops in 32 bits know no others."""


class Chunks(NamedTuple):
    """Chunk k holds columns ``first_column[k]`` on, ``width[k]`` of them; its slots are ``LANES * k`` on.

    ``node`` and ``piece`` (of the phase, :mod:`hw_model.accounting.pieces`) say where it is; ``parent``: the chunk that
    its voltages are added to, or -1; ``sums``: it keeps nothing and no synapse reaches it, so that it only adds up its
    children. ``registers`` (chunks, FIELDS, LANES) are its parameters, with a state of 0, in 32 bits, or in 64 where a
    sum might need them. Bundle i is
    ``member[bundle[i]:bundle[i + 1]]``, and ``begins`` marks the first member of each. Block k is bundles
    ``of_block[k]`` to the next; it feeds itself where ``feeds_itself[k]``, and the nodes in it that can spike are
    ``spiking_node[of_node[k]:of_node[k + 1]]``.
    """

    node: IntArray
    piece: IntArray
    parent: IntArray
    first_column: IntArray
    width: IntArray
    sums: npt.NDArray[np.uint8]
    registers: Lanes
    member: IntArray
    begins: npt.NDArray[np.bool_]
    bundle: IntArray
    of_block: IntArray
    feeds_itself: npt.NDArray[np.uint8]
    spiking_node: IntArray
    of_node: IntArray
    widths: Widths


class Links(NamedTuple):
    """Synapses between nodes. Weights are in units of 64.

    Link l of source s adds, if ``dense[l]``, ``matrix[offset[l] + s * width[l] + j]`` to slot ``target[l] + j``,
    ``delay[l]`` steps late; else, for rows k of ``list_start[offset[l] + s]`` to the next, ``weight[k]`` to slot
    ``slot[k]``, ``late[k]`` steps late; from ``reach_start`` likewise, ``reach_chunk`` and ``reach_late`` list the
    chunks and delays of these once each. Links into block k from other nodes are rows ``into_block[k]`` to the next;
    those from node n into its own block are rows ``from_node[n]`` to the next.
    """

    source: IntArray
    target_node: IntArray
    dense: IntArray
    offset: IntArray
    width: IntArray
    target: IntArray
    delay: IntArray
    matrix: npt.NDArray[np.int16]
    list_start: IntArray
    slot: Int32Array
    weight: Int32Array
    late: Int32Array
    reach_start: IntArray
    reach_chunk: Int32Array
    reach_late: Int32Array
    into_block: IntArray
    from_node: IntArray


class Nodes(NamedTuple):
    """Inputs, then groups: node n has ``size[n]`` sources from ``first[n]`` on, lines or columns.

    A group's node has the chunks ``chunk[n]`` to the next.
    """

    first: IntArray
    size: IntArray
    chunk: IntArray


@dataclass(frozen=True, eq=False)
class FastLayout:
    """A phase, of which the first ``inputs`` nodes are inputs; the named tuples are what the compiled loops take.

    ``slot`` (columns,) tells the slot of every column.
    """

    inputs: int
    pieces: int
    nodes: Nodes
    chunks: Chunks
    links: Links
    slot: IntArray
    longest_delay: int

    @property
    def columns(self) -> int:
        """Compartments of the phase."""
        return len(self.slot)


@lru_cache(maxsize=8)
def fast_layout(program: ChipProgram, phase: str) -> FastLayout:
    """Follow every axon to its synapses and lay them out by node. Programs are hashed by identity."""
    nodes = _Numbering(program, phase)
    synapses = _synapses(program, phase, nodes)
    blocks = _blocks(program, phase, nodes, synapses)
    pieces = _pieces(program, phase, nodes)
    slot, chunk_first = _slots(pieces, nodes)
    links = _links(nodes, synapses, blocks, slot, chunk_first)
    return FastLayout(
        inputs=nodes.inputs,
        pieces=sum(map(len, pieces.values())),
        nodes=Nodes(nodes.first, nodes.size, chunk_first),
        chunks=_chunks(program, phase, nodes, synapses, blocks, pieces, links),
        links=links,
        slot=slot,
        longest_delay=int(synapses.delay.max(initial=0)),
    )


class _Numbering:
    """Inputs, then groups, with their names, first lines or columns, and sizes."""

    def __init__(self, program: ChipProgram, phase: str) -> None:
        inputs = program.inputs_of(phase)
        columns = program.columns_of(phase)
        self.inputs = len(inputs)
        self.names = [item.name for item in inputs] + list(columns)
        self.size = np.array([i.size for i in inputs] + [c.stop - c.start for c in columns.values()], dtype=np.int64)
        lines = np.cumsum([0, *(item.size for item in inputs)])
        self.first = np.array([*lines[:-1], *(c.start for c in columns.values())], dtype=np.int64)
        self.lines, self.columns = int(lines[-1]), int(self.size[self.inputs :].sum())

    def of_line(self, line: IntArray) -> IntArray:
        """Return the nodes of lines."""
        return np.asarray(np.searchsorted(self.first[: self.inputs], line, side="right") - 1)

    def of_column(self, column: IntArray) -> IntArray:
        """Return the nodes of columns."""
        return np.asarray(np.searchsorted(self.first[self.inputs :], column, side="right") - 1 + self.inputs)


@dataclass(frozen=True, eq=False)
class _Synapses:
    """Every synapse of a phase: node and number of its source there, node and column of its target."""

    node: IntArray
    source: IntArray
    target_node: IntArray
    column: IntArray
    weight: IntArray
    delay: IntArray


def _synapses(program: ChipProgram, phase: str, nodes: _Numbering) -> _Synapses:
    cores = program.cores_of(phase)
    columns = {core.number: program.columns_of_core(core) for core in cores}
    source, to_core, to_axon = [], [], []
    first = 0
    for item in program.inputs_of(phase):
        route = program.route_of(item.name)
        source.append(route.line + first)
        to_core.append(route.core)
        to_axon.append(route.axon)
        first += item.size
    for core in cores:
        source.append(nodes.lines + columns[core.number][core.axons.out_compartment])
        to_core.append(core.axons.out_core)
        to_axon.append(core.axons.out_axon)
    sources, targets, axons_there = (np.concatenate(parts) for parts in (source, to_core, to_axon))
    order = np.argsort(targets, kind="stable")
    starts = np.searchsorted(targets[order], [[core.number, core.number + 1] for core in cores])
    parts = []
    for core, (low, high) in zip(cores, starts, strict=True):
        axons, mine = core.axons, order[low:high]
        of_axon = np.full(axons.input_axons, -1, dtype=np.int64)
        of_axon[axons_there[mine]] = sources[mine]
        weight = core.effective_weights >> WEIGHT_SHIFT
        global_source = np.repeat(of_axon, np.diff(axons.list_start))
        parts.append((global_source, columns[core.number][axons.target], weight, axons.delay))
    flat, column, weight, delay = (np.concatenate(part) for part in zip(*parts, strict=True))
    is_line = flat < nodes.lines
    node = np.where(is_line, nodes.of_line(flat), nodes.of_column(flat - nodes.lines))
    source_there = np.where(is_line, flat, flat - nodes.lines) - nodes.first[node]
    return _Synapses(node, source_there, nodes.of_column(column), column, weight, delay)


def _blocks(program: ChipProgram, phase: str, nodes: _Numbering, synapses: _Synapses) -> list[list[int]]:
    """Return the groups' nodes block by block, sources before targets, children before parents."""
    graph = nx.DiGraph()
    graph.add_nodes_from(range(nodes.inputs, len(nodes.names)))
    pairs = np.unique(np.stack((synapses.node, synapses.target_node)), axis=1).T
    graph.add_edges_from((int(a), int(b)) for a, b in pairs if a >= nodes.inputs)
    parents = _parents(program, phase, nodes)
    # Both ways, for what is joined is updated together.
    graph.add_edges_from(parents.items())
    graph.add_edges_from((parent, child) for child, parent in parents.items())
    whole = nx.condensation(graph)
    order = nx.lexicographical_topological_sort(whole, key=lambda block: min(whole.nodes[block]["members"]))

    def depth(node: int) -> int:
        above = 0
        while node in parents:
            node, above = parents[node], above + 1
        return above

    return [sorted(whole.nodes[block]["members"], key=lambda node: (-depth(node), node)) for block in order]


def _parents(program: ChipProgram, phase: str, nodes: _Numbering) -> dict[int, int]:
    """Return the node that each joined node is joined to."""
    number = {name: i for i, name in enumerate(nodes.names)}
    found = {}
    for core in program.cores_of(phase):
        group_of = {piece.offset: piece.group for piece in core.slices}
        for piece in core.slices:
            parent = int(core.parent[piece.offset])
            if parent >= 0:
                found[number[piece.group]] = number[group_of[parent]]
    return found


@dataclass(frozen=True)
class _Piece:
    """What one core holds of a group: columns ``first..stop``; ``parent``: the node it is joined to, or -1.

    ``number`` counts the pieces of the phase as :mod:`hw_model.accounting.pieces` does.
    """

    first: int
    stop: int
    number: int
    parent: int


def _pieces(program: ChipProgram, phase: str, nodes: _Numbering) -> dict[int, list[_Piece]]:
    """Return the pieces of every group's node, in the order of their columns."""
    first_column = {name: columns.start for name, columns in program.columns_of(phase).items()}
    number = {name: i for i, name in enumerate(nodes.names)}
    parents = _parents(program, phase, nodes)
    found: dict[int, list[_Piece]] = {node: [] for node in range(nodes.inputs, len(nodes.names))}
    slices = (part for core in program.cores_of(phase) for part in core.slices)
    for index, part in enumerate(slices):
        node = number[part.group]
        first = first_column[part.group] + part.start
        found[node].append(_Piece(first, first + part.size, index, parents.get(node, -1)))
    return {node: sorted(pieces, key=lambda piece: piece.first) for node, pieces in found.items()}


def _slots(pieces: dict[int, list[_Piece]], nodes: _Numbering) -> tuple[IntArray, IntArray]:
    """Return the slot of every column, and the first chunk of every node, with the end."""
    slot = np.empty(nodes.columns, dtype=np.int64)
    chunk_first = np.zeros(len(nodes.names) + 1, dtype=np.int64)
    chunk = 0
    for node, parts in pieces.items():
        chunk_first[node] = chunk
        for piece in parts:
            slot[piece.first : piece.stop] = LANES * chunk + np.arange(piece.stop - piece.first)
            chunk += -(-(piece.stop - piece.first) // LANES)
    chunk_first[len(nodes.names)] = chunk
    return slot, chunk_first


def _chunks(
    program: ChipProgram,
    phase: str,
    nodes: _Numbering,
    synapses: _Synapses,
    blocks: list[list[int]],
    pieces: dict[int, list[_Piece]],
    links: Links,
) -> Chunks:
    slot, chunk_first = _slots(pieces, nodes)
    count = int(chunk_first[-1])
    limits = program.chip.registers
    widths = Widths(1 << (limits.charge_bits - WEIGHT_SHIFT), 1 << limits.current_bits)
    fits = widths == USUAL_WIDTHS and _largest_sum(program, phase, synapses) <= np.iinfo(np.int32).max
    never = np.iinfo(np.int32 if fits else np.int64).max  # the threshold of what cannot spike
    shape = (count, FIELDS, LANES)
    registers: Lanes = np.zeros(shape, dtype=np.int32) if fits else np.zeros(shape, dtype=np.int64)
    registers[:, THRESHOLD] = never
    for field, values in _parameters(program, phase, never).items():
        registers[slot // LANES, field, slot % LANES] = values
    reached = np.zeros(count, dtype=np.bool_)
    reached[slot[synapses.column] // LANES] = True
    keeps = registers[:, [KEEP_U, KEEP_V, BIAS]].any(axis=(1, 2))
    rows = [
        (node, piece.number, first, min(LANES, piece.stop - first), piece.parent)
        for node, parts in pieces.items()
        for piece in parts
        for first in range(piece.first, piece.stop, LANES)
    ]
    node, piece_number, first_column, width, parent_node = np.array(rows, dtype=np.int64).reshape(-1, 5).T.copy()
    # A child lies beside its parent on the same core, so both are cut into chunks at the same places.
    joined = parent_node >= 0
    parent = np.full(count, -1, dtype=np.int64)
    beside = (nodes.first[parent_node] + first_column - nodes.first[node])[joined]
    parent[joined] = slot[beside] // LANES
    children: dict[int, list[int]] = {}
    for chunk in np.flatnonzero(joined).tolist():
        children.setdefault(int(parent[chunk]), []).append(chunk)

    def bundle(root: int) -> list[int]:
        found, begun = [], [root]
        while begun:
            found.append(begun.pop())
            begun += children.get(found[-1], [])
        return found[::-1]

    bundles = [
        [bundle(c) for n in block for c in range(chunk_first[n], chunk_first[n + 1]) if parent[c] < 0]
        for block in blocks
    ]
    member = [chunk for block in bundles for each in block for chunk in each]
    starts = np.cumsum([0, *(len(each) for block in bundles for each in block)])
    parents = _parents(program, phase, nodes)
    spiking = [[n for n in block if n not in parents] for block in blocks]
    return Chunks(
        node=node,
        piece=piece_number,
        parent=parent,
        first_column=first_column,
        width=width,
        sums=(~keeps & ~reached).astype(np.uint8),
        registers=registers,
        member=np.array(member, dtype=np.int64),
        begins=np.isin(np.arange(len(member)), starts),
        bundle=starts,
        of_block=np.cumsum([0, *map(len, bundles)]),
        feeds_itself=np.array(
            [any(links.from_node[n] < links.from_node[n + 1] for n in block) for block in blocks], dtype=np.uint8
        ),
        spiking_node=np.array([n for block in spiking for n in block], dtype=np.int64),
        of_node=np.cumsum([0, *map(len, spiking)]),
        widths=widths,
    )


def _largest_sum(program: ChipProgram, phase: str, synapses: _Synapses) -> int:
    """Return a bound on every number that an update of this phase works with, whatever the input."""
    registers = program.chip.registers
    charge, current = 1 << registers.charge_bits, 1 << registers.current_bits
    arrived = np.bincount(synapses.column, np.abs(synapses.weight)).max(initial=0)
    found = [int(arrived), charge + current]
    for core in program.cores_of(phase):
        # A child adds its v, within the core's limits, to what the parent keeps of its own and to its drive.
        most_children = int(np.bincount(core.parent[core.parent >= 0]).max(initial=0))
        found.append((most_children + 1) * max(-core.vmin, core.vmax) + current)
        found.append(current + int(np.abs(core.bias).max()))
        found.append(int(core.threshold_voltage.max()))
    return max(found)


def _links(
    nodes: _Numbering, synapses: _Synapses, blocks: list[list[int]], slot: IntArray, chunk_first: IntArray
) -> Links:
    count = len(nodes.names)
    pair = synapses.node * count + synapses.target_node
    order = np.lexsort((synapses.column, synapses.source, pair))
    pairs, starts = np.unique(pair[order], return_index=True)
    bounds = np.append(starts, len(order))
    block_of = {node: k for k, block in enumerate(blocks) for node in block}
    external: list[list[int]] = [[] for _ in blocks]
    internal: list[list[int]] = [[] for _ in range(count)]
    for i, (source, target) in enumerate(divmod(int(p), count) for p in pairs):
        inside = source >= nodes.inputs and block_of[source] == block_of[target]
        (internal[source] if inside else external[block_of[target]]).append(i)
    listed = [i for part in (*external, *internal) for i in part]
    rows, matrices, starts_of_lists, slots, weights, delays = [], [], [], [], [], []
    matrix_size = lists_size = list_rows = 0
    for i in listed:
        mine = order[bounds[i] : bounds[i + 1]]
        node, to = divmod(int(pairs[i]), count)
        low, high = LANES * int(chunk_first[to]), LANES * int(chunk_first[to + 1])
        matrix = _matrix(synapses, mine, slot[synapses.column[mine]] - low, (int(nodes.size[node]), high - low))
        if matrix is not None:
            late = int(synapses.delay[mine[0]])
            rows.append((node, to, 1, matrix_size, high - low, low, late))
            matrices.append(matrix.ravel())
            matrix_size += matrix.size
        else:
            rows.append((node, to, 0, list_rows, 0, 0, 0))
            sources = np.arange(nodes.size[node] + 1)
            starts_of_lists.append(np.searchsorted(synapses.source[mine], sources) + lists_size)
            slots.append(slot[synapses.column[mine]])
            weights.append(synapses.weight[mine])
            delays.append(synapses.delay[mine])
            list_rows += len(sources)
            lists_size += len(mine)

    empty = np.empty(0, dtype=np.int64)
    list_start = np.concatenate([empty, *starts_of_lists])
    slot_of, lates = np.concatenate([empty, *slots]), np.concatenate([empty, *delays])
    reach_start, reach_chunk, reach_late = _reach(list_start, slot_of // LANES, lates)
    matrix = aligned((matrix_size,), np.int16)
    if matrices:
        np.concatenate(matrices, out=matrix)
    heads = np.array(rows, dtype=np.int64).reshape(-1, 7).T.copy()
    outside = sum(len(part) for part in external)
    return Links(
        source=heads[0],
        target_node=heads[1],
        dense=heads[2],
        offset=heads[3],
        width=heads[4],
        target=heads[5],
        delay=heads[6],
        matrix=matrix,
        list_start=list_start,
        slot=slot_of.astype(np.int32),
        weight=np.concatenate([empty, *weights]).astype(np.int32),
        late=lates.astype(np.int32),
        reach_start=reach_start,
        reach_chunk=reach_chunk,
        reach_late=reach_late,
        into_block=np.cumsum([0, *map(len, external)]),
        from_node=np.cumsum([0, *map(len, internal)]) + outside,
    )


def _reach(list_start: IntArray, chunk: IntArray, late: IntArray) -> tuple[IntArray, Int32Array, Int32Array]:
    """List, for the synapses between two starts, each chunk and delay once; return where these begin, and both."""
    row = np.searchsorted(list_start, np.arange(len(chunk)), side="right")
    longest = int(late.max(initial=0)) + 1
    chunks = int(chunk.max(initial=0)) + 1
    once = np.unique((row * chunks + chunk) * longest + late)
    first = np.searchsorted(once // (longest * chunks), np.arange(len(list_start)), side="right")
    return first, (once // longest % chunks).astype(np.int32), (once % longest).astype(np.int32)


def _matrix(
    synapses: _Synapses, mine: IntArray, target: IntArray, shape: tuple[int, int]
) -> npt.NDArray[np.int16] | None:
    """Return synapses as a matrix (sources, slots); None where lists are better, or weights or delays forbid it."""
    delay = synapses.delay[mine]
    if len(mine) < DENSE_SHARE * shape[0] * shape[1] or shape[0] * shape[1] > DENSE_MOST or (delay != delay[0]).any():
        return None
    matrix = np.zeros(shape, dtype=np.int64)
    np.add.at(matrix, (synapses.source[mine], target), synapses.weight[mine])
    if np.abs(matrix).max() >= 1 << 15:
        return None
    return matrix.astype(np.int16)


def _parameters(program: ChipProgram, phase: str, never: int) -> dict[int, IntArray]:
    """Return the parameters of every column by field; ``never`` is the threshold of what cannot spike."""
    n = sum(core.compartments for core in program.cores_of(phase))
    found = {field: np.zeros(n, dtype=np.int64) for field in range(KEEP_U, VMAX + 1)}
    for core in program.cores_of(phase):
        here = program.columns_of_core(core)
        found[KEEP_U][here] = DECAY_ONE - core.setting("decay_u")
        found[KEEP_V][here] = DECAY_ONE - core.setting("decay_v")
        found[THRESHOLD][here] = np.where(core.setting("joined") == 0, core.threshold_voltage, never)
        found[BIAS][here] = core.bias
        found[REFRACTORY][here] = core.setting("refractory")
        found[VMIN][here], found[VMAX][here] = core.vmin, core.vmax
    return found
