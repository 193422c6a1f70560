"""Write a network as a NIR file, with its rounded integers in the metadata of the graph.

NIR (Neuromorphic Intermediate Representation) is a format in which frameworks exchange spiking networks: a graph of
nodes with differential equations, stored as HDF5. A network that came from NIR is written as the graph that it was,
node by node and number by number. Any other becomes Input, Linear, Delay, neuron and Output nodes; behind an Input of
an image, (C, H, W), comes a Flatten.

The constants of a neuron are chosen so that the usual Euler step of its equation is the step of the network: with a
share d lost per step, ``tau = dt / d`` and ``r = 1 / d``, and a bias b gives ``v_leak = b / d``. Neurons that are read
by potential become LI or CubaLI, which never spike. In NIR, spikes take no step from node to node, or one step where
they close a loop; a Delay holds the steps that they take longer here (:mod:`locsnn_compile.frontends.nir.paths`).

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
"""The version of the format, as ``nir.write`` has it."""


def nir_bytes(quantized: QuantizedNetwork) -> bytes:
    """Return the content of the file. Raise InputError for what NIR does not have."""
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
    # A heavy import that only this emitter needs.
    import h5py

    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        file.create_dataset("version", data=_VERSION, dtype=h5py.string_dtype())
        _write_graph(file.create_group("node"), graph)
    return content.getvalue()


def _write_graph(group: Any, graph: NirGraph) -> None:
    """Write a graph into a group of an HDF5 file; a node may be a graph itself."""
    import h5py

    group.create_dataset("type", data="NIRGraph", dtype=h5py.string_dtype())
    # The shape also holds for a graph without edges.
    edges = np.array(graph.edges, dtype=object).reshape(-1, 2)
    group.create_dataset("edges", data=edges, dtype=h5py.string_dtype())
    nodes = group.create_group("nodes")
    for name, node in graph.nodes.items():
        node_group = nodes.create_group(name)
        if isinstance(node, NirGraph):
            _write_graph(node_group, node)
        else:
            _write_values(node_group, {"type": node.kind, **node.parameters})
    if graph.metadata:
        _write_values(group.create_group("metadata"), graph.metadata)


def _write_values(group: Any, values: Mapping[str, Array | str]) -> None:
    for name, value in values.items():
        group.create_dataset(name, data=value)


def nir_graph(network: Network) -> NirGraph:
    """Return the graph of a network of leaky integrate-and-fire neurons along time."""
    # Time constants need a step even where its length is unknown; readers of the file divide by the same step.
    dt = network.stated_step_seconds or DT_SECONDS
    graph = _Graph()
    _add_inputs(graph, network)
    by_potential = network.readout.from_step
    for population in network.populations:
        kind, parameters = _neuron(population, dt, is_read=population.name in by_potential)
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
    """A graph that is being built; ``name_of`` has the node of each input and population of the network."""

    def __init__(self) -> None:
        self.nodes: dict[str, NirNode | NirGraph] = {}
        self.edges: list[Edge] = []
        self.name_of: dict[str, str] = {}

    def add(self, name: str, kind: str, parameters: Mapping[str, Array | str]) -> str:
        """Add a node, and return its name, which may differ from ``name`` to be unique."""
        # HDF5 would read a slash as a group.
        name = name.replace("/", ".")
        while name in self.nodes:
            name += "_"
        self.nodes[name] = NirNode(kind, parameters)
        return name


def _add_inputs(graph: _Graph, network: Network) -> None:
    """Add one Input node for all inputs of the network.

    They all play the same recording. A reader would take several Input nodes for inputs side by side.
    """
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
    """Return how many steps after the input a reader of the file will place each population (its depth).

    Depths are made less where delays of the network are too short for them.
    """
    pairs = ((projection.source, projection.target) for projection in network.projections)
    inputs = [view.name for view in network.views]
    paths = Paths(pairs, inputs, [population.name for population in network.populations])
    # Copied, because ``fit`` changes the depths.
    depths_when_read = dict(paths.depths)
    delays = [
        (projection.source, projection.target, delay)
        for projection in network.projections
        for delay in np.unique(projection.delay).tolist()
    ]
    paths.fit(delays)
    _check_readout(network, depths_when_read, paths.depths)
    return paths


def _add_weights(
    graph: _Graph, projection: Projection | ChipProjection, number: int, paths: Paths, dt: float
) -> None:
    """Add a Linear node for each delay of a projection, behind a Delay node where a reader adds less delay by itself.

    ``dt`` is the length of a step in seconds.
    """
    weights, factor = weights_of(projection)
    reader_delay = paths.late(projection.source, projection.target)
    has_one_delay = np.size(projection.delay) == 1
    # A projection without any weight has no delays, but is still an edge.
    for delay, delayed_weights in by_delay(weights, projection.delay) or [(reader_delay, weights)]:
        name = f"weights{number}" if has_one_delay else f"weights{number}.{delay}"
        if sparse.issparse(delayed_weights):
            delayed_weights = delayed_weights.toarray()
        dense = delayed_weights * factor
        chain = [graph.name_of[projection.source]]
        linear = graph.add(name, "Linear", {"weight": dense})
        if delay > reader_delay:
            seconds = np.full(dense.shape[1], (delay - reader_delay) * dt)
            chain.append(graph.add(f"{name}.delay", "Delay", {"delay": seconds}))
        chain += [linear, graph.name_of[projection.target]]
        graph.edges += itertools.pairwise(chain)


def _image_shape(network: Network) -> tuple[int, int, int] | None:
    """Return the shape (C, H, W) of inputs that are numbered like the pixels of an image; None for others."""
    # pyx: numbered by polarity (the channel of the image), then row, then column.
    pixels = network.known_inputs
    if pixels is None or pixels.numbering != "pyx" or pixels.pixels == 1:
        return None
    return pixels.polarities, pixels.rows, pixels.columns


def _flattening(image: tuple[int, int, int]) -> dict[str, Array | str]:
    """Return the parameters of a node that flattens an image; NIR does not count an axis for the batch."""
    return {"input_type": np.array(image), "start_dim": np.array(0), "end_dim": np.array(-1)}


def _check_readout(
    network: Network, depths_when_read: Mapping[str, int], depths: Mapping[str, int]
) -> None:
    """Raise InputError for a readout by potentials that a reader of the file would take for another one.

    A reader counts potentials from the largest of ``depths_when_read`` among the populations that are read out: the
    step in which an input can reach all of them. With the delays of this network, inputs arrive after ``depths``.
    """
    readout = network.readout
    from_steps = readout.from_step
    where = "--emit nir, readout"
    if 0 < len(from_steps) < len(readout.populations):
        raise InputError(where, "NIR cannot add spikes and potentials", fix=HELD)
    deepest = max((depths_when_read[name] for name in from_steps), default=0)
    for name, from_step in from_steps.items():
        steps_earlier = depths_when_read[name] - depths[name]
        if from_step + steps_earlier != deepest:
            what = f"NIR counts potentials of {name!r} from another step"
            measured = f"{deepest - steps_earlier} against {from_step}"
            raise InputError(where, what, measured=measured, fix=HELD)
        neuron = next(
            population.neuron for population in network.populations if population.name == name
        )
        if neuron.biased.any() or (
            isinstance(neuron, Cuba | ChipCuba) and may_spike(neuron, network.into(name))
        ):
            what = "neurons that NIR reads by potential have no biases and never spike"
            raise InputError(f"--emit nir, population {name!r}", what, fix=HELD)
        if any(projection.source == name for projection in network.projections):
            what = "NIR sends no spikes on from neurons that it reads by potential"
            raise InputError(f"--emit nir, population {name!r}", what, fix=HELD)


def _neuron(
    population: Population, dt: float, *, is_read: bool
) -> tuple[str, dict[str, Array | str]]:
    """Return the kind and the parameters of a population's node.

    ``dt`` is the length of a step in seconds, and ``is_read`` whether its potentials are read out. Raise InputError for
    neurons that NIR does not have.
    """
    where = f"--emit nir, population {population.name!r}"
    neuron = population.neuron
    if not isinstance(neuron, Cuba | ChipCuba):
        raise InputError(where, "NIR has no neuron without reset", fix="Emit another kind.")
    decay_u, decay_v, threshold, bias = neurons_of(neuron)
    if population.axis != "time":
        raise InputError(where, "NIR has no steps along locations", fix="Emit another kind.")
    if (neuron.refractory > 1).any():
        raise InputError(where, "NIR has no refractory period", fix="Emit another kind.")
    # A v that never decays is possible only in an IF node, which has neither a current nor a leak, and always spikes.
    is_plain_if = (
        not is_read and not (decay_v > 0).any() and not (decay_u < 1).any() and not bias.any()
    )
    if (decay_u <= 0).any() or ((decay_v <= 0).any() and not is_plain_if):
        raise InputError(
            where, "a state that never decays has no time constant", fix="Emit another kind."
        )
    zero = np.zeros(population.size)
    if not decay_v.any():
        return "IF", {"r": zero + 1 / dt, "v_threshold": threshold, "v_reset": zero}
    parameters: dict[str, Array | str] = {"r": 1 / decay_v, "v_leak": bias / decay_v}
    kind = "LI"
    if not is_read:
        kind = "LIF"
        parameters |= {"v_threshold": threshold, "v_reset": zero}
    # A current that decays at once is the charge of the step, and needs no state.
    if (decay_u == 1).all():
        return kind, {"tau": dt / decay_v, **parameters}
    return f"Cuba{kind}", {
        "tau_syn": dt / decay_u,
        "tau_mem": dt / decay_v,
        "w_in": 1 / decay_u,
        **parameters,
    }


def _integers(quantized: QuantizedNetwork) -> dict[str, Array | str]:
    """Return the integers of the rounded network as metadata, by the keys that the module's docstring lists."""
    metadata: dict[str, Array | str] = {}
    for q in quantized.populations:
        # HDF5 would read a slash as a group.
        name = q.population.name.replace("/", ".")
        metadata[f"quantized.{name}.scale"] = np.asarray(q.scale)
        numbers = dict(vars(q.neuron))
        if isinstance(q.neuron, ChipSrm):
            for key, value in vars(q.neuron.refractory).items():
                if value is not None:
                    numbers[f"refractory.{key}"] = np.asarray(value)
        for key, values in numbers.items():
            if isinstance(values, np.ndarray):
                metadata[f"quantized.{name}.{key}"] = values
    for k, projection in enumerate(quantized.projections):
        target, source, index = connections(projection.mantissa)
        mantissas = values_of(projection.mantissa)
        delays = np.broadcast_to(projection.delay, mantissas.shape)
        entries: dict[str, Array | str] = {
            "source": projection.source,
            "target": projection.target,
            "rows": target,
            "columns": source,
            "mantissa": mantissas.ravel()[index],
            "delay": delays.ravel()[index],
            "exponent": np.array(projection.exponent),
            "weight_bits": np.array(projection.weight_bits),
        }
        metadata |= {f"quantized.projection{k}.{key}": value for key, value in entries.items()}
    return metadata
