"""The table of mutants: small faults, each a text of one function replaced by another.

``table/*.yaml`` holds lists of sections::

    - module: hw_model.streaming.early_stop
      tests: [test_early_stop.py]        # what is run, wherever it lies in tests; likeliest killers first
      loops: false                       # true: the module holds compiled loops, or constants of theirs
      compiled: false                    # true: the tests compile the fault
      mutants:
        _Voter.spikes_after:             # a function or class of the module; "module" for lines outside of them
          - ["| (not self._safe)", ""]   # occurs once there
          - ["1e-9", "1e-8", "Why nothing that anyone can see changes."]
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from textwrap import dedent

import yaml

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RUN = ("loops", "compiled")
"""Keys of a section that say how its faults are run."""


@dataclass(frozen=True)
class Mutant:
    """``old`` becomes ``new`` in a scope of a module.

    ``loops``: its loops are compiled ones, and interpreted in the tests; ``compiled``: the tests compile the fault itself;
    ``equivalent``: why the fault changes nothing, where it is so.
    """

    module: str
    scope: str
    old: str
    new: str
    tests: tuple[str, ...]
    loops: bool = False
    compiled: bool = False
    equivalent: str = ""

    @property
    def name(self) -> str:
        """What it is called: all of it, so that no other has the same."""
        old, new = (" ".join(text.split()) for text in (self.old, self.new))
        return f"{self.module} {self.scope}: {old} -> {new or 'nothing'}"

    def path(self, root: Path = ROOT) -> Path:
        """Return the module's file."""
        return root / f"{self.module.replace('.', '/')}.py"

    def applied(self, root: Path = ROOT) -> str:
        """Return the module's text with the fault in it; one that does not fit the text is a ``ValueError``."""
        source = self.path(root).read_text()
        start, stop = _extent(source, self.scope)
        return source[:start] + self._faulty(source[start:stop]) + source[stop:]

    def faulty_scope(self, root: Path = ROOT) -> str:
        """Return the text of the scope alone, with the fault in it."""
        source = self.path(root).read_text()
        start, stop = _extent(source, self.scope)
        return self._faulty(source[start:stop])

    def _faulty(self, part: str) -> str:
        places = _anyhow_broken(self.old).findall(part)
        if len(places) != 1:
            raise ValueError(f"{self.name}: found {len(places)} times, not once")
        mutated = part.replace(places[0], self.new)
        if ast.dump(ast.parse(dedent(mutated))) == ast.dump(ast.parse(dedent(part))):
            raise ValueError(f"{self.name}: is the same program")
        return mutated


def mutants() -> list[Mutant]:
    """Return all mutants of the table."""
    return [
        Mutant(
            section["module"],
            scope,
            *row[:2],
            tuple(section["tests"]),
            *(section.get(k, False) for k in RUN),
            *row[2:],
        )
        for path in sorted((HERE / "table").glob("*.yaml"))
        for section in yaml.safe_load(path.read_text())
        for scope, rows in section["mutants"].items()
        for row in rows
    ]


@cache
def file_of(test: str, root: Path = ROOT) -> Path:
    """Return the file of tests of that name."""
    found = sorted((root / "tests").rglob(test.split("::")[0]))
    if len(found) != 1:
        raise ValueError(f"{test}: {len(found)} files of that name, not one")
    return found[0]


@cache
def _anyhow_broken(text: str) -> re.Pattern[str]:
    """Return a pattern of a text of a program, however the formatter breaks it into lines."""
    words = text.split()
    indent = text[: len(text) - len(text.lstrip())]
    pattern = re.escape(indent) + r"\s+".join(map(re.escape, words))
    if text[-1:].isspace():
        pattern += re.escape(text[-1])
    after_opening = re.sub(r"(\\[(\[])(?=.)", r"\1\\s*", pattern)
    return re.compile(re.sub(r"(?<=.)(\\[)\]])", r",?\\s*\1", after_opening))


@lru_cache(maxsize=256)
def _extent(source: str, scope: str) -> tuple[int, int]:
    """Return where the text of a function or class begins and ends."""
    if scope == "module":
        return 0, len(source)
    lines = [0]
    for line in source.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    found = [node for name, node in _scopes(ast.parse(source), "") if name == scope]
    if len(found) != 1:
        raise ValueError(f"{scope}: {len(found)} functions or classes of that name, not one")
    assert found[0].end_lineno is not None
    first = min([found[0].lineno, *(decorator.lineno for decorator in found[0].decorator_list)])
    return lines[first - 1], lines[found[0].end_lineno]


def _scopes(tree: ast.AST, prefix: str) -> Iterator[tuple[str, ast.FunctionDef | ast.ClassDef]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield prefix + node.name, node
            yield from _scopes(node, f"{prefix}{node.name}.")
