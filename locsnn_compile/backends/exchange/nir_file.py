"""A network as a NIR file, with its quantised integers in the metadata of the graph.

A network from NIR is written as the graph that it was, node by node and number by number. Others become Input, Linear,
Delay, neuron and Output nodes; behind an Input of an image, (C, H, W), comes a Flatten. Their constants are those whose
usual Euler step is that of the network: a share d lost per step is ``tau = dt / d``, ``r = 1 / d``, and a bias b is
``v_leak = b / d``. Neurons that are read by potential become LI or CubaLI. Spikes of NIR take no step, or one where
they close a loop; a Delay holds what they take more here (:mod:`locsnn_compile.frontends.nir.paths`).

Metadata has dotted keys: ``dt``, the step of the constants, and ``step_seconds``, the width of a bin of recordings,
each if known; for each population ``quantized.<name>.threshold``, ``decay_u``,
``decay_v``, ``bias_mantissa``, ``bias_exponent``, ``refractory`` and ``scale``, with dots for slashes in the name; for
neurons whose spikes lower their own potential, the self-synapses ``refractory.delay``, ``refractory.mantissa`` and
``refractory.exponent``; for the k-th projection ``quantized.projection<k>`` with ``source``, ``target``, ``rows``,
``columns``, ``mantissa``, ``delay``, ``exponent`` and ``weight_bits``.
"""

import io
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import sparse

from locsnn_compile.backends.exchange.floats import HELD, may_spike, neurons_of, weights_of
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir.graph import Array, Edge, NirGraph, NirNode
from locsnn_compile.frontends.nir.neurons import DT_SECONDS
from locsnn_compile.frontends.nir.paths import Paths
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import (
    ChipProjection,
    Projection,
    by_delay,
    connections,
    values_of,
)
from locsnn_compile.network.quantized import QuantizedNetwork

_VERSION = "1.0"


def nir_bytes(quantized: QuantizedNetwork) -> bytes:
    """Return the file; ``InputError`` for neurons that NIR lacks."""
    network = quantized.network
    step_seconds = network.stated_step_seconds
    if isinstance(network.origin, NirGraph):
        graph = network.origin
    else:
        graph = nir_graph(network)
        if step_seconds is not None:
            graph = graph.with_metadata(dt=np.array(step_seconds))
    if step_seconds is not None:
        graph = graph.with_metadata(step_seconds=np.array(step_seconds))
    return graph_bytes(graph.with_metadata(**_integers(quantized)))


def graph_bytes(graph: NirGraph) -> bytes:
    """Return a graph as HDF5, in the layout of ``nir.write``."""
    import h5py

    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file.create_dataset("version", data=_VERSION, dtype=h5py.string_dtype())
        _write_graph(file.create_group("node"), graph)
    return content.getvalue()


def _write_graph(group: Any, graph: NirGraph) -> None:
    import h5py

    group.create_dataset("type", data="NIRGraph", dtype=h5py.string_dtype())
    group.create_dataset(
        "edges", data=np.array(graph.edges, dtype=object).reshape(-1, 2), dtype=h5py.string_dtype()
    )
    nodes = group.create_group("nodes")
    for name, node in graph.nodes.items():
        inside = nodes.create_group(name)
        if isinstance(node, NirGraph):
            _write_graph(inside, node)
        else:
            _write_values(inside, {"type": node.kind, **node.parameters})
    if graph.metadata:
        _write_values(group.create_group("metadata"), graph.metadata)


def _write_values(group: Any, values: Mapping[str, Array | str]) -> None:
    for name, value in values.items():
        group.create_dataset(name, data=value)


def nir_graph(network: Network) -> NirGraph:
    """Return the graph of a network of leaky integrate-and-fire neurons along time."""
    dt = network.stated_step_seconds or DT_SECONDS
    graph = _Graph()
    _add_inputs(graph, network)
    read = network.readout.from_step
    for population in network.populations:
        kind, parameters = _neuron(population, dt, population.name in read)
        graph.name_of[population.name] = graph.add(population.name, kind, parameters)
    paths = _paths(network)
    for number, projection in enumerate(network.projections):
        _add_weights(graph, projection, number, paths, dt)
    for name in network.readout.populations:
        shape = np.array([network.classes])
        output = graph.add(f"{name}.output", "Output", {"shape": shape})
        graph.edges.append((graph.name_of[name], output))
    return NirGraph(graph.nodes, tuple(graph.edges))


class _Graph:
    """The nodes and edges so far; ``name_of`` has the node that stands for each input and population."""

    def __init__(self) -> None:
        self.nodes: dict[str, NirNode | NirGraph] = {}
        self.edges: list[Edge] = []
        self.name_of: dict[str, str] = {}

    def add(self, name: str, kind: str, parameters: Mapping[str, Array | str]) -> str:
        """Add a node, and return its name, which is one that no other node has."""
        # HDF5 would read a slash as a group.
        name = name.replace("/", ".")
        while name in self.nodes:
            name += "_"
        self.nodes[name] = NirNode(kind, parameters)
        return name


def _add_inputs(graph: _Graph, network: Network) -> None:
    """Add one Input for all inputs: they play the same recording, and a reader would put several side by side."""
    views = [view for view in network.views if view.axis == "time"]
    if not views:
        return
    image = _image_shape(network)
    shape = (views[0].lines,) if image is None else image
    node = graph.add(views[0].name, "Input", {"shape": np.array(shape)})
    if image is not None:
        flat = graph.add(f"{views[0].name}.flat", "Flatten", _flattening(image))
        graph.edges.append((node, flat))
        node = flat
    for view in views:
        graph.name_of[view.name] = node


def _paths(network: Network) -> Paths:
    """Return how deep a reader will place populations, made less where delays of the network are too short for it."""
    pairs = ((p.source, p.target) for p in network.projections)
    inputs = [view.name for view in network.views]
    paths = Paths(pairs, inputs, [p.name for p in network.populations])
    depths_when_read = dict(paths.depths)
    delays = [
        (p.source, p.target, delay)
        for p in network.projections
        for delay in np.unique(p.delay).tolist()
    ]
    paths.fit(delays)
    _check_readout(network, depths_when_read, paths.depths)
    return paths


def _add_weights(
    graph: _Graph, projection: Projection | ChipProjection, number: int, paths: Paths, dt: float
) -> None:
    """Add a Linear node for each delay of a projection, behind a Delay node where a reader adds less by itself."""
    weights, factor = weights_of(projection)
    late = paths.late(projection.source, projection.target)
    has_one_delay = np.size(projection.delay) == 1
    for delay, part in by_delay(weights, projection.delay) or [(late, weights)]:
        name = f"weights{number}" if has_one_delay else f"weights{number}.{delay}"
        dense = (part.toarray() if sparse.issparse(part) else part) * factor
        chain = [graph.name_of[projection.source]]
        linear = graph.add(name, "Linear", {"weight": dense})
        if delay > late:
            seconds = np.full(dense.shape[1], (delay - late) * dt)
            chain.append(graph.add(f"{name}.delay", "Delay", {"delay": seconds}))
        chain += [linear, graph.name_of[projection.target]]
        graph.edges += itertools.pairwise(chain)


def _image_shape(network: Network) -> tuple[int, int, int] | None:
    """Return the shape (C, H, W) of inputs that are numbered as images are; None for others."""
    pixels = network.known_inputs
    if pixels is None or pixels.numbering != "pyx" or pixels.pixels == 1:
        return None
    return pixels.polarities, pixels.rows, pixels.columns


def _flattening(image: tuple[int, int, int]) -> dict[str, Array | str]:
    """Return the parameters of a node that flattens an image; NIR counts no axis of a batch."""
    return {"input_type": np.array(image), "start_dim": np.array(0), "end_dim": np.array(-1)}


def _check_readout(
    network: Network, depths_when_read: Mapping[str, int], depths: Mapping[str, int]
) -> None:
    """Refuse a readout by potentials that a reader would take for another one.

    Readers count potentials from the last of the ``depths_when_read``, after which inputs reach them; here inputs
    arrive after ``depths``.
    """
    readout = network.readout
    from_steps = readout.from_step
    where = "--emit nir, readout"
    if 0 < len(from_steps) < len(readout.populations):
        raise InputError(where, "NIR cannot add spikes and potentials", fix=HELD)
    deepest = max((depths_when_read[name] for name in from_steps), default=0)
    for name, from_step in from_steps.items():
        late = depths_when_read[name] - depths[name]
        if from_step + late != deepest:
            what = f"NIR counts potentials of {name!r} from another step"
            measured = f"{deepest - late} against {from_step}"
            raise InputError(where, what, measured=measured, fix=HELD)
        neuron = next(p.neuron for p in network.populations if p.name == name)
        if neuron.biased.any() or (
            isinstance(neuron, Cuba | ChipCuba) and may_spike(neuron, network.into(name))
        ):
            what = "neurons that NIR reads by potential have no biases and never spike"
            raise InputError(f"--emit nir, population {name!r}", what, fix=HELD)
        if any(p.source == name for p in network.projections):
            what = "NIR sends no spikes on from neurons that it reads by potential"
            raise InputError(f"--emit nir, population {name!r}", what, fix=HELD)


def _neuron(population: Population, dt: float, read: bool) -> tuple[str, dict[str, Array | str]]:
    """Return the kind of a population's node, and its parameters; ``read``: its potentials are read out."""
    where, neuron = f"--emit nir, population {population.name!r}", population.neuron
    if not isinstance(neuron, Cuba | ChipCuba):
        raise InputError(where, "NIR has no neuron without reset", fix="Emit another kind.")
    u, v, threshold, bias = neurons_of(neuron)
    if population.axis != "time":
        raise InputError(where, "NIR has no steps along locations", fix="Emit another kind.")
    if (neuron.refractory > 1).any():
        raise InputError(where, "NIR has no refractory period", fix="Emit another kind.")
    if (u <= 0).any() or (
        (v <= 0).any() and (read or (v > 0).any() or (u < 1).any() or bias.any())
    ):
        raise InputError(
            where, "a state that never decays has no time constant", fix="Emit another kind."
        )
    zero = np.zeros(population.size)
    if not v.any():
        return "IF", {"r": zero + 1 / dt, "v_threshold": threshold, "v_reset": zero}
    fires = {} if read else {"v_threshold": threshold, "v_reset": zero}
    common, suffix = {"r": 1 / v, "v_leak": bias / v, **fires}, "LI" if read else "LIF"
    if (u == 1).all():
        return suffix, {"tau": dt / v, **common}
    return f"Cuba{suffix}", {"tau_syn": dt / u, "tau_mem": dt / v, "w_in": 1 / u, **common}


def _integers(quantized: QuantizedNetwork) -> dict[str, Array | str]:
    """Return the integers of the quantised network as metadata."""
    metadata: dict[str, Array | str] = {}
    for q in quantized.populations:
        # HDF5 would read a slash as a group.
        name = q.population.name.replace("/", ".")
        metadata[f"quantized.{name}.scale"] = np.asarray(q.scale)
        numbers = dict(vars(q.neuron))
        if isinstance(q.neuron, ChipSrm):
            of_taps = {
                key: value for key, value in vars(q.neuron.refractory).items() if value is not None
            }
            numbers |= {f"refractory.{key}": np.asarray(value) for key, value in of_taps.items()}
        for key, values in numbers.items():
            if isinstance(values, np.ndarray):
                metadata[f"quantized.{name}.{key}"] = values
    for k, p in enumerate(quantized.projections):
        target, source, index = connections(p.mantissa)
        entries: dict[str, Array | str] = {
            "source": p.source,
            "target": p.target,
            "rows": target,
            "columns": source,
            "mantissa": values_of(p.mantissa).ravel()[index],
            "delay": np.broadcast_to(p.delay, values_of(p.mantissa).shape).ravel()[index],
            "exponent": np.array(p.exponent),
            "weight_bits": np.array(p.weight_bits),
        }
        metadata |= {f"quantized.projection{k}.{key}": value for key, value in entries.items()}
    return metadata
