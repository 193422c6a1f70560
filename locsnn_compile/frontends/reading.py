"""Read a model file of any format in :mod:`locsnn_compile.frontends.formats` as a checked Network."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hw_model.io.arguments import checked
from locsnn_compile.data.channels import parse_numbering
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.format_rows import LoadOptions, ModelSource
from locsnn_compile.frontends.formats import check_options, format_of
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import Network


@checked
def load(  # noqa: PLR0913 - public: each is an option of its own
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
    host_layers: str | int | None = None,
) -> Network:
    """Read a model: a checkpoint of ``locsnn train`` or slayerPytorch, a state dict, a NIR graph or a lava-dl network.

    A file of ``locsnn pack`` becomes one network of all that it contains. What ``lc.train`` returned needs no file.

    - A ``.pt`` file is a checkpoint. With ``config``, its YAML description, it is a state dict whose layers the
      description lists, or a checkpoint of slayerPytorch.
    - HDF5 files are told apart by their content.
    - NIR graph: ``dt`` is the length of a step in seconds (by convention 1e-4), ``reset`` what a spike does to the
      potential (``zero``, ``subtract``, ``late-zero``, ``late-subtract`` or ``none``), and ``discretisation`` is
      ``euler``, ``hold`` or ``exact``. ``floor`` is the lowest potential of neurons that spike, in the unit of their
      thresholds, like ``min_v_mem`` of sinabs.
    - slayerPytorch checkpoint of SRMALPHA neurons: ``kernels`` of the float reference are ``full``, or ``cut`` as in
      training. The chip always keeps the tails. ``branches`` names the layers that run along ``time`` and
      ``location``, as ``{"location": ["locationFc1", "locationFc2"]}``, or ``time=fc1,fc2,location=...`` in a text.
    - ``relay_delays``: reach delays above 62 steps by neurons that repeat spikes. Without it, lava-dl's delays are cut
      to 62, as its own reader does, which is listed as an assumption; NIR graphs with such delays do not fit the chip.
    - ``host_layers``: how many of the first layers of neurons run on the host, or the names of such layers, separated
      by commas, on arrays of numbers. The network is then the rest, and its ``host`` the layers.
    - ``channel_order``: how the inputs are numbered, by rows, columns and polarities: ``yxp`` or ``pyx``, as of images
      (C, H, W). For models that do not state it themselves.

    Other formats contain these values themselves. Raises ``InputError`` for an option that the format does not take,
    and for a file that cannot be read or used. Nothing in the file is executed.
    """
    options = LoadOptions(
        config=config,
        dt=dt,
        reset=reset,
        discretisation=discretisation,
        floor=floor,
        kernels=kernels,
        branches=branches,
        channel_order=channel_order,
        relay_delays=relay_delays,
        host_layers=None if host_layers is None else str(host_layers),
    )
    if isinstance(model, Checkpoint):
        source = ModelSource(Path(), options, model)
    else:
        source = ModelSource(Path(model), options)
    model_format = format_of(source)
    check_options(model_format, source)
    network = with_channel_order(model_format.read(source), channel_order)
    check_network(network)
    return network


def with_channel_order(network: Network, channel_order: str | None) -> Network:
    """Return the network with the numbering of its inputs that its user states.

    Raises ``InputError`` if the network has another numbering.
    """
    numbering = parse_numbering(channel_order)
    if numbering is None or numbering == network.numbering:
        return network
    if network.numbering is not None:
        measured = f"got {numbering} against {network.numbering}"
        what = f"model {network.name!r} has another"
        raise InputError("channel_order", what, measured=measured, fix="Leave it out.")
    return replace(network, channel_order=numbering)
