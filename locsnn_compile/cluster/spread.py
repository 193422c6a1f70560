"""A job in parts: what does them gives their results in their order, whoever does them where."""

import pickle
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any, Protocol, TypeVar

Part = TypeVar("Part")
Result = TypeVar("Result")


class Spread(Protocol):
    """Does the parts of a job; holds no more of them, and of their results, than are under way."""

    def __call__(self, work: Callable[[Part], Result], parts: Iterable[Part], /) -> Iterator[Result]:
        """Yield what ``work`` gives for each part, in their order."""


def here(work: Callable[[Part], Result], parts: Iterable[Part], /) -> Iterator[Result]:
    """Do one part after the other in this process."""
    return map(work, parts)


def packed(value: object) -> bytes:
    """Return bytes to send to another process: recordings are mostly zeros, and shrink a hundredfold."""
    return zlib.compress(pickle.dumps(value))


@lru_cache(maxsize=2)
def unpacked(content: bytes) -> Any:
    """Return what :func:`packed` was given in a process of ours; kept for the next part of the same job."""
    return pickle.loads(zlib.decompress(content))


def work_packed(work: bytes, part: bytes) -> Any:
    """Do a part that comes from another process; what both share is unpacked once."""
    return unpacked(work)(unpacked.__wrapped__(part))
