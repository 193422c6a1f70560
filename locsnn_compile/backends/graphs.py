"""``--emit graphml`` and ``--emit dot``: write the placed program as a graph, for graph tools and for Graphviz.

A node is an input, or a slice: the part of a group of compartments that lies on one core. An edge stands for all
synapses between two nodes, or for compartments that are joined to others on the same core.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import ClassVar, NamedTuple

import numpy as np

import hw_model as hw
from hw_model.io.xml_text import escaped, xml_file
from hw_model.program.chip_program import Core
from hw_model.values import Frozen, IntArray


class InputNode(Frozen):
    """An input of a program, with ``size`` lines."""

    kind: ClassVar[str] = "input"
    name: str
    phase: str
    size: int


class SliceNode(Frozen):
    """A slice: compartments ``start`` to ``stop`` (excluded) of the group ``name``, which share a core.

    ``slot`` is the place of the core among all cores of the chips, and ``tile_x``, ``tile_y`` its tile in the mesh.
    """

    kind: ClassVar[str] = "compartments"
    name: str
    phase: str
    size: int
    start: int
    stop: int
    core: int
    slot: int
    tile_x: int
    tile_y: int
    spiking: bool


class SynapseCount(Frozen):
    """What an edge carries: its synapses, the input axons at the target that have any of them, and a spike's hops."""

    kind: ClassVar[str] = "synapses"
    synapses: int
    axons: int
    hops: int


class JoinCount(Frozen):
    """What an edge carries: the number of compartments that add their voltage to that of a parent at the target."""

    kind: ClassVar[str] = "joined"
    compartments: int


class Edge(Frozen):
    """An edge between two nodes, by their names."""

    source: str
    target: str
    carries: SynapseCount | JoinCount


Node = InputNode | SliceNode


def placed_graph(program: hw.ChipProgram) -> tuple[dict[str, Node], list[Edge]]:
    """Return the nodes of a program by their names, and its edges, in the program's order.

    Names are ``i0`` for the first input and ``c2s0`` for the first slice of core 2.
    """
    nodes: dict[str, Node] = {
        f"i{k}": InputNode(program_input.name, program_input.phase, program_input.size)
        for k, program_input in enumerate(program.inputs)
    }
    for core in program.cores:
        tile_x, tile_y = program.chip.tile_of(core.slot)
        for k, core_slice in enumerate(core.slices):
            nodes[_slice_name(core, k)] = SliceNode(
                name=core_slice.group,
                phase=core.phase,
                size=core_slice.size,
                start=core_slice.start,
                stop=core_slice.stop,
                core=core.number,
                slot=core.slot,
                tile_x=tile_x,
                tile_y=tile_y,
                spiking=core_slice.group in program.spiking,
            )
    synapses = [edge for core in program.cores for edge in _synapse_edges(core, program)]
    joins = [edge for core in program.cores for edge in _join_edges(core)]
    return nodes, synapses + joins


def _slice_name(core: Core, number: int) -> str:
    """Return the name of the node of a slice, given its number on its core."""
    return f"c{core.number}s{number}"


class _Source(NamedTuple):
    """A node that may send spikes to a core, and its distance to the core in hops."""

    node: str
    hops: int


def _sources(core: Core, program: hw.ChipProgram) -> tuple[list[_Source], IntArray]:
    """Return the nodes that may send spikes to a core, and which of them each input axon of the core belongs to.

    The second is the index in the first, (axons,).
    """
    sources: list[_Source] = []
    source_of_axon = np.full(core.axons.input_axons, -1, dtype=np.int64)
    for k, program_input in enumerate(program.inputs):
        route = program.route_of(program_input.name)
        source_of_axon[route.axon[route.core == core.number]] = k
        # Events come from outside the chip, so their hops are not counted.
        sources.append(_Source(f"i{k}", hops=0))
    for sender in program.cores_of(core.phase):
        is_sent_to_core = sender.axons.out_core == core.number
        slice_number = sender.slice_of_compartment[sender.axons.out_compartment[is_sent_to_core]]
        source_of_axon[sender.axons.out_axon[is_sent_to_core]] = len(sources) + slice_number
        hops = sum(program.chip.hops(sender.slot, core.slot))
        sources += [_Source(_slice_name(sender, k), hops) for k in range(len(sender.slices))]
    return sources, source_of_axon


def _synapse_edges(core: Core, program: hw.ChipProgram) -> Iterator[Edge]:
    """Yield the edges of synapses onto a core: an edge for each pair of a source and a slice of the core."""
    sources, source_of_axon = _sources(core, program)
    axon = core.axons.axon_of_synapse
    slice_count = len(core.slices)
    # The source and the slice of a synapse, as one number, by which numpy can count.
    ends = source_of_axon[axon] * slice_count + core.slice_of_compartment[core.axons.target]
    edges, synapse_counts = np.unique(ends, return_counts=True)
    # An axon counts once for each edge, however many synapses it has there.
    ends_of_used_axon = np.unique(np.stack((ends, axon)), axis=1)[0]
    axon_counts = np.unique(ends_of_used_axon, return_counts=True)[1]
    for edge, synapses, axons in zip(
        edges.tolist(), synapse_counts.tolist(), axon_counts.tolist(), strict=True
    ):
        source_number, slice_number = divmod(edge, slice_count)
        source = sources[source_number]
        carried = SynapseCount(synapses=synapses, axons=axons, hops=source.hops)
        yield Edge(source.node, _slice_name(core, slice_number), carried)


def _join_edges(core: Core) -> Iterator[Edge]:
    """Yield the edges of joined compartments of a core, which always share it with their parents."""
    children = np.flatnonzero(core.parent >= 0)
    child_slices = core.slice_of_compartment[children].tolist()
    parent_slices = core.slice_of_compartment[core.parent[children]].tolist()
    counts = Counter(zip(child_slices, parent_slices, strict=True))
    for (child, parent), count in sorted(counts.items()):
        yield Edge(_slice_name(core, child), _slice_name(core, parent), JoinCount(count))


GRAPHML_FILE = "program.graphml"
DOT_FILE = "program.dot"
_NAMESPACE = "http://graphml.graphdrawing.org/xmlns"

Values = Mapping[str, str | int | bool]
"""The values of a graph, a node or an edge in GraphML, by name."""
_TYPES = {str: "string", int: "long", bool: "boolean"}
"""GraphML's names of types."""


def graphml_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the content of the GraphML file, by its name.

    It has a node for each input and slice, and edges for synapses and for joined compartments.
    """
    nodes, edges = placed_graph(program)
    about: Values = {"name": program.name, "target": program.chip.name}
    keys = (
        _graphml_keys("graph", [about])
        + _graphml_keys("node", [_values(node) for node in nodes.values()])
        + _graphml_keys("edge", [_values(edge.carries) for edge in edges])
    )
    markup = f"""\
<graphml>{keys}<graph id="program" edgedefault="directed">
{_graphml_data("graph", about)}
{"".join(_graphml_node(identity, node) for identity, node in nodes.items())}
{"".join(_graphml_edge(edge) for edge in edges)}
</graph></graphml>"""
    return {GRAPHML_FILE: xml_file(markup, xmlns=_NAMESPACE)}


def _values(part: Node | SynapseCount | JoinCount) -> Values:
    """Return the values of a node, or of what an edge carries, by name; the kind comes first."""
    return {"kind": part.kind, **vars(part)}


def _graphml_keys(domain: str, parts: Iterable[Values]) -> str:
    """Declare every name that the parts of a domain (graph, node or edge) use, with the type of its values.

    GraphML wants these declarations before any value.
    """
    types = {name: _TYPES[type(value)] for values in parts for name, value in values.items()}
    return "".join(
        f'<key id="{domain}_{name}" for="{domain}" attr.name="{name}" attr.type="{type_name}"/>'
        for name, type_name in types.items()
    )


def _graphml_node(identity: str, node: Node) -> str:
    return f'<node id="{identity}">{_graphml_data("node", _values(node))}</node>'


def _graphml_edge(edge: Edge) -> str:
    data = _graphml_data("edge", _values(edge.carries))
    return f'<edge source="{edge.source}" target="{edge.target}">{data}</edge>'


def _graphml_data(domain: str, values: Values) -> str:
    return "".join(
        f'<data key="{domain}_{name}">{_graphml_value(value)}</data>'
        for name, value in values.items()
    )


def _graphml_value(value: str | int | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else escaped(str(value))


def dot_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the content of the Graphviz file, by its name: a box per core, dashed edges for joined compartments."""
    nodes, edges = placed_graph(program)
    parts = [
        *(_dot_input(name, node) for name, node in nodes.items() if isinstance(node, InputNode)),
        *(_dot_core(core, program.chip, nodes) for core in program.cores),
        *(_dot_edge(edge) for edge in edges),
    ]
    text = f"""\
digraph "{_quoted(program.name)}" {{
  rankdir=LR;
  node [shape=box];
{"".join(parts)}}}
"""
    return {DOT_FILE: text.encode()}


def _dot_input(identity: str, node: InputNode) -> str:
    label = rf"{_quoted(node.name)}\n{node.size} lines, phase {_quoted(node.phase)}"
    return f'  {identity} [label="{label}", shape=cds];\n'


def _dot_core(core: Core, chip: hw.Chip, nodes: Mapping[str, Node]) -> str:
    """Return a core as a box around the slices of groups that it holds."""
    tile_x, tile_y = chip.tile_of(core.slot)
    label = (
        rf"core {core.number}, phase {_quoted(core.phase)}\n"
        f"slot {core.slot}, tile {tile_x},{tile_y}"
    )
    slices = [
        _dot_slice(name, node)
        for name, node in nodes.items()
        if isinstance(node, SliceNode) and node.core == core.number
    ]
    return f"""\
  subgraph cluster_core{core.number} {{
    label="{label}";
{"".join(slices)}  }}
"""


def _dot_slice(identity: str, node: SliceNode) -> str:
    label = rf"{_quoted(node.name)}\n{node.start} to {node.stop - 1}"
    style = "" if node.spiking else ", style=rounded"
    return f'    {identity} [label="{label}"{style}];\n'


def _dot_edge(edge: Edge) -> str:
    if isinstance(edge.carries, JoinCount):
        return f"  {edge.source} -> {edge.target} [style=dashed];\n"
    return f'  {edge.source} -> {edge.target} [label="{edge.carries.synapses} synapses"];\n'


def _quoted(text: str) -> str:
    """Return a text for a quoted string, with backslashes and quotes escaped and control characters replaced."""
    printable = "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text
    )
    # Backslashes first, as escaping quotes adds some.
    return printable.replace("\\", "\\\\").replace('"', '\\"')
