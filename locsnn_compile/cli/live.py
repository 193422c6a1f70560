"""A line that is written over while a command runs, where somebody watches; a line for each change elsewhere."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

_CLEAR = "\r\x1b[K"


class LiveLine:
    """Writes to a stream; on a terminal :meth:`show` replaces the line that it wrote before."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.watched = stream.isatty()
        self._open = False

    def show(self, line: str) -> None:
        """Write a line that the next one replaces, where there is a terminal; else for good."""
        if not self.watched:
            self._stream.write(f"{line}\n")
            return
        self._stream.write(_CLEAR + line[: shutil.get_terminal_size().columns - 1])
        self._stream.flush()
        self._open = True

    def say(self, line: str) -> None:
        """Write a line for good."""
        self.close()
        self._stream.write(f"{line}\n")
        self._stream.flush()

    def close(self) -> None:
        """Take away the line that would be replaced."""
        if self._open:
            self._stream.write(_CLEAR)
            self._stream.flush()
            self._open = False


@contextmanager
def live_line(*, quiet: bool) -> Iterator[LiveLine | None]:
    """Give a line on standard output, and take it away at the end, however that comes; None where it is quiet."""
    if quiet:
        yield None
        return
    line = LiveLine(sys.stdout)
    try:
        yield line
    finally:
        line.close()
