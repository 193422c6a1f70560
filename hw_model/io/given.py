"""Checks of arguments to public functions: their types are the annotated ones, and their paths can be looked up."""

import errno
import functools
import inspect
import os
import stat
import sys
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from hw_model.errors import InputError, listed

P = ParamSpec("P")
T = TypeVar("T")
_ACCEPTED: dict[Any, type] = {int: Integral, float: Real}
_WAYS_OUT = {
    "Network": "Read it with lc.load(path), or lc.load(path, config=...).",
    "CompiledModel": "Make one with lc.compile(network).",
    "ChipProgram": "Take .program of lc.compile(network), or read one with hw.load_program(folder).",
    "Chip": "Use hw.chip('loihi-sim'), or hw.chip(path) of a chip file.",
    "Profile": "Use chip.profile(name).",
    "StepActivity": "Take that of a recording, result.activity[phase][0].",
    "Counts": "Take .counts of hw.simulate(program, spikes).",
    "Sequence": "Put it in a list.",
}
"""Where to get values of our own types; for other types, the name says enough."""
_SHOWN = 60
_NAME_BYTES = 255
"""The longest name of a file or folder; the length of a whole path has a limit as well."""
_LOOKED_INTO = (str, Path, list, tuple, int)
"""Of these more than the type is checked."""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Refuse arguments that are not of the annotated types, with a one-line error, before the function begins.

    Arrays, and the contents of sequences and mappings, are left to the function, except for rows of different lengths.
    """
    signature = inspect.signature(function)
    called = function.__qualname__.removesuffix(".__init__")
    by_place = [p for p in signature.parameters.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
    names = [p.name for p in by_place]
    least = sum(p.default is p.empty for p in by_place)
    if any(p not in by_place and p.default is p.empty for p in signature.parameters.values()):
        least = len(names) + 1
    passed: set[tuple[str, type]] = set()
    rest = next((p.name for p in signature.parameters.values() if p.kind is p.VAR_KEYWORD), "")
    # Names in annotations may be unknown until all modules are imported.
    kinds = functools.cache(
        lambda: {name: kinds_of(hint) for name, hint in get_type_hints(function).items()}
    )

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        # Binding and looking at types takes as long as a short recording: what is plain, and known, is let through.
        plain = not kwargs and least <= len(args) <= len(names)
        for name, value in (
            zip(names, args, strict=False) if plain else _bound(signature, args, kwargs).items()
        ):
            if (name, type(value)) not in passed:
                hint = name if name in signature.parameters else rest
                check_argument(called, name, value, kinds().get(hint, (object,)))
                if not isinstance(value, _LOOKED_INTO):
                    passed.add((name, type(value)))
        return function(*args, **kwargs)

    return call


def check_path(path: str | Path, where: str) -> None:
    """Refuse a path that the system cannot look up, because a name is too long or holds a NUL character."""
    try:
        os.lstat(path)
        _check_links(path, where)
    except ValueError:
        raise InputError(
            where, "it contains a NUL character", fix="Give the path of a file."
        ) from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            longest = max(len(os.fsencode(part)) for part in Path(path).parts)
            which, many = (
                ("name", longest) if longest > _NAME_BYTES else ("path", len(os.fsencode(path)))
            )
            raise InputError(
                where, f"the {which} is too long", measured=f"{many} bytes", fix="Shorten it."
            ) from None


def _check_links(path: str | Path, where: str) -> None:
    """Refuse a link that leads back to itself."""
    try:
        os.stat(path)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise InputError(
                where, "its links lead in a circle", fix="Give another path, or remove them."
            ) from None


def is_plain(found: os.stat_result) -> bool:
    """Tell files and folders from pipes and devices, which may never end."""
    return stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)


def _bound(signature: inspect.Signature, args: Any, kwargs: Any) -> Mapping[str, Any]:
    """Return arguments by name; nothing for a call that Python itself will refuse."""
    try:
        arguments = signature.bind(*args, **kwargs).arguments
    except TypeError:
        return {}
    for name, parameter in signature.parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            arguments |= arguments.pop(name, {})
    return arguments


def classes_of(hint: Any) -> tuple[Any, ...]:
    """Return the classes that a hint stands for: ``tuple`` for ``tuple[int, ...]``, two for ``int | None``."""
    kind = get_origin(hint) or hint
    if type(kind).__name__ == "TypeAliasType":  # what numpy's hints are from Python 3.12 on
        return classes_of(kind.__value__)
    return (
        tuple(one for o in get_args(hint) for one in classes_of(o))
        if kind in (UnionType, Union)
        else (kind,)
    )


def kinds_of(hint: Any) -> tuple[Any, ...]:
    """Return the types that a hint accepts; ``object`` stands for those that ``isinstance`` cannot check."""
    return tuple(kind if _can_be_checked(kind) else object for kind in classes_of(hint))


def _can_be_checked(kind: Any) -> bool:
    return (
        isinstance(kind, type)
        and kind not in (bool, Any)
        and not kind.__module__.startswith("numpy.")
    )


def check_argument(function: str, name: str, value: Any, kinds: tuple[Any, ...]) -> None:
    """Refuse a value that is none of these types, ragged rows where an array may stand, and a path of no file."""
    where = f"{function}, {name}"
    if not any(_is_a(value, kind) for kind in kinds):
        names = [kind.__name__ for kind in kinds if kind is not type(None)]
        article = "an" if names[0][0].lower() in "aeiou" else "a"
        what = f"it must be {article} {listed(names, 'or')}"
        fix = next((_WAYS_OUT[kind] for kind in names if kind in _WAYS_OUT), "Correct it.")
        raise InputError(
            where, what, measured=f"got {type(value).__name__} {_short(repr(value))}", fix=fix
        )
    if float in kinds and isinstance(value, int) and abs(value) > sys.float_info.max:
        raise InputError(
            where,
            "it is too large for a float",
            measured=f"{value.bit_length()} bits",
            fix="Correct it.",
        )
    if object in kinds and isinstance(value, list | tuple):
        as_array(where, value)
    if Path in kinds and isinstance(value, str | Path):
        check_path(value, f"{name.rsplit('_', 1)[-1]} {_short(str(value))!r}")


def as_array(where: str, value: Any) -> Any:
    """Return what is given as an array; ``InputError`` for rows that differ in length."""
    import numpy as np

    try:
        return np.asarray(value)
    except ValueError:
        raise InputError(
            where, "it is not an array: its rows differ in length", fix="Make them equal."
        ) from None


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def _is_a(value: Any, kind: Any) -> bool:
    """Tell whether a value is of a type; a bool is not a number here, and a text is not a sequence."""
    if (isinstance(value, bool) and kind in _ACCEPTED) or (
        isinstance(value, str) and kind is Sequence
    ):
        return False
    return isinstance(value, _ACCEPTED.get(kind, kind))
