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
CHECK_KINDS = "LOCSNN_CHECK_KINDS"
"""Set in the environment, makes every call of an :func:`entry` look at its arguments."""


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
    """Compile a function that only other compiled ones call: Python cannot, and what it becomes is kept with theirs."""
    return numba.njit(**OPTIONS, **private_numba.OF_A_PART, **options)(function)


def absorbed(function: Callable[..., Any]) -> Any:
    """Compile a function that its callers take in as machine code: passing many arrays costs more than a short loop."""
    return inner(function, forceinline=True)


def entry(function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the machine code of a compiled function for arguments of these kinds; it must never be given others.

    A call of the function itself looks at the kind of every array that it is given, which takes longer than a short
    loop. With :data:`CHECK_KINDS` in the environment, as in the tests, it does so: others are then a ``TypeError``.
    """
    kinds = tuple(map(numba.typeof, arguments))
    code = private_numba.code_of(function, kinds)
    if CHECK_KINDS not in os.environ:
        return code

    named = [*map(_named, kinds)]

    def checked(*given: Any) -> Any:
        for expected, argument in zip(named, given, strict=True):
            if (kind := _named(numba.typeof(argument))) != expected:
                raise TypeError(f"{function.py_func.__name__}: made for {expected}, given {kind}")
        return code(*given)

    return checked


def _named(kind: Any) -> str:
    """Return a kind without what does not matter: what is read-only lies in memory as other arrays do."""
    return str(kind).replace("readonly ", "")


def address(function: Any, *arguments: Any) -> np.int64:
    """Return where the machine code of a :func:`shared` function for arguments of these kinds begins."""
    return private_numba.address_of(function, tuple(map(numba.typeof, arguments)))


_of_one_kind: dict[Any, Callable[..., Any]] = {}


def called(function: Any, *arguments: Any) -> Any:
    """Call a compiled function whose arguments are of the same kinds in every call: only the first looks at them.

    As with :func:`entry`, others would be read as if they were of those kinds.
    """
    code = _of_one_kind.get(function)
    if code is None:
        code = _of_one_kind[function] = entry(function, *arguments)
    return code(*arguments)


@lru_cache(maxsize=1)
def _stamp_of_loops() -> tuple[tuple[int, int], ...]:
    """Return age and size of every file that may hold compiled loops, or constants of theirs."""
    folders = [Path(__file__).parents[1] / name for name in FOLDERS_OF_LOOPS]
    files = [path.stat() for folder in folders for path in sorted(folder.glob("*.py"))]
    return tuple((file.st_mtime_ns, file.st_size) for file in files)
