"""Write XML files, such as JUnit reports and SVG pictures, with texts that may hold any character."""

import re
from xml.etree import ElementTree

# Every character that XML 1.0 does not allow, even as an escape: control characters and surrogates, among others.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# xml.sax.saxutils has such a function, but its import loads a web client's modules and slows down every start.
# Tabs and line ends are escaped, too: readers turn them into spaces in attributes.
_ESCAPES = str.maketrans(
    {
        "&": "&amp;",
        "<": "&lt;",
        ">": "&gt;",
        '"': "&quot;",
        "\t": "&#9;",
        "\n": "&#10;",
        "\r": "&#13;",
    }
)


def escaped(text: str) -> str:
    """Return a text escaped for elements and quoted attributes.

    A character that XML 1.0 cannot express becomes the replacement character U+FFFD.
    """
    return _NOT_XML.sub("\ufffd", text).translate(_ESCAPES)


def xml_file(markup: str, **attributes: str) -> bytes:
    """Return markup as an indented UTF-8 file; the root element gets ``attributes``, before those that it has."""
    root = ElementTree.fromstring(markup)
    root.attrib = attributes | root.attrib
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"
