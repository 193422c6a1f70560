"""Formulas of a page of an arithmetic, compiled as they are, for the fast engine of that arithmetic."""

from collections.abc import Sequence
from types import FunctionType, ModuleType
from typing import Any

from hw_model.engine.compiled import compiled


def compiled_formulas(page: ModuleType, names: Sequence[str], module: str) -> dict[str, Any]:
    """Compile formulas of a page for loops of ``module``; each comes after those that it calls.

    A compiled function finds the functions that it calls among the globals of its module, and those
    of the page are plain: so the same code is given globals in which they are compiled.
    """
    formulas: dict[str, Any] = {}
    for name in names:
        plain: FunctionType = getattr(page, name)
        function = FunctionType(plain.__code__, vars(page) | formulas, name)
        function.__module__ = module
        formulas[name] = compiled(function)
    return formulas
