"""The pictures of an exploration: energy and chip time over spike error, and the simulator's seconds over it."""

from __future__ import annotations

from collections.abc import Callable

from locsnn_compile.explore.exploration import Exploration
from locsnn_compile.explore.point import Figures, Point
from locsnn_compile.report.format import agreed, energy, time
from locsnn_compile.report.pictures.scatter import Mark, Panel, draw
from locsnn_compile.settings import AXES, Setting, Value

X_LABEL = "spikes that differ from the float network's"


def figures_picture(found: Exploration) -> bytes:
    """Draw what energy and time on the chip are paid for how few errors; the same figures give the same bytes."""
    profile = next(point.figures.energy_profile for point in found.points if point.figures)
    panels = (
        _panel(found, f"energy of a recording ({profile})", energy, lambda point, figures: figures.energy_pj),
        _panel(
            found, f"time of a recording on the chip ({profile})", time, lambda point, figures: figures.chip_time_ns
        ),
    )
    return _picture(found, "speed, error and energy", panels)


def timings_picture(found: Exploration) -> bytes:
    """Draw what the simulator took for a recording, a panel for each engine."""
    panels = []
    for engine in found.study.engines:
        many = max(point.timings[engine].recordings for point in found.points if point.figures)

        def nanoseconds(point: Point, figures: Figures, engine: str = engine) -> float:
            return 1e9 * point.timings[engine].seconds

        panels.append(_panel(found, f"simulation of a recording, engine {engine}, {many} at a time", time, nanoseconds))
    return _picture(found, "time in the simulator", panels)


def _picture(found: Exploration, what: str, panels: tuple[Panel, ...] | list[Panel]) -> bytes:
    title = f"{found.study.network.name} on {found.study.chip.name}: {what}"
    return draw(title, found.events.words(), [str(kind) for kind in _kinds(found)], panels)


def _panel(found: Exploration, title: str, text: Callable[[float], str], y: Callable[[Point, Figures], float]) -> Panel:
    kinds = _kinds(found)
    marks = tuple(
        Mark(
            x=error,
            y=y(point, point.figures),
            kind=kinds.index(point.setting.values[0]),
            label=_label(found, point.setting),
            words=_words(point.setting, point.figures),
            front=mark,
            taken=point is found.recommendation.taken,
        )
        for point, mark in zip(found.points, found.on_front, strict=True)
        # Where no neuron spikes there is nothing to place a mark by.
        if point.figures and (error := point.figures.spike_error) is not None
    )
    return Panel(title, X_LABEL, _percent, text, marks)


def _kinds(found: Exploration) -> list[Value]:
    """Return the values of the first axis, each of which has a shape of its own."""
    return list(dict.fromkeys(point.setting.values[0] for point in found.points))


def _label(found: Exploration, setting: Setting) -> str:
    """Return the values of the other axes that differ between points."""
    columns = list(zip(*(point.setting.values for point in found.points), strict=True))
    differing = [i for i in range(1, len(AXES)) if len(set(columns[i])) > 1]
    return setting.name(differing)


def _words(setting: Setting, figures: Figures) -> str:
    changed = agreed(figures.prediction_error, "none")
    return (
        f"{setting}: {agreed(figures.spike_error)} of spikes differ, {changed} of predictions, "
        f"{energy(figures.energy_pj)}, {time(figures.chip_time_ns)}"
    )


def _percent(value: float) -> str:
    return f"{100 * value:g} %"
