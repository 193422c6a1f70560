"""From a state dict and the YAML that lists its layers (the *description*) to a Network.

The layers become a NIR graph in memory, which is read like that of a NIR file.
"""

from pathlib import Path
from typing import Any

from hw_model.io.files import read_bytes
from hw_model.io.records import RecordReader
from hw_model.io.yaml_text import load_yaml
from hw_model.values import Frozen
from locsnn_compile.data.tensors import FLOATS
from locsnn_compile.data.torch_file import load_plain
from locsnn_compile.errors import InputError, check_known, check_most
from locsnn_compile.frontends.linear_maps import check_shape
from locsnn_compile.frontends.nir.ends import image_of
from locsnn_compile.frontends.nir.flat import flatten_graph
from locsnn_compile.frontends.nir.to_network import divided_parts
from locsnn_compile.frontends.parts import DEFAULT_STEPS, FileFacts
from locsnn_compile.frontends.state_dict import SAVE_A_STATE_DICT, WHOLE_NUMBERS, state_tensors
from locsnn_compile.frontends.torch_layers.chain import Chain, readings_of
from locsnn_compile.frontends.torch_layers.layers import LAYERS, Layer
from locsnn_compile.frontends.torch_layers.neurons import NEURON_TYPES
from locsnn_compile.network.network import Network

MAX_DESCRIPTION_BYTES = 200_000
"""Largest size of a description; a limit for hostile files, chosen by hand."""
MAX_LAYERS = 1000
"""Largest number of layers of a description; a limit for hostile files, chosen by hand."""
LAYER_TYPES: dict[str, type[Layer]] = {**LAYERS, **NEURON_TYPES}
"""The classes of layers and neurons, by the type that a description states."""
FIX = "Give 'input: [channels, height, width]' and 'layers: {name: {type: ...}, ...}'."


class Description(Frozen):
    """The content of a description: the shape of the input of one step, and the layers by name, in order."""

    input: tuple[int, ...]
    layers: dict[str, Layer]
    step_seconds: float | None = None


def lists_layers(config: Path) -> bool:
    """Return whether a YAML file lists layers.

    A file that cannot be read does not; the format that then takes it raises the error.
    """
    try:
        values = _yaml(config)
    except InputError:
        return False
    return isinstance(values, dict) and "layers" in values


def read_description(config: Path) -> Description:
    """Read a description and check every entry; raise ``InputError`` for other files."""
    where = f"config {config.name!r}"
    reader = RecordReader(where, FIX)
    is_required = {"input": True, "layers": True, "step_seconds": False}
    entries = reader.entries(_yaml(config), "", is_required)
    shape = entries["input"]
    if isinstance(shape, int):
        shape = [shape]
    input_shape = reader.value(tuple[int, ...], shape, "input")
    check_shape(input_shape, f"{where}: input")
    layers = reader.value(dict, entries["layers"], "layers")
    check_most(len(layers), MAX_LAYERS, where, "too many layers", fix="Give a smaller network.")
    if not layers:
        raise InputError(f"{where}: layers", "there are none", fix=FIX)
    layer_of = {str(name): _layer(reader, entry, str(name)) for name, entry in layers.items()}
    seconds = reader.value(float | None, entries.get("step_seconds"), "step_seconds")
    return Description(input_shape, layer_of, seconds)


def _layer(reader: RecordReader, entry: Any, name: str) -> Layer:
    """Return a layer; raise ``InputError`` for an unknown type, and for options that the type does not have."""
    key = f"layers.{name}"
    if not name.isprintable() or "/" in name or len(name) > 200:
        raise InputError(reader.place(key), "its name has a slash or is not text", fix="Rename it.")
    if not isinstance(entry, dict) or "type" not in entry:
        fix = "Write 'name: {type: Linear}'."
        raise InputError(reader.place(key), "it has no type", fix=fix)
    kind = str(entry["type"])
    check_known(reader.place(key), f"{kind[:60]!r} is not read", kind, LAYER_TYPES)
    options = {option: value for option, value in entry.items() if option != "type"}
    return RecordReader(reader.where).record(LAYER_TYPES[kind], options, key)


def load_torch_layers(
    path: Path, config: Path, *, relay_delays: bool = False, host_layers: str | None = None
) -> Network:
    """Read a state dict and its description, and return the network; raise ``InputError`` if they cannot be used."""
    where = f"model {path.name!r}"
    data = read_bytes(path, where)
    description = read_description(config)
    state = load_plain(data, where, fix=SAVE_A_STATE_DICT)
    tensors = state_tensors(state, where, (*FLOATS, *WHOLE_NUMBERS))
    # Layers on the host take numbers.
    takes_spikes = host_layers is None
    chain = Chain(where, tensors, axes=len(description.input), spiking=takes_spikes)
    for name, layer in description.layers.items():
        layer.add_to(chain, name)
    flat = flatten_graph(chain.graph(description.input), where)
    readings = readings_of(chain)
    on_chip, host = divided_parts(flat, readings, where, host_layers, relays=relay_delays)
    facts = FileFacts(
        any_length=True,
        inputs=image_of(flat),
        assumptions=(*chain.assumed, *on_chip.assumed),
    )
    return on_chip.parts.network_of_file(
        path,
        data,
        channels=on_chip.parts.views[0].lines,
        steps=DEFAULT_STEPS,
        step_seconds=description.step_seconds,
        facts=facts if host is None else facts.behind(host),
    )


def _yaml(config: Path) -> object:
    """Return the content of a YAML file."""
    where = f"config {config.name!r}"
    text = read_bytes(config, where, MAX_DESCRIPTION_BYTES, "Give only the YAML.")
    return load_yaml(text, where, "it is not YAML", "Give the network's description.")
