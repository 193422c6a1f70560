"""Finished points on disk: one small file each, named by the hash of all that decides it.

    {"schema": "locsnn-explore-point/1", "sha256": of the text of the point, "point": {...}}

A file that is not whole, or not of this setting and code, counts as none: its point is measured again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hw_model.io.files import replace_file
from locsnn_compile.cluster.code import code_version
from locsnn_compile.errors import InputError
from locsnn_compile.explore.point import Figures, Point, Refusal, Timing
from locsnn_compile.settings import Setting

SCHEMA = "locsnn-explore-point/1"
MAX_BYTES = 1 << 20


@dataclass(frozen=True)
class Store:
    """A folder of points; it is made with the first one."""

    folder: Path

    def read(self, key: str, setting: Setting) -> Point | None:
        """Return a finished point, None where there is none that is whole."""
        path = self._path(key)
        try:
            if path.stat().st_size > MAX_BYTES:
                return None
            document = json.loads(path.read_bytes())
            if document["schema"] != SCHEMA or document["sha256"] != _digest(document["point"]):
                return None
            point = _point(document["point"], setting)
        # Whatever else is in the file: it is not a point.
        except (OSError, ValueError, RecursionError, LookupError, TypeError, AttributeError):
            return None
        return point if point.code == code_version() else None

    def write(self, key: str, point: Point) -> None:
        """Write a point, whole or not at all."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"output {self.folder.name!r}",
                "the folder cannot be made",
                measured=error.strerror or "",
                fix="Choose a folder with -o.",
            ) from None
        entry = asdict(point)
        document = {"schema": SCHEMA, "sha256": _digest(entry), "point": entry}
        replace_file(self._path(key), (json.dumps(document, indent=1) + "\n").encode(), where=f"point {key[:12]}")

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"


def _digest(entry: object) -> str:
    return hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()


def _point(entry: Mapping[str, Any], setting: Setting) -> Point:
    """Return the point of an entry; one of another setting is a ``ValueError``."""
    if entry["setting"] != asdict(setting):
        raise ValueError(entry["setting"])
    return Point(
        setting=setting,
        figures=entry["figures"] and Figures(**entry["figures"]),
        refusal=entry["refusal"] and Refusal(**entry["refusal"]),
        timings={engine: Timing(**timing) for engine, timing in entry["timings"].items()},
        code=entry["code"],
    )
