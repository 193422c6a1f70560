"""``--emit graphml`` and ``--emit dot``: the placed program as a graph, for graph tools and for Graphviz."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.etree import ElementTree

import hw_model as hw
from hw_model.io.xml_text import xml_file, xml_text
from locsnn_compile.backends.placed_graph import ProgramGraph, placed_graph

GRAPHML_FILE, DOT_FILE = "program.graphml", "program.dot"
_NAMESPACE = "http://graphml.graphdrawing.org/xmlns"

_Value = str | int | bool
_TYPES = {str: "string", int: "long", bool: "boolean"}
_NODE_KEYS: dict[str, type] = {
    "kind": str, "name": str, "phase": str, "size": int, "start": int, "stop": int, "core": int, "slot": int,
    "tile_x": int, "tile_y": int, "spiking": bool,
}  # fmt: skip
_EDGE_KEYS: dict[str, type] = {"kind": str, "synapses": int, "axons": int, "hops": int, "compartments": int}
_GRAPH_KEYS: dict[str, type] = {"name": str, "target": str}


def graphml_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the file by name: a node for each input and slice, an edge for synapses and for joined compartments."""
    graph = placed_graph(program)
    root = ElementTree.Element("graphml", xmlns=_NAMESPACE)
    for domain, keys in (("graph", _GRAPH_KEYS), ("node", _NODE_KEYS), ("edge", _EDGE_KEYS)):
        for name, kind in keys.items():
            attributes = {"id": f"{domain}_{name}", "for": domain, "attr.name": name, "attr.type": _TYPES[kind]}
            ElementTree.SubElement(root, "key", attributes)
    body = ElementTree.SubElement(root, "graph", id="program", edgedefault="directed")
    _data(body, "graph", {"name": program.name, "target": program.chip.name})
    for identity, values in _nodes(graph):
        _data(ElementTree.SubElement(body, "node", id=identity), "node", values)
    for source, target, values in _edges(graph):
        _data(ElementTree.SubElement(body, "edge", source=source, target=target), "edge", values)
    return {GRAPHML_FILE: xml_file(root)}


def dot_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the file by name: a box for each core, joined compartments dashed."""
    graph = placed_graph(program)
    return {DOT_FILE: ("\n".join(_dot_lines(graph)) + "\n").encode()}


def _nodes(graph: ProgramGraph) -> Iterator[tuple[str, dict[str, _Value]]]:
    program = graph.program
    for item in graph.inputs:
        yield item.id, {"kind": "input", "name": item.name, "phase": item.phase, "size": item.size}
    for node in graph.slices:
        core = program.cores[node.core]
        x, y = program.chip.tile_of(core.slot)
        yield node.id, {
            "kind": "compartments", "name": node.name, "phase": node.phase, "size": node.size, "start": node.start,
            "stop": node.stop, "core": node.core, "slot": core.slot, "tile_x": x, "tile_y": y, "spiking": node.spiking,
        }  # fmt: skip


def _edges(graph: ProgramGraph) -> Iterator[tuple[str, str, dict[str, _Value]]]:
    for edge in graph.synapses:
        counts = {"synapses": edge.synapses, "axons": edge.axons, "hops": edge.hops}
        yield edge.source, edge.target, {"kind": "synapses", **counts}
    for join in graph.joins:
        yield join.source, join.target, {"kind": "joined", "compartments": join.compartments}


def _data(element: ElementTree.Element, domain: str, values: dict[str, _Value]) -> None:
    for name, value in values.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        ElementTree.SubElement(element, "data", key=f"{domain}_{name}").text = xml_text(text)


def _dot_lines(graph: ProgramGraph) -> Iterator[str]:
    program = graph.program
    yield f"digraph {_quoted(program.name)} {{"
    yield "  rankdir=LR;"
    yield "  node [shape=box];"
    for item in graph.inputs:
        label = _label((item.name, f"{item.size} lines, phase {item.phase}"))
        yield f"  {item.id} [label={label}, shape=cds];"
    for core in program.cores:
        x, y = program.chip.tile_of(core.slot)
        yield f"  subgraph cluster_core{core.number} {{"
        heading = (f"core {core.number}, phase {core.phase}", f"slot {core.slot}, tile {x},{y}")
        yield f"    label={_label(heading)};"
        for node in (node for node in graph.slices if node.core == core.number):
            style = "" if node.spiking else ", style=rounded"
            yield f"    {node.id} [label={_label((node.name, f'{node.start} to {node.stop - 1}'))}{style}];"
        yield "  }"
    for edge in graph.synapses:
        yield f"  {edge.source} -> {edge.target} [label={_quoted(f'{edge.synapses} synapses')}];"
    for join in graph.joins:
        yield f"  {join.source} -> {join.target} [style=dashed];"
    yield "}"


def _label(lines: Iterable[str]) -> str:
    return '"' + "\\n".join(_escaped(line) for line in lines) + '"'


def _quoted(text: str) -> str:
    return f'"{_escaped(text)}"'


def _escaped(text: str) -> str:
    """Return a text for a quoted string; a backslash would begin an escape, a control character would not show."""
    printable = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return printable.replace("\\", "\\\\").replace('"', '\\"')
