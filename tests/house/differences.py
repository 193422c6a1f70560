"""Where two folders differ: file by file, and within a file by key, by line, or by array."""

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

_SOURCES = re.compile(rb"\d+\.\d+\.\d+\+[0-9a-f]{12}")
"""A version with a digest of the sources: the one thing that may differ."""


def differences(before: Path, after: Path) -> dict[str, list[str]]:
    """Return by file what differs between two folders, in lines; nothing where the bytes are the same."""
    folders = [
        {path.relative_to(f).as_posix() for path in f.rglob("*") if path.is_file()}
        for f in (before, after)
    ]
    found = {}
    for name in sorted(folders[0] | folders[1]):
        if name not in folders[1]:
            found[name] = ["only before"]
        elif name not in folders[0]:
            found[name] = ["only now"]
        else:
            found[name] = file_differences(
                name, (before / name).read_bytes(), (after / name).read_bytes()
            )
    return found


def file_differences(name: str, before: bytes, after: bytes) -> list[str]:
    """Return in lines what differs between two contents of a file."""
    before, after = _SOURCES.sub(b"SOURCES", before), _SOURCES.sub(b"SOURCES", after)
    if before == after:
        return []
    if name.endswith(".json"):
        return [*_by_key("", json.loads(before), json.loads(after))] or [
            "layout: keys and values are the same"
        ]
    if name.endswith((".npz", ".zip")):
        return [*_by_member(before, after)] or ["archive: its members are the same"]
    if name.endswith((".html", ".svg")):
        before, after = before.replace(b"><", b">\n<"), after.replace(b"><", b">\n<")
    try:
        lines = before.decode().splitlines(), after.decode().splitlines()
    except UnicodeDecodeError:
        first = next(
            (i for i, (a, b) in enumerate(zip(before, after, strict=False)) if a != b), None
        )
        at = "one is longer" if first is None else f"first at byte {first}"
        return [f"{len(before)} bytes, now {len(after)}; {at}"]
    diff = difflib.unified_diff(*lines, n=0, lineterm="")
    return [line[:400] for line in diff if not line.startswith(("---", "+++", "@@"))] or [
        "line ends"
    ]


def _by_key(where: str, before: Any, after: Any) -> Iterator[str]:
    """Give each key whose value differs; numbers and words are told apart, for only words may be changed on purpose."""
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
        words = isinstance(before, str) and isinstance(after, str)
        yield f"{'words' if words else 'value'} {where[:-1]}: {_short(before)} -> {_short(after)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 160 else f"{text[:160]}..."


def _by_member(before: bytes, after: bytes) -> Iterator[str]:
    """Give each member of two archives that differs; arrays by how many of their numbers do."""
    with zipfile.ZipFile(io.BytesIO(before)) as old, zipfile.ZipFile(io.BytesIO(after)) as new:
        for name in dict.fromkeys([*old.namelist(), *new.namelist()]):
            if name not in old.namelist() or name not in new.namelist():
                yield f"member {name}: {'only now' if name in new.namelist() else 'only before'}"
            elif (pair := (old.read(name), new.read(name)))[0] != pair[1]:
                yield f"member {name}: {_arrays(*pair) if name.endswith('.npy') else 'other bytes'}"


def _arrays(before: bytes, after: bytes) -> str:
    old, new = np.load(io.BytesIO(before)), np.load(io.BytesIO(after))
    if (old.shape, old.dtype) != (new.shape, new.dtype):
        return f"{old.dtype} {old.shape} -> {new.dtype} {new.shape}"
    return f"{np.count_nonzero(old != new)} of {old.size} values differ"
