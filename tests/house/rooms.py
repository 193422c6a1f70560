"""Measure the structure of the packages: lines of code, imports between folders, and import cycles.

    python tests/house/rooms.py [TREE] [--types]

A room is a folder directly in a package, with all folders in it, or a module directly in the package. Lines of code are
counted by folder, without docstrings, comments and blank lines. An arrow leads from a room to another one if any module of
the first imports any module of the second, also inside functions; imports for types alone count only with ``--types``.
Floors are the rooms on the longest chain of arrows, where rooms that import each other in a circle count as one. Arrows
that run back are those with the fewest imports whose removal breaks all circles. Folders within a room are checked too.
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import networkx as nx

ROOT = Path(__file__).parents[2]
PACKAGES = ("hw_model", "locsnn_compile")
_NO_CODE = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)
"""Tokens that do not make a line a line of code."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "tree", nargs="?", type=Path, default=ROOT, help="a checkout (default this one)"
    )
    parser.add_argument("--types", action="store_true", help="count imports for types alone")
    args = parser.parse_args()
    print(table(modules_of(args.tree), types=args.types))


def modules_of(tree: Path) -> dict[str, str]:
    """Return the source of each module of the packages. Its key is its path without the ending: ``hw_model/chip``."""
    paths = [path for package in PACKAGES for path in sorted((tree / package).rglob("*.py"))]
    return {
        path.relative_to(tree).with_suffix("").as_posix(): path.read_text("utf-8") for path in paths
    }


def table(modules: dict[str, str], *, types: bool = False) -> str:
    """Return everything that this script measures as text."""
    lines: Counter[str] = Counter()
    for name, source in modules.items():
        lines[folder(name)] += code_lines(source)
    files = imports_of(modules, types=types)
    rooms = between(files, room)
    rows = [("folder", "lines")]
    rows += [(name, f"{n:,}") for name, n in sorted(lines.items())]
    rows.append(("all", f"{lines.total():,}"))
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    shown = [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
        for row in rows
    ]
    back = [
        f"{importer} -> {imported} ({rooms.edges[importer, imported]['imports']})"
        for importer, imported in running_back(rooms)
    ]
    return "\n".join(
        [
            *shown,
            "",
            f"arrows between rooms: {rooms.number_of_edges()}",
            f"floors: {nx.dag_longest_path_length(nx.condensation(rooms)) + 1}",
            *listed("arrows that run back", back),
            *listed("circles of rooms", [", ".join(circle) for circle in circles(rooms)]),
            *listed(
                "circles of folders in a room",
                [", ".join(circle) for circle in inner_circles(files)],
            ),
            *listed("circles of files", [", ".join(circle) for circle in circles(files)]),
        ]
    )


def listed(title: str, rows: list[str]) -> list[str]:
    """Return a heading with the number of rows, and the rows below it."""
    return [f"{title}: {len(rows)}", *(f"  {row}" for row in rows)]


def folder(module: str) -> str:
    """Return the folder of a module."""
    return module.rpartition("/")[0]


def room(module: str) -> str:
    """Return the room of a module: its package and the folder, or the module, directly in the package."""
    parts = module.split("/")
    return "/".join(parts[:2])


def code_lines(source: str) -> int:
    """Count the lines of a source that are not docstrings, comments or blank."""
    with_code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            with_code.update(range(token.start[0], token.end[0] + 1))
    # A docstring is a string that stands as a statement of its own.
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            last_line = node.end_lineno or node.lineno
            with_code.difference_update(range(node.lineno, last_line + 1))
    return len(with_code)


def imports_of(modules: dict[str, str], *, types: bool = False) -> nx.DiGraph:
    """Return the graph of imports between modules; an edge leads from a module to one that it imports."""
    files = nx.DiGraph()
    files.add_nodes_from(modules)
    for importer, source in modules.items():
        imported = {module_of(name, modules) for name in imported_names(source, types=types)}
        files.add_edges_from((importer, module) for module in sorted(imported - {importer, None}))
    return files


def between(files: nx.DiGraph, place: Callable[[str], str]) -> nx.DiGraph:
    """Return the graph of imports between groups of modules, with the number of imports of each edge.

    `place` names the group of a module: its room or its folder.
    """
    groups = nx.DiGraph()
    groups.add_nodes_from(map(place, files))
    for importer, imported in files.edges:
        source = place(importer)
        target = place(imported)
        if source != target:
            imports_before = groups.get_edge_data(source, target, {"imports": 0})["imports"]
            groups.add_edge(source, target, imports=imports_before + 1)
    return groups


def inner_circles(files: nx.DiGraph) -> list[list[str]]:
    """Return the circles of folders that lie side by side in one room."""
    # Two slashes or fewer: package/room/module, a module that lies in no folder inside a room.
    inner = files.subgraph(module for module in files if module.count("/") > 2)
    return circles(between(inner, folder))


def imported_names(source: str, *, types: bool) -> Iterator[str]:
    """Yield the dotted names that a source imports anywhere, also in functions.

    Imports under ``if TYPE_CHECKING:`` are passed over unless `types` is true.
    """
    waiting: list[ast.AST] = [ast.parse(source)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif types or not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            waiting += ast.iter_child_nodes(node)


def module_of(name: str, modules: dict[str, str]) -> str | None:
    """Return the module of the packages that a dotted name denotes or belongs to; None for other packages."""
    path = name.replace(".", "/")
    # The name is a module or a package, or else a class or function in one.
    candidates = (path, f"{path}/__init__", folder(path), f"{folder(path)}/__init__")
    return next((candidate for candidate in candidates if candidate in modules), None)


def circles(graph: nx.DiGraph) -> list[list[str]]:
    """Return the groups of nodes that all reach each other, sorted."""
    return sorted(
        sorted(group) for group in nx.strongly_connected_components(graph) if len(group) > 1
    )


def running_back(rooms: nx.DiGraph) -> list[tuple[str, str]]:
    """Return the arrows to remove so that no circle is left.

    From the first circle, the arrow with the fewest imports is removed, until there is no circle.
    """
    remaining = rooms.copy()
    removed = []
    while circle := next(iter(circles(remaining)), None):
        inside = remaining.subgraph(circle)
        # The arrow itself decides between equal numbers, so that the answer is always the same.
        fewest = min(inside.edges, key=lambda arrow: (inside.edges[arrow]["imports"], arrow))
        removed.append(fewest)
        remaining.remove_edge(*fewest)
    return [arrow for arrow in removed if nx.has_path(rooms, arrow[1], arrow[0])]


if __name__ == "__main__":
    main()
