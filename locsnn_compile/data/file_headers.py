"""Split a camera's file into its header, which is lines of text, and the binary events behind it."""

from hw_model.values import Frozen

MOST_HEADER_BYTES = 1 << 20
"""The longest header that is read; jAER copies all settings of a camera into it."""
_FIRST_PRINTABLE = 0x20
"""The lowest byte that is not a control character."""
_PRINTED_CONTROLS = b"\t\r"
"""Control characters that occur in lines of text."""


class FileHeader(Frozen):
    """A file of a camera: the ``lines`` of its header, and the ``body``, which is the bytes of its events.

    The mark with which lines begin in the file, such as ``%``, and blanks around them are removed.
    """

    lines: tuple[str, ...]
    body: bytes

    def value(self, name: str) -> str:
        """Return the text behind a name, as in ``geometry 1280x720``; empty if no line has it."""
        for line in self.lines:
            label, _, value = line.partition(" ")
            if label.rstrip(":").lower() == name.lower():
                return value.strip()
        return ""


def split_header(data: bytes, mark: bytes, last_line: str) -> FileHeader:
    """Return the header of a file and what follows.

    The header is made of lines that begin with ``mark``. It ends behind ``last_line``, given without
    mark and in lower case, or before a line without the mark. Events may begin with the bytes of the
    mark as well, so a line counts only if all of it can be printed.
    """
    lines: list[str] = []
    begin = 0
    while data.startswith(mark, begin):
        end = data.find(b"\n", begin, MOST_HEADER_BYTES)
        is_line = end >= 0 and _is_printed(data[begin:end])
        if not is_line:
            break
        line = data[begin + len(mark) : end].decode("latin-1").strip()
        lines.append(line)
        begin = end + 1
        if line.lower() == last_line:
            break
    return FileHeader(tuple(lines), data[begin:])


def _is_printed(line: bytes) -> bool:
    """Return whether a line has no control characters except tabs and carriage returns."""
    return all(byte >= _FIRST_PRINTABLE or byte in _PRINTED_CONTROLS for byte in line)
