"""The graph of a branch as matrices: what a node hears, and the weights of single neurons in a graph convolution.

Nothing here imports torch, so that the compiler can spread the weights without it.
"""

import numpy as np
import numpy.typing as npt
from scipy import sparse

from hw_model.values import Frozen, IntArray
from locsnn_compile.models.description import NetworkDescription


class BranchGraph(Frozen, eq=False):
    """The graph of one branch: ``hop`` as :func:`hop_matrix` gives it; ``lines[node, c]`` is the line of an input."""

    hop: sparse.csr_array
    lines: IntArray


def branch_graph(description: NetworkDescription, branch: str) -> BranchGraph:
    """Return the graph of a branch of a network that has graph convolutions.

    The inputs of a taxel are its polarities on the first fingertip, then those on the next. Channels are numbered as in
    :class:`~locsnn_compile.data.sensor.SensorLayout`.
    """
    graph, sensor = description.graph, description.input.sensor
    assert graph is not None
    nodes, inputs, _ = description.graph_size(branch)
    if branch == "location":
        lines = np.arange(nodes, dtype=np.int64)[:, np.newaxis]
        return BranchGraph(hop_matrix(step_edges(nodes), nodes, graph.hops), lines)
    channels = np.arange(sensor.channels, dtype=np.int64).reshape(sensor.surfaces, nodes, sensor.polarities)
    return BranchGraph(
        hop_matrix(graph.taxel_edges, nodes, graph.hops), channels.transpose(1, 0, 2).reshape(nodes, inputs)
    )


def step_edges(steps: int) -> tuple[tuple[int, int], ...]:
    """Return the 1-based edges of the temporal graph, from every time step to the next."""
    return tuple((t, t + 1) for t in range(1, steps))


def hop_matrix(edges: tuple[tuple[int, int], ...], nodes: int, hops: int) -> sparse.csr_array:
    """Return the matrices A^0, A^1, ... A^hops on top of each other, ((hops + 1) * nodes, nodes), float64.

    A = D^(-1/2) B D^(-1/2), with the adjacency matrix B and the degrees D of the undirected graph. A node without edges
    only hears itself.
    """
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2) - 1
    rows, columns = np.concatenate([ends, ends[:, ::-1]]).T
    adjacency = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(nodes, nodes))
    degree = adjacency.sum(axis=1)
    scale = sparse.diags_array(np.where(degree > 0, 1 / np.sqrt(np.maximum(degree, 1)), 0.0))
    step = sparse.csr_array(scale @ adjacency @ scale)
    powers = [sparse.csr_array(sparse.eye_array(nodes))]
    for _ in range(hops):
        powers.append(sparse.csr_array(powers[-1] @ step))
    return sparse.csr_array(sparse.vstack(powers))


def spread_weights(weight: npt.NDArray[np.floating], graph: BranchGraph) -> sparse.csr_array:
    """Return the weights of single neurons in a graph convolution, (nodes * features, lines), float64.

    ``weight`` (features, (hops + 1) * inputs) has the weights of each hop next to each other. Neuron
    ``node * features + f`` is feature f of a node.
    """
    hop, (nodes, inputs) = graph.hop, graph.lines.shape
    features = len(weight)
    order = np.argsort(graph.lines.ravel())
    added = sparse.csr_array((nodes * features, nodes * inputs))
    for k in range(hop.shape[0] // nodes):
        part = weight[:, k * inputs : (k + 1) * inputs].astype(np.float64)
        added = added + sparse.kron(hop[k * nodes : (k + 1) * nodes], part, format="csr")
    spread = sparse.csr_array(sparse.csc_array(added)[:, order])
    spread.sort_indices()
    return spread
