"""Decorators that compile functions with numba, and ways to call the compiled code without checks.

Which decorator a loop needs depends on who calls it: Python (:func:`compiled`), compiled code by address
(:func:`shared`), or compiled code that it becomes part of (:func:`inner`, :func:`absorbed`).

Compiled code is kept in numba's cache: in the folder that NUMBA_CACHE_DIR names, else the ``__pycache__`` next to the
file of the function, else numba's folder in the user's cache, whichever is the first that can be written. If none can,
every process compiles what it uses.
"""

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from hw_model.engine.usable import check_compiled

check_compiled()  # before the imports below, which fail or crash with a numba that is not supported

import llvmlite.binding
import numba
import numpy as np

from hw_model.engine import private_numba
from hw_model.engine.private_numba import call_at as call_at

# LLVM runs a loop in vectors only after checking that its arrays do not overlap. With the default limit on such checks
# it gives up on loops over many arrays.
llvmlite.binding.set_option("hw_model", "-runtime-memory-check-threshold=200")

FOLDERS_OF_LOOPS = ("arithmetic", "engine", "spinnaker", "streaming", "xylo")
"""Rooms with compiled loops, or with constants of theirs: a changed file in one of them compiles all loops again."""
OPTIONS = {"nogil": True, "boundscheck": False} | private_numba.WITHOUT_RUNTIME
"""Options of numba for every function: it releases Python's lock, so that threads run in parallel, and it creates no
arrays, so that it need not count references."""
CHECK_KINDS = "LOCSNN_CHECK_KINDS"
"""A variable of the environment. If it is set, every call of an :func:`entry` checks the types of its arguments."""


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that Python calls. It takes no Python objects and holds no lock, so it may run in threads."""
    options = OPTIONS | private_numba.OF_A_WHOLE | options
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # Neither the package's folder nor the user's cache can be written: compile every time.
        return numba.njit(**options)(function)
    private_numba.keep_in(dispatcher, function.__module__, _stamp_of_loops())
    return dispatcher


def compiled_with_arrays(function: Callable[..., Any]) -> Any:
    """Compile a function that creates arrays: it has numba's runtime, which counts references to them."""
    return compiled(function, **private_numba.WITH_RUNTIME)


def shared(function: Callable[..., Any]) -> Any:
    """Compile a function that compiled code calls by :func:`call_at`: once, instead of once in each caller."""
    return compiled(function, **private_numba.NOT_FROM_PYTHON)


def inner(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that only compiled functions call; its code is linked into theirs, and LLVM may inline it."""
    return numba.njit(**OPTIONS, **private_numba.OF_A_PART, **options)(function)


def absorbed(function: Callable[..., Any]) -> Any:
    """Compile a function that is always inlined: passing many arrays costs more than a short loop."""
    return inner(function, forceinline=True)


def entry(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the machine code of a compiled function for arguments of these kinds.

    A kind is a type of numba, such as that of a contiguous array of int32 with two axes. Calling the function itself
    looks at the kinds of all arguments, which takes longer than a short loop. The machine code does not, so it must
    never be called with other kinds: it would read them as if they were of these. With :data:`CHECK_KINDS` in the
    environment, as in the tests, other kinds are a ``TypeError``.
    """
    numba_types = tuple(map(numba.typeof, arguments))
    code = private_numba.code_of(function, numba_types)
    if CHECK_KINDS not in os.environ:
        return code

    expected_kinds = [_kind_of(numba_type) for numba_type in numba_types]

    def checked(*values: Any) -> Any:
        for expected, value in zip(expected_kinds, values, strict=True):
            kind = _kind_of(numba.typeof(value))
            if kind != expected:
                raise TypeError(f"{function.py_func.__name__}: made for {expected}, given {kind}")
        return code(*values)

    return checked


def _kind_of(numba_type: Any) -> str:
    """Return the kind of an argument as text. Read-only arrays count as others: they lie in memory in the same way."""
    return str(numba_type).replace("readonly ", "")


def address(function: Any, *arguments: Any) -> np.int64:
    """Compile a :func:`shared` function for arguments of these kinds, and return the address of its code."""
    return private_numba.address_of(function, tuple(map(numba.typeof, arguments)))


code_by_function: dict[Any, Callable[..., Any]] = {}
"""The machine code of each function that was called by :func:`called`."""


def called(function: Any, *arguments: Any) -> Any:
    """Call a compiled function whose arguments have the same kinds in every call: only the first call looks at them.

    As with :func:`entry`, arguments of other kinds would be read as if they were of these kinds.
    """
    code = code_by_function.get(function)
    if code is None:
        code = entry(function, *arguments)
        code_by_function[function] = code
    return code(*arguments)


@lru_cache(maxsize=1)
def _stamp_of_loops() -> tuple[tuple[int, int], ...]:
    """Return the modification time and size of every file of :data:`FOLDERS_OF_LOOPS`."""
    folders = [Path(__file__).parents[1] / name for name in FOLDERS_OF_LOOPS]
    files = [path.stat() for folder in folders for path in sorted(folder.glob("*.py"))]
    return tuple((file.st_mtime_ns, file.st_size) for file in files)
