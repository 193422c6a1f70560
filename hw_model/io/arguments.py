"""Check the arguments of public functions: their types must be the annotated ones, and paths must be valid.

A user's mistake becomes one readable ``InputError`` instead of a traceback from deep inside. Public functions are
decorated with :func:`checked`; :mod:`hw_model.io.records` checks fields of records with the same functions.
"""

import errno
import functools
import inspect
import itertools
import os
import stat
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from hw_model.errors import InputError, listed

P = ParamSpec("P")
T = TypeVar("T")
_ACCEPTED: dict[Any, type] = {int: Integral, float: Real}
"""The types whose values are accepted for an annotated type: numpy's numbers count as numbers."""
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
"""The way out for a wrong argument, by the name of the expected type. Types that are not listed need no hint."""
_SHOWN_CHARACTERS = 60
"""How much of a wrong value an error shows."""
_NAME_BYTES = 255
"""The longest name of a file or folder on common file systems; the length of a whole path has a limit as well."""
_CHECKED_BY_VALUE = (str, Path, list, tuple, int)
"""Types whose values are checked, too: paths, rows of arrays, integers that are too large for a float."""


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that it raises a one-line ``InputError`` if an argument has not the annotated type.

    Arrays, and the contents of sequences and mappings, are left to the function, except for rows of different lengths.
    """
    signature = inspect.signature(function)
    parameters = signature.parameters.values()
    called = function.__qualname__.removesuffix(".__init__")
    positional = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    names = [p.name for p in positional]
    required_count = sum(p.default is p.empty for p in positional)
    if any(p not in positional and p.default is p.empty for p in parameters):
        # A required keyword argument, *args or **kwargs: no number of positional arguments makes a plain call.
        required_count = len(names) + 1
    # Pairs of a parameter and a type that were found to be right, and need not be checked again.
    known_right: set[tuple[str, type]] = set()
    extra_keywords = next((p.name for p in parameters if p.kind is p.VAR_KEYWORD), "")

    @functools.cache
    def kinds_of_parameters() -> dict[str, tuple[Any, ...]]:
        # At the first call, not at import: names in annotations may be unknown until all modules are imported.
        return {name: kinds_of(hint) for name, hint in get_type_hints(function).items()}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        # Checking must be fast: to bind the arguments and check all types takes as long as to play a short recording.
        # So a plain call, with positional arguments alone, is not bound, and known types are not checked again.
        is_plain_call = not kwargs and required_count <= len(args) <= len(names)
        if is_plain_call:
            arguments: Iterable[tuple[str, Any]] = zip(names, args, strict=False)
        else:
            arguments = _bound(signature, args, kwargs).items()
        for name, value in arguments:
            if (name, type(value)) not in known_right:
                annotated = name if name in signature.parameters else extra_keywords
                check_argument(called, name, value, kinds_of_parameters().get(annotated, (object,)))
                if not isinstance(value, _CHECKED_BY_VALUE):
                    known_right.add((name, type(value)))
        return function(*args, **kwargs)

    return call


def check_path(path: str | Path, where: str) -> None:
    """Raise InputError for a path that the system cannot look up.

    A name is too long or contains a NUL character, or links lead in a circle. A path that does not exist is valid.
    """
    try:
        os.lstat(path)
        _check_links(path, where)
    except ValueError:
        raise InputError(
            where, "it contains a NUL character", fix="Give the path of a file."
        ) from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            longest_name = max(len(os.fsencode(part)) for part in Path(path).parts)
            if longest_name > _NAME_BYTES:
                what = "the name is too long"
                measured = f"{longest_name} bytes"
            else:
                what = "the path is too long"
                measured = f"{len(os.fsencode(path))} bytes"
            raise InputError(where, what, measured=measured, fix="Shorten it.") from None


def _check_links(path: str | Path, where: str) -> None:
    """Raise InputError if links lead in a circle."""
    try:
        os.stat(path)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise InputError(
                where, "its links lead in a circle", fix="Give another path, or remove them."
            ) from None


def is_plain(status: os.stat_result) -> bool:
    """Return whether this is a file or folder, not a pipe or device, which may never end."""
    return stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)


def _bound(signature: inspect.Signature, args: Any, kwargs: Any) -> Mapping[str, Any]:
    """Return the arguments by name, or nothing for a call with wrong arguments, which Python itself will refuse."""
    try:
        arguments = signature.bind(*args, **kwargs).arguments
    except TypeError:
        return {}
    for name, parameter in signature.parameters.items():
        # Extra keyword arguments are in a dictionary of their own: put them among the others.
        if parameter.kind is parameter.VAR_KEYWORD:
            arguments |= arguments.pop(name, {})
    return arguments


def classes_of(hint: Any) -> tuple[Any, ...]:
    """Return the classes that a hint stands for: ``tuple`` for ``tuple[int, ...]``, two for ``int | None``."""
    kind = get_origin(hint) or hint
    # From Python 3.12 on, numpy's hints are of this type.
    if type(kind).__name__ == "TypeAliasType":
        return classes_of(kind.__value__)
    if kind not in (UnionType, Union):
        return (kind,)
    return tuple(itertools.chain.from_iterable(map(classes_of, get_args(hint))))


def kinds_of(hint: Any) -> tuple[Any, ...]:
    """Return the types that a hint accepts; ``object`` stands for a type that ``isinstance`` cannot check."""
    return tuple(kind if _can_be_checked(kind) else object for kind in classes_of(hint))


def _can_be_checked(kind: Any) -> bool:
    """Return whether values are checked for a type: not numpy's types and booleans, for which much else will do."""
    return (
        isinstance(kind, type)
        and kind not in (bool, Any)
        and not kind.__module__.startswith("numpy.")
    )


def check_argument(function: str, name: str, value: Any, kinds: tuple[Any, ...]) -> None:
    """Raise InputError for a value of none of the types ``kinds``, for ragged rows, and for an invalid path."""
    where = f"{function}, {name}"
    if not any(_is_a(value, kind) for kind in kinds):
        # None is accepted for an optional argument, but it is not worth suggesting.
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
    # `object` stands for arrays, among others.
    if object in kinds and isinstance(value, list | tuple):
        as_array(where, value)
    if Path in kinds and isinstance(value, str | Path):
        # An argument such as `output_folder` is called "folder" in the error.
        noun = name.rsplit("_", 1)[-1]
        check_path(value, f"{noun} {_short(str(value))!r}")


def as_array(where: str, value: Any) -> Any:
    """Return a value as an array; raise ``InputError`` for rows that differ in length."""
    # Imported here, so that commands that need no arrays start fast.
    import numpy as np

    try:
        return np.asarray(value)
    except ValueError:
        raise InputError(
            where, "it is not an array: its rows differ in length", fix="Make them equal."
        ) from None


def _short(text: str) -> str:
    """Return a text, cut if it is long."""
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}..."


def _is_a(value: Any, kind: Any) -> bool:
    """Return whether a value is of a type. Unlike in Python, a bool is not a number, and a text is not a sequence."""
    if isinstance(value, bool) and kind in _ACCEPTED:
        return False
    if isinstance(value, str) and kind is Sequence:
        return False
    return isinstance(value, _ACCEPTED.get(kind, kind))
