"""Texts in XML files: any name is escaped so that a parser reads it back, in elements and in attributes."""

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_model.io.xml_text import escaped, xml_file

XML = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters="\ufffe\uffff")
)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        pytest.param('<a href="b">&', "&lt;a href=&quot;b&quot;&gt;&amp;", id="markup"),
        pytest.param(
            "one\ntwo\tthree\r", "one&#10;two&#9;three&#13;", id="blanks that attributes would lose"
        ),
        pytest.param("a\x00b\uffff", "a\ufffdb\ufffd", id="what XML cannot express"),
    ],
)
def test_a_text_is_escaped(text, written):
    assert escaped(text) == written


@given(XML | st.sampled_from(["a\nb", "\t", "a\r\nb"]))
def test_a_text_is_read_again(text):
    root = ElementTree.fromstring(xml_file(f'<a b="{escaped(text)}">{escaped(text)}</a>'))
    assert (root.get("b"), (root.text or "").replace("\r\n", "\n").replace("\r", "\n")) == (
        text,
        text.replace("\r\n", "\n").replace("\r", "\n"),
    )


def test_a_file_is_indented_and_its_root_has_the_attributes_first():
    content = xml_file("<a b='1'>\n<c/></a>", xmlns="urn:x")
    assert (
        content
        == b"<?xml version='1.0' encoding='utf-8'?>\n<a xmlns=\"urn:x\" b=\"1\">\n  <c />\n</a>\n"
    )
