"""The files of an exploration: figures, front and recommendation, and apart from them what clocks said.

``explore.json``, ``explore.csv`` and ``explore.svg`` depend on what was explored alone: they have the same bytes
wherever the points were measured. ``timings.csv`` and ``timings.svg`` hold the seconds that the engines took there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from locsnn_compile.cluster.code import code_version
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.exploration import Exploration
from locsnn_compile.explore.front import FRONT_RULE, OBJECTIVES
from locsnn_compile.explore.pictures import figures_picture, timings_picture
from locsnn_compile.explore.point import Figures
from locsnn_compile.report.figures.flat import csv_bytes
from locsnn_compile.settings import AXES

SCHEMA = "locsnn-explore/1"
Document = dict[str, Any]


def document(found: Exploration) -> Document:
    """Return explore.json as plain values."""
    network, taken = found.study.network, found.recommendation.taken
    return {
        "schema": SCHEMA,
        "code": code_version(),
        "model": {"name": network.name, "sha256": network.sha256},
        "target": found.study.chip.name,
        "chosen_on": _events(found.events),
        "reported_on": found.reported_on and _events(found.reported_on),
        "objectives": list(OBJECTIVES),
        "front_rule": FRONT_RULE,
        "recommended": {
            "setting": taken and asdict(taken.setting),
            "why": found.recommendation.why,
            "command": taken and found.command(taken.setting),
            **asdict(found.budget),
        },
        "points": _points(found),
    }


def exploration_files(found: Exploration) -> dict[str, bytes]:
    """Return the files by name."""
    made = document(found)
    return {
        "explore.json": (json.dumps(made, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode(),
        "explore.csv": csv_bytes([_flat(row) for row in made["points"]]),
        "explore.svg": figures_picture(found),
        "timings.csv": csv_bytes(timing_rows(found)),
        "timings.svg": timings_picture(found),
    }


def timing_rows(found: Exploration) -> list[Document]:
    """Return a row for each point and engine: seconds of a recording, over how many recordings."""
    return [
        asdict(point.setting)
        | {"engine": engine, "recordings": timing.recordings, "seconds_per_recording": timing.seconds}
        for point in found.points
        for engine, timing in point.timings.items()
    ]


def _points(found: Exploration) -> list[Document]:
    reported = {point.setting: point.figures for point in found.reported}
    return [
        {
            "setting": asdict(point.setting),
            "figures": point.figures and _figures(point.figures),
            "refused": point.refusal and str(point.refusal.error()),
            "on_front": mark,
            "recommended": point is found.recommendation.taken,
            "reported": (figures := reported.get(point.setting)) and _figures(figures),
            "command": found.command(point.setting),
            "report_command": found.report_command(point.setting),
        }
        for point, mark in zip(found.points, found.on_front, strict=True)
    ]


def _figures(figures: Figures) -> Document:
    return {name: getattr(figures, name) for name in OBJECTIVES} | asdict(figures)


def _events(chosen: Chosen) -> Document:
    return {
        "source": chosen.recordings.source,
        "part": chosen.part,
        "recordings": len(chosen.recordings),
        "available": chosen.available,
    }


def _flat(row: Mapping[str, Any]) -> Document:
    """Return a row of the table: figures of both sets of recordings in columns, empty where there are none."""
    names = list(dict.fromkeys((*OBJECTIVES, *Figures.__dataclass_fields__)))
    figures, reported = row["figures"] or {}, row["reported"] or {}
    return {
        **{axis.name: row["setting"][axis.name] for axis in AXES},
        **{key: row[key] for key in ("on_front", "recommended")},
        **{name: figures.get(name) for name in names},
        **{f"reported_{name}": reported.get(name) for name in names},
        **{key: row[key] for key in ("refused", "command", "report_command")},
    }
