"""``--emit graphml`` and ``--emit dot``: the placed program as a graph, for graph tools and for Graphviz."""

from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np

import hw_model as hw
from hw_model.io.xml_text import escaped, xml_file
from hw_model.program.chip_program import Core
from hw_model.texts.pieces import Pieces

Values = Mapping[str, str | int | bool]
Edge = tuple[str, str, Values]


def placed_graph(program: hw.ChipProgram) -> tuple[dict[str, Values], list[Edge]]:
    """Return the nodes of a program by their names, and its edges (source, target, values), in the program's order.

    A node is an ``input`` or a slice of ``compartments``, ``start`` to ``stop`` of a group on a core. An edge counts
    ``synapses``, their axons and the hops of a spike, or ``joined`` compartments, which add their voltage one to one to
    those of the target.
    """
    nodes: dict[str, Values] = {
        f"i{k}": {"kind": "input", "name": item.name, "phase": item.phase, "size": item.size}
        for k, item in enumerate(program.inputs)
    }
    for core in program.cores:
        x, y = program.chip.tile_of(core.slot)
        for k, piece in enumerate(core.slices):
            nodes[_slice(core, k)] = {
                "kind": "compartments", "name": piece.group, "phase": core.phase, "size": piece.size,
                "start": piece.start, "stop": piece.stop, "core": core.number, "slot": core.slot,
                "tile_x": x, "tile_y": y, "spiking": piece.group in program.spiking,
            }  # fmt: skip
    synapses = [edge for core in program.cores for edge in _into(core, program)]
    joins = [edge for core in program.cores for edge in _joins(core)]
    return nodes, synapses + joins


def _slice(core: Core, number: int) -> str:
    return f"c{core.number}s{number}"


def _into(core: Core, program: hw.ChipProgram) -> Iterator[Edge]:
    """Yield the edges onto a core: its synapses, counted by the nodes of their source and target."""
    axons = core.axons
    sources: list[tuple[str, int]] = []
    source_of_axon = np.full(axons.input_axons, -1, dtype=np.int64)
    for k, item in enumerate(program.inputs):
        route = program.route_of(item.name)
        source_of_axon[route.axon[route.core == core.number]] = k
        sources.append((f"i{k}", 0))
    for sender in program.cores_of(core.phase):
        here = sender.axons.out_core == core.number
        piece = sender.slice_of_compartment[sender.axons.out_compartment[here]]
        source_of_axon[sender.axons.out_axon[here]] = len(sources) + piece
        hops = sum(program.chip.hops(sender.slot, core.slot))
        sources += [(_slice(sender, k), hops) for k in range(len(sender.slices))]

    axon, pieces = axons.axon_of_synapse, len(core.slices)
    pair = source_of_axon[axon] * pieces + core.slice_of_compartment[axons.target]
    pairs, synapses = np.unique(pair, return_counts=True)
    used = np.unique(np.stack((pair, axon)), axis=1)[0]
    used_axons = np.searchsorted(used, pairs, side="right") - np.searchsorted(used, pairs)
    for number, count, used_count in np.stack((pairs, synapses, used_axons), axis=1).tolist():
        source, hops = sources[number // pieces]
        values = {"kind": "synapses", "synapses": count, "axons": used_count, "hops": hops}
        yield source, _slice(core, number % pieces), values


def _joins(core: Core) -> Iterator[Edge]:
    piece_of, children = core.slice_of_compartment, np.flatnonzero(core.parent >= 0)
    found = Counter(
        zip(piece_of[children].tolist(), piece_of[core.parent[children]].tolist(), strict=True)
    )
    for (child, parent), count in sorted(found.items()):
        yield _slice(core, child), _slice(core, parent), {"kind": "joined", "compartments": count}


GRAPHML_FILE, DOT_FILE = "program.graphml", "program.dot"
_NAMESPACE = "http://graphml.graphdrawing.org/xmlns"

_TYPES = {str: "string", int: "long", bool: "boolean"}


def graphml_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the file by name: a node for each input and slice, edges for synapses and joined compartments."""
    nodes, edges = placed_graph(program)
    about: Values = {"name": program.name, "target": program.chip.name}
    held = {"graph": [about], "node": nodes.values(), "edge": [values for _, _, values in edges]}
    kinds = {
        (domain, name): type(value)
        for domain, each in held.items()
        for its in each
        for name, value in its.items()
    }
    given = {
        "keys": [
            {"domain": domain, "name": name, "type": _TYPES[kind]}
            for (domain, name), kind in kinds.items()
        ],
        "about": _data("graph", about),
        "nodes": [
            {"id": identity, "data": _data("node", values)} for identity, values in nodes.items()
        ],
        "edges": [
            {"source": a, "target": b, "data": _data("edge", values)} for a, b, values in edges
        ],
    }
    made = Pieces(__package__, GRAPHML_FILE, escaped).piece("graph", given)
    return {GRAPHML_FILE: xml_file(made, xmlns=_NAMESPACE)}


def dot_file(program: hw.ChipProgram) -> dict[str, bytes]:
    """Return the file by name: a box for each core, and dashed edges for joined compartments."""
    nodes, found = placed_graph(program)
    inputs = [{"id": name, **item} for name, item in nodes.items() if item["kind"] == "input"]
    cores = []
    for core in program.cores:
        slices = [
            {
                "id": name,
                **item,
                "last": int(item["stop"]) - 1,
                "style": "" if item["spiking"] else ", style=rounded",
            }
            for name, item in nodes.items()
            if item.get("core") == core.number
        ]
        tile = program.chip.tile_of(core.slot)
        cores.append(
            {
                "number": core.number,
                "phase": core.phase,
                "slot": core.slot,
                "tile": tile,
                "slices": slices,
            }
        )
    edges = [{"source": source, "target": target, **values} for source, target, values in found]
    synapses, joins = (
        [edge for edge in edges if edge["kind"] == kind] for kind in ("synapses", "joined")
    )
    given = {
        "name": program.name,
        "inputs": inputs,
        "cores": cores,
        "synapses": synapses,
        "joins": joins,
    }
    return {DOT_FILE: Pieces(__package__, DOT_FILE, _escaped).piece("graph", given).encode()}


def _data(domain: str, values: Values) -> list[dict[str, str]]:
    texts = {
        name: str(value).lower() if isinstance(value, bool) else str(value)
        for name, value in values.items()
    }
    return [{"domain": domain, "name": name, "text": text} for name, text in texts.items()]


def _escaped(text: str) -> str:
    """Return a text for a quoted string, with backslashes and quotes escaped and control characters replaced."""
    printable = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return printable.replace("\\", "\\\\").replace('"', '\\"')
