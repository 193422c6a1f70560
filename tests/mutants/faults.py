"""Generate faults from the syntax tree of a module: each changes one expression or drops one statement of a function.

A fault (a mutant) shows whether the tests of a module notice a change; `run_mutants.py` plants faults and runs the tests.
Faults are found anew from the source each time, so code may be rewritten without changing a list here. The name of a fault
says its module, its function, the code that it replaces, and the code that it puts there.
"""

from __future__ import annotations

import ast
import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULE = "module"
"""The scope of code outside all functions."""
COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
"""By the kind of a comparison, the comparison that takes its place."""
CALCULATED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Pow: ast.Mult,
}
"""By an operator, the operator that takes its place."""
CALLED = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "floor": "ceil",
    "ceil": "floor",
    "rint": "floor",
    "any": "all",
    "all": "any",
    "argmax": "argmin",
    "argmin": "argmax",
    "cumsum": "asarray",
    "abs": "int",
}
"""By the name of a function that is called, the name that takes its place."""
NOT_TESTED = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom, ast.ClassDef)
"""Kinds of nodes without faults: messages, imports and classes, whose functions are scopes of their own."""
Site = tuple[ast.AST, ast.AST]
"""A node of the tree, and the node that takes its place."""


@dataclass(frozen=True)
class Fault:
    """A place in a scope of a module where the code ``old`` becomes ``new``.

    A scope is a function, or ``module`` for code outside all. Where the same change is possible at
    several places of a scope, ``number`` counts them from 0.
    """

    module: str
    scope: str
    old: str
    new: str
    number: int

    @property
    def name(self) -> str:
        """Its name, which no other fault has."""
        repetition = f" ({self.number + 1})" if self.number else ""
        return f"{self.module} {self.scope}: {self.old} -> {self.new}{repetition}"

    def path(self, root: Path = ROOT) -> Path:
        """Return the module's file."""
        return path_of(self.module, root)

    def applied(self, root: Path = ROOT) -> str:
        """Return the module's text with the fault in it. Raise ``KeyError`` if it has no such place."""
        source = self.path(root).read_text()
        old, new = _sites_by_name(source)[self.scope, self.old, self.new, self.number]
        return _spliced(source, old, new)

    def scope_text(self, root: Path = ROOT) -> str:
        """Return the text of the function without the fault."""
        source = self.path(root).read_text()
        if self.scope == MODULE:
            return source
        return ast.unparse(next(node for name, node in _scopes(source) if name == self.scope))

    def is_in(self, share: float) -> bool:
        """Return whether the fault belongs to a random sample of this share of all faults.

        The first 32 bits of a hash of its name decide, so the sample is the same in every run, and a
        larger sample holds all faults of a smaller one.
        """
        first_32_bits = int(hashlib.sha256(self.name.encode()).hexdigest()[:8], 16)
        return first_32_bits < share * 2**32


def path_of(module: str, root: Path = ROOT) -> Path:
    """Return the file of a module."""
    return root / f"{module.replace('.', '/')}.py"


def faults_of(module: str, root: Path = ROOT) -> list[Fault]:
    """Return all faults of a module, in the order of its text."""
    keys = _sites_by_name(path_of(module, root).read_text())
    return [Fault(module, *key) for key in keys]


@lru_cache(maxsize=256)
def _sites_by_name(source: str) -> dict[tuple[str, str, str, int], Site]:
    """Return every place that a fault can change, by scope, old code, new code, and number among equal ones."""
    sites: dict[tuple[str, str, str, int], Site] = {}
    for scope, node in _scopes(source):
        repetitions: Counter[tuple[str, str]] = Counter()
        for old, new in _sites(node):
            texts = (_in_line(old), _in_line(new))
            sites[scope, *texts, repetitions[texts]] = (old, new)
            repetitions[texts] += 1
    return sites


def _in_line(node: ast.AST) -> str:
    """Return the code of a node in one line."""
    return " ".join(ast.unparse(node).split())


def _scopes(source: str) -> Iterator[tuple[str, ast.AST]]:
    """Yield the code outside all functions, and every function by its name, with the functions inside it."""
    tree = ast.parse(source)
    outside = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
    yield MODULE, ast.Module(list(outside), [])
    yield from _functions(tree, "")


def _functions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, ast.AST]]:
    """Yield the functions and methods below a node by name; methods are called ``Class.method``."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            if not _is_declared_only(node):
                yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def _is_declared_only(function: ast.FunctionDef) -> bool:
    """Return whether a function has no body to be tested (an overload), or shares its name (a setter)."""
    decorators = {ast.unparse(each) for each in function.decorator_list}
    return bool(decorators & {"overload", "abstractmethod"}) or any(
        each.endswith(".setter") for each in decorators
    )


def _sites(node: ast.AST) -> Iterator[Site]:
    """Yield the places inside a node that a fault can change. Only the type checker reads annotations."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, NOT_TESTED):
                continue
            if isinstance(child, ast.FunctionDef) and _is_declared_only(child):
                continue
            for changed in _changes(child):
                yield child, changed
            yield from _sites(child)


def _changes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that faults put in the place of a node."""
    for kind, change in CHANGES:
        if isinstance(node, kind):
            yield from change(node)


def _compared_otherwise(node: ast.Compare) -> Iterator[ast.AST]:
    if len(node.ops) == 1:
        yield ast.Compare(node.left, [COMPARED[type(node.ops[0])]()], node.comparators)


def _calculated_otherwise(node: ast.BinOp) -> Iterator[ast.AST]:
    # A string with % or * is text that is formatted, not a number.
    operands = (node.left, node.right)
    if any(isinstance(each, ast.Constant) and isinstance(each.value, str) for each in operands):
        return
    if type(node.op) in CALCULATED:
        yield ast.BinOp(node.left, CALCULATED[type(node.op)](), node.right)


def _one_of_several(node: ast.BoolOp) -> Iterator[ast.AST]:
    for left_out in range(len(node.values)):
        remaining = [value for place, value in enumerate(node.values) if place != left_out]
        yield remaining[0] if len(remaining) == 1 else ast.BoolOp(node.op, remaining)


def _without_sign(node: ast.UnaryOp) -> Iterator[ast.AST]:
    if isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield node.operand


def _one_more(node: ast.Constant) -> Iterator[ast.AST]:
    if isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node.value, int):
        yield ast.Constant(node.value + 1)


def _called_otherwise(node: ast.Call) -> Iterator[ast.AST]:
    function = node.func
    if isinstance(function, ast.Name) and function.id in CALLED:
        changed: ast.expr = ast.Name(CALLED[function.id])
    elif isinstance(function, ast.Attribute) and function.attr in CALLED:
        changed = ast.Attribute(function.value, CALLED[function.attr])
    else:
        return
    yield ast.Call(changed, node.args, node.keywords)


def _always_the_first(node: ast.IfExp) -> Iterator[ast.AST]:
    yield node.body


def _left_out(node: ast.Expr | ast.AugAssign) -> Iterator[ast.AST]:
    # A text that stands alone is a docstring.
    is_text = isinstance(node.value, ast.Constant | ast.JoinedStr)
    if not is_text or isinstance(node, ast.AugAssign):
        yield ast.Pass()


CHANGES: tuple[tuple[type | tuple[type, ...], Callable[..., Iterator[ast.AST]]], ...] = (
    (ast.Compare, _compared_otherwise),
    (ast.BinOp, _calculated_otherwise),
    (ast.BoolOp, _one_of_several),
    (ast.UnaryOp, _without_sign),
    (ast.Constant, _one_more),
    (ast.Call, _called_otherwise),
    (ast.IfExp, _always_the_first),
    ((ast.Expr, ast.AugAssign), _left_out),
)
"""For each kind of node, the function that yields its replacements."""


def _spliced(source: str, old: ast.AST, new: ast.AST) -> str:
    """Return a source with one of its nodes replaced; all other lines keep their numbers."""
    assert isinstance(old, ast.expr | ast.stmt)
    assert old.end_lineno is not None
    assert old.end_col_offset is not None
    # The syntax tree counts columns in bytes of UTF-8, so the text is cut as bytes.
    encoded = source.encode()
    starts = [0]
    for line in encoded.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    start = starts[old.lineno - 1] + old.col_offset
    stop = starts[old.end_lineno - 1] + old.end_col_offset
    text = ast.unparse(new)
    if isinstance(old, ast.expr):
        # As many lines as before, so that the lines that follow keep their numbers.
        text = f"({text}" + "\n" * (old.end_lineno - old.lineno) + ")"
    return (encoded[:start] + text.encode() + encoded[stop:]).decode()
