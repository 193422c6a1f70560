"""File formats in: one frontend a format, each giving a checked Network."""

from __future__ import annotations

from pathlib import Path

from locsnn_compile.errors import InputError
from locsnn_compile.network import Network, check_network


def load(model: str | Path) -> Network:
    """Read a model file by its suffix: ``.pt`` is a checkpoint that ``locsnn train`` wrote.

    Nothing in the file is executed. A file that cannot be read or used is an ``InputError``.
    """
    path = Path(model)
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
