"""Functions compiled by numba, kept in its cache where there is one to write to.

That is the folder that NUMBA_CACHE_DIR names, else the ``__pycache__`` next to the file of the function, else numba's
in the cache folder of the user: the first that can be written. Where none can, every process compiles what it uses.
"""

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from hw_model.engine.usable import check_compiled

check_compiled()  # a numba that does not fit would end in an error of its own below, or crash

import llvmlite.binding
import numba
import numpy as np

from hw_model.engine import private_numba
from hw_model.engine.private_numba import call_at as call_at

# Many arrays take part in an update; without this the compiler gives up proving that they do not overlap, and the loop
# does not run in vectors.
llvmlite.binding.set_option("hw_model", "-runtime-memory-check-threshold=200")

FOLDERS_OF_LOOPS = ("arithmetic", "engine", "spinnaker", "streaming", "xylo")
"""A change of a file in them compiles the loops anew."""
OPTIONS = {"nogil": True, "boundscheck": False} | private_numba.WITHOUT_RUNTIME
"""Of numba, for every function: it holds no lock, and makes no arrays, so that it needs no counts of references."""
CHECK_KINDS = "LOCSNN_CHECK_KINDS"
"""Set in the environment, it makes every call of an :func:`entry` look at its arguments."""


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that takes no Python objects and holds no lock: it may run in threads."""
    options = OPTIONS | private_numba.OF_A_WHOLE | options
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # Neither the package's folder nor the user's cache can be written: compile every time.
        return numba.njit(**options)(function)
    private_numba.keep_in(dispatcher, function.__module__, _stamp_of_loops())
    return dispatcher


def compiled_with_arrays(function: Callable[..., Any]) -> Any:
    """Compile a function that makes arrays of its own: it has the runtime, and counts references to them."""
    return compiled(function, **private_numba.WITH_RUNTIME)


def shared(function: Callable[..., Any]) -> Any:
    """Compile a function that others call by :func:`call_at`: once, and not again in each of them."""
    return compiled(function, **private_numba.NOT_FROM_PYTHON)


def inner(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that only compiled functions call; its machine code becomes part of theirs."""
    return numba.njit(**OPTIONS, **private_numba.OF_A_PART, **options)(function)


def absorbed(function: Callable[..., Any]) -> Any:
    """Compile a function that its callers take in as machine code: passing many arrays costs more than a short loop."""
    return inner(function, forceinline=True)


def entry(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the machine code of a compiled function for arguments of these kinds; it must never be given others.

    A kind is a type of numba, such as that of a contiguous array of int32 with two axes. A call of the function itself
    looks at the kinds of all arguments, which takes longer than a short loop. The machine code does so only with
    :data:`CHECK_KINDS` in the environment, as in the tests: arguments of other kinds are then a ``TypeError``.
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
    """Return the kind of an argument: a type of numba, but read-only arrays lie in memory as others do."""
    return str(numba_type).replace("readonly ", "")


def address(function: Any, *arguments: Any) -> np.int64:
    """Return where the machine code of a :func:`shared` function for arguments of these kinds begins."""
    return private_numba.address_of(function, tuple(map(numba.typeof, arguments)))


code_by_function: dict[Any, Callable[..., Any]] = {}
"""The machine code of each function that was :func:`called`."""


def called(function: Any, *arguments: Any) -> Any:
    """Call a compiled function whose arguments are of the same kinds in every call: only the first looks at them.

    As with :func:`entry`, arguments of other kinds would be read as if they were of those.
    """
    code = code_by_function.get(function)
    if code is None:
        code = entry(function, *arguments)
        code_by_function[function] = code
    return code(*arguments)


@lru_cache(maxsize=1)
def _stamp_of_loops() -> tuple[tuple[int, int], ...]:
    """Return the time of change and the size of every file that may hold compiled loops, or constants of theirs."""
    folders = [Path(__file__).parents[1] / name for name in FOLDERS_OF_LOOPS]
    files = [path.stat() for folder in folders for path in sorted(folder.glob("*.py"))]
    return tuple((file.st_mtime_ns, file.st_size) for file in files)
