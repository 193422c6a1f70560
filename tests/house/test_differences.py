"""The byte comparison finds every kind of difference: in a key, a line, an array, or a file that is missing."""

import io
import json

import numpy as np
import pytest
from differences import differences, file_differences
from same_bytes import case_lines


def archive(**arrays):
    """The bytes of a ``.npz`` of these arrays."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def document(**keys):
    """The bytes of a JSON file of these keys."""
    return json.dumps(keys, indent=2).encode()


# By title: the name of a file, two contents, and the lines that describe how they differ.
DIFFERENCES = {
    "equal": ("a.txt", b"one\n", b"one\n", []),
    "a digest of sources": (
        "a.json",
        b'{"code": "0.1.0+0123456789ab"}',
        b'{"code": "0.1.0+fedcba987654"}',
        [],
    ),
    "another version": ("a.txt", b"0.1.0", b"0.1.1", ["-0.1.0", "+0.1.1"]),
    "a line": ("a.txt", b"one\ntwo\n", b"one\n2\n", ["-two", "+2"]),
    "the last line's end": ("a.txt", b"one\n", b"one", ["line ends"]),
    "a tag in a long line": (
        "a.html",
        b"<p>a</p><b>c</b>",
        b"<p>a</p><b>d</b>",
        ["-<b>c</b>", "+<b>d</b>"],
    ),
    "a number": (
        "a.json",
        document(a={"b": [1, 2]}),
        document(a={"b": [1, 3]}),
        ["value a.b.1: 2 -> 3"],
    ),
    "a number of another type": ("a.json", document(a=1), document(a=1.0), ["value a: 1 -> 1.0"]),
    "words": (
        "a.json",
        document(a="no rate"),
        document(a="not a rate"),
        ['words a: "no rate" -> "not a rate"'],
    ),
    "keys": (
        "a.json",
        document(a=1, b=2),
        document(a=1, c=2),
        ["key b: only before", "key c: only now"],
    ),
    "the order of keys": (
        "a.json",
        document(a=1, b=2),
        document(b=2, a=1),
        ["key : its keys are in another order"],
    ),
    "layout": ("a.json", b'{"a": 1}', b'{"a":1}', ["layout: keys and values are the same"]),
    "a value": (
        "a.npz",
        archive(a=np.arange(4)),
        archive(a=np.array([0, 1, 9, 9])),
        ["member a.npy: 2 of 4 values differ"],
    ),
    "a shape": (
        "a.npz",
        archive(a=np.zeros(2)),
        archive(a=np.zeros(3)),
        ["member a.npy: float64 (2,) -> float64 (3,)"],
    ),
    "an array": (
        "a.npz",
        archive(a=np.zeros(2)),
        archive(b=np.zeros(2)),
        ["member a.npy: only before", "member b.npy: only now"],
    ),
    "bytes": ("a.nir", b"\xff\x00", b"\xff\x01", ["2 bytes, now 2; first at byte 1"]),
}


@pytest.mark.parametrize(
    ("name", "before", "after", "lines"), DIFFERENCES.values(), ids=DIFFERENCES
)
def test_differences_within_a_file_are_described(name, before, after, lines):
    assert file_differences(name, before, after) == lines


def test_files_that_only_one_folder_has_are_listed(tmp_path):
    for side, names in (("before", "ab"), ("now", "bc")):
        (tmp_path / side).mkdir()
        for name in names:
            (tmp_path / side / name).write_text(name)
    by_file = differences(tmp_path / "before", tmp_path / "now")
    assert by_file == {"a": ["only before"], "b": [], "c": ["only now"]}
    assert case_lines("case", "0", by_file, most=1) == [
        "case: 1 of 3 files the same (exit codes 0)",
        "  a",
        "    only before",
        "  c",
        "    only now",
    ]
