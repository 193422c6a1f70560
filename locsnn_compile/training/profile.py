"""The picture of a training run: losses and validation accuracy over its epochs."""

from collections.abc import Callable, Sequence

from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.chart import Panel, draw
from locsnn_compile.training.config import EpochRecord


def profile(history: Sequence[EpochRecord], name: str) -> bytes:
    """Return the picture as an SVG file; equal input gives equal bytes. What a run has not measured is left out."""
    losses = (
        _curve("training, part of the recordings", history, "select", lambda row: row.loss),
        _curve("validation", history, "select", lambda row: row.validation_loss),
        _curve("training afresh, all recordings", history, "refit", lambda row: row.loss),
    )
    accuracy = _curve("validation", history, "select", lambda row: row.validation_accuracy)
    panels = [_panel("loss", losses), _panel("accuracy", (accuracy,))]
    return draw(f"Training of {name}", [panel for panel in panels if panel.curves])


def _curve(
    label: str, history: Sequence[EpochRecord], phase: str, figure: Callable[[EpochRecord], float | None]
) -> Curve:
    measured = [(float(row.epoch), figure(row)) for row in history if row.phase == phase]
    return Curve(label, tuple((epoch, value) for epoch, value in measured if value is not None))


def _panel(title: str, curves: tuple[Curve, ...]) -> Panel:
    return Panel(title, "epoch", tuple(curve for curve in curves if curve.points), x_log=False, y_log=False)
