"""``--emit graphml`` and ``--emit dot``: the placed program as a graph, for graph tools and for Graphviz."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import ClassVar, NamedTuple

import numpy as np

import hw_model as hw
from hw_model.io.xml_text import escaped, xml_file
from hw_model.program.chip_program import Core
from hw_model.values import Frozen, IntArray


class InputNode(Frozen):
    """An input of a program."""

    kind: ClassVar[str] = "input"
    name: str
    phase: str
    size: int


class SliceNode(Frozen):
    """Compartments ``start`` to ``stop`` of the group ``name``, which share a core."""

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
    """What an edge carries: ``synapses``, their axons at the target, and the hops of a spike."""

    kind: ClassVar[str] = "synapses"
    synapses: int
    axons: int
    hops: int


class JoinCount(Frozen):
    """Compartments that add their voltage one to one to those of the target."""

    kind: ClassVar[str] = "joined"
    compartments: int


class Edge(Frozen):
    """An edge between two nodes, by their names."""

    source: str
    target: str
    carries: SynapseCount | JoinCount


Node = InputNode | SliceNode


def placed_graph(program: hw.ChipProgram) -> tuple[dict[str, Node], list[Edge]]:
    """Return the nodes of a program by their names, and its edges, in the program's order."""
    nodes: dict[str, Node] = {
        f"i{k}": InputNode(item.name, item.phase, item.size)
        for k, item in enumerate(program.inputs)
    }
    for core in program.cores:
        tile_x, tile_y = program.chip.tile_of(core.slot)
        for k, piece in enumerate(core.slices):
            nodes[_slice(core, k)] = SliceNode(
                name=piece.group,
                phase=core.phase,
                size=piece.size,
                start=piece.start,
                stop=piece.stop,
                core=core.number,
                slot=core.slot,
                tile_x=tile_x,
                tile_y=tile_y,
                spiking=piece.group in program.spiking,
            )
    synapses = [edge for core in program.cores for edge in _into(core, program)]
    joins = [edge for core in program.cores for edge in _joins(core)]
    return nodes, synapses + joins


def _slice(core: Core, number: int) -> str:
    """Return the name of a node."""
    return f"c{core.number}s{number}"


class _Source(NamedTuple):
    """A node that may send spikes to a core, so many hops away."""

    node: str
    hops: int


def _sources(core: Core, program: hw.ChipProgram) -> tuple[list[_Source], IntArray]:
    """Return what may send to a core, and by input axon of the core its number in that list, (axons,)."""
    sources: list[_Source] = []
    source_of_axon = np.full(core.axons.input_axons, -1, dtype=np.int64)
    for k, item in enumerate(program.inputs):
        route = program.route_of(item.name)
        source_of_axon[route.axon[route.core == core.number]] = k
        sources.append(_Source(f"i{k}", 0))
    for sender in program.cores_of(core.phase):
        sent_here = sender.axons.out_core == core.number
        slice_number = sender.slice_of_compartment[sender.axons.out_compartment[sent_here]]
        source_of_axon[sender.axons.out_axon[sent_here]] = len(sources) + slice_number
        hops = sum(program.chip.hops(sender.slot, core.slot))
        sources += [_Source(_slice(sender, k), hops) for k in range(len(sender.slices))]
    return sources, source_of_axon


def _into(core: Core, program: hw.ChipProgram) -> Iterator[Edge]:
    """Yield the edges onto a core: its synapses, counted by the nodes of their source and target."""
    sources, source_of_axon = _sources(core, program)
    axon = core.axons.axon_of_synapse
    slice_count = len(core.slices)
    # The source and the slice of a synapse, as one number.
    ends = source_of_axon[axon] * slice_count + core.slice_of_compartment[core.axons.target]
    edges, synapse_counts = np.unique(ends, return_counts=True)
    ends_of_used_axon = np.unique(np.stack((ends, axon)), axis=1)[0]
    axon_counts = np.unique(ends_of_used_axon, return_counts=True)[1]
    for edge, synapses, axons in zip(
        edges.tolist(), synapse_counts.tolist(), axon_counts.tolist(), strict=True
    ):
        source_number, slice_number = divmod(edge, slice_count)
        source = sources[source_number]
        carried = SynapseCount(synapses=synapses, axons=axons, hops=source.hops)
        yield Edge(source.node, _slice(core, slice_number), carried)


def _joins(core: Core) -> Iterator[Edge]:
    piece_of = core.slice_of_compartment
    children = np.flatnonzero(core.parent >= 0)
    joined = Counter(
        zip(piece_of[children].tolist(), piece_of[core.parent[children]].tolist(), strict=True)
    )
    for (child, parent), count in sorted(joined.items()):
        yield Edge(_slice(core, child), _slice(core, parent), JoinCount(count))


GRAPHML_FILE = "program.graphml"
DOT_FILE = "program.dot"
_NAMESPACE = "http://graphml.graphdrawing.org/xmlns"

Values = Mapping[str, str | int | bool]
"""What GraphML says of a graph, a node or an edge, by name."""
_TYPES = {str: "string", int: "long", bool: "boolean"}
"""The types of values in GraphML."""


def graphml_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the file by name: a node for each input and slice, edges for synapses and joined compartments."""
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
    """Return the fields of a node or of what an edge carries by name, its kind first."""
    return {"kind": part.kind, **vars(part)}


def _graphml_keys(domain: str, parts: Iterable[Values]) -> str:
    """Declare every name that parts of a domain (graph, node or edge) use, with the type of its values."""
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
    """Return the file by name: a box for each core, and dashed edges for joined compartments."""
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
    printable = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return printable.replace("\\", "\\\\").replace('"', '\\"')
