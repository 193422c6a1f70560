"""File formats in: one frontend a format, each giving a checked Network."""

from __future__ import annotations

from pathlib import Path

from locsnn_compile.check_network import check_network
from locsnn_compile.errors import InputError
from locsnn_compile.network import Network


def load(model: str | Path, config: str | Path | None = None, dt: float | None = None) -> Network:
    """Read a model file by its suffix: ``.pt`` is a checkpoint that ``locsnn train`` wrote.

    ``config`` (a network description beside the model) and ``dt`` (seconds a step) are for formats that do not hold
    these themselves; a checkpoint does, so giving them is an ``InputError``, like a file that cannot be read or used.
    Nothing in the file is executed.
    """
    path = Path(model)
    for name, given in (("config", config), ("dt", dt)):
        if given is not None:
            raise InputError(
                f"model {path.name!r}", f"{name} was given, but a checkpoint says this itself", fix=f"Leave {name} out."
            )
    if path.suffix != ".pt":
        raise InputError(
            f"model {path.name!r}",
            f"files ending in {path.suffix or 'nothing'!r} are not read",
            fix="Give a checkpoint (.pt) that `locsnn train` wrote.",
        )
    from locsnn_compile.frontends.checkpoint import load_checkpoint

    network = load_checkpoint(path)
    check_network(network)
    return network
