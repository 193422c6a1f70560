"""Read a NIR file as plain frozen data: nodes with their arrays, and edges. Nothing is interpreted here.

HDF5 layout (NIR 1.0): ``/version`` and ``/node``. A graph is a group of ``type`` NIRGraph with ``nodes/<name>`` and
``edges`` (n, 2). A node is a group with its ``type`` and parameters. We do not use the ``nir`` package, because its
reader trusts every size.
"""

import contextlib
from collections.abc import Mapping
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from hw_model.io.yaml_text import read_mapping
from hw_model.values import AnyArray, FloatArray, Frozen
from locsnn_compile.data.hdf5.read import Group, open_hdf5
from locsnn_compile.errors import InputError, check_known, check_most

MAX_NODES = 10_000
"""Largest number of nodes of a file; a limit for hostile files, chosen by hand."""
MAX_DEPTH = 16
"""Largest number of graphs inside each other; a limit for hostile files, chosen by hand."""
LONGEST_NAME = 200
"""Most characters of a node's name; chosen by hand."""
SHOWN_CHARACTERS = 60
"""Characters of a word of the file that an error shows, so that it stays short; chosen by hand."""

Array = AnyArray
Edge = tuple[str, str]

PARAMETERS = read_mapping(Path(__file__).with_name("primitives.yaml"), "primitives.yaml", "")
"""The parameters of each NIR primitive, in the order in which they are read."""
OPTIONAL = ("input_type", "input_shape", "v_reset", "w_in")
"""Parameters that may be missing: older files lack ``v_reset``, which is then 0, and ``w_in``, which is then 1."""

UNBOUNDED = ("tau", "tau_mem", "r")
"""Parameters that may be infinite: snnTorch writes an infinite tau and r for a neuron that does not leak."""


class NirNode(Frozen, eq=False):
    """A primitive of a NIR graph: its type (``kind``) and its parameters.

    Parameters are int64 or float64 arrays, and text for a padding such as ``same``.
    """

    kind: str
    parameters: Mapping[str, Array | str]

    def array(self, name: str) -> Array:
        """Return a parameter that is an array."""
        value = self.parameters[name]
        assert not isinstance(value, str)
        return value

    def each(self, name: str, size: int, *, of: str, where: str) -> FloatArray:
        """Return a parameter with one number per item, (size,); a single number in the file stands for all.

        ``of`` names an item in the error, such as ``neuron``.
        """
        values = self.array(name).astype(np.float64).reshape(-1)
        if values.size not in (1, size):
            measured = f"{self.array(name).shape} against {size}"
            what = f"{name} is not one number per {of}"
            raise InputError(where, what, measured=measured, fix="Give as many.")
        return np.broadcast_to(values, (size,))


class NirGraph(Frozen, eq=False):
    """Nodes by name, in file order, and edges between them; a node may be a graph."""

    nodes: "Mapping[str, NirNode | NirGraph]"
    edges: tuple[Edge, ...]
    metadata: Mapping[str, Array | str] = field(default_factory=dict)

    def with_metadata(self, **entries: Array | str) -> "NirGraph":
        """Return the graph with more metadata, which replace entries of the same name."""
        return replace(self, metadata={**self.metadata, **entries})


def read_nir(path: Path, where: str) -> tuple[NirGraph, bytes]:
    """Return the graph of a file, and the bytes of the file; raise ``InputError`` if it is not a NIR graph."""
    with open_hdf5(path, where) as (root, data):
        top = root.group("node")
        kind = top.text("type")
        if kind != "NIRGraph":
            what = "it contains one node, not a graph"
            raise InputError(
                where, what, measured=kind[:SHOWN_CHARACTERS], fix="Wrap it in a NIRGraph."
            )
        return _read_graph(top, where, 0, [0]), data


def _read_graph(group: Group, where: str, depth: int, node_count: list[int]) -> NirGraph:
    """Read a graph that is inside ``depth`` others; ``node_count`` is one number that counts the nodes of the file."""
    check_most(depth, MAX_DEPTH, where, "graphs are nested too deep", fix="Flatten them.")
    nodes: dict[str, NirNode | NirGraph] = {}
    node_groups = group.group("nodes")
    for name in node_groups.names():
        node_count[0] += 1
        check_most(node_count[0], MAX_NODES, where, "too many nodes", fix="Give a smaller graph.")
        place = f"{where}, node {name[:SHOWN_CHARACTERS]!r}"
        if not name.isprintable() or len(name) > LONGEST_NAME:
            raise InputError(place, "its name is not plain text", fix="Rename it.")
        nodes[name] = _read_node(node_groups.group(name, place), place, depth, node_count)
    edges = group.texts("edges") if "edges" in group else []
    if edges and group.shape("edges")[1:] != (2,):
        raise InputError(
            where,
            "edges are not pairs",
            measured=f"shape {group.shape('edges')}",
            fix="Write it again.",
        )
    # The texts of (n, 2) come flat: source, target, source, target, ...
    pairs = tuple(zip(edges[::2], edges[1::2], strict=True))
    return NirGraph(nodes, pairs, _metadata(group))


def _metadata(group: Group) -> dict[str, Array | str]:
    """Return the metadata that are text or numbers; other entries, which other tools may store, are skipped."""
    if "metadata" not in group:
        return {}
    entries = group.group("metadata")
    metadata: dict[str, Array | str] = {}
    for name in entries.names():
        with contextlib.suppress(InputError):
            metadata[name] = entries.value(name)
    return metadata


def _read_node(group: Group, where: str, depth: int, node_count: list[int]) -> NirNode | NirGraph:
    """Read a primitive, or a graph inside a graph."""
    if "type" not in group:
        fix = "Rename nodes without slashes."
        raise InputError(where, "it has no type; HDF5 makes groups of a name with a slash", fix=fix)
    kind = group.text("type")
    if kind == "NIRGraph":
        return _read_graph(group, where, depth + 1, node_count)
    shown_kind = kind[:SHOWN_CHARACTERS]
    check_known(where, f"{shown_kind!r} is not a NIR primitive", shown_kind, PARAMETERS)
    # Some versions write the type of the input as a group. It only names axes, and later weights depend on the order of
    # the values alone, so it is skipped.
    missing = [
        name
        for name in OPTIONAL
        if name not in group or (name == "input_type" and group.is_group(name))
    ]
    parameters: dict[str, Array | str] = {}
    for name in PARAMETERS[kind]:
        if name not in missing:
            if name == "padding":
                parameters[name] = group.value(name)  # numbers, or the word same or valid
            else:
                parameters[name] = group.array(name, infinite=name in UNBOUNDED)
    return NirNode(kind, parameters)
