"""The table of model formats: one row for each. To add a format, write its reader and its row.

Formats can share an ending, so each row has a function that recognises its files. A row imports its reader only when a
file is read, so that help does not wait for it.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from locsnn_compile.errors import InputError, listed
from locsnn_compile.frontends.format_rows import FormatOption, ModelFormat, ModelSource

if TYPE_CHECKING:
    from locsnn_compile.network.network import Network


def _is_described(source: ModelSource) -> bool:
    """Return whether a YAML description was given."""
    return source.options.config is not None


def _lists_layers(source: ModelSource) -> bool:
    """Return whether a YAML description was given that lists the layers of a state dict."""
    from locsnn_compile.frontends.torch_layers.to_network import lists_layers

    config = source.options.config
    return config is not None and lists_layers(Path(config))


def _is_undescribed(source: ModelSource) -> bool:
    """Return whether no YAML description was given."""
    return source.options.config is None


def _has_nodes(source: ModelSource) -> bool:
    """Return whether an HDF5 file has the root entry of a NIR graph."""
    return "node" in source.hdf5_entries


def _has_layers(source: ModelSource) -> bool:
    """Return whether an HDF5 file has the root entry of a lava-dl network."""
    return "layer" in source.hdf5_entries


def _read_checkpoint(source: ModelSource) -> "Network":
    from locsnn_compile.frontends.checkpoint import network_of_models
    from locsnn_compile.models.checkpoint_reader import read_models

    # The caller may pass a checkpoint that is in memory already, instead of a file.
    if source.checkpoint is not None:
        return network_of_models(source.checkpoint, source.path.stem)
    # What the error advises if the file is a bare state dict of torch, which has the same ending.
    advice = (
        "If it is slayerPytorch's, give its YAML (--config FILE.yaml); "
        "else export the network as NIR (.nir)."
    )
    models = read_models(source.path, state_dict=advice)
    return network_of_models(models, source.path.stem)


def _read_slayer(source: ModelSource) -> "Network":
    from locsnn_compile.frontends.slayer.branches import checked_branches, parse_branches
    from locsnn_compile.frontends.slayer.to_network import load_slayer

    options = source.options
    assert options.config is not None  # _is_described
    branches = None
    if isinstance(options.branches, str):
        branches = parse_branches(options.branches)
    elif options.branches is not None:
        branches = checked_branches(options.branches, "branches")
    return load_slayer(source.path, Path(options.config), options.kernels, branches)


def _read_torch_layers(source: ModelSource) -> "Network":
    from locsnn_compile.frontends.torch_layers.to_network import load_torch_layers

    options = source.options
    assert options.config is not None  # _lists_layers
    return load_torch_layers(
        source.path,
        Path(options.config),
        relay_delays=bool(options.relay_delays),
        host_layers=options.host_layers,
    )


def _read_nir(source: ModelSource) -> "Network":
    from locsnn_compile.frontends.nir.to_network import load_nir

    options = source.options
    return load_nir(
        source.path,
        options.dt,
        options.reset,
        options.discretisation,
        options.floor,
        relay_delays=bool(options.relay_delays),
        host_layers=options.host_layers,
    )


def _read_lava_dl(source: ModelSource) -> "Network":
    from locsnn_compile.frontends.lava_dl.to_network import load_lava_dl

    options = source.options
    return load_lava_dl(
        source.path, relay_delays=bool(options.relay_delays), host_layers=options.host_layers
    )


FORMAT_OPTIONS = (
    FormatOption(
        "config",
        "YAML file: the layers of a state dict, or the network of a slayerPytorch checkpoint",
        "FILE",
    ),
    FormatOption(
        "dt",
        "NIR: the step of the graph's constants in seconds, never the width of a bin "
        "(default 1e-4, the convention)",
        "SECONDS",
        is_number=True,
    ),
    # What a spike does to the potential: set it to the reset value, subtract the threshold, or nothing. The late ones
    # also act in the step after the spike (docs/reference/formats/nir.md).
    FormatOption(
        "reset",
        "NIR: zero (default), subtract, late-zero, late-subtract or none at a spike",
        "NAME",
    ),
    FormatOption(
        "discretisation", "NIR: how equations become steps: euler (default), hold or exact", "NAME"
    ),
    FormatOption(
        "floor",
        "NIR: potentials of neurons that spike never fall below VALUE, such as -1 "
        "(default: no floor)",
        "VALUE",
        is_number=True,
        elsewhere="the neurons of {called} have none",
    ),
    # 62 steps is the longest delay of a synapse on loihi-sim (hw_model/arithmetic/loihi.py).
    FormatOption(
        "relay_delays",
        "NIR, lava-dl, state dict: neurons that repeat spikes carry delays above 62 steps",
    ),
    FormatOption(
        "host_layers",
        "NIR, lava-dl, state dict: the first N layers of neurons, or those named, run on the host "
        "and send spikes: recordings are arrays of numbers",
        "N|NAME,...",
        elsewhere="{called} takes spikes",
    ),
    FormatOption(
        "kernels",
        "slayerPytorch: full (default), or cut: the float reference cuts kernels off, "
        "as training did",
        "NAME",
    ),
    FormatOption(
        "branches",
        "slayerPytorch: the layers that run, such as "
        "time=fc1,fc2,location=locationFc1,locationFc2 (default: all)",
        "BRANCH=LAYER,...",
    ),
)
"""The options that only some formats take, in the order of the help."""
HDF5 = (".h5", ".hdf5")
"""The general endings of HDF5 files, which NIR and lava-dl both use."""
CHECKPOINT = ModelFormat(
    called="a checkpoint",
    helped="checkpoint (.pt) of `locsnn train`",
    offered="a checkpoint (.pt) that `locsnn train` wrote",
    suffixes=(".pt", ".pth"),
    recognises=_is_undescribed,
    read=_read_checkpoint,
)
MODEL_FORMATS = (
    CHECKPOINT,
    ModelFormat(
        called="a NIR graph",
        helped="NIR graph (.nir)",
        offered="a NIR graph (.nir)",
        suffixes=(".nir", ".net", *HDF5),
        recognises=_has_nodes,
        read=_read_nir,
        options=("dt", "reset", "discretisation", "floor", "relay_delays", "host_layers"),
    ),
    ModelFormat(
        called="a lava-dl network",
        helped="lava-dl network (.net)",
        offered="a lava-dl network (.net)",
        suffixes=(".net", ".nir", *HDF5),
        recognises=_has_layers,
        read=_read_lava_dl,
        options=("relay_delays", "host_layers"),
    ),
    ModelFormat(
        called="a state dict with its layers",
        # The words of the next row include this format.
        helped="",
        # Errors advise only formats of a single file; this one and the next need a YAML file as well.
        offered="",
        suffixes=(".pt", ".pth"),
        recognises=_lists_layers,
        read=_read_torch_layers,
        options=("config", "relay_delays", "host_layers"),
    ),
    ModelFormat(
        called="a slayerPytorch checkpoint",
        helped="with --config, a state dict of torch or slayerPytorch",
        offered="",
        suffixes=(".pt", ".pth"),
        recognises=_is_described,
        read=_read_slayer,
        options=("config", "kernels", "branches"),
    ),
)
"""In the order of the help. Files are given to the first row that recognises them, so a state dict with layers, which
also has a description, comes before a slayerPytorch checkpoint."""


def models_in_words() -> str:
    """Return the list of model files that ``--help`` shows."""
    *formats, last = (row.helped for row in MODEL_FORMATS if row.helped)
    return f"{', '.join(formats)} or, {last}"


def format_of(source: ModelSource) -> ModelFormat:
    """Return the format of a model; raise ``InputError`` for files of no format."""
    suffix = source.path.suffix
    if source.checkpoint is not None:
        return CHECKPOINT
    candidates = [row for row in MODEL_FORMATS if suffix in row.suffixes]
    if not candidates:
        ending = f"ending in {suffix!r}" if suffix else "without an ending"
        raise InputError(source.where, f"files {ending} are not read", fix=_ways_out())
    for row in candidates:
        if row.recognises(source):
            return row
    neither = listed([row.called for row in candidates], "nor")
    raise InputError(source.where, f"it contains neither {neither}", fix=_ways_out())


def check_options(row: ModelFormat, source: ModelSource) -> None:
    """Raise ``InputError`` for an option that a format does not take."""
    given = source.options.given
    for option in FORMAT_OPTIONS:
        if option.name in given and option.name not in row.options:
            why = option.elsewhere.format(called=row.called)
            what = f"{option.name} was given, but {why}"
            raise InputError(source.where, what, fix=f"Leave {option.name} out.")


def _ways_out() -> str:
    """Return the advice of errors: the files that can be given."""
    *formats, last = (row.offered for row in MODEL_FORMATS if row.offered)
    return f"Give {', '.join(formats)}, or {last}."
