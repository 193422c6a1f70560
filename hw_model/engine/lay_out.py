"""Lay out a phase for the fast engine: its groups in blocks, and these in bundles of chunks."""

from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import pairwise

import numpy as np

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
from hw_model.engine.links import Blocks, Echoes, Ends, links_of, synapses_by_ends, take_echoes
from hw_model.engine.places import Cut, Numbering, cut_pieces
from hw_model.engine.trace import due_late
from hw_model.mapping.circles import roots, sources_first
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.program.pieces import pieces_of
from hw_model.range_proof import charges
from hw_model.values import AnyArray, BoolArray, IntArray


@lru_cache(maxsize=8)
def fast_layout(program: ChipProgram, phase: str) -> FastLayout:
    """Follow every axon to its synapses and lay them out by node. Programs are hashed by identity."""
    nodes = Numbering(program, phase)
    cut = cut_pieces(pieces_of(program, phase), nodes)
    synapses = synapses_by_ends(program, phase, nodes)
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


def _blocks(nodes: Numbering, pairs: Iterable[Ends]) -> Blocks:
    """Return the groups' nodes block by block, sources before targets."""
    first = nodes.inputs
    joined = [(child, int(parent)) for child, parent in enumerate(nodes.parent) if parent >= 0]
    # Both ways, for what is joined is updated together.
    edges = (
        [(a, b) for a, b in sorted(pairs) if a >= first]
        + joined
        + [(parent, child) for child, parent in joined]
    )
    order = sources_first(len(nodes.names) - first, [(a - first, b - first) for a, b in edges])
    return [[first + i for i in block] for block in order]


def _chunks(
    program: ChipProgram,
    phase: str,
    nodes: Numbering,
    blocks: Blocks,
    cut: Cut,
    links: Links,
    echoes: Echoes,
) -> Chunks:
    slot = cut.slot
    count = len(cut.node)
    limits = program.chip.registers
    widths = Widths(loihi.charge_span(limits.charge_bits), limits.half_current)
    arrived = np.zeros(count * LANES)
    reached = np.zeros(count, dtype=np.bool_)
    for core in program.cores_of(phase):
        here = slot[program.columns_of_core(core)]
        charge = charges(core)
        arrived[here] = loihi.in_units(np.maximum(-charge.low, charge.high))
        reached[here[core.axons.target] // LANES] = True
    fits = (
        widths == layout.USUAL_WIDTHS
        and _largest_sum(program, phase, arrived) <= np.iinfo(np.int32).max
    )
    fits &= all(
        high_part_fits(max(-core.vmin, core.vmax), layout.FACTOR_BITS)
        for core in program.cores_of(phase)
    )
    never = np.iinfo(np.int32 if fits else np.int64).max  # the threshold of what cannot spike
    shape = (count, layout.FIELDS, LANES)
    registers: Lanes = np.zeros(shape, dtype=np.int32) if fits else np.zeros(shape, dtype=np.int64)
    registers[:, layout.THRESHOLD] = never
    for field, values in _parameters(program, phase, never).items():
        registers[slot // LANES, field, slot % LANES] = values
    keeps = registers[:, [layout.KEEP_U, layout.KEEP_V, layout.BIAS]].any(axis=(1, 2))
    plain = ~registers[:, layout.BIAS].any(axis=1) & (registers[:, layout.REFRACTORY] <= 1).all(
        axis=1
    )
    plain &= _cannot_wrap(
        arrived.reshape(-1, LANES), loihi_inverse.decay_of(registers[:, layout.KEEP_U]), widths
    )
    # A child lies next to its parent on the same core, so both are cut into chunks at the same places.
    joined = nodes.parent[cut.node] >= 0
    parent = np.full(count, -1, dtype=np.int64)
    beside = nodes.first[nodes.parent[cut.node]] + cut.first_column - nodes.first[cut.node]
    parent[joined] = slot[beside[joined]] // LANES
    plain[parent[joined]] = False
    heads = [
        [c for n in block for c in range(cut.of_node[n], cut.of_node[n + 1]) if parent[c] < 0]
        for block in blocks
    ]
    (root, depth), rank = roots(parent), np.zeros(count, dtype=np.int64)
    rank[[c for block in heads for c in block]] = np.arange(sum(map(len, heads)))
    member = np.lexsort((-depth, rank[root]))
    begins = np.diff(rank[root[member]], prepend=-1) != 0
    bundle = np.append(np.flatnonzero(begins), count)
    forgets = ~keeps & ~reached & (registers[:, layout.REFRACTORY].max(axis=1) <= 1)
    pair = np.zeros(count, dtype=np.bool_)
    for low, high in pairwise(bundle.tolist()):
        *dendrites, last = member[low:high]
        pair[low] = len(dendrites) == 2 and forgets[last] and (parent[dendrites] == last).all()
    latest = max((len(weights) for _, weights in echoes.values()), default=1)
    echo_to = np.full(count, -1, dtype=np.int64)
    echo = aligned((latest, count * LANES), registers.dtype)
    for node, (child, weights) in echoes.items():
        here, there = (slot[nodes.first[n] : nodes.first[n] + nodes.size[n]] for n in (node, child))
        echo_to[here // LANES], echo[: len(weights), there] = there // LANES, weights
    spiking = [[n for n in block if nodes.parent[n] < 0] for block in blocks]
    feeds_itself = [
        any(links.from_node[n] < links.from_node[n + 1] for n in block) for block in blocks
    ]
    return Chunks(
        node=cut.node, piece=cut.piece, parent=parent, first_column=cut.first_column, width=cut.width,
        plain=plain.astype(np.uint8), registers=registers,
        member=member, begins=begins, pair=pair, bundle=bundle,
        of_block=np.cumsum([0, *map(len, heads)]), feeds_itself=np.array(feeds_itself, np.uint8),
        spiking_node=np.array([n for block in spiking for n in block], np.int64),
        of_node=np.cumsum([0, *map(len, spiking)]), echo_to=echo_to, echo=echo.reshape(-1), widths=widths,
    )  # fmt: skip


def _cannot_wrap(arrived: AnyArray, decay_u: Lanes, widths: Widths) -> BoolArray:
    """Tell which chunks neither q nor u can wrap in, whatever arrives of the charges ``arrived`` (chunks, LANES)."""
    charge = loihi.in_registers(arrived)
    u_stays = loihi_bounds.current_stays_below(widths.half_current, charge, decay_u)
    return np.asarray(((arrived < widths.half_charge) & u_stays).all(axis=1))


def _largest_sum(program: ChipProgram, phase: str, arrived: AnyArray) -> int:
    """Return a bound on every number that an update of this phase works with, whatever the input."""
    registers = program.chip.registers
    current = registers.half_current
    found = [int(arrived.max(initial=0)), registers.half_charge + current]
    for core in program.cores_of(phase):
        # A child adds its v, within the core's limits, to what the parent keeps of its own and to its drive.
        most_children = int(np.bincount(core.parent[core.parent >= 0]).max(initial=0))
        found.append((most_children + 1) * max(-core.vmin, core.vmax) + current)
        found.append(current + int(np.abs(core.bias).max()))
        found.append(int(core.threshold_voltage.max()))
    return max(found)


def _parameters(program: ChipProgram, phase: str, never: int) -> dict[int, IntArray]:
    """Return the parameters of every column by field; ``never`` is the threshold of what cannot spike."""
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
