"""The house in numbers: lines of code by room, who imports whom, and circles.

    python tests/house/rooms.py [TREE] [--types]

A room is a folder of a package with the folders in it, or a file that lies loose in the package. Lines of code are those
that are not docstrings, comments or blank, counted by folder. An arrow is a room of which a module imports one of another,
inside functions also; imports for types alone count with ``--types``. A floor is a place in the longest chain of arrows.
Arrows that run back are the thinnest whose removal opens all circles. Folders in one room must not form a circle either.
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
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    tokenize.ENDMARKER,
)


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
    """Return the source of each module of the packages, by its path without the ending: ``hw_model/chip``."""
    paths = [path for package in PACKAGES for path in sorted((tree / package).rglob("*.py"))]
    return {
        path.relative_to(tree).with_suffix("").as_posix(): path.read_text("utf-8") for path in paths
    }


def table(modules: dict[str, str], *, types: bool = False) -> str:
    """Return the house as text."""
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
    back = [f"{a} -> {b} ({rooms.edges[a, b]['imports']})" for a, b in running_back(rooms)]
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
    return [f"{title}: {len(rows)}", *(f"  {row}" for row in rows)]


def folder(module: str) -> str:
    return module.rpartition("/")[0]


def room(module: str) -> str:
    parts = module.split("/")
    return "/".join(parts[:2])


def code_lines(source: str) -> int:
    """Count the lines of a source that are not docstrings, comments or blank."""
    found: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            found.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            found.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(found)


def imports_of(modules: dict[str, str], *, types: bool = False) -> nx.DiGraph:
    """Return which module imports which."""
    files = nx.DiGraph()
    files.add_nodes_from(modules)
    for name, source in modules.items():
        wanted = {module_of(n, modules) for n in imported_names(source, types=types)} - {name, None}
        files.add_edges_from((name, one) for one in sorted(wanted))
    return files


def between(files: nx.DiGraph, place: Callable[[str], str]) -> nx.DiGraph:
    """Return the arrows between places of modules, with the number of imports of each."""
    found = nx.DiGraph()
    found.add_nodes_from(map(place, files))
    for arrow in ((place(a), place(b)) for a, b in files.edges):
        if arrow[0] != arrow[1]:
            found.add_edge(
                *arrow, imports=found.get_edge_data(*arrow, {"imports": 0})["imports"] + 1
            )
    return found


def inner_circles(files: nx.DiGraph) -> list[list[str]]:
    """Return the circles of folders that lie side by side in one room."""
    inner = files.subgraph(module for module in files if module.count("/") > 2)
    return circles(between(inner, folder))


def imported_names(source: str, *, types: bool) -> Iterator[str]:
    """Give the dotted names that a source imports anywhere."""
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
    """Return the module of the packages that a dotted name is, or is a name of; None for a name of others."""
    path = name.replace(".", "/")
    tried = (path, f"{path}/__init__", folder(path), f"{folder(path)}/__init__")
    return next((candidate for candidate in tried if candidate in modules), None)


def circles(graph: nx.DiGraph) -> list[list[str]]:
    """Return the groups of nodes that reach each other."""
    return sorted(
        sorted(group) for group in nx.strongly_connected_components(graph) if len(group) > 1
    )


def running_back(rooms: nx.DiGraph) -> list[tuple[str, str]]:
    """Return the arrows of the fewest imports without which there is no circle, the thinnest of each circle in turn."""
    left, found = rooms.copy(), []
    while circle := next(iter(circles(left)), None):
        inside = left.subgraph(circle)
        found.append(min(inside.edges, key=lambda arrow: (inside.edges[arrow]["imports"], arrow)))
        left.remove_edge(*found[-1])
    return [arrow for arrow in found if nx.has_path(rooms, arrow[1], arrow[0])]


if __name__ == "__main__":
    main()
