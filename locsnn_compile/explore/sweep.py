"""Measure every setting of a grid once, despite interruptions, and find the bounds that ``auto`` keeps by default.

Finished points are small files on disk, named by the hash of everything that determines the point:

    {"schema": "locsnn-explore-point/1", "sha256": of the text of the point, "point": {...}}

A file that is not complete, or not of this setting and code, is ignored, and its point is measured again.
"""

import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from hw_model.io.files import replace_file
from hw_model.io.records import RecordReader
from locsnn_compile.cluster.spread import Spread, check_code, code_version
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.explore.point import Figures, Point, Study, digest_of, measure
from locsnn_compile.settings import Setting, usual_settings, weight_bits_of
from locsnn_compile.verification.error_bounds import ErrorBudget, default_budget
from locsnn_compile.verification.matching import Progress

SCHEMA = "locsnn-explore-point/1"
MAX_BYTES = 1 << 20


class StoredPoint(Protocol):
    """A record of what was measured: of which setting, and by which code."""

    @property
    def setting(self) -> Hashable:
        """What was tried."""

    @property
    def code(self) -> str:
        """The version of the code that measured it."""


PointT = TypeVar("PointT", bound=StoredPoint)
SettingT = TypeVar("SettingT", bound=Hashable)


@dataclass(frozen=True)
class Store(Generic[PointT]):
    """A folder of points of one ``kind``, which is made for the first one."""

    folder: Path
    kind: type[PointT]

    def read(self, key: str, setting: Hashable) -> PointT | None:
        """Return a finished point; None if there is no complete file."""
        path = self._path(key)
        try:
            if path.stat().st_size > MAX_BYTES:
                return None
            document = json.loads(path.read_bytes())
            if document["schema"] != SCHEMA or document["sha256"] != digest_of(document["point"]):
                return None
            point = RecordReader(path.name).record(self.kind, document["point"])
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

    def write(self, key: str, point: PointT) -> None:
        """Write a point, completely or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        record: Any = point
        entry = asdict(record)
        document = {"schema": SCHEMA, "sha256": digest_of(entry), "point": entry}
        replace_file(
            self._path(key),
            (json.dumps(document, indent=1) + "\n").encode(),
            where=f"point {key[:12]}",
        )

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"


def measured_points(
    work: Callable[[SettingT], PointT],
    keys: Mapping[SettingT, str],
    store: Store[PointT],
    spread: Spread,
    progress: Progress | None = None,
) -> tuple[PointT, ...]:
    """Return what ``work`` finds for every setting of ``keys``, in their order.

    Those that are in the store are not measured again; each other is stored as soon as it is
    measured. Points measured by other code are refused.
    """
    stored = {setting: store.read(key, setting) for setting, key in keys.items()}
    points = {setting: point for setting, point in stored.items() if point is not None}
    missing = [setting for setting in keys if setting not in points]
    if progress:
        progress(len(points), len(keys))
    if missing:
        # However this ends, processes and connections end with it.
        with closing(spread(work, missing)) as measured:
            for point in measured:
                # Results come in any order, and each says what it is of.
                setting: Any = point.setting
                check_code(f"setting {setting}", point.code)
                store.write(keys[setting], point)
                points[setting] = point
                if progress:
                    progress(len(points), len(keys))
    return tuple(points[setting] for setting in keys)


def sweep(
    study: Study,
    settings: Sequence[Setting],
    store: Store[Point],
    spread: Spread,
    progress: Progress | None = None,
) -> tuple[Point, ...]:
    """Return a point for every setting, in their order, as :func:`measured_points` does.

    A setting that the chip cannot hold is also a point, but if none fits, the error of the first setting is raised. An
    ``InputError`` is common to all settings and is raised at once.
    """
    keys = {setting: study.key(setting) for setting in settings}
    points = measured_points(partial(measure, study), keys, store, spread, progress)
    if points and points[0].refused and not any(point.figures for point in points):
        raise points[0].refused
    return points


def auto_bounds(
    study: Study, points: Sequence[Point], store: Store[Point], spread: Spread
) -> ErrorBudget:
    """Return what ``auto`` may lose: by the first strategy that the chip holds, measured here if not on the grid."""
    known = {point.setting: point.figures for point in points}
    for setting in usual_settings(study.network, weight_bits_of(study.chip, None)):
        figures = known[setting] if setting in known else _measured(study, setting, store, spread)
        if figures:
            return default_budget(figures)
    # The chip holds this network only with fewer bits than its most.
    return default_budget(min((f for f in known.values() if f), key=lambda figures: figures.losses))


def _measured(
    study: Study, setting: Setting, store: Store[Point], spread: Spread
) -> Figures | None:
    try:
        return sweep(replace(study, engines=()), [setting], store, spread)[0].figures
    except TargetError:
        return None
