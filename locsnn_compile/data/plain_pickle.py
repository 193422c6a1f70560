"""Read the pickles in torch's files without running code.

A pickle is a program for a small stack machine, which can call any function of Python. This interpreter knows only the
opcodes that torch writes, calls only functions of a fixed list, and bounds its work. It also refuses a value that
unfolds to far more than the file holds, nests too deeply or contains itself, so that code that prints, compares or
walks the value comes to an end.
"""

from collections.abc import Callable, Iterable, Sized
from typing import IO, Any

from locsnn_compile.errors import check_most

MAX_VALUES = 2_000_000
"""Largest number of opcodes of a pickle, and of values that it unfolds to."""
CHARACTERS_OF_A_VALUE = 16
"""Characters of text that count as one value."""
MAX_DEPTH = 200
"""Deepest nesting, far from the 1,000 calls at which Python's recursion ends in whoever walks a value."""
MAX_KEY = 16
"""Longest tuple that is the key of a dict."""
_PROTOCOL = 2
"""The pickle protocol that torch.save writes."""

_KEYS = frozenset((str, int, float, bool, bytes, type(None)))
"""Types of values that may be keys of a dict."""
_PLAIN = frozenset(("BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE"))
"""Opcodes that push their argument."""
_FIXED: dict[str, Callable[[], object]] = {
    "NONE": lambda: None,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
}
_NEW = _FIXED | {"EMPTY_TUPLE": tuple, "EMPTY_LIST": list, "EMPTY_DICT": dict}
"""Opcodes that push a value of their own."""
_LAST = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3, "APPEND": 1, "SETITEM": 2}
"""How many values an opcode takes off the stack, if it does not take all since the last mark."""
_MARKED = frozenset(("TUPLE", "APPENDS", "SETITEMS"))
"""Opcodes that take all values off the stack since the last mark."""


class RefusedError(ValueError):
    """A pickle asks for something that is not on the list of names; the text is its name."""


class Budget:
    """How many values of a file may still be read; ``InputError`` when it asks for more."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.used = 0

    def take(self, amount: int) -> None:
        """Count values."""
        self.used += amount
        check_most(
            self.used,
            MAX_VALUES,
            self.where,
            "it holds too many values",
            fix="Save numbers as tensors.",
        )


def read_pickle(  # noqa: C901 - a case for each kind of opcode
    stream: IO[bytes],
    named: Callable[[str], object],
    stored: Callable[[object], object],
    budget: Budget,
) -> object:
    """Return the value of the next pickle in the stream, and leave the stream at its end.

    ``named`` returns the value of a global, or a function that may be called with values of the pickle. ``stored``
    returns the value of a persistent id. Raises ``RefusedError``, ``InputError`` for too many values, and any other
    exception for bytes that make no sense.
    """
    from pickletools import genops

    stack: list[Any] = []
    marked: list[list[Any]] = []
    memo: dict[int, Any] = {}
    arg: Any
    # ``stack`` has the values since the last mark; ``marked`` the stacks before earlier marks; ``memo``
    # the values that the pickle numbered to use them again.
    for opcode, arg, _ in genops(stream):
        name = opcode.name
        budget.take(1 + _cost(arg))
        if name in _PLAIN:
            stack.append(arg)
        elif name in _NEW:
            stack.append(_NEW[name]())
        elif name in ("BINPUT", "LONG_BINPUT"):
            memo[arg] = stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            stack.append(memo[arg])
        elif name == "MARK":
            marked.append(stack)
            stack = []
        elif name in _MARKED:
            since_mark = stack
            stack = marked.pop()
            _put(stack, since_mark, name)
        elif name in _LAST:
            items = [stack.pop() for _ in range(_LAST[name])][::-1]
            _put(stack, items, name)
        elif name == "SHORT_BINSTRING":
            # A text of Python 2, whose bytes the library reads as Latin-1.
            stack.append(arg.encode("latin-1").decode("utf-8"))
        elif name == "GLOBAL":
            # "module name", where Python 2 calls its builtins __builtin__.
            dotted = arg.replace(" ", ".", 1)
            stack.append(named(dotted.replace("__builtin__.", "builtins.", 1)))
        elif name in ("REDUCE", "NEWOBJ"):
            arguments = stack.pop()
            function = stack.pop()
            budget.take(_cost(arguments))
            budget.take(sum(map(_cost, arguments)))
            stack.append(function(*arguments))
        elif name == "BUILD":
            # Attributes, such as those of an OrderedDict or a Parameter, are ignored.
            stack.pop()
        elif name == "BINPERSID":
            stack.append(stored(stack.pop()))
        elif name == "PROTO":
            fix = "Save it with torch.save, without pickle_protocol."
            check_most(
                arg,
                _PROTOCOL,
                budget.where,
                "its pickle has a newer protocol than torch's own",
                fix=fix,
            )
        elif name != "STOP":
            raise RefusedError(f"opcode {name}")
    (value,) = stack
    _check_tree(value, Budget(budget.where))
    return value


def filled(pairs: Iterable[tuple[Any, Any]], into: dict[Any, Any]) -> dict[Any, Any]:
    """Put pairs into the dict ``into``, and return it.

    Raises ``ValueError`` for a key that is not a plain value or a short tuple of such: hashing it might take for ever.
    """
    for key, value in pairs:
        is_short_tuple = type(key) is tuple and len(key) <= MAX_KEY
        parts = key if is_short_tuple else (key,)
        if not all(map(_is_plain_key, parts)):
            raise ValueError("a key that is not a plain value")
        # The method of dict itself, which raises TypeError if a pickle has put something else here.
        dict.__setitem__(into, key, value)
    return into


def _is_plain_key(part: object) -> bool:
    """Return whether a value may be a key of a dict, or a part of a tuple that is one.

    Large integers may not: a file could have many with the same hash (the value modulo 2**61 - 1),
    and a dict of these takes quadratic time.
    """
    if isinstance(part, int) and type(part) is int and abs(part) >> 60:
        return False
    return type(part) in _KEYS


def _cost(value: object) -> int:
    """Return how many values of the budget a value takes: its length, or for text its characters by 16."""
    if isinstance(value, str):
        return len(value) // CHARACTERS_OF_A_VALUE
    return len(value) if isinstance(value, Sized) else 0


def _put(stack: list[Any], items: list[Any], name: str) -> None:
    """Push values as a tuple, or add them to the list or dict on top of the stack; ``TypeError`` for anything else."""
    if name.startswith("TUPLE"):
        stack.append(tuple(items))
    elif name.startswith("APPEND"):
        list.extend(stack[-1], items)
    else:
        filled(zip(items[::2], items[1::2], strict=True), stack[-1])


def _check_tree(root: object, budget: Budget) -> None:
    """Refuse a value with too many parts or levels, and one with a function in it.

    A part that is shared counts each time, so a value that contains itself has too many levels.
    """
    level = [root]
    for _ in range(MAX_DEPTH):
        below: list[object] = []
        for value in level:
            if callable(value):
                raise RefusedError("a function")
            if isinstance(value, list | tuple | dict):
                budget.take(len(value))
                below.extend(value.values() if isinstance(value, dict) else value)
        level = below
        if not level:
            return
    raise ValueError("it nests too deeply")
