"""Lay out a phase for the fast engine: its compartments in chunks, bundles and blocks, its synapses in links.

:mod:`hw_model.engine.layout` explains these words and the tables that :func:`fast_layout` fills.
:mod:`hw_model.engine.places` cuts chunks, :mod:`hw_model.engine.links` lays out synapses, and this
module decides the order of updates, the width of numbers, and which chunks need less work.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic import loihi, loihi_bounds, loihi_inverse
from hw_model.arithmetic.fixed_point import high_part_fits
from hw_model.engine import layout
from hw_model.engine.layout import (
    LANES,
    Chunks,
    FastLayout,
    Lanes,
    Links,
    Nodes,
    Tables,
    Widths,
    aligned,
)
from hw_model.engine.links import Blocks, Echoes, NodePair, links_of, synapses_by_ends, take_echoes
from hw_model.engine.places import Cut, Numbering, cut_pieces
from hw_model.engine.trace import due_late
from hw_model.mapping.circles import roots, sources_first
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.program.pieces import pieces_of
from hw_model.range_proof import charges
from hw_model.values import AnyArray, BoolArray, IntArray


@lru_cache(maxsize=8)
def fast_layout(program: ChipProgram, phase: str) -> FastLayout:
    """Return the tables of a phase. The cache is keyed by the identity of the program."""
    nodes = Numbering(program, phase)
    cut = cut_pieces(pieces_of(program, phase), nodes)
    synapses = synapses_by_ends(program, phase, nodes)
    # Blocks are found with all synapses; then echoes are removed, so that they become no links.
    blocks = _blocks(nodes, synapses)
    echoes = take_echoes(nodes, synapses)
    links = links_of(nodes, synapses, blocks, cut, due_late(program, phase))
    return FastLayout(
        inputs=nodes.inputs,
        pieces=len(pieces_of(program, phase).group),
        tables=Tables(
            nodes=Nodes(nodes.first, nodes.size, cut.of_node),
            chunks=_chunks(program, phase, nodes, blocks, cut, links, echoes),
            links=links,
        ),
        slot=cut.slot,
    )


def _blocks(nodes: Numbering, pairs: Iterable[NodePair]) -> Blocks:
    """Return the nodes of groups, block by block, sources before their targets.

    ``pairs``: the nodes that are connected by synapses.
    """
    first_group = nodes.inputs
    groups = len(nodes.names) - first_group
    edges = [pair for pair in sorted(pairs) if pair[0] >= first_group]
    # Edges both ways make a child and its parent a circle, hence one block: they are updated together.
    joins = [(child, int(parent)) for child, parent in enumerate(nodes.parent) if parent >= 0]
    edges += joins
    edges += [(parent, child) for child, parent in joins]
    edges_of_groups = [(source - first_group, target - first_group) for source, target in edges]
    order = sources_first(groups, edges_of_groups)
    return [[first_group + group for group in block] for block in order]


def _chunks(  # noqa: PLR0913 - results of the steps of fast_layout, each used once
    program: ChipProgram,
    phase: str,
    nodes: Numbering,
    blocks: Blocks,
    cut: Cut,
    links: Links,
    echoes: Echoes,
) -> Chunks:
    """Return the table of chunks: registers, the order of updates, and which shortcuts apply to each chunk."""
    limits = program.chip.registers
    widths = Widths(loihi.charge_span(limits.charge_bits), limits.half_current)
    arriving, has_synapses = _arriving(program, phase, cut)
    registers = _registers(program, phase, cut, arriving, widths)
    parent = _parent_chunks(nodes, cut)

    is_parent = np.zeros(len(parent), dtype=np.bool_)
    is_parent[parent[parent >= 0]] = True
    decay_u = loihi_inverse.decay_of(registers[:, layout.KEEP_U])
    has_bias = registers[:, layout.BIAS].any(axis=1)
    is_refractory = (registers[:, layout.REFRACTORY] > 1).any(axis=1)
    cannot_wrap = _cannot_wrap(arriving.reshape(-1, LANES), decay_u, widths)
    # A refractory of 1 blocks no step. Plain chunks run in a shorter kernel.
    plain = ~has_bias & ~is_refractory & ~is_parent & cannot_wrap

    order = _order_of_updates(blocks, cut, parent)
    keeps_state = registers[:, [layout.KEEP_U, layout.KEEP_V]].any(axis=(1, 2))
    # Such a chunk is only the sum of its children: its state is 0 before every step.
    keeps_nothing = ~keeps_state & ~has_bias & ~has_synapses & ~is_refractory
    echo_to, echo = _echo(nodes, cut, echoes, registers.dtype)
    # Joined compartments have no threshold.
    spiking = [[node for node in block if nodes.parent[node] < 0] for block in blocks]
    has_links_within = np.diff(links.from_node) > 0
    feeds_itself = [bool(has_links_within[block].any()) for block in blocks]
    return Chunks(
        node=cut.node,
        piece=cut.piece,
        parent=parent,
        first_column=cut.first_column,
        width=cut.width,
        plain=plain.astype(np.uint8),
        registers=registers,
        member=order.member,
        begins=order.begins,
        pair=_pairs(order, parent, keeps_nothing),
        bundle=order.bundle,
        of_block=order.of_block,
        feeds_itself=np.array(feeds_itself, np.uint8),
        spiking_node=np.array([node for block in spiking for node in block], np.int64),
        of_node=np.cumsum([0, *map(len, spiking)]),
        echo_to=echo_to,
        echo=echo,
        widths=widths,
    )


def _arriving(program: ChipProgram, phase: str, cut: Cut) -> tuple[AnyArray, BoolArray]:
    """Return the largest charge, of either sign, that a step may bring to each slot, and which chunks have synapses."""
    chunks = len(cut.node)
    arriving = np.zeros(chunks * LANES)
    has_synapses = np.zeros(chunks, dtype=np.bool_)
    for core in program.cores_of(phase):
        slots = cut.slot[program.columns_of_core(core)]
        charge = charges(core)
        arriving[slots] = loihi.in_units(np.maximum(-charge.low, charge.high))
        has_synapses[slots[core.axons.target] // LANES] = True
    return arriving, has_synapses


def _registers(
    program: ChipProgram, phase: str, cut: Cut, arriving: AnyArray, widths: Widths
) -> Lanes:
    """Return the registers of every chunk, (chunks, FIELDS, LANES), with a state of 0.

    They are 32 bits wide if that is proven to suffice for the whole phase, else 64.
    """
    has_short_factors = all(
        high_part_fits(max(-core.vmin, core.vmax), layout.FACTOR_BITS)
        for core in program.cores_of(phase)
    )
    fits_32_bits = (
        widths == layout.USUAL_WIDTHS
        and largest_sum(program, phase, arriving) <= np.iinfo(np.int32).max
        and has_short_factors
    )
    shape = (len(cut.node), layout.FIELDS, LANES)
    registers: Lanes = np.zeros(shape, dtype=np.int64)
    if fits_32_bits:
        registers = np.zeros(shape, dtype=np.int32)
    # Empty lanes of a chunk that is not full, and joined compartments, must never spike.
    never = int(np.iinfo(registers.dtype).max)
    registers[:, layout.THRESHOLD] = never
    for field, values in _parameters(program, phase, never).items():
        registers[cut.slot // LANES, field, cut.slot % LANES] = values
    return registers


def _parent_chunks(nodes: Numbering, cut: Cut) -> IntArray:
    """Return the chunk to which each chunk adds its voltages, or -1.

    Child and parent compartments lie on the same core in the same order, so both groups are cut into
    chunks at the same places, and a chunk has one parent.
    """
    parent = np.full(len(cut.node), -1, dtype=np.int64)
    is_joined = nodes.parent[cut.node] >= 0
    column_on_node = cut.first_column - nodes.first[cut.node]
    column_of_parent = nodes.first[nodes.parent[cut.node]] + column_on_node
    parent[is_joined] = cut.slot[column_of_parent[is_joined]] // LANES
    return parent


class _Order(NamedTuple):
    """The order in which chunks are updated; :class:`hw_model.engine.layout.Chunks` says what each array is."""

    member: IntArray
    begins: BoolArray
    bundle: IntArray
    of_block: IntArray


def _order_of_updates(blocks: Blocks, cut: Cut, parent: IntArray) -> _Order:
    """Return all chunks block by block, within a block bundle by bundle, and within a bundle children first.

    Chunks that add their voltages into one another form a tree, the bundle, whose root has no parent.
    """
    chunks = len(parent)
    roots_in_order: list[int] = []
    bundles_of_block = []
    for block in blocks:
        roots_of_block = []
        for node in block:
            for chunk in range(cut.of_node[node], cut.of_node[node + 1]):
                if parent[chunk] < 0:
                    roots_of_block.append(chunk)
        roots_in_order += roots_of_block
        bundles_of_block.append(len(roots_of_block))
    rank_of_root = np.zeros(chunks, dtype=np.int64)
    rank_of_root[roots_in_order] = np.arange(len(roots_in_order))
    root, depth = roots(parent)
    # Sorted by the rank of the bundle, and within it deepest first: the root, at depth 0, is last.
    member = np.lexsort((-depth, rank_of_root[root]))
    begins = np.diff(rank_of_root[root[member]], prepend=-1) != 0
    return _Order(
        member=member,
        begins=begins,
        bundle=np.append(np.flatnonzero(begins), chunks),
        of_block=np.cumsum([0, *bundles_of_block]),
    )


def _pairs(order: _Order, parent: IntArray, keeps_nothing: BoolArray) -> BoolArray:
    """Mark the first member of each bundle that consists of two children and a chunk that is only their sum.

    Neurons of two dendrites are lowered like this; one kernel updates all three chunks.
    """
    pair = np.zeros(len(parent), dtype=np.bool_)
    for low, high in pairwise(order.bundle.tolist()):
        *children, last = order.member[low:high]
        pair[low] = len(children) == 2 and keeps_nothing[last] and (parent[children] == last).all()
    return pair


def _echo(
    nodes: Numbering, cut: Cut, echoes: Echoes, dtype: npt.DTypeLike
) -> tuple[IntArray, AnyArray]:
    """Return the child chunk that each chunk has an echo to, or -1, and the weights of echoes, (delays x slots,)."""
    chunks = len(cut.node)
    delays = max((len(weights) for _, weights in echoes.values()), default=1)
    echo_to = np.full(chunks, -1, dtype=np.int64)
    echo = aligned((delays, chunks * LANES), dtype)
    for node, (child, weights) in echoes.items():
        slots = _slots_of(node, nodes, cut)
        slots_of_child = _slots_of(child, nodes, cut)
        echo_to[slots // LANES] = slots_of_child // LANES
        echo[: len(weights), slots_of_child] = weights
    return echo_to, echo.reshape(-1)


def _slots_of(node: int, nodes: Numbering, cut: Cut) -> IntArray:
    """Return the slots of a node's columns."""
    first = nodes.first[node]
    return cut.slot[first : first + nodes.size[node]]


def _cannot_wrap(arriving: AnyArray, decay_u: Lanes, widths: Widths) -> BoolArray:
    """Return in which chunks q and u cannot wrap if no charge exceeds ``arriving``, (chunks, LANES) in units of 64."""
    charge = loihi.in_registers(arriving)
    u_stays = loihi_bounds.current_stays_below(widths.half_current, charge, decay_u)
    return np.asarray(((arriving < widths.half_charge) & u_stays).all(axis=1))


def largest_sum(program: ChipProgram, phase: str, arriving: AnyArray) -> int:
    """Return a bound of every sum in an update of this phase, for any input. It decides whether 32 bits suffice.

    ``arriving`` are the largest charges of each slot, in units of 64.
    """
    registers = program.chip.registers
    current = registers.half_current
    sums = [int(arriving.max(initial=0)), registers.half_charge + current]
    for core in program.cores_of(phase):
        # v of a parent: its own v and that of each child, all within the core's limits, plus its drive.
        most_children = int(np.bincount(core.parent[core.parent >= 0]).max(initial=0))
        sums.append((most_children + 1) * max(-core.vmin, core.vmax) + current)
        sums.append(current + int(np.abs(core.bias).max()))
        sums.append(int(core.threshold_voltage.max()))
    return max(sums)


def _parameters(program: ChipProgram, phase: str, never: int) -> dict[int, IntArray]:
    """Return the parameters of every column by field of a chunk; ``never`` is the threshold of joined compartments."""
    values: dict[int, Callable[[Core], IntArray | int]] = {
        layout.KEEP_U: lambda core: loihi.keep_of(core.setting("decay_u")),
        layout.KEEP_V: lambda core: loihi.keep_of(core.setting("decay_v")),
        layout.THRESHOLD: lambda core: np.where(
            core.setting("joined") == 0, core.threshold_voltage, never
        ),
        layout.BIAS: lambda core: core.bias,
        layout.REFRACTORY: lambda core: core.setting("refractory"),
        layout.VMIN: lambda core: core.vmin,
        layout.VMAX: lambda core: core.vmax,
    }
    return {field: program.by_column(phase, value) for field, value in values.items()}
