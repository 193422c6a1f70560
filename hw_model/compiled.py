"""Functions compiled by numba, kept in its cache where there is one to write to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numba

# Many arrays take part in an update; without this the compiler gives up proving that they do not overlap, and the loop
# does not run in vectors.
llvmlite.binding.set_option("hw_model", "-runtime-memory-check-threshold=200")


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function that takes no Python objects and holds no lock: it may run in threads."""
    return _compile(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function into each of its callers."""
    return _compile(function, inline="always")


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    try:
        return numba.njit(cache=True, nogil=True, boundscheck=False, **options)(function)
    except RuntimeError:  # neither the package's folder nor the user's cache can be written: compile every time
        return numba.njit(nogil=True, boundscheck=False, **options)(function)
