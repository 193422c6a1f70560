"""A phase laid out for the fast engine: segments, blocks in the order of data flow, and links between groups.

A *segment* is a range of columns of one group on one core, updated in one sweep. A *block* is a set of groups that
drive each other (a strongly connected component of synapses and joins): blocks can run one after the other over many
steps, only inside a block must steps be taken one by one. A *link* holds the synapses from one *node* - an input, or a
group - to one group, as a dense matrix of weights where that is quicker, else as lists.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import networkx as nx
import numpy as np
import numpy.typing as npt

from hw_model.fixed_point import DECAY_ONE, WEIGHT_SHIFT, IntArray
from hw_model.program import ChipProgram

Int32Array = npt.NDArray[np.int32]

DENSE_SHARE = 0.25
"""A link with at least this share of all pairs is a matrix: adding zeros in a row is cheaper than following a list."""
DENSE_MOST = 1 << 27
"""Entries of the largest matrix, 256 MiB."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Parameters of every compartment, (columns,); ``keep`` is 4096 less the decay, ``threshold`` a voltage."""

    keep_u: Int32Array
    keep_v: Int32Array
    threshold: Int32Array
    bias: Int32Array
    refractory: Int32Array
    vmin: Int32Array
    vmax: Int32Array
    spiking: npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Segments:
    """Columns ``first..stop``, on the phase's core ``core``, of node ``node``; ``parent``: where v is added, or -1.

    Block k is segments ``of_block[k]..of_block[k + 1]``; in it children come before their parents.
    """

    first: IntArray
    stop: IntArray
    core: IntArray
    node: IntArray
    parent: IntArray
    parent_node: IntArray
    of_block: IntArray


@dataclass(frozen=True, eq=False)
class Links:
    """Synapses between nodes. Weights are in units of 64.

    Link l of source s adds, if ``dense[l]``, ``matrix[offset[l] + s * width[l] + j]`` to column ``target[l] + j``,
    ``delay[l]`` steps late; else, for rows k of ``list_start[offset[l] + s]`` to the next, ``weight[k]`` to column
    ``column[k]``, ``late[k]`` steps late. Links into block k from other nodes are rows ``into_block[k]`` to the next;
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
    column: Int32Array
    weight: Int32Array
    late: Int32Array
    into_block: IntArray
    from_node: IntArray


@dataclass(frozen=True, eq=False)
class FastLayout:
    """A phase: nodes are its inputs, then its groups; node n has ``node_size[n]`` sources from ``node_first[n]`` on.

    Sources of inputs are lines, those of groups columns. ``wide`` tells that the charge of a step may not fit 32 bits.
    """

    inputs: int
    node_first: IntArray
    node_size: IntArray
    cores: int
    columns: Columns
    segments: Segments
    links: Links
    longest_delay: int
    wide: bool


@lru_cache(maxsize=8)
def fast_layout(program: ChipProgram, phase: str) -> FastLayout:
    """Follow every axon to its synapses and lay them out by node. Programs are hashed by identity."""
    nodes = _Nodes(program, phase)
    synapses = _synapses(program, phase, nodes)
    blocks = _blocks(program, phase, nodes, synapses)
    links = _links(nodes, synapses, blocks)
    charge = np.zeros(max(nodes.columns, 1))
    np.add.at(charge, synapses.column, np.abs(synapses.weight))
    return FastLayout(
        inputs=nodes.inputs,
        node_first=nodes.first,
        node_size=nodes.size,
        cores=len(program.cores_of(phase)),
        columns=_columns(program, phase),
        segments=_segments(program, phase, nodes, blocks),
        links=links,
        longest_delay=int(synapses.delay.max(initial=0)),
        wide=bool(charge.max() >= 2**31),
    )


class _Nodes:
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


def _synapses(program: ChipProgram, phase: str, nodes: _Nodes) -> _Synapses:
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


def _blocks(program: ChipProgram, phase: str, nodes: _Nodes, synapses: _Synapses) -> list[list[int]]:
    """Return the groups' nodes block by block, sources before targets, children before parents."""
    graph = nx.DiGraph()
    graph.add_nodes_from(range(nodes.inputs, len(nodes.names)))
    pairs = np.unique(np.stack((synapses.node, synapses.target_node)), axis=1).T
    graph.add_edges_from((int(a), int(b)) for a, b in pairs if a >= nodes.inputs)
    children = _parents(program, phase, nodes)
    graph.add_edges_from(children.items())
    whole = nx.condensation(graph)
    order = nx.lexicographical_topological_sort(whole, key=lambda block: min(whole.nodes[block]["members"]))

    def depth(node: int) -> int:
        return 1 + depth(children[node]) if node in children else 0

    return [sorted(whole.nodes[block]["members"], key=lambda node: (-depth(node), node)) for block in order]


def _parents(program: ChipProgram, phase: str, nodes: _Nodes) -> dict[int, int]:
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


def _segments(program: ChipProgram, phase: str, nodes: _Nodes, blocks: list[list[int]]) -> Segments:
    first_column = {name: columns.start for name, columns in program.columns_of(phase).items()}
    number = {name: i for i, name in enumerate(nodes.names)}
    parents = _parents(program, phase, nodes)
    by_node: dict[int, list[tuple[int, int, int, int, int, int]]] = {}
    for index, core in enumerate(program.cores_of(phase)):
        for piece in core.slices:
            node = number[piece.group]
            first = first_column[piece.group] + piece.start
            parent_node = parents.get(node, -1)
            parent = -1 if parent_node < 0 else int(nodes.first[parent_node]) + piece.start
            by_node.setdefault(node, []).append((first, first + piece.size, index, node, parent, parent_node))
    rows = [row for block in blocks for node in block for row in by_node[node]]
    starts = np.cumsum([0, *(sum(len(by_node[node]) for node in block) for block in blocks)])
    first_of, stop, core_of, node_of, parent_of, parent_node_of = np.array(rows, dtype=np.int64).T.copy()
    return Segments(first_of, stop, core_of, node_of, parent_of, parent_node_of, of_block=starts)


def _links(nodes: _Nodes, synapses: _Synapses, blocks: list[list[int]]) -> Links:
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
    rows, matrices, starts_of_lists, columns, weights, delays = [], [], [], [], [], []
    matrix_size = lists_size = list_rows = 0
    for i in listed:
        mine = order[bounds[i] : bounds[i + 1]]
        node, to = divmod(int(pairs[i]), count)
        matrix = _matrix(synapses, mine, nodes, node, to)
        if matrix is not None:
            late = int(synapses.delay[mine[0]])
            rows.append((node, to, 1, matrix_size, int(nodes.size[to]), int(nodes.first[to]), late))
            matrices.append(matrix.ravel())
            matrix_size += matrix.size
        else:
            rows.append((node, to, 0, list_rows, 0, 0, 0))
            sources = np.arange(nodes.size[node] + 1)
            starts_of_lists.append(np.searchsorted(synapses.source[mine], sources) + lists_size)
            columns.append(synapses.column[mine])
            weights.append(synapses.weight[mine])
            delays.append(synapses.delay[mine])
            list_rows += len(sources)
            lists_size += len(mine)

    empty = np.empty(0, dtype=np.int64)
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
        matrix=np.concatenate([np.empty(0, dtype=np.int16), *matrices]),
        list_start=np.concatenate([empty, *starts_of_lists]),
        column=np.concatenate([empty, *columns]).astype(np.int32),
        weight=np.concatenate([empty, *weights]).astype(np.int32),
        late=np.concatenate([empty, *delays]).astype(np.int32),
        into_block=np.cumsum([0, *map(len, external)]),
        from_node=np.cumsum([0, *map(len, internal)]) + outside,
    )


def _matrix(
    synapses: _Synapses, mine: IntArray, nodes: _Nodes, source: int, target: int
) -> npt.NDArray[np.int16] | None:
    """Return synapses as a matrix (sources, targets); None where lists are better, or weights or delays forbid it."""
    shape = (int(nodes.size[source]), int(nodes.size[target]))
    delay = synapses.delay[mine]
    if len(mine) < DENSE_SHARE * shape[0] * shape[1] or shape[0] * shape[1] > DENSE_MOST or (delay != delay[0]).any():
        return None
    matrix = np.zeros(shape, dtype=np.int64)
    np.add.at(matrix, (synapses.source[mine], synapses.column[mine] - nodes.first[target]), synapses.weight[mine])
    if np.abs(matrix).max() >= 1 << 15:
        return None
    return matrix.astype(np.int16)


def _columns(program: ChipProgram, phase: str) -> Columns:
    n = sum(core.compartments for core in program.cores_of(phase))
    names = ("keep_u", "keep_v", "threshold", "bias", "refractory", "vmin", "vmax")
    table: dict[str, Int32Array] = {name: np.zeros(n, dtype=np.int32) for name in names}
    spiking = np.zeros(n, dtype=np.uint8)
    for core in program.cores_of(phase):
        here = program.columns_of_core(core)
        table["keep_u"][here] = DECAY_ONE - core.setting("decay_u")
        table["keep_v"][here] = DECAY_ONE - core.setting("decay_v")
        table["threshold"][here] = core.threshold_voltage
        table["bias"][here] = core.bias
        table["refractory"][here] = core.setting("refractory")
        table["vmin"][here], table["vmax"][here] = core.vmin, core.vmax
        spiking[here] = core.setting("joined") == 0
    return Columns(spiking=spiking, **table)
