"""Epochs of a training run as scalars that TensorBoard shows, where it is installed."""

from pathlib import Path

from locsnn_compile.errors import InputError
from locsnn_compile.training.config import EpochRecord, Progress


def tensorboard_log(folder: Path) -> Progress:
    """Return what writes every epoch's figures into a folder; ``InputError`` without TensorBoard."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        fix = "Install it with pip install 'locsnn-compile[tensorboard]'."
        raise InputError("--tensorboard", "the package tensorboard is not installed", fix=fix) from None
    writer = SummaryWriter(str(folder))

    def after_epoch(done: int, expected: int, record: EpochRecord) -> None:
        for name in ("learning_rate", "loss", "validation_loss", "validation_accuracy"):
            if (value := getattr(record, name)) is not None:
                writer.add_scalar(f"{record.phase}/{name}", value, record.epoch)
        writer.flush()

    return after_epoch
