"""Check whether numba here can compile our loops, which use private parts of it that change between releases.

Nothing here imports numba unless asked. If loops cannot be compiled, the plain engine runs instead:
the same integers, about a hundred times slower.
"""

import re
from functools import cache
from importlib import import_module

from hw_model.errors import InputError
from hw_model.io.memory import LOOPS_BYTES, check_room

LOWEST = (0, 62)
ABOVE = (0, 69)
"""Loops are compiled by numba from release ``LOWEST`` to before ``ABOVE``; ``pyproject.toml`` has the same bounds.

Releases before 0.62 have an LLVM that crashes on processors with AVX-512 when it compiles
:func:`hw_model.engine.lanes.put_side_by_side`.
"""
PRIVATE_PARTS = {
    "numba.core.caching.Cache": ("_load_overload", "_save_overload"),
    "numba.core.caching.IndexDataCacheFile": (
        "_load_data",
        "_save_data",
        "_data_path",
        "_dump",
        "_open_for_write",
    ),
    "numba.core.codegen.JITCodeLibrary": ("_ensure_finalized", "_get_module_for_linking"),
    "numba.core.compiler.Compiler": ("define_pipelines",),
    "numba.core.datamodel.models.PrimitiveModel": ("get_value_type",),
    "numba.core.runtime.rtsys": ("initialize",),
    "numba.core.typing.templates.AttributeTemplate": ("resolve",),
}
"""Undocumented methods and functions of numba that the loops use, by class or module."""


@cache
def why_not_compiled() -> str | None:
    """Return why no loop can be compiled here, or None if loops can be compiled.

    Raises ``InputError`` if a limit on memory, such as that of ulimit, leaves too little to find out.
    """
    # Without enough memory, importing numba ends in an obscure error or a crash.
    check_room(LOOPS_BYTES)
    try:
        numba = import_module("numba")
    except ImportError as error:  # numba also raises it for a numpy that is too new for it
        return f"numba cannot be imported: {error}".rstrip(".")
    if numba.config.DISABLE_JIT:
        return "NUMBA_DISABLE_JIT is set"
    if not LOWEST <= _release(numba.__version__) < ABOVE:
        return f"numba {numba.__version__} is not {supported()}"
    for owner, names in PRIVATE_PARTS.items():
        for name in names:
            if not _has(owner, name):
                return f"numba {numba.__version__} has no {owner}.{name}"
    return None


def check_compiled() -> None:
    """Raise ``InputError`` if no loop can be compiled here."""
    reason = why_not_compiled()
    if reason is not None:
        raise InputError(
            "compiled loops", "they are needed here", measured=reason, fix=fix_of(reason)
        )


def fix_of(reason: str) -> str:
    """Return what a user can do about a reason of :func:`why_not_compiled`."""
    if "DISABLE_JIT" in reason:
        return "Unset it."
    return f"Install numba {supported()}."


def supported() -> str:
    """Return the supported releases of numba as a requirement of pip."""
    return f">={_dotted(LOWEST)},<{_dotted(ABOVE)}"


def _dotted(release: tuple[int, int]) -> str:
    return ".".join(map(str, release))


def _release(version: str) -> tuple[int, ...]:
    """Return the first two numbers of a version, (0, 62) for ``0.62.1rc1``."""
    return tuple(int(number) for number in re.findall(r"\d+", version)[:2])


def _has(owner: str, name: str) -> bool:
    """Return whether a class or module of numba, by its dotted name, has an attribute."""
    module, _, attribute = owner.rpartition(".")
    try:
        return hasattr(getattr(import_module(module), attribute), name)
    except (ImportError, AttributeError):
        return False
