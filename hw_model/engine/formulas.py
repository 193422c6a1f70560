"""Formulas of a page of an arithmetic, compiled as they are, for the fast engine of that page."""

from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

from hw_model.engine.compiled import compiled


class CompiledPage:
    """A page of an arithmetic, whose formulas are compiled one by one for the loops of a module.

    A page is a module of formulas in plain Python. A formula looks the formulas that it calls up
    among the globals of the page, but compiled code can call only compiled functions. So each
    formula is made again, of the same code, with a copy of these globals that holds what was
    compiled before instead of the plain formulas. Compile a formula after those that it calls.

    ``page`` itself stays as it is. ``module`` is the name of the module of the loops: where numba
    keeps the code, and by which its package is compiled ahead.
    """

    def __init__(self, page: ModuleType, module: str) -> None:
        self._globals = dict(vars(page))
        self._module = module

    def compiled(self, formula: Callable[..., Any]) -> Any:
        """Return a function of the page, compiled, for those that are compiled after it to call."""
        assert isinstance(formula, FunctionType)
        name = formula.__name__
        function = FunctionType(formula.__code__, self._globals.copy(), name)
        function.__module__ = self._module
        self._globals[name] = compiled(function)
        return self._globals[name]
