"""File formats in: one frontend a format, each giving a checked Network."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hw_model.io.given import checked
from locsnn_compile.errors import InputError
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import Network

_FORMATS = "Give a checkpoint (.pt) that `locsnn train` wrote, a NIR graph (.nir), or a lava-dl network (.net)."


@checked
def load(
    model: str | Path,
    config: str | Path | None = None,
    dt: float | None = None,
    *,
    reset: str | None = None,
    discretisation: str | None = None,
    kernels: str | None = None,
) -> Network:
    """Read a model file: a checkpoint of ``locsnn train`` or of slayerPytorch, a NIR graph, or a lava-dl network.

    ``.pt`` is a checkpoint, one of slayerPytorch where ``config``, its YAML description, is given; HDF5 files are told
    apart by what they hold. For a NIR graph, ``dt`` is the seconds of a step (1e-4 by convention), ``reset`` what a
    spike does to the potential (``zero``, ``subtract``, ``late-zero`` or ``late-subtract``), ``discretisation``
    ``euler``, ``hold`` or ``exact``. For a slayerPytorch checkpoint of SRMALPHA neurons, ``kernels`` are ``full``, or
    ``cut`` as in its training: in the float reference, for the chip keeps the tails. Other formats say these
    themselves, so giving them is an ``InputError``, like a file that cannot be read or used. Nothing in the file is
    executed.
    """
    path = Path(model)
    network = _load(path, config, dt, reset, discretisation, kernels)
    check_network(network)
    return network


def _load(
    path: Path,
    config: str | Path | None,
    dt: float | None,
    reset: str | None,
    discretisation: str | None,
    kernels: str | None,
) -> Network:
    where = f"model {path.name!r}"
    given = {"config": config, "dt": dt, "reset": reset, "discretisation": discretisation, "kernels": kernels}
    if path.suffix in (".pt", ".pth") and config is not None:
        _refuse({"dt": dt, "reset": reset, "discretisation": discretisation}, where, "a slayerPytorch checkpoint")
        from locsnn_compile.frontends.slayer.to_network import load_slayer

        return load_slayer(path, Path(config), kernels)
    if path.suffix == ".pt":
        _refuse(given, where, "a checkpoint")
        from locsnn_compile.frontends.checkpoint import load_checkpoint

        return load_checkpoint(path)
    if path.suffix not in (".nir", ".net", ".h5", ".hdf5"):
        raise InputError(where, f"files ending in {path.suffix or 'nothing'!r} are not read", fix=_FORMATS)
    from locsnn_compile.frontends.hdf5.read import open_hdf5

    with open_hdf5(path, where) as (root, _):
        held = root.names()
    if "node" in held:
        _refuse({"config": config, "kernels": kernels}, where, "a NIR graph")
        from locsnn_compile.frontends.nir.to_network import load_nir

        return load_nir(path, dt, reset, discretisation)
    if "layer" in held:
        _refuse(given, where, "a lava-dl network")
        from locsnn_compile.frontends.lava_dl.to_network import load_lava_dl

        return load_lava_dl(path)
    raise InputError(where, "it holds neither a NIR graph nor a lava-dl network", fix=_FORMATS)


def _refuse(given: Mapping[str, object], where: str, kind: str) -> None:
    """Refuse options that this kind of file answers itself."""
    for name, value in given.items():
        if value is not None:
            raise InputError(where, f"{name} was given, but {kind} says this itself", fix=f"Leave {name} out.")
