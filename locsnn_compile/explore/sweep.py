"""Measure every setting of a grid once, despite interruptions, and find the bounds that ``auto`` keeps by default.

Finished points are small files on disk, named by the hash of everything that determines the point:

    {"schema": "locsnn-explore-point/1", "sha256": of the text of the point, "point": {...}}

A file that is not complete, or not of this setting and code, is ignored, and its point is measured again.
"""

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from hw_model.io.files import replace_file
from hw_model.io.records import RecordReader
from hw_model.values import Frozen
from locsnn_compile.cluster.spread import Spread, check_code, code_version
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.explore.point import Figures, Point, Study, digest_of, measure
from locsnn_compile.settings import Setting, usual_settings, weight_bits_of
from locsnn_compile.verification.error_bounds import ErrorBudget, default_budget
from locsnn_compile.verification.matching import Progress

SCHEMA = "locsnn-explore-point/1"
MAX_BYTES = 1 << 20


class Store(Frozen):
    """A folder of points, which is made for the first one."""

    folder: Path

    def read(self, key: str, setting: Setting) -> Point | None:
        """Return a finished point; None if there is no complete file."""
        path = self._path(key)
        try:
            if path.stat().st_size > MAX_BYTES:
                return None
            document = json.loads(path.read_bytes())
            if document["schema"] != SCHEMA or document["sha256"] != digest_of(document["point"]):
                return None
            point = RecordReader(path.name).record(Point, document["point"])
        # Whatever is in the file, it is not a point.
        except (
            OSError,
            ValueError,
            RecursionError,
            LookupError,
            TypeError,
            AttributeError,
            InputError,
        ):
            return None
        return point if (point.setting, point.code) == (setting, code_version()) else None

    def write(self, key: str, point: Point) -> None:
        """Write a point, completely or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        entry = asdict(point)
        document = {"schema": SCHEMA, "sha256": digest_of(entry), "point": entry}
        replace_file(
            self._path(key),
            (json.dumps(document, indent=1) + "\n").encode(),
            where=f"point {key[:12]}",
        )

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"


def sweep(
    study: Study,
    settings: Sequence[Setting],
    store: Store,
    spread: Spread,
    progress: Progress | None = None,
) -> tuple[Point, ...]:
    """Return a point for every setting, in their order; each is stored as soon as it is measured.

    A setting that the chip cannot hold is also a point, but if none fits, the error of the first setting is raised. An
    ``InputError`` is common to all settings and is raised at once. Points measured by other code are refused.
    """
    keys = {setting: study.key(setting) for setting in settings}
    points = {
        setting: point for setting, key in keys.items() if (point := store.read(key, setting))
    }
    missing = [setting for setting in keys if setting not in points]
    if progress:
        progress(len(points), len(keys))
    if missing:
        # However this ends, processes and connections end with it.
        with closing(spread(partial(measure, study), missing)) as measured:
            for point in measured:
                check_code(f"setting {point.setting}", point.code)
                store.write(keys[point.setting], point)
                points[point.setting] = point
                if progress:
                    progress(len(points), len(keys))
    done = tuple(points[setting] for setting in keys)
    if done and done[0].refused and not any(point.figures for point in done):
        raise done[0].refused
    return done


def auto_bounds(study: Study, points: Sequence[Point], store: Store, spread: Spread) -> ErrorBudget:
    """Return what ``auto`` may lose: by the first strategy that the chip holds, measured here if not on the grid."""
    known = {point.setting: point.figures for point in points}
    for setting in usual_settings(study.network, weight_bits_of(study.chip, None)):
        figures = known[setting] if setting in known else _measured(study, setting, store, spread)
        if figures:
            return default_budget(figures)
    # The chip holds this network only with fewer bits than its most.
    return default_budget(min((f for f in known.values() if f), key=lambda figures: figures.losses))


def _measured(study: Study, setting: Setting, store: Store, spread: Spread) -> Figures | None:
    try:
        return sweep(replace(study, engines=()), [setting], store, spread)[0].figures
    except TargetError:
        return None
