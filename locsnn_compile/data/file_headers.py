"""Lines of text with which files of cameras begin, before their binary events."""

from hw_model.values import Frozen

MOST_HEADER_BYTES = 1 << 20
"""The longest header that is read; jAER copies all settings of a camera into it."""


class FileHeader(Frozen):
    """The ``lines`` of a header without mark and blanks, and the events that follow, as bytes."""

    lines: tuple[str, ...]
    body: bytes

    def value(self, name: str) -> str:
        """Return the text behind a name, as in ``geometry 1280x720``; empty if no line has it."""
        for line in self.lines:
            first, _, rest = line.partition(" ")
            if first.rstrip(":").lower() == name.lower():
                return rest.strip()
        return ""


def split_header(data: bytes, mark: bytes, last: str) -> FileHeader:
    """Return the header of a file and what follows.

    The header is made of lines that begin with ``mark``, and ends behind the line ``last``, or
    before a line that is none. Events may begin with the bytes of the mark as well, so a line
    counts only if all of it can be printed.
    """
    lines: list[str] = []
    begin = 0
    while data.startswith(mark, begin):
        end = data.find(b"\n", begin, MOST_HEADER_BYTES)
        if end < 0 or not _is_printed(data[begin:end]):
            break
        lines.append(data[begin + len(mark) : end].decode("latin-1").strip())
        begin = end + 1
        if lines[-1].lower() == last:
            break
    return FileHeader(tuple(lines), data[begin:])


def _is_printed(line: bytes) -> bool:
    """Tell whether a line has no control characters but tabs and the end of a line."""
    return all(byte >= 0x20 or byte in b"\t\r" for byte in line)
