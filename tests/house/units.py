"""Find where a module computes what only the modules of the chip's arithmetic may know.

That is: the units of decays (1/4096) and of weights (64), the bounds of a register of a given number
of bits, the lower limits of voltages ``1 - 2^k``, the truncation of weights, and the step at which a
spike acts (one step after its delay). The search reads the syntax tree, so it finds only what is
written out; `test_units.py` uses it.
"""

import ast
from collections.abc import Iterator

NAMES = {"DECAY_BITS", "DECAY_ONE", "UNIT", "WEIGHT_SHIFT"}
"""The names of the units in ``hw_model.arithmetic``."""
UNITS = {64, 4095, 4096}
"""A weight's unit, the mask of a decay's 12 bits, and a decay of one."""
SHIFTS = {6, 12}
"""The binary logarithms of the units of weights and decays, by which values are shifted."""
PARAMETERS = ("bias", "decay", "keep", "threshold", "weight")
"""How names of parameters begin whose values are counted in units."""
WIDTHS = {
    "bits",
    "charge_bits",
    "current_bits",
    "voltage_bits",
    "threshold_mantissa_bits",
    "bias_mantissa_bits",
}
"""Names of the widths of registers."""


def units_in(source: str) -> list[str]:
    """Return a description of every use of a unit in a module's source, in the order of lines."""
    uses = [(node.lineno, use) for node in ast.walk(ast.parse(source)) for use in _uses(node)]
    return [f"line {line}: {use}" for line, use in sorted(uses)]


def _uses(node: ast.AST) -> Iterator[str]:
    """Yield a description of each use of a unit in a node itself, not in the nodes below it."""
    if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hw_model.arithmetic"):
        for alias in node.names:
            if alias.name in NAMES:
                yield f"imports {alias.name}"
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield f"uses {ast.unparse(node)}"
    elif isinstance(node, ast.BinOp) and _knows_the_page(node):
        yield f"computes {ast.unparse(node)}"
    elif isinstance(node, ast.Call) and _truncates_a_weight(node):
        yield f"computes {ast.unparse(node)}"
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


def _knows_the_page(node: ast.BinOp) -> bool:
    """Return whether an expression is the bound of a register, a lower limit, or the step at which a spike acts."""
    if _is_power_of_two(node):
        return _name(node.right) in WIDTHS
    if isinstance(node.op, ast.Sub) and _is_one_of(node.left, {1}):
        return isinstance(node.right, ast.BinOp) and _is_power_of_two(node.right)
    if isinstance(node.op, ast.Add):
        return _acts_one_step_later(node.left, node.right)
    return False


def _is_power_of_two(node: ast.BinOp) -> bool:
    shifted_one = isinstance(node.op, ast.LShift) and _is_one_of(node.left, {1})
    power_of_two = isinstance(node.op, ast.Pow) and _is_one_of(node.left, {2})
    return shifted_one or power_of_two


def _acts_one_step_later(left: ast.expr, right: ast.expr) -> bool:
    """Return whether a sum is ``1 + delay``, in any order, or ``row + 1 + delay``."""
    if isinstance(left, ast.BinOp) and isinstance(left.op, ast.Add):
        left = left.right
    terms = (left, right)
    return any(_is_one_of(term, {1}) for term in terms) and any(
        _name(term) == "delay" for term in terms
    )


def _truncates_a_weight(node: ast.Call) -> bool:
    """Return whether a call is ``floor(m 2^exponent)``."""
    if _name(node.func) not in {"floor", "trunc", "fix"}:
        return False
    powers = (
        part for part in ast.walk(node) if isinstance(part, ast.BinOp) and _is_power_of_two(part)
    )
    return any(_name(power.right).startswith("exponent") for power in powers)


def _name(node: ast.expr) -> str:
    """Return the last part of a dotted name, or "" for any other expression."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _is_one_of(node: ast.expr, numbers: set[int]) -> bool:
    """Return whether an expression is one of these numbers, written out."""
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
        and node.value in numbers
    )
