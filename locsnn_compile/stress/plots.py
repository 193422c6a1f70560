"""What the pictures of the page show."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.curves import Panel, draw
from locsnn_compile.strategies import NATIVE
from locsnn_compile.stress.bounds import SOURCES, Source
from locsnn_compile.stress.row import Drift, Measured, Row


def pictures(rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the pictures by the end of their names; one that has nothing to show is left out."""
    made = {
        "time-constants.svg": _time_constants(rows),
        "weights.svg": _weights(rows),
        "long-runs.svg": _long_runs(rows),
    }
    return {name: picture for name, picture in made.items() if picture is not None}


def _time_constants(rows: Sequence[Row]) -> bytes | None:
    figures: dict[str, Callable[[Measured], float]] = {"error found": lambda m: m.error, "bound": lambda m: m.bound}
    figures |= {f"of it {source}": _part(source) for source in SOURCES}
    panels = [
        Panel(
            f"{strategy}: error in thresholds",
            "time constant, steps",
            tuple(_curve(name, rows, "time constants", strategy, figure) for name, figure in figures.items()),
        )
        for strategy in ("dendrite", NATIVE)
    ]
    return _drawn("Error of potentials by time constant, same spikes on both sides", panels)


def _part(source: Source) -> Callable[[Measured], float]:
    return lambda m: m.parts[source]


def _weights(rows: Sequence[Row]) -> bytes | None:
    group = "weights against the threshold"

    def curves(of: Callable[[Measured], float]) -> tuple[Curve, ...]:
        return tuple(_curve(strategy, rows, group, strategy, of) for strategy in ("dendrite", NATIVE))

    x_label = "weights, times those the threshold is made for"
    panels = [
        Panel(
            "share of weights that round to 0", x_label, curves(lambda m: m.weights.lost / m.weights.of), y_log=False
        ),
        Panel("wraps and clips", x_label, curves(lambda m: m.wraps + m.clips), y_log=False),
    ]
    return _drawn("Weights over twelve orders of magnitude, one threshold", panels)


def _long_runs(rows: Sequence[Row]) -> bytes | None:
    named = {
        f"{row.case.name}, {row.case.strategy}": row.drift
        for row in rows
        if row.drift is not None and row.drift.error is not None and row.case.strategy != "delay-line"
    }
    errors = tuple(_by_tenth(name, drift, 1.0) for name, drift in named.items())
    shares = tuple(_by_tenth(name, drift, drift.bound) for name, drift in named.items() if drift.bound)
    panels = [
        Panel("largest error of each tenth, thresholds", "step", errors, x_log=False),
        Panel("the same as a share of its bound", "step", shares, x_log=False, y_log=False),
    ]
    return _drawn("Neurons below the threshold in a long run", panels)


def _by_tenth(name: str, drift: Drift, unit: float) -> Curve:
    """Return the errors of a long run over a unit, at the end of each tenth."""
    assert drift.error is not None
    tenth = drift.steps / len(drift.error)
    return Curve(name, tuple(((i + 1) * tenth, error / unit) for i, error in enumerate(drift.error)))


def _curve(label: str, rows: Sequence[Row], group: str, strategy: str, figure: Callable[[Measured], float]) -> Curve:
    points = tuple(
        (row.case.x, figure(row.measured))
        for row in rows
        if row.case.group == group
        and row.case.strategy == strategy
        and row.case.x is not None
        and row.measured is not None
    )
    return Curve(label, points)


def _drawn(title: str, panels: Sequence[Panel]) -> bytes | None:
    return draw(title, panels) if any(curve.points for panel in panels for curve in panel.curves) else None
