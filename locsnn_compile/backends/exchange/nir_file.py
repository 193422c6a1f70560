"""A network as a NIR file, with its quantised integers in the metadata of the graph.

A network from NIR is written as the graph that it was, node by node and number by number. Others become Input, Linear,
Delay, neuron and Output nodes, with constants whose usual Euler step is that of the network: a share d lost per step
is ``tau = dt / d``, ``r = 1 / d``, and a bias b is ``v_leak = b / d``. Spikes of NIR take no step, or one where they
close a loop; a Delay holds what they take more here (:mod:`locsnn_compile.frontends.nir.paths`).

Metadata has dotted keys: ``dt``, if known; for each population ``quantized.<name>.threshold``, ``decay_u``,
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

from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir.graph import Array, Edge, NirGraph, NirNode
from locsnn_compile.frontends.nir.neurons import DT_SECONDS
from locsnn_compile.frontends.nir.paths import Paths
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import ChipProjection, Matrix, Projection, by_delay, connections, values_of
from locsnn_compile.network.quantized import QuantizedNetwork

_VERSION = "1.0"


def nir_bytes(quantized: QuantizedNetwork) -> bytes:
    """Return the file; ``InputError`` for neurons that NIR lacks."""
    network = quantized.network
    graph = network.origin if isinstance(network.origin, NirGraph) else nir_graph(network)
    step = {} if network.step_seconds is None else {"dt": np.array(network.step_seconds)}
    metadata = {**graph.metadata, **step, **_integers(quantized)}
    return graph_bytes(NirGraph(graph.nodes, graph.edges, metadata))


def graph_bytes(graph: NirGraph) -> bytes:
    """Return a graph as HDF5, in the layout of ``nir.write``."""
    import h5py

    held = io.BytesIO()
    with h5py.File(held, "w") as file:
        file.create_dataset("version", data=_VERSION, dtype=h5py.string_dtype())
        _write_graph(file.create_group("node"), graph)
    return held.getvalue()


def _write_graph(group: Any, graph: NirGraph) -> None:
    import h5py

    group.create_dataset("type", data="NIRGraph", dtype=h5py.string_dtype())
    group.create_dataset("edges", data=np.array(graph.edges, dtype=object).reshape(-1, 2), dtype=h5py.string_dtype())
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
    dt = network.step_seconds or DT_SECONDS
    nodes: dict[str, NirNode | NirGraph] = {}
    edges: list[Edge] = []
    called: dict[str, str] = {}

    def add(name: str, kind: str, parameters: Mapping[str, Array | str]) -> str:
        # HDF5 would read a slash as a group.
        name = name.replace("/", ".")
        while name in nodes:
            name += "_"
        nodes[name] = NirNode(kind, parameters)
        return name

    for view in network.views:
        called[view.name] = add(view.name, "Input", {"shape": np.array([view.lines])})
    for population in network.populations:
        called[population.name] = add(population.name, *_neuron(population, dt))
    pairs = ((p.source, p.target) for p in network.projections)
    paths = Paths(pairs, [view.name for view in network.views], [p.name for p in network.populations])
    paths.fit([(p.source, p.target, delay) for p in network.projections for delay in np.unique(p.delay).tolist()])
    for k, projection in enumerate(network.projections):
        weights, factor = _weights(projection)
        late = paths.late(projection.source, projection.target)
        for delay, part in by_delay(weights, projection.delay) or [(late, weights)]:
            name = f"weights{k}" if np.size(projection.delay) == 1 else f"weights{k}.{delay}"
            dense = (part.toarray() if sparse.issparse(part) else part) * factor
            ways = [called[projection.source], add(name, "Linear", {"weight": dense}), called[projection.target]]
            if delay > late:
                held = np.full(dense.shape[1], (delay - late) * dt)
                ways.insert(1, add(f"{name}.delay", "Delay", {"delay": held}))
            edges += itertools.pairwise(ways)
    for name in network.readout.populations:
        edges.append((called[name], add(f"{name}.output", "Output", {"shape": np.array([network.classes])})))
    return NirGraph(nodes, tuple(edges))


def _weights(projection: Projection | ChipProjection) -> tuple[Matrix, float]:
    """Return weights and the factor that they stand for."""
    if isinstance(projection, ChipProjection):
        return projection.mantissa, 64.0 * 2.0**projection.exponent
    return projection.weights, 1.0


def _neuron(population: Population, dt: float) -> tuple[str, dict[str, Array | str]]:
    """Return the kind of a population's node, and its parameters."""
    where, neuron = f"--emit nir, population {population.name!r}", population.neuron
    if isinstance(neuron, ChipCuba):
        scale = 1 / 4096
        u, v = neuron.decay_u * scale, neuron.decay_v * scale
        threshold, bias = 64.0 * neuron.threshold, neuron.bias_mantissa * 2.0**neuron.bias_exponent
    elif isinstance(neuron, Cuba):
        u, v, bias = neuron.decay_u, neuron.decay_v, neuron.bias
        # NIR spikes only above the threshold; to spike at it as well, take the next number below.
        threshold = neuron.threshold if neuron.rule == ">" else np.nextafter(neuron.threshold, -np.inf)
    else:
        raise InputError(where, "NIR has no neuron without reset", fix="Emit another kind.")
    if population.axis != "time":
        raise InputError(where, "NIR has no steps along locations", fix="Emit another kind.")
    if (neuron.refractory > 1).any():
        raise InputError(where, "NIR has no refractory period", fix="Emit another kind.")
    if (u <= 0).any() or ((v <= 0).any() and ((v > 0).any() or (u < 1).any() or bias.any())):
        raise InputError(where, "a state that never decays has no time constant", fix="Emit another kind.")
    zero = np.zeros(population.size)
    if not v.any():
        return "IF", {"r": zero + 1 / dt, "v_threshold": threshold, "v_reset": zero}
    common = {"r": 1 / v, "v_leak": bias / v, "v_threshold": threshold, "v_reset": zero}
    if (u == 1).all():
        return "LIF", {"tau": dt / v, **common}
    return "CubaLIF", {"tau_syn": dt / u, "tau_mem": dt / v, "w_in": 1 / u, **common}


def _integers(quantized: QuantizedNetwork) -> dict[str, Array | str]:
    """Return the integers of the quantised network as metadata."""
    found: dict[str, Array | str] = {}
    for q in quantized.populations:
        # HDF5 would read a slash as a group.
        name = q.population.name.replace("/", ".")
        found[f"quantized.{name}.scale"] = np.asarray(q.scale)
        numbers = dict(vars(q.neuron))
        if isinstance(q.neuron, ChipSrm):
            held_back = {key: value for key, value in vars(q.neuron.refractory).items() if value is not None}
            numbers |= {f"refractory.{key}": np.asarray(value) for key, value in held_back.items()}
        for key, values in numbers.items():
            if isinstance(values, np.ndarray):
                found[f"quantized.{name}.{key}"] = values
    for k, p in enumerate(quantized.projections):
        target, source, index = connections(p.mantissa)
        held: dict[str, Array | str] = {
            "source": p.source,
            "target": p.target,
            "rows": target,
            "columns": source,
            "mantissa": values_of(p.mantissa).ravel()[index],
            "delay": np.broadcast_to(p.delay, values_of(p.mantissa).shape).ravel()[index],
            "exponent": np.array(p.exponent),
            "weight_bits": np.array(p.weight_bits),
        }
        found |= {f"quantized.projection{k}.{key}": value for key, value in held.items()}
    return found
