"""Show the course of a training run, its losses and accuracies by epoch: as a picture, and in TensorBoard."""

from collections.abc import Callable, Sequence
from pathlib import Path

from hw_model.io.extras import needed
from locsnn_compile.report.content import Curve
from locsnn_compile.report.pictures.chart import Panel, draw
from locsnn_compile.training.config import EpochRecord, Progress


def profile(history: Sequence[EpochRecord], name: str) -> bytes:
    """Return the picture as an SVG file; equal input gives equal bytes.

    The first phase of a run (``select``) trains on a part of the recordings and validates on the rest; the second
    (``refit``) trains afresh on all. Curves of figures that were not measured are left out.
    """
    losses = (
        _curve("training, part of the recordings", history, "select", lambda row: row.loss),
        _curve("validation", history, "select", lambda row: row.validation_loss),
        _curve("training afresh, all recordings", history, "refit", lambda row: row.loss),
    )
    accuracy = _curve("validation", history, "select", lambda row: row.validation_accuracy)
    panels = [_panel("loss", losses), _panel("accuracy", (accuracy,))]
    return draw(f"Training of {name}", [panel for panel in panels if panel.curves])


def _curve(
    label: str,
    history: Sequence[EpochRecord],
    phase: str,
    figure: Callable[[EpochRecord], float | None],
) -> Curve:
    """Return the curve of a ``figure`` over the epochs of a phase, without epochs in which it was not measured."""
    measured = [(float(row.epoch), figure(row)) for row in history if row.phase == phase]
    return Curve(label, tuple((epoch, value) for epoch, value in measured if value is not None))


def _panel(title: str, curves: tuple[Curve, ...]) -> Panel:
    """Return a panel of the curves that have points, over epochs."""
    return Panel(
        title, "epoch", tuple(curve for curve in curves if curve.points), x_log=False, y_log=False
    )


def tensorboard_log(folder: Path) -> Progress:
    """Return a function that writes every epoch's figures into a folder; ``InputError`` without TensorBoard."""
    writer = needed(
        package="torch.utils.tensorboard", extra="tensorboard", where="--tensorboard"
    ).SummaryWriter(str(folder))

    def after_epoch(done: int, expected: int, record: EpochRecord) -> None:
        for name in ("learning_rate", "loss", "validation_loss", "validation_accuracy"):
            if (value := getattr(record, name)) is not None:
                writer.add_scalar(f"{record.phase}/{name}", value, record.epoch)
        writer.flush()

    return after_epoch
