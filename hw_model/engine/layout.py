"""How the fast engine sees a phase: chunks of compartments, bundles, blocks, nodes and links.

A *chunk* is :data:`LANES` compartments that are updated together, in vectors; a group fills the chunks of its *node*,
and starts anew on every core. A chunk's *slots* are its places in the accumulators. Chunks that add their voltages into
one another, children first, make a *bundle*. A *block* is a strongly connected part of the groups: blocks can be run
one after the other over many steps, and only within a block that feeds itself must steps be taken one by one. A *link*
holds the synapses from one node - an input, or a group - to one group, as a dense matrix of weights where that is
quicker, else as lists.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic.fixed_point import DECAY_ONE, WEIGHT_SHIFT
from hw_model.engine.trace import due_late
from hw_model.mapping.circles import sources_first
from hw_model.program.chip_program import ChipProgram, Core, Pieces, pieces_of
from hw_model.values import AnyArray, BoolArray, ByteArray, Frozen, Int32Array, IntArray

Lanes = Int32Array | IntArray

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
REACH_SHARE = 0.33
"""Where lists reach this share of the chunks in the rows that they might, all of these count as reached."""
LIST, MATRIX, PACKED_LIST = range(3)
"""Ways to hold a link."""
PACKED_BITS = 32
"""Bits in which the slot, delay and weight of every synapse of a link have to fit, or its lists are wide ones."""


def aligned(shape: tuple[int, ...], dtype: npt.DTypeLike) -> AnyArray:
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

    ``node`` and ``piece`` (of :class:`hw_model.program.chip_program.Pieces`) say where it is; ``parent``: the chunk
    that its voltages are added to, or -1; ``sums``: it keeps nothing and no synapse reaches it, so that it only adds up
    its children; ``plain``: nothing in it has a bias, is refractory, has children or can wrap. ``registers`` (chunks,
    FIELDS, LANES) are its parameters, with a state of 0, in 32 bits, or in 64 where a sum might need them. Bundle i is
    ``member[bundle[i]:bundle[i + 1]]``, and ``begins`` marks the first member of each. Block k is bundles
    ``of_block[k]`` to the next; it feeds itself where ``feeds_itself[k]``, and the nodes in it that can spike are
    ``spiking_node[of_node[k]:of_node[k + 1]]``.
    """

    node: IntArray
    piece: IntArray
    parent: IntArray
    first_column: IntArray
    width: IntArray
    sums: ByteArray
    plain: ByteArray
    registers: Lanes
    member: IntArray
    begins: BoolArray
    bundle: IntArray
    of_block: IntArray
    feeds_itself: ByteArray
    spiking_node: IntArray
    of_node: IntArray
    widths: Widths


class Links(NamedTuple):
    """Synapses between nodes. Weights are in units of 64.

    Link l of source s adds, if ``kind[l]`` is a matrix, ``matrix[offset[l] + s * width[l] + j]`` to slot ``target[l] +
    j``, ``delay[l]`` steps late; else, for rows k of ``list_start[offset[l] + s]`` to the next, ``weight[k]`` to slot
    ``slot[k]``, ``late[k]`` steps late. A packed list has ``packed[k]`` for these: from the lowest bit on ``slot_bits``
    of the slot, from ``target[l]`` on; ``late_bits`` of the delay, beyond ``delay[l]``; and the weight, in units of
    2^``weight_shift``. From ``reach_start`` likewise, ``reach_chunk`` and ``reach_late`` list the chunks and delays of
    a list once each; where ``width[l]`` of a packed list is not 0, all chunks of the target are reached in so many
    rows. Links into block k from other nodes are rows ``into_block[k]`` to the next; those from node n into its own
    block are rows ``from_node[n]`` to the next. ``due_late`` counts them by delay.
    """

    source: IntArray
    target_node: IntArray
    kind: IntArray
    offset: IntArray
    width: IntArray
    target: IntArray
    delay: IntArray
    slot_bits: IntArray
    late_bits: IntArray
    weight_shift: IntArray
    matrix: npt.NDArray[np.int16]
    packed: Int32Array
    list_start: IntArray
    slot: Int32Array
    weight: Int32Array
    late: Int32Array
    reach_start: IntArray
    reach_chunk: Int32Array
    reach_late: Int32Array
    into_block: IntArray
    from_node: IntArray
    due_late: IntArray


class Nodes(NamedTuple):
    """Inputs, then groups: node n has ``size[n]`` sources from ``first[n]`` on, lines or columns.

    A group's node has the chunks ``chunk[n]`` to the next.
    """

    first: IntArray
    size: IntArray
    chunk: IntArray


class FastLayout(Frozen, eq=False):
    """A phase, of which the first ``inputs`` nodes are inputs; the named tuples are what the compiled loops take.

    ``slot`` (columns,) tells the slot of every column.
    """

    inputs: int
    pieces: int
    nodes: Nodes
    chunks: Chunks
    links: Links
    slot: IntArray

    @property
    def columns(self) -> int:
        """Compartments of the phase."""
        return len(self.slot)


@lru_cache(maxsize=8)
def fast_layout(program: ChipProgram, phase: str) -> FastLayout:
    """Follow every axon to its synapses and lay them out by node. Programs are hashed by identity."""
    nodes = _Numbering(program, phase)
    cut = _cut(pieces_of(program, phase), nodes)
    synapses = _synapses(program, phase, nodes)
    blocks = _blocks(nodes, synapses)
    links = _links(nodes, synapses, blocks, cut, due_late(program, phase))
    return FastLayout(
        inputs=nodes.inputs,
        pieces=len(pieces_of(program, phase).group),
        nodes=Nodes(nodes.first, nodes.size, cut.of_node),
        chunks=_chunks(program, phase, nodes, blocks, cut, links),
        links=links,
        slot=cut.slot,
    )


class _Numbering:
    """Inputs, then groups, with their names and sizes; ``first``: first lines or columns; ``parent``, or -1."""

    def __init__(self, program: ChipProgram, phase: str) -> None:
        places = {**program.lines_of(phase), **program.columns_of(phase)}
        self.inputs = len(program.inputs_of(phase))
        self.names = list(places)
        self.first = np.array([place.start for place in places.values()], dtype=np.int64)
        self.size = np.array([place.stop - place.start for place in places.values()], dtype=np.int64)
        self.lines = int(self.size[: self.inputs].sum())
        self._begin = np.cumsum(self.size) - self.size
        number = {name: node for node, name in enumerate(self.names)}
        parents = [program.joined_to.get(name, "") for name in self.names]
        self.parent = np.array([number.get(name, -1) for name in parents], dtype=np.int64)

    def of_source(self, source: IntArray) -> tuple[IntArray, IntArray]:
        """Return the nodes of sources, lines and then columns, and the numbers of these on them."""
        node = np.asarray(np.searchsorted(self._begin, source, side="right") - 1)
        return node, source - self._begin[node]

    def of_column(self, column: IntArray) -> IntArray:
        """Return the nodes of columns."""
        return self.of_source(self.lines + column)[0]


_Synapses = tuple[Int32Array, ...]
"""Some synapses from one node to another: number of the source there, column, weight in units of 64, and delay."""
Ends = tuple[int, int]
"""Nodes that synapses lead from and to."""


def _synapses(program: ChipProgram, phase: str, nodes: _Numbering) -> dict[Ends, list[_Synapses]]:
    """Return the synapses of a phase by their ends, core by core: each is held once, in 32 bits a number."""
    found: dict[Ends, list[_Synapses]] = {}
    for core in program.cores_of(phase):
        axons, columns = core.axons, program.columns_of_core(core)
        node, source = nodes.of_source(program.senders[core.number])
        axon = axons.axon_of_synapse
        ends = node[axon] * len(nodes.names) + nodes.of_column(columns)[axons.target]
        weight = core.effective_weights >> WEIGHT_SHIFT
        for pair in np.unique(ends).tolist():
            here = np.flatnonzero(ends == pair)
            table = (source[axon[here]], columns[axons.target[here]], weight[here], axons.delay[here])
            part = tuple(values.astype(np.int32) for values in table)
            found.setdefault(divmod(pair, len(nodes.names)), []).append(part)
    return found


def _sorted(parts: list[_Synapses]) -> tuple[IntArray, ...]:
    """Return the columns of synapses of the same ends together, by source and then by column."""
    together = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.lexsort((together[1], together[0]))
    return tuple(column[order].astype(np.int64) for column in together)


def _blocks(nodes: _Numbering, pairs: Iterable[Ends]) -> list[list[int]]:
    """Return the groups' nodes block by block, sources before targets, children before parents."""
    first = nodes.inputs
    joined = [(child, int(parent)) for child, parent in enumerate(nodes.parent) if parent >= 0]
    # Both ways, for what is joined is updated together.
    edges = [(a, b) for a, b in sorted(pairs) if a >= first] + joined + [(parent, child) for child, parent in joined]
    order = sources_first(len(nodes.names) - first, [(a - first, b - first) for a, b in edges])

    def depth(node: int) -> int:
        above = 0
        while (node := nodes.parent[node]) >= 0:
            above += 1
        return above

    return [sorted((first + i for i in block), key=lambda node: (-depth(node), node)) for block in order]


class _Cut(Frozen, eq=False):
    """Pieces cut into chunks: node, piece, first column and width of each chunk, the slot of every column.

    ``of_node``: the first chunk of each node, with the end.
    """

    node: IntArray
    piece: IntArray
    first_column: IntArray
    width: IntArray
    slot: IntArray
    of_node: IntArray


def _cut(pieces: Pieces, nodes: _Numbering) -> _Cut:
    """Cut the pieces in the order of their columns, which is that of their nodes."""
    order = np.argsort(pieces.first)
    size, chunks = pieces.size[order], -(-pieces.size[order] // LANES)
    begin = np.cumsum(chunks) - chunks
    slot = np.arange(size.sum()) + np.repeat(LANES * begin - pieces.first[order], size)
    piece = np.repeat(order, chunks)
    first_column = pieces.first[piece] + LANES * (np.arange(len(piece)) - np.repeat(begin, chunks))
    width = np.minimum(LANES, pieces.stop[piece] - first_column)
    node = nodes.of_column(first_column)
    of_node = np.searchsorted(node, np.arange(len(nodes.names) + 1))
    return _Cut(node, piece, first_column, width, slot, of_node)


def _chunks(
    program: ChipProgram, phase: str, nodes: _Numbering, blocks: list[list[int]], cut: _Cut, links: Links
) -> Chunks:
    slot, count = cut.slot, len(cut.node)
    limits = program.chip.registers
    widths = Widths(1 << (limits.charge_bits - WEIGHT_SHIFT), 1 << limits.current_bits)
    arrived, reached = np.zeros(count * LANES), np.zeros(count, dtype=np.bool_)
    for core in program.cores_of(phase):
        here, weights = slot[program.columns_of_core(core)], np.abs(core.effective_weights >> WEIGHT_SHIFT)
        arrived[here] = np.bincount(core.axons.target, weights, minlength=len(here))
        reached[here[core.axons.target] // LANES] = True
    fits = widths == USUAL_WIDTHS and _largest_sum(program, phase, arrived) <= np.iinfo(np.int32).max
    never = np.iinfo(np.int32 if fits else np.int64).max  # the threshold of what cannot spike
    shape = (count, FIELDS, LANES)
    registers: Lanes = np.zeros(shape, dtype=np.int32) if fits else np.zeros(shape, dtype=np.int64)
    registers[:, THRESHOLD] = never
    for field, values in _parameters(program, phase, never).items():
        registers[slot // LANES, field, slot % LANES] = values
    keeps = registers[:, [KEEP_U, KEEP_V, BIAS]].any(axis=(1, 2))
    plain = ~registers[:, BIAS].any(axis=1) & (registers[:, REFRACTORY] <= 1).all(axis=1)
    plain &= _cannot_wrap(arrived.reshape(-1, LANES), DECAY_ONE - registers[:, KEEP_U], widths)
    # A child lies beside its parent on the same core, so both are cut into chunks at the same places.
    joined = nodes.parent[cut.node] >= 0
    parent = np.full(count, -1, dtype=np.int64)
    beside = nodes.first[nodes.parent[cut.node]] + cut.first_column - nodes.first[cut.node]
    parent[joined] = slot[beside[joined]] // LANES
    plain[parent[joined]] = False
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
        [bundle(c) for n in block for c in range(cut.of_node[n], cut.of_node[n + 1]) if parent[c] < 0]
        for block in blocks
    ]
    member = [chunk for block in bundles for each in block for chunk in each]
    starts = np.cumsum([0, *(len(each) for block in bundles for each in block)])
    spiking = [[n for n in block if nodes.parent[n] < 0] for block in blocks]
    feeds_itself = [any(links.from_node[n] < links.from_node[n + 1] for n in block) for block in blocks]
    return Chunks(
        node=cut.node, piece=cut.piece, parent=parent, first_column=cut.first_column, width=cut.width,
        sums=(~keeps & ~reached).astype(np.uint8), plain=plain.astype(np.uint8), registers=registers,
        member=np.array(member, np.int64), begins=np.isin(np.arange(len(member)), starts), bundle=starts,
        of_block=np.cumsum([0, *map(len, bundles)]), feeds_itself=np.array(feeds_itself, np.uint8),
        spiking_node=np.array([n for block in spiking for n in block], np.int64),
        of_node=np.cumsum([0, *map(len, spiking)]), widths=widths,
    )  # fmt: skip


def _cannot_wrap(arrived: AnyArray, decay_u: Lanes, widths: Widths) -> BoolArray:
    """Tell which chunks neither q nor u can wrap in, whatever arrives of the charges ``arrived`` (chunks, LANES).

    If all of a compartment's synapses, taken without their signs, bring a charge of a in every step, u stays within
    64 a 4096 / decay_u.
    """
    grows_to = arrived * (DECAY_ONE << WEIGHT_SHIFT)
    return np.asarray(((arrived < widths.half_charge) & (grows_to < decay_u * float(widths.half_current))).all(axis=1))


def _largest_sum(program: ChipProgram, phase: str, arrived: AnyArray) -> int:
    """Return a bound on every number that an update of this phase works with, whatever the input."""
    registers = program.chip.registers
    charge, current = 1 << registers.charge_bits, 1 << registers.current_bits
    found = [int(arrived.max(initial=0)), charge + current]
    for core in program.cores_of(phase):
        # A child adds its v, within the core's limits, to what the parent keeps of its own and to its drive.
        most_children = int(np.bincount(core.parent[core.parent >= 0]).max(initial=0))
        found.append((most_children + 1) * max(-core.vmin, core.vmax) + current)
        found.append(current + int(np.abs(core.bias).max()))
        found.append(int(core.threshold_voltage.max()))
    return max(found)


def _links(
    nodes: _Numbering, synapses: dict[Ends, list[_Synapses]], blocks: list[list[int]], cut: _Cut, by_delay: IntArray
) -> Links:
    """Lay out the synapses by their ends; they are taken out, so that no more than one link is there twice."""
    slot = cut.slot
    block_of = {node: k for k, block in enumerate(blocks) for node in block}
    external: list[list[Ends]] = [[] for _ in blocks]
    internal: list[list[Ends]] = [[] for _ in nodes.names]
    for source, target in sorted(synapses):
        inside = source >= nodes.inputs and block_of[source] == block_of[target]
        (internal[source] if inside else external[block_of[target]]).append((source, target))
    listed = [ends for part in (*external, *internal) for ends in part]
    rows, matrices, packed, wide = [], [], [], []
    starts_of_lists, reached = [], []
    nothing = np.empty((3, 0), dtype=np.int64)
    matrix_size = list_rows = reach_size = 0
    sizes = {LIST: 0, PACKED_LIST: 0}
    for node, to in listed:
        sources, column, weights, delay = _sorted(synapses.pop((node, to)))
        low, high = LANES * int(cut.of_node[to]), LANES * int(cut.of_node[to + 1])
        place = slot[column] - low
        matrix = _matrix(sources, place, weights, delay, (int(nodes.size[node]), high - low))
        if matrix is not None:
            rows.append((node, to, MATRIX, matrix_size, high - low, low, int(delay[0]), 0, 0, 0))
            matrices.append(matrix.ravel())
            matrix_size += matrix.size
            continue
        first = np.searchsorted(sources, np.arange(nodes.size[node] + 1))
        words, form = _packed(place, weights, delay, (high - low - 1).bit_length())
        kind = LIST if words is None else PACKED_LIST
        reach, late_rows = _reach(first, (place + low) // LANES, delay), 0
        if words is None:
            wide.append(np.stack((place + low, weights, delay)))
        else:
            packed.append(words)
            late_rows = int(delay.max() - delay.min()) + 1
            if len(reach[1]) < REACH_SHARE * nodes.size[node] * late_rows * (high - low) // LANES:
                late_rows = 0
        if late_rows:
            reach = _reach(np.zeros_like(first), nothing[0], nothing[0])
        rows.append((node, to, kind, list_rows, late_rows, low, *form))
        starts_of_lists.append(np.stack((first + sizes[kind], reach[0] + reach_size)))
        reached.append(np.stack(reach[1:]))
        sizes[kind] += len(place)
        list_rows += len(first)
        reach_size += len(reach[1])

    list_start, reach_start = np.concatenate([nothing[:2], *starts_of_lists], axis=1)
    reach_chunk, reach_late = np.concatenate([nothing[:2], *reached], axis=1).astype(np.int32)
    slot_of, weight, late = np.concatenate([nothing, *wide], axis=1).astype(np.int32)
    matrix = aligned((matrix_size,), np.int16)
    if matrices:
        np.concatenate(matrices, out=matrix)
    heads = dict(zip(Links._fields, np.array(rows, dtype=np.int64).reshape(-1, 10).T.copy(), strict=False))
    outside = sum(len(part) for part in external)
    return Links(
        **heads, matrix=matrix, packed=np.concatenate([nothing[0].astype(np.int32), *packed]), list_start=list_start,
        slot=slot_of, weight=weight, late=late, reach_start=reach_start, reach_chunk=reach_chunk, reach_late=reach_late,
        into_block=np.cumsum([0, *map(len, external)]), from_node=np.cumsum([0, *map(len, internal)]) + outside,
        due_late=by_delay,
    )  # fmt: skip


def _packed(
    slot: IntArray, weight: IntArray, delay: IntArray, slot_bits: int
) -> tuple[Int32Array | None, tuple[int, int, int, int]]:
    """Return synapses in a word each, None where one does not fit; and delay, slot_bits, late_bits, weight_shift."""
    least, union = int(delay.min()), int(np.bitwise_or.reduce(weight))
    shift = (union & -union).bit_length() - 1 if union else 0
    late_bits = int(delay.max() - least).bit_length()
    widest = max(int(weight.max()), -int(weight.min())) >> shift
    if slot_bits + late_bits + widest.bit_length() + 1 > PACKED_BITS:
        return None, (0, 0, 0, 0)
    words = (weight >> shift) << (slot_bits + late_bits) | (delay - least) << slot_bits | slot
    return words.astype(np.int32), (least, slot_bits, late_bits, shift)


def _reach(list_start: IntArray, chunk: IntArray, late: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """List, for the synapses between two starts, each chunk and delay once; return where these begin, and both."""
    row = np.searchsorted(list_start, np.arange(len(chunk)), side="right")
    longest = int(late.max(initial=0)) + 1
    chunks = int(chunk.max(initial=0)) + 1
    once = np.unique((row * chunks + chunk) * longest + late)
    first = np.searchsorted(once // (longest * chunks), np.arange(len(list_start)), side="right")
    return first, once // longest % chunks, once % longest


def _matrix(
    source: IntArray, target: IntArray, weight: IntArray, delay: IntArray, shape: tuple[int, int]
) -> npt.NDArray[np.int16] | None:
    """Return synapses as a matrix (sources, slots); None where lists are better, or weights or delays forbid it."""
    size = shape[0] * shape[1]
    if len(delay) < DENSE_SHARE * size or size > DENSE_MOST or (delay != delay[0]).any():
        return None
    matrix = np.zeros(shape, dtype=np.int64)
    np.add.at(matrix, (source, target), weight)
    if np.abs(matrix).max() >= 1 << 15:
        return None
    return matrix.astype(np.int16)


def _parameters(program: ChipProgram, phase: str, never: int) -> dict[int, IntArray]:
    """Return the parameters of every column by field; ``never`` is the threshold of what cannot spike."""
    values: dict[int, Callable[[Core], IntArray | int]] = {
        KEEP_U: lambda core: DECAY_ONE - core.setting("decay_u"),
        KEEP_V: lambda core: DECAY_ONE - core.setting("decay_v"),
        THRESHOLD: lambda core: np.where(core.setting("joined") == 0, core.threshold_voltage, never),
        BIAS: lambda core: core.bias,
        REFRACTORY: lambda core: core.setting("refractory"),
        VMIN: lambda core: core.vmin,
        VMAX: lambda core: core.vmax,
    }
    return {field: program.by_column(phase, value) for field, value in values.items()}
