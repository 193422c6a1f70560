"""XML files from texts that may hold any character."""

import re
from xml.etree import ElementTree

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_text(text: str) -> str:
    """Return a text with a replacement for each character that XML 1.0 cannot express."""
    return _NOT_XML.sub("\ufffd", text)


def xml_file(root: ElementTree.Element) -> bytes:
    """Return an element as an indented UTF-8 file."""
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"
