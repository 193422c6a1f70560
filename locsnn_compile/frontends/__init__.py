"""Read networks: one frontend per file format, each of which returns a checked Network."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hw_model.io.given import checked
from locsnn_compile.data.channels import parse_numbering
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.network.check import check_network
from locsnn_compile.network.committee import committee
from locsnn_compile.network.network import Network

_FORMATS = "Give a checkpoint (.pt) that `locsnn train` wrote, a NIR graph (.nir), or a lava-dl network (.net)."

_SLAYER, _CHECKPOINT = "a slayerPytorch checkpoint", "a checkpoint"
_NIR, _LAVA_DL = "a NIR graph", "a lava-dl network"
_OPTIONS = {
    _SLAYER: ("config", "kernels", "branches"),
    _CHECKPOINT: (),
    _NIR: ("dt", "reset", "discretisation", "floor", "relay_delays"),
    _LAVA_DL: ("relay_delays",),
}
"""The options of each kind; files of the other kinds hold these values themselves."""


@checked
def load(
    model: str | Path | Checkpoint,
    config: str | Path | None = None,
    dt: float | None = None,
    *,
    reset: str | None = None,
    discretisation: str | None = None,
    floor: float | None = None,
    kernels: str | None = None,
    branches: str | Mapping[str, Sequence[str]] | None = None,
    channel_order: str | None = None,
    relay_delays: bool | None = None,
) -> Network:
    """Read a model: a checkpoint of ``locsnn train`` or slayerPytorch, a NIR graph, or a lava-dl network.

    A file of ``locsnn pack`` becomes one network of all that it contains. What ``lc.train`` returned needs no file.

    - A ``.pt`` file is a checkpoint. With ``config``, its YAML description, it is one of slayerPytorch.
    - HDF5 files are told apart by their content.
    - NIR graph: ``dt`` is the length of a step in seconds (by convention 1e-4), ``reset`` what a spike does to the
      potential (``zero``, ``subtract``, ``late-zero``, ``late-subtract`` or ``none``), and ``discretisation`` is
      ``euler``, ``hold`` or ``exact``. ``floor`` is the lowest potential of neurons that spike, in the unit of their
      thresholds, like ``min_v_mem`` of sinabs.
    - slayerPytorch checkpoint of SRMALPHA neurons: ``kernels`` of the float reference are ``full``, or ``cut`` as in
      training. The chip always keeps the tails. ``branches`` names the layers that run along ``time`` and
      ``location``, as ``{"location": ["locationFc1", "locationFc2"]}``, or ``time=fc1,fc2,location=...`` in a text.
    - ``relay_delays``: reach delays above 62 steps by neurons that repeat spikes. Without it, lava-dl's delays are cut
      to 62, as its own reader does, and said to be; NIR graphs with such delays do not fit the chip.
    - ``channel_order``: how the inputs are numbered, by rows, columns and polarities: ``yxp`` or ``pyx``, as of images
      (C, H, W). For models that do not say so themselves.

    Other formats hold these values themselves, so giving them is an ``InputError``, as is a file that cannot be read or
    used. Nothing in the file is executed.
    """
    if isinstance(model, Checkpoint):
        path, where, kind = Path(), f"model {model.description.name!r}", _CHECKPOINT
    else:
        path = Path(model)
        where = f"model {path.name!r}"
        kind = _kind(path, where, described=config is not None)
    given = {
        "config": config,
        "dt": dt,
        "reset": reset,
        "discretisation": discretisation,
        "floor": floor,
        "kernels": kernels,
        "branches": branches,
        "relay_delays": relay_delays or None,
    }
    for name, value in given.items():
        if value is not None and name not in _OPTIONS[kind]:
            why = f"{kind} contains this itself"
            if name == "floor":
                why = f"the neurons of {kind} have none"
            raise InputError(where, f"{name} was given, but {why}", fix=f"Leave {name} out.")
    if kind == _SLAYER:
        from locsnn_compile.frontends.slayer.branches import checked_branches, parse_branches
        from locsnn_compile.frontends.slayer.to_network import load_slayer

        assert config is not None  # that makes it a checkpoint of slayerPytorch
        if isinstance(branches, str):
            branches = parse_branches(branches)
        elif branches is not None:
            branches = checked_branches(branches, "branches")
        network = load_slayer(path, Path(config), kernels, branches)
    elif kind == _CHECKPOINT:
        from locsnn_compile.frontends.checkpoint import network_of
        from locsnn_compile.models.checkpoint_reader import read_models

        way_out = "If it is slayerPytorch's, give its YAML (--config FILE.yaml); else export the network as NIR (.nir)."
        held = model if isinstance(model, Checkpoint) else read_models(path, state_dict=way_out)
        if isinstance(held, Checkpoint):
            network = network_of(held)
        else:
            joined = committee(
                [network_of(member) for member in held.members], held.weights, path.stem
            )
            network = replace(joined, sha256=held.sha256)
    elif kind == _NIR:
        from locsnn_compile.frontends.nir.to_network import load_nir

        network = load_nir(path, dt, reset, discretisation, floor, relay_delays=bool(relay_delays))
    else:
        from locsnn_compile.frontends.lava_dl.to_network import load_lava_dl

        network = load_lava_dl(path, relay_delays=bool(relay_delays))
    network = with_channel_order(network, channel_order)
    check_network(network)
    return network


def with_channel_order(network: Network, channel_order: str | None) -> Network:
    """Return the network with the numbering of its inputs that its user states; refuse another than its own."""
    asked = parse_numbering(channel_order)
    if asked is None or asked == network.numbering:
        return network
    if network.numbering is not None:
        measured = f"got {asked} against {network.numbering}"
        what = f"model {network.name!r} has another"
        raise InputError("channel_order", what, measured=measured, fix="Leave it out.")
    return replace(network, channel_order=asked)


def _kind(path: Path, where: str, *, described: bool) -> str:
    """Return the kind of a file, judged by its ending, by whether a description is given, and by its content."""
    if path.suffix in (".pt", ".pth"):
        return _SLAYER if described else _CHECKPOINT
    if path.suffix not in (".nir", ".net", ".h5", ".hdf5"):
        ending = f"ending in {path.suffix!r}" if path.suffix else "without an ending"
        raise InputError(where, f"files {ending} are not read", fix=_FORMATS)
    from locsnn_compile.data.hdf5.read import open_hdf5

    with open_hdf5(path, where) as (root, _):
        kind = next(
            (kind for name, kind in (("node", _NIR), ("layer", _LAVA_DL)) if name in root), None
        )
    if kind is None:
        raise InputError(
            where, "it contains neither a NIR graph nor a lava-dl network", fix=_FORMATS
        )
    return kind
