"""``--emit graphml`` and ``--emit dot``: the placed program as a graph, for graph tools and for Graphviz."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.etree import ElementTree

import hw_model as hw
from hw_model.io.xml_text import xml_file, xml_text
from locsnn_compile.backends.placed_graph import ProgramGraph, Values, placed_graph

GRAPHML_FILE, DOT_FILE = "program.graphml", "program.dot"
_NAMESPACE = "http://graphml.graphdrawing.org/xmlns"

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
    for identity, values in graph.nodes.items():
        _data(ElementTree.SubElement(body, "node", id=identity), "node", values)
    for source, target, values in graph.edges:
        _data(ElementTree.SubElement(body, "edge", source=source, target=target), "edge", values)
    return {GRAPHML_FILE: xml_file(root)}


def dot_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the file by name: a box for each core, joined compartments dashed."""
    graph = placed_graph(program)
    return {DOT_FILE: ("\n".join(_dot_lines(graph)) + "\n").encode()}


def _data(element: ElementTree.Element, domain: str, values: Values) -> None:
    for name, value in values.items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        ElementTree.SubElement(element, "data", key=f"{domain}_{name}").text = xml_text(text)


def _dot_lines(graph: ProgramGraph) -> Iterator[str]:
    program, nodes = graph.program, graph.nodes.items()
    yield f"digraph {_quoted(program.name)} {{"
    yield "  rankdir=LR;"
    yield "  node [shape=box];"
    for name, item in nodes:
        if item["kind"] == "input":
            label = _label((str(item["name"]), f"{item['size']} lines, phase {item['phase']}"))
            yield f"  {name} [label={label}, shape=cds];"
    for core in program.cores:
        x, y = program.chip.tile_of(core.slot)
        yield f"  subgraph cluster_core{core.number} {{"
        heading = (f"core {core.number}, phase {core.phase}", f"slot {core.slot}, tile {x},{y}")
        yield f"    label={_label(heading)};"
        for name, item in nodes:
            if item.get("core") == core.number:
                label = _label((str(item["name"]), f"{item['start']} to {int(item['stop']) - 1}"))
                yield f"    {name} [label={label}{'' if item['spiking'] else ', style=rounded'}];"
        yield "  }"
    for source, target, values in graph.edges:
        joined = values["kind"] == "joined"
        style = "style=dashed" if joined else f"label={_quoted(str(values['synapses']) + ' synapses')}"
        yield f"  {source} -> {target} [{style}];"
    yield "}"


def _label(lines: Iterable[str]) -> str:
    return '"' + "\\n".join(_escaped(line) for line in lines) + '"'


def _quoted(text: str) -> str:
    return f'"{_escaped(text)}"'


def _escaped(text: str) -> str:
    """Return a text for a quoted string; a backslash would begin an escape, a control character would not show."""
    printable = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return printable.replace("\\", "\\\\").replace('"', '\\"')
