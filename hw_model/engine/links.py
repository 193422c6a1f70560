"""Lay out the synapses of a phase for the fast engine: each link as a matrix, or as lists of packed words.

A *link* is all synapses from one node (an input or a group) to one group. Dense links become a
matrix, of which every spike adds a row; sparse ones become lists, a word of bits per synapse.
:class:`hw_model.engine.layout.Links` defines both formats. ``docs/research/special-paths.md``
measures what each of the ways below is worth; the thresholds between them were chosen by hand.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic import loihi
from hw_model.engine.layout import LANES, LIST, MATRIX, WIDE_LIST, Lanes, Links, aligned
from hw_model.engine.places import Cut, Numbering
from hw_model.program.chip_program import ChipProgram
from hw_model.values import Int32Array, IntArray

DENSE_SHARE = 0.25
"""A link with synapses between at least this share of all pairs is a matrix, unless its delays differ: adding zeros in
a row is cheaper than following a list."""
DENSE_MOST = 1 << 27
"""Entries of the largest matrix: 256 MiB of 16-bit weights."""
REACH_SHARE = 0.33
"""Synapses of an average source, per chunk of the target and row in which they may be due, from which on a spike marks
all these chunks as touched at once; with fewer, each synapse marks its own chunk."""
LONG_LIST = 16
"""Each delay gets lists of its own if a source has at least this many synapses per delay, on average."""
WORD_BITS = 32
"""If the slot, delay and weight of every synapse of a link fit this many bits, its words are 32 bits wide, else 64."""
_Synapses = tuple[Int32Array, ...]
"""Columns of a table of synapses between two nodes: number of the source within its node, column of the target, weight
in units of 64, and delay."""
_DELAY = 3
"""The position of the delay in :data:`_Synapses`."""
NodePair = tuple[int, int]
"""The node that synapses lead from, and the one that they lead to."""
Blocks = list[list[int]]
"""The nodes of every block: groups that reach each other in a circle, or a single group."""


def synapses_by_ends(
    program: ChipProgram, phase: str, nodes: Numbering
) -> dict[NodePair, list[_Synapses]]:
    """Return the synapses of a phase by the nodes of their ends, one table per core.

    Numbers have 32 bits, as a large network has many millions of synapses.
    """
    by_ends: dict[NodePair, list[_Synapses]] = {}
    for core in program.cores_of(phase):
        axons = core.axons
        columns = program.columns_of_core(core)
        node, source = nodes.of_source(program.senders[core.number])
        axon = axons.axon_of_synapse
        # Both ends as one number, which `divmod` takes apart again below.
        ends = node[axon] * len(nodes.names) + nodes.of_column(columns)[axons.target]
        weight = loihi.whole_units(core.effective_weights)
        for pair in np.unique(ends).tolist():
            synapses = np.flatnonzero(ends == pair)
            table = (
                source[axon[synapses]],
                columns[axons.target[synapses]],
                weight[synapses],
                axons.delay[synapses],
            )
            part = tuple(values.astype(np.int32) for values in table)
            by_ends.setdefault(divmod(pair, len(nodes.names)), []).append(part)
    return by_ends


Echoes = dict[int, tuple[int, IntArray]]
"""By node: a child node, and the weights (delays, n) of the synapses from each compartment to its own child."""


def take_echoes(nodes: Numbering, synapses: dict[NodePair, list[_Synapses]]) -> Echoes:
    """Remove from ``synapses`` those that lead from the compartments of a group to their own child, and return them.

    Neurons are made refractory by such synapses: with a single delay, or with many delays as a delay line. They are
    added as vectors, chunk to chunk. Their block then needs no lists for them, and need not run step by step. Links
    that also lead to other compartments, or with few of the possible delays, stay links.
    """
    echoes: Echoes = {}
    for node, child in sorted(synapses):
        if nodes.parent[child] != node or node in echoes:
            continue
        # A node has one echo at most: the first child in order.
        source, column, weight, delay = _sorted(synapses[node, child])
        weights = np.zeros((1 + delay.max(), nodes.size[node]), dtype=np.int64)
        is_to_own_child = np.array_equal(column, nodes.first[child] + source)
        if is_to_own_child and len(source) >= DENSE_SHARE * weights.size:
            np.add.at(weights, (delay, source), weight)
            echoes[node] = child, weights
            del synapses[node, child]
    return echoes


class _LinkRow(NamedTuple):
    """One link, in the fields of :class:`hw_model.engine.layout.Links` that have a number per link."""

    source: int
    target_node: int
    kind: int
    offset: int
    width: int
    target: int
    delay: int
    slot_bits: int = 0
    late_bits: int = 0
    weight_shift: int = 0


class _LinkColumns:
    """Collects links one after the other: a row for each, the entries of matrices, and the words of lists."""

    def __init__(self) -> None:
        self.rows: list[_LinkRow] = []
        self.matrices: list[npt.NDArray[np.int16]] = []
        self.words: dict[int, list[Lanes]] = {
            LIST: [np.empty(0, dtype=np.int32)],
            WIDE_LIST: [np.empty(0, dtype=np.int64)],
        }
        self.list_starts = [np.empty(0, dtype=np.int64)]
        self._matrix_size = 0
        self._list_rows = 0

    def add(
        self, ends: NodePair, synapses: tuple[IntArray, ...], sources: int, slots: slice
    ) -> None:
        """Add a link from a node of ``sources`` sources to the slots of a node; its synapses are sorted by source."""
        source, slot, weight, delay = synapses
        slots_of_target = slots.stop - slots.start
        matrix = _matrix(source, slot, weight, delay, (sources, slots_of_target))
        if matrix is not None:
            row = _LinkRow(
                *ends,
                kind=MATRIX,
                offset=self._matrix_size,
                width=slots_of_target,
                target=slots.start,
                delay=int(delay[0]),
            )
            self.rows.append(row)
            self.matrices.append(matrix.ravel())
            self._matrix_size += matrix.size
            return
        words, bits = packed_synapses(slot, weight, delay, (slots_of_target - 1).bit_length())
        kind = LIST if words.dtype == np.int32 else WIDE_LIST
        late_rows = int(delay.max() - delay.min()) + 1
        # A sparse spike reaches few chunks: each of its synapses marks its own.
        if len(slot) < REACH_SHARE * sources * late_rows * slots_of_target // LANES:
            late_rows = 0
        slot_bits, late_bits, weight_shift = bits
        row = _LinkRow(
            *ends,
            kind=kind,
            offset=self._list_rows,
            width=late_rows,
            target=slots.start,
            delay=int(delay.min()),
            slot_bits=slot_bits,
            late_bits=late_bits,
            weight_shift=weight_shift,
        )
        self.rows.append(row)
        # Every link adds the end of its last list too, so that a list always ends at the next entry.
        first = np.searchsorted(source, np.arange(sources + 1))
        self.list_starts.append(first + sum(map(len, self.words[kind])))
        self.words[kind].append(words)
        self._list_rows += len(first)

    def matrix(self) -> npt.NDArray[np.int16]:
        """Return the entries of all matrices."""
        entries = aligned((self._matrix_size,), np.int16)
        if self.matrices:
            np.concatenate(self.matrices, out=entries)
        return entries


def links_of(
    nodes: Numbering,
    synapses: dict[NodePair, list[_Synapses]],
    blocks: Blocks,
    cut: Cut,
    due_late: IntArray,
) -> Links:
    """Return the links of a phase, made from its synapses, which this empties.

    Each link is removed from ``synapses`` as it is laid out, so that only one is in memory twice.
    """
    divided = _by_delay(nodes, synapses)
    into_block, from_node = _in_order(nodes, blocks, sorted(divided))
    link_columns = _LinkColumns()
    for parts in (*into_block, *from_node):
        for node, target, part in parts:
            source, column, weight, delay = _sorted(divided.pop((node, target, part)))
            slots = slice(LANES * int(cut.of_node[target]), LANES * int(cut.of_node[target + 1]))
            slot = cut.slot[column] - slots.start
            link_columns.add(
                (node, target), (source, slot, weight, delay), int(nodes.size[node]), slots
            )

    # `reshape` gives a phase without links its columns, too. A copy, because loops need each column in C order.
    fields_of_link = len(_LinkRow._fields)
    columns = np.array(link_columns.rows, dtype=np.int64).reshape(-1, fields_of_link).T.copy()
    links_between_blocks = sum(map(len, into_block))
    return Links(
        **dict(zip(_LinkRow._fields, columns, strict=True)),
        matrix=link_columns.matrix(),
        word=np.concatenate(link_columns.words[LIST]),
        wide_word=np.concatenate(link_columns.words[WIDE_LIST]),
        list_start=np.concatenate(link_columns.list_starts),
        into_block=np.cumsum([0, *map(len, into_block)]),
        from_node=np.cumsum([0, *map(len, from_node)]) + links_between_blocks,
        due_late=due_late,
    )


_Part = tuple[int, int, int]
"""Both ends of a link, and its delay if the synapses of these ends are divided by delay, else 0."""


def _in_order(
    nodes: Numbering, blocks: Blocks, parts: list[_Part]
) -> tuple[list[list[_Part]], list[list[_Part]]]:
    """Return the links into each block from outside it, and the links of each node within its own block."""
    block_of = {node: k for k, block in enumerate(blocks) for node in block}
    into_block: list[list[_Part]] = [[] for _ in blocks]
    from_node: list[list[_Part]] = [[] for _ in nodes.names]
    for source, target, part in parts:
        is_input = source < nodes.inputs
        if not is_input and block_of[source] == block_of[target]:
            from_node[source].append((source, target, part))
        else:
            into_block[block_of[target]].append((source, target, part))
    return into_block, from_node


def _by_delay(
    nodes: Numbering, synapses: dict[NodePair, list[_Synapses]]
) -> dict[tuple[int, int, int], list[_Synapses]]:
    """Divide long lists by delay, and empty ``synapses`` on the way.

    All synapses of a list with one delay are due in the same row, which then stays in the cache.
    """
    divided = {}
    for node, target in sorted(synapses):
        parts = synapses.pop((node, target))
        delay_columns = [part[_DELAY] for part in parts]
        delays: set[int] = set()
        for column in delay_columns:
            # Not with np.unique, which sorts: there may be millions of synapses.
            delays.update(np.flatnonzero(np.bincount(column)).tolist())
        count = sum(map(len, delay_columns))
        if count < LONG_LIST * int(nodes.size[node]) * len(delays):
            divided[node, target, 0] = parts
            continue
        for delay in sorted(delays):
            divided[node, target, delay] = [_of_delay(part, delay) for part in parts]
    return divided


def _of_delay(part: _Synapses, delay: int) -> _Synapses:
    """Return the synapses with one delay."""
    has_delay = part[_DELAY] == delay
    return tuple(column[has_delay] for column in part)


def _sorted(parts: list[_Synapses]) -> tuple[IntArray, ...]:
    """Return the synapses of all parts (cores) as one table, sorted by source and then by column.

    Lists are looked up by source; ascending columns make a list walk through memory in one direction.
    """
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    source, target_column, *_ = columns
    order = np.lexsort((target_column, source))
    return tuple(column[order].astype(np.int64) for column in columns)


def packed_synapses(
    slot: IntArray, weight: IntArray, delay: IntArray, slot_bits: int
) -> tuple[Lanes, tuple[int, int, int]]:
    """Return a word for each synapse, 64 bits wide if any does not fit 32; and slot_bits, late_bits, weight_shift.

    The weight takes the highest bits, so that its sign is that of the word.
    """
    shortest_delay = int(delay.min())
    # Low bits that are 0 in every weight are not stored. `x & -x` is the lowest bit of x that is set.
    union = int(np.bitwise_or.reduce(weight))
    shift = (union & -union).bit_length() - 1 if union else 0
    late_bits = int(delay.max() - shortest_delay).bit_length()
    largest_weight = max(int(weight.max()), -int(weight.min())) >> shift
    weight_part = (weight >> shift) << (slot_bits + late_bits)
    words = weight_part | (delay - shortest_delay) << slot_bits | slot
    bits = slot_bits + late_bits + largest_weight.bit_length() + 1  # 1 for the sign
    if bits <= WORD_BITS:
        words = words.astype(np.int32)
    return words, (slot_bits, late_bits, shift)


def _matrix(
    source: IntArray, target: IntArray, weight: IntArray, delay: IntArray, shape: tuple[int, int]
) -> npt.NDArray[np.int16] | None:
    """Return synapses as a matrix (sources, slots).

    Return None if the link is sparse or too large, if delays differ, or if a weight does not fit 16 bits.
    """
    size = shape[0] * shape[1]
    if len(delay) < DENSE_SHARE * size or size > DENSE_MOST or (delay != delay[0]).any():
        return None
    matrix = np.zeros(shape, dtype=np.int64)
    # Several synapses may lead from one compartment to another: their weights add up.
    np.add.at(matrix, (source, target), weight)
    if np.abs(matrix).max() >= 1 << 15:
        return None
    return matrix.astype(np.int16)
