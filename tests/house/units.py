"""Find where a module computes with the chip's units of decays and weights, which only its page may know."""

import ast
from collections.abc import Iterator

NAMES = {"DECAY_BITS", "DECAY_ONE", "UNIT", "WEIGHT_SHIFT"}
"""What ``hw_model.arithmetic`` calls its units."""
UNITS = {64, 4095, 4096}
SHIFTS = {6, 12}
PARAMETERS = ("bias", "decay", "keep", "threshold", "weight")
"""Beginnings of names of what is counted in units."""


def units_in(source: str) -> list[str]:
    """Return every use of a unit in a module's source, by line."""
    found = [(node.lineno, what) for node in ast.walk(ast.parse(source)) for what in _uses(node)]
    return [f"line {line}: {what}" for line, what in sorted(found)]


def _uses(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hw_model.arithmetic"):
        for alias in node.names:
            if alias.name in NAMES:
                yield f"imports {alias.name}"
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield f"uses {ast.unparse(node)}"
    elif isinstance(node, ast.BinOp):
        if isinstance(node.left, ast.Constant) and isinstance(node.right, ast.Constant):
            return  # the size of a buffer, in which nothing is measured
        shifts = isinstance(node.op, ast.LShift | ast.RShift)
        if shifts and _is_one_of(node.right, SHIFTS):
            yield f"computes {ast.unparse(node)}"
        elif _is_one_of(node.left, UNITS) or _is_one_of(node.right, UNITS):
            yield f"computes {ast.unparse(node)}"
    elif isinstance(node, ast.AugAssign):
        shifts = isinstance(node.op, ast.LShift | ast.RShift)
        if _is_one_of(node.value, SHIFTS if shifts else UNITS):
            yield f"computes {ast.unparse(node)}"
    elif isinstance(node, ast.Compare):
        if any(_is_one_of(side, UNITS) for side in (node.left, *node.comparators)):
            yield f"compares {ast.unparse(node)}"
    elif isinstance(node, ast.keyword) and (node.arg or "").startswith(PARAMETERS):
        if _is_one_of(node.value, UNITS):
            yield f"gives {ast.unparse(node)}"


def _is_one_of(node: ast.expr, numbers: set[int]) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
        and node.value in numbers
    )
