"""List what differs between two folders, for the byte comparison of `same_bytes.py`.

A file of JSON is compared by key, an archive by member (arrays by the number of values that differ),
any other text by line, and other bytes by the first place. The kind of a file is read from its ending.
"""

from __future__ import annotations

import difflib
import io
import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

_VERSION_OF_SOURCES = re.compile(rb"\d+\.\d+\.\d+\+[0-9a-f]{12}")
"""A version and a digest of the sources, as `explore` writes them. Only these may differ between two commits."""
_LONGEST_LINE = 400
"""Characters of a differing line, and (below) of a JSON value, that are printed; chosen by hand."""
_LONGEST_VALUE = 160


def differences(before: Path, after: Path) -> dict[str, list[str]]:
    """Return, for every file of two folders, lines that describe the differences; no lines for equal files."""
    names_before = _files_in(before)
    names_after = _files_in(after)
    by_file = {}
    for name in sorted(names_before | names_after):
        if name not in names_after:
            by_file[name] = ["only before"]
        elif name not in names_before:
            by_file[name] = ["only now"]
        else:
            by_file[name] = file_differences(
                name, (before / name).read_bytes(), (after / name).read_bytes()
            )
    return by_file


def _files_in(folder: Path) -> set[str]:
    """Return the paths of all files in a folder, relative to it."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def file_differences(name: str, before: bytes, after: bytes) -> list[str]:
    """Return lines that describe the differences between two contents of a file; no lines if they are equal."""
    before = _VERSION_OF_SOURCES.sub(b"SOURCES", before)
    after = _VERSION_OF_SOURCES.sub(b"SOURCES", after)
    if before == after:
        return []
    if name.endswith(".json"):
        return [*_by_key("", json.loads(before), json.loads(after))] or [
            "layout: keys and values are the same"
        ]
    if name.endswith((".npz", ".zip")):
        return [*_by_member(before, after)] or ["archive: its members are the same"]
    if name.endswith((".html", ".svg")):
        # Lines of these files are long: with a line per tag, only the changed tag is shown.
        before = before.replace(b"><", b">\n<")
        after = after.replace(b"><", b">\n<")
    try:
        lines_before = before.decode().splitlines()
        lines_after = after.decode().splitlines()
    except UnicodeDecodeError:
        return [f"{len(before)} bytes, now {len(after)}; {_first_byte(before, after)}"]
    diff = difflib.unified_diff(lines_before, lines_after, n=0, lineterm="")
    changed = [line for line in diff if not line.startswith(("---", "+++", "@@"))]
    # The bytes differ but no line does, so the characters that end the lines do.
    return [line[:_LONGEST_LINE] for line in changed] or ["line ends"]


def _first_byte(before: bytes, after: bytes) -> str:
    """Describe the first place at which two contents that are no text differ."""
    for place, (old, new) in enumerate(zip(before, after, strict=False)):
        if old != new:
            return f"first at byte {place}"
    return "one is longer"


def _by_key(where: str, before: Any, after: Any) -> Iterator[str]:
    """Yield a line for each key whose value differs.

    The line begins with `words` if both values are strings, and with `value` otherwise, because a
    change of wording may be intended where a changed number is a fault. `where` is the dotted path
    of keys that leads to these values, with a dot at its end.
    """
    if isinstance(before, dict) and isinstance(after, dict):
        for key in [*before, *(key for key in after if key not in before)]:
            if key not in after or key not in before:
                yield f"key {where}{key}: {'only now' if key in after else 'only before'}"
            else:
                yield from _by_key(f"{where}{key}.", before[key], after[key])
        if list(before) != list(after) and sorted(before) == sorted(after):
            yield f"key {where[:-1]}: its keys are in another order"
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for i, pair in enumerate(zip(before, after, strict=True)):
            yield from _by_key(f"{where}{i}.", *pair)
    elif before != after or type(before) is not type(after):
        kind = "words" if isinstance(before, str) and isinstance(after, str) else "value"
        yield f"{kind} {where[:-1]}: {_short(before)} -> {_short(after)}"


def _short(value: Any) -> str:
    """Return a value as JSON, cut to the length that is printed."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."


def _by_member(before: bytes, after: bytes) -> Iterator[str]:
    """Yield a line for each member of two archives that differs; for an array, with the number of its values that do."""
    with zipfile.ZipFile(io.BytesIO(before)) as old, zipfile.ZipFile(io.BytesIO(after)) as new:
        for name in dict.fromkeys([*old.namelist(), *new.namelist()]):
            if name not in new.namelist():
                yield f"member {name}: only before"
            elif name not in old.namelist():
                yield f"member {name}: only now"
            elif old.read(name) == new.read(name):
                continue
            elif name.endswith(".npy"):
                yield f"member {name}: {_array_difference(old.read(name), new.read(name))}"
            else:
                yield f"member {name}: other bytes"


def _array_difference(before: bytes, after: bytes) -> str:
    """Describe how two ``.npy`` files differ: in type and shape, or in how many values."""
    old = np.load(io.BytesIO(before))
    new = np.load(io.BytesIO(after))
    if (old.shape, old.dtype) != (new.shape, new.dtype):
        return f"{old.dtype} {old.shape} -> {new.dtype} {new.shape}"
    return f"{np.count_nonzero(old != new)} of {old.size} values differ"
