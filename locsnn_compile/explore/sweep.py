"""Measure every setting of a grid once, despite interruptions, and find the bounds that ``auto`` keeps by default.

Finished points are small files on disk, named by the hash of everything that determines the point:

    {"schema": "locsnn-explore-point/1", "sha256": of the text of the point, "point": {...}}

A file that is not complete, or not of this setting and code, is ignored, and its point is measured again. A setting is
one value for each dial of the compiler; a point is a setting with its figures (``point.py``).
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
"""A larger file is not a point: points take a few kilobytes."""


class StoredPoint(Protocol):
    """What :class:`Store` needs of a point, whether of one chip or of several."""

    @property
    def setting(self) -> Hashable:
        """The setting that was measured."""

    @property
    def code(self) -> str:
        """The version of the code that measured it."""


PointT = TypeVar("PointT", bound=StoredPoint)
SettingT = TypeVar("SettingT", bound=Hashable)


@dataclass(frozen=True)
class Store(Generic[PointT]):
    """A folder of points of one ``kind``; the folder is made when the first point is written."""

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
        # A file with any content may have this name; where reading it fails, it is not a point.
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
        # The name of the file is a hash of both, but a file can be renamed or copied.
        is_this_point = point.setting == setting and point.code == code_version()
        return point if is_this_point else None

    def write(self, key: str, point: PointT) -> None:
        """Write a point, completely or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        record: Any = point  # a protocol cannot say that it is a dataclass
        entry = asdict(record)
        document = {"schema": SCHEMA, "sha256": digest_of(entry), "point": entry}
        content = (json.dumps(document, indent=1) + "\n").encode()
        replace_file(self._path(key), content, where=f"point {key[:12]}")

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.json"


def measured_points(
    work: Callable[[SettingT], PointT],
    keys: Mapping[SettingT, str],
    store: Store[PointT],
    spread: Spread,
    progress: Progress | None = None,
) -> tuple[PointT, ...]:
    """Return the point that ``work`` measures for every setting of ``keys``, in their order.

    ``keys`` has the name under which the point of each setting is stored. Points in the store are
    not measured again; every other is stored as soon as it is measured. A point that a worker with
    other code measured is an ``InputError``.
    """
    points: dict[SettingT, PointT] = {}
    for setting, key in keys.items():
        stored = store.read(key, setting)
        if stored is not None:
            points[setting] = stored
    missing = [setting for setting in keys if setting not in points]
    if progress:
        progress(len(points), len(keys))
    if missing:
        # Closing the generator ends its processes and connections, also after an error or Ctrl-C.
        with closing(spread(work, missing)) as measured:
            for point in measured:
                # Processes finish in any order, so each point names its setting.
                measured_setting: Any = point.setting
                check_code(f"setting {measured_setting}", point.code)
                store.write(keys[measured_setting], point)
                points[measured_setting] = point
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
    """Return the bounds that ``auto`` keeps by default: the losses of the first strategy that fits, and a bit more.

    That strategy, with the widest weights, is measured here if it is not among the points.
    """
    figures_of = {point.setting: point.figures for point in points}
    widest_bits = weight_bits_of(study.chip, bits=None)
    for setting in usual_settings(study.network, widest_bits):
        if setting in figures_of:
            figures = figures_of[setting]
        else:
            figures = _measure_untimed(study, setting, store, spread)
        if figures is not None:
            return default_budget(figures)
    # The chip holds this network only with narrower weights: of the points, take the one that loses least.
    known_figures = [figures for figures in figures_of.values() if figures is not None]
    return default_budget(min(known_figures, key=lambda figures: figures.losses))


def _measure_untimed(
    study: Study, setting: Setting, store: Store[Point], spread: Spread
) -> Figures | None:
    """Return the figures of a setting that is not on the grid, without timing engines; None if it does not fit."""
    try:
        (point,) = sweep(replace(study, engines=()), [setting], store, spread)
    except TargetError:  # sweep raises it if no setting fits
        return None
    return point.figures
