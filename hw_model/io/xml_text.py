"""XML files from markup, whose texts may hold any character."""

import re
from xml.etree import ElementTree

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# That of xml.sax imports the modules of a web client.
_SAFE = str.maketrans(
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
    """Return a text for elements and quoted attributes; what XML 1.0 cannot express is replaced."""
    return _NOT_XML.sub("\ufffd", text).translate(_SAFE)


def xml_file(markup: str, **attributes: str) -> bytes:
    """Return markup as an indented UTF-8 file; its root has these ``attributes`` first."""
    root = ElementTree.fromstring(markup)
    root.attrib = attributes | root.attrib
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"
