"""Lay out the synapses of a phase for the fast engine: each link as a matrix, or as lists of packed words."""

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic import loihi
from hw_model.engine.layout import LANES, LIST, MATRIX, WIDE_LIST, Lanes, Links, aligned
from hw_model.engine.places import Cut, Numbering
from hw_model.program.chip_program import ChipProgram
from hw_model.values import Int32Array, IntArray

DENSE_SHARE = 0.25
"""A link with at least this share of all pairs is a matrix: adding zeros in a row is cheaper than following a list."""
DENSE_MOST = 1 << 27
"""Entries of the largest matrix, 256 MiB."""
REACH_SHARE = 0.33
"""Lists with at least as many synapses as this share of the chunks in the rows that they might reach mark all these."""
LONG_LIST = 16
"""Synapses of a source with one delay, on average, from which on each delay has lists of its own."""
WORD_BITS = 32
"""Bits in which the slot, delay and weight of every synapse of a link have to fit, or its lists are wide ones."""
_Synapses = tuple[Int32Array, ...]
"""Some synapses from one node to another: number of the source there, column, weight in units, and delay."""
_DELAY = 3
"""Which of these is the delay."""
NodePair = tuple[int, int]
"""Nodes that synapses lead from and to."""
Blocks = list[list[int]]
"""The nodes of every block."""


def synapses_by_ends(
    program: ChipProgram, phase: str, nodes: Numbering
) -> dict[NodePair, list[_Synapses]]:
    """Return the synapses of a phase by their ends, core by core: each is held once, in 32 bits a number."""
    by_ends: dict[NodePair, list[_Synapses]] = {}
    for core in program.cores_of(phase):
        axons = core.axons
        columns = program.columns_of_core(core)
        node, source = nodes.of_source(program.senders[core.number])
        axon = axons.axon_of_synapse
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
"""By node: one that is joined to it, and weights (delays, n) of synapses from its compartments to their own child."""


def take_echoes(nodes: Numbering, synapses: dict[NodePair, list[_Synapses]]) -> Echoes:
    """Take synapses out that lead from compartments of a group to their own child, with not many delays left out.

    This is how a neuron is made refractory: with one step late, or as a delay line. They are added as vectors, chunk to
    chunk, and their block needs no lists.
    """
    echoes: Echoes = {}
    for node, to in sorted(synapses):
        if nodes.parent[to] != node or node in echoes:
            continue
        source, column, weight, delay = _sorted(synapses[node, to])
        weights = np.zeros((1 + delay.max(), nodes.size[node]), dtype=np.int64)
        is_to_own_child = np.array_equal(column, nodes.first[to] + source)
        if is_to_own_child and len(source) >= DENSE_SHARE * weights.size:
            np.add.at(weights, (delay, source), weight)
            echoes[node] = to, weights
            del synapses[node, to]
    return echoes


class _LinkColumns:
    """Links as they are laid out, one after the other: a row of numbers each, entries of matrices, and lists."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, ...]] = []
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
        """Add the synapses, sorted, of a link from ``sources`` sources to slots of a node."""
        source, slot, weight, delay = synapses
        slots_of_target = slots.stop - slots.start
        matrix = _matrix(source, slot, weight, delay, (sources, slots_of_target))
        if matrix is not None:
            form = MATRIX, self._matrix_size, slots_of_target, slots.start, int(delay[0]), 0, 0, 0
            self.rows.append((*ends, *form))
            self.matrices.append(matrix.ravel())
            self._matrix_size += matrix.size
            return
        words, bits = packed_synapses(slot, weight, delay, (slots_of_target - 1).bit_length())
        kind = LIST if words.dtype == np.int32 else WIDE_LIST
        late_rows = int(delay.max() - delay.min()) + 1
        if len(slot) < REACH_SHARE * sources * late_rows * slots_of_target // LANES:
            late_rows = 0
        list_form = kind, self._list_rows, late_rows, slots.start, int(delay.min())
        self.rows.append((*ends, *list_form, *bits))
        first = np.searchsorted(source, np.arange(sources + 1))
        self.list_starts.append(first + sum(map(len, self.words[kind])))
        self.words[kind].append(words)
        self._list_rows += len(first)

    def matrix(self) -> npt.NDArray[np.int16]:
        """Return the entries of all matrices."""
        together = aligned((self._matrix_size,), np.int16)
        if self.matrices:
            np.concatenate(self.matrices, out=together)
        return together


def links_of(
    nodes: Numbering,
    synapses: dict[NodePair, list[_Synapses]],
    blocks: Blocks,
    cut: Cut,
    due_late: IntArray,
) -> Links:
    """Lay out the synapses by their ends; they are taken out, so that no more than one link is there twice."""
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

    columns = np.array(link_columns.rows, dtype=np.int64).reshape(-1, 10).T.copy()
    outside = sum(map(len, into_block))
    return Links(
        **dict(zip(Links._fields, columns, strict=False)),
        matrix=link_columns.matrix(),
        word=np.concatenate(link_columns.words[LIST]),
        wide_word=np.concatenate(link_columns.words[WIDE_LIST]),
        list_start=np.concatenate(link_columns.list_starts),
        into_block=np.cumsum([0, *map(len, into_block)]),
        from_node=np.cumsum([0, *map(len, from_node)]) + outside,
        due_late=due_late,
    )


_Part = tuple[int, int, int]
"""Both ends of synapses, and the delay by which those of these ends are divided, or 0."""


def _in_order(
    nodes: Numbering, blocks: Blocks, parts: list[_Part]
) -> tuple[list[list[_Part]], list[list[_Part]]]:
    """Return what leads into each block from other nodes, and what each node sends within its own block."""
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
    """Divide long lists by delay: what spikes of one step add is due in one row then, which stays in the cache."""
    divided = {}
    for node, to in sorted(synapses):
        parts = synapses.pop((node, to))
        delay_columns = [part[_DELAY] for part in parts]
        delays: set[int] = set()
        for column in delay_columns:
            # Not by np.unique, which sorts: there may be millions.
            delays.update(np.flatnonzero(np.bincount(column)).tolist())
        count = sum(map(len, delay_columns))
        if count < LONG_LIST * int(nodes.size[node]) * len(delays):
            divided[node, to, 0] = parts
            continue
        for delay in sorted(delays):
            divided[node, to, delay] = [_of_delay(part, delay) for part in parts]
    return divided


def _of_delay(part: _Synapses, delay: int) -> _Synapses:
    """Return the synapses that have a delay."""
    has_it = part[_DELAY] == delay
    return tuple(column[has_it] for column in part)


def _sorted(parts: list[_Synapses]) -> tuple[IntArray, ...]:
    """Return the columns of synapses of the same ends together, by source and then by column."""
    together = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.lexsort((together[1], together[0]))
    return tuple(column[order].astype(np.int64) for column in together)


def packed_synapses(
    slot: IntArray, weight: IntArray, delay: IntArray, slot_bits: int
) -> tuple[Lanes, tuple[int, int, int]]:
    """Return synapses in a word each, of 64 bits where one does not fit 32; and slot_bits, late_bits, weight_shift."""
    least = int(delay.min())
    # The bits that any weight has: those below the lowest of them need not be kept.
    union = int(np.bitwise_or.reduce(weight))
    shift = (union & -union).bit_length() - 1 if union else 0
    late_bits = int(delay.max() - least).bit_length()
    widest = max(int(weight.max()), -int(weight.min())) >> shift
    words = (weight >> shift) << (slot_bits + late_bits) | (delay - least) << slot_bits | slot
    fits = slot_bits + late_bits + widest.bit_length() + 1 <= WORD_BITS
    return words.astype(np.int32) if fits else words, (slot_bits, late_bits, shift)


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
