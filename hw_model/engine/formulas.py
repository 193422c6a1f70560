"""Compile the formulas of a module of :mod:`hw_model.arithmetic` without a second copy of their source."""

from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

from hw_model.engine.compiled import compiled


class CompiledPage:
    """Compiles the formulas of a page, one by one, for the loops of a module.

    A page is a module of formulas in plain Python, such as :mod:`hw_model.arithmetic.spinnaker`. A
    formula finds the formulas that it calls among the globals of its page, but compiled code can
    call only compiled functions. So each formula becomes a new function with the same code, and
    with a copy of these globals in which the formulas compiled so far replace the plain ones.
    Compile a formula after those that it calls.

    ``page`` itself does not change. ``module`` is the name of the module with the loops: numba
    keeps the code in its cache, and :mod:`hw_model.engine.ahead` finds its helper by it.
    """

    def __init__(self, page: ModuleType, module: str) -> None:
        self._globals = dict(vars(page))
        self._module = module

    def compiled(self, formula: Callable[..., Any]) -> Any:
        """Compile a formula of the page and return it; formulas that are compiled later can call it."""
        assert isinstance(formula, FunctionType)  # for the type checker: only these have __code__
        name = formula.__name__
        function = FunctionType(formula.__code__, self._globals.copy(), name)
        function.__module__ = self._module
        self._globals[name] = compiled(function)
        return self._globals[name]
