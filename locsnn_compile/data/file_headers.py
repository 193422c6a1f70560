"""Split a camera's file into its header, which is lines of text, and the binary events behind it."""

from hw_model.values import Frozen
from locsnn_compile.errors import InputError

MOST_HEADER_BYTES = 1 << 20
"""The longest header that is read; a longer one is an error. jAER copies all settings of a camera into it, so it may
be long. Chosen by hand."""
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
        """Return the text behind a name, as in ``geometry 1280x720``; empty if no line has it.

        The name may be in upper or lower case, and followed by a colon, as in ``AEChip: DVS128``.
        """
        for line in self.lines:
            label, _, value = line.partition(" ")
            if label.rstrip(":").lower() == name.lower():
                return value.strip()
        return ""


def split_header(data: bytes, mark: bytes, last_line: str, where: str) -> FileHeader:
    """Return the header of a file and what follows; ``InputError`` for a header that is too long.

    The header is made of lines that begin with ``mark``, such as ``%``. It ends behind ``last_line``,
    given without mark and in lower case, such as ``end`` for the line ``% end``. Not all files have
    this line: otherwise it ends before the first line without the mark. Events may begin with the
    bytes of the mark as well, so a line counts only if all of it can be printed.
    """
    lines: list[str] = []
    begin = 0
    while data.startswith(mark, begin):
        end = data.find(b"\n", begin, MOST_HEADER_BYTES)
        has_end = end >= 0
        stop = end if has_end else MOST_HEADER_BYTES
        if not _is_printed(data[begin:stop]):
            break
        if not has_end:
            # The text goes on beyond the limit, or the file ends within the line.
            _check_length(data, where)
            break
        line = data[begin + len(mark) : end].decode("latin-1").strip()
        lines.append(line)
        begin = end + 1
        if line.lower() == last_line:
            break
    return FileHeader(tuple(lines), data[begin:])


def _check_length(data: bytes, where: str) -> None:
    """Raise ``InputError`` for a file whose header goes on beyond :data:`MOST_HEADER_BYTES`."""
    if len(data) > MOST_HEADER_BYTES:
        measured = f"more than {MOST_HEADER_BYTES} bytes"
        raise InputError(where, "its header is too long", measured=measured, fix="Shorten it.")


def _is_printed(line: bytes) -> bool:
    """Return whether a line has no control characters except tabs and carriage returns."""
    return all(byte >= _FIRST_PRINTABLE or byte in _PRINTED_CONTROLS for byte in line)
