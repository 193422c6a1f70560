"""First layers that are not fully connected: graph convolutions, and neurons that count events in windows.

Both are described in plain values, and given as the matrices of their synapses. Nothing here imports torch, so that the
compiler can read descriptions and make the synapses without it.

A *window* is a range of consecutive time steps; windows of one length start every few steps. A network that counts in
windows has, for every channel of the recording, window and *level*, one hidden neuron, which spikes if the channel had
at least that number of events in the window. Hidden neuron ``(i * windows + w) * levels + k`` belongs to channel
``walk[i]``, window ``w`` and ``levels[k]``, where the *walk* is the order of the channels.
"""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from scipy import sparse

from hw_model.io.records import AT_LEAST_ONE, Checked, Must, between
from hw_model.values import AnyArray, Frozen, IntArray
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.errors import InputError, check_most

HEARD_BY_OUTPUT = 1_024
"""Largest number of hidden neurons from which an output neuron receives, if they belong to several taxels.

The charge register, which adds up the weights that arrive in one step, must hold all of their weights at once. With
4,096 instead, weights of the networks in docs/research/results.md had to be smaller and lost up to two bits.
"""
AXONS_OF_CORE = 4_096
"""Input axons of a core of the chip, and so the largest number of hidden neurons that an output can hear."""
MAX_WINDOW_NEURONS = 131_072
"""Largest number of hidden neurons of a network: 128 cores of 1,024 compartments."""
MAX_HOPS = 16
MAX_FEATURES = 1024
"""Limits for graph convolutions in files, far above any published network."""
_NAME = Must(
    lambda text: 0 < len(text) <= 200 and text.isprintable() and not {"/", "\\"} & {*text},
    "that is a name",
)
PlainName = Annotated[str, _NAME]
"""Up to 200 printable characters without slashes."""


def rises(values: Sequence[Any], least: int, most: int) -> bool:
    """Return whether values are one or more whole numbers from ``least`` to ``most``, each above the previous one."""
    # Not isinstance: True would pass as 1.
    are_in_range = all(type(value) is int and least <= value <= most for value in values)
    return are_in_range and bool(values) and list(values) == sorted(set(values))


def require_rising(
    where: str, values: Sequence[object], least: int, most: int, what: str, fix: str
) -> None:
    """Raise ``InputError`` unless :func:`rises` holds; ``what`` says in the error what the numbers are."""
    if not rises(values, least, most):
        measured = f"got {list(values)!r:.80} against {least}..{most}"
        raise InputError(
            where,
            f"they must be {what}, each larger than the one before",
            measured=measured,
            fix=fix,
        )


class WindowParameters(Checked):
    """Windows in which events are counted.

    - ``steps``: length of a window in time steps
    - ``stride``: steps from the start of a window to the start of the next
    - ``levels``: numbers of events; each window has a neuron for every level, which spikes if there are at least so
      many events of its channel

    With the published bins of 20 ms, the default window is 0.12 s long.
    """

    steps: Annotated[int, AT_LEAST_ONE] = 6
    stride: Annotated[int, AT_LEAST_ONE] = 3
    levels: tuple[int, ...] = (1, 2)

    called = "windows"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_rising(
            "windows 'levels'",
            self.levels,
            least=1,
            most=self.steps,
            what="numbers of events",
            fix="Give, for example, 1 2.",
        )

    def starts(self, steps: int) -> IntArray:
        """Return the first step of every window in a recording of ``steps`` steps; ``InputError`` if none fits."""
        what, fix = "one window is longer than they are", "Use shorter windows (window_steps)."
        check_most(self.steps, steps, "recordings", what, unit="steps", fix=fix)
        return np.arange(0, steps - self.steps + 1, self.stride, dtype=np.int64)

    def of_channel(self, steps: int) -> int:
        """Return how many hidden neurons one channel has, in recordings of ``steps`` steps."""
        return len(self.starts(steps)) * len(self.levels)

    def synapses(self, steps: int, channels: int) -> sparse.csr_array:
        """Return the weights onto the hidden neurons, all 1: (channels * windows * levels, channels * steps), float64.

        Line ``i * steps + t`` carries the event of channel ``walk[i]`` at time step t. The neurons of different levels
        of a window have the same weights: the level is their threshold.
        """
        starts = self.starts(steps)
        # The time steps that each neuron of one channel counts, (windows * levels, steps of a window).
        counted_steps = starts[:, np.newaxis] + np.arange(self.steps)
        counted_steps = counted_steps.repeat(len(self.levels), axis=0)
        row_starts = self.steps * np.arange(len(counted_steps) + 1)
        of_channel = sparse.csr_array(
            (np.ones(counted_steps.size), counted_steps.reshape(-1), row_starts),
            shape=(len(counted_steps), steps),
        )
        # One block on the diagonal for each channel.
        return sparse.csr_array(sparse.kron(sparse.eye_array(channels), of_channel, format="csr"))


def output_parts(hidden_of_taxel: Sequence[int] | IntArray) -> list[slice]:
    """Return the slice of hidden neurons from which each output population receives.

    An output that receives from all hidden neurons would need more axons or a wider register than a core has. So there
    are several populations of outputs, whose potentials are added. Each takes the hidden neurons of as many whole
    taxels as :data:`HEARD_BY_OUTPUT` allows, but at least of one. ``hidden_of_taxel`` is the number of hidden neurons
    of every taxel of the walk. Raises ``InputError`` if a single taxel has too many.
    """
    parts: list[slice] = []
    start = end = 0
    for size in map(int, hidden_of_taxel):
        what = "one taxel has more hidden neurons than an output can receive from"
        fix = "Use a larger window_stride, or fewer window_levels."
        check_most(size, AXONS_OF_CORE, "windows", what, fix=fix)
        if end > start and end + size - start > HEARD_BY_OUTPUT:
            parts.append(slice(start, end))
            start = end
        end += size
    return [*parts, slice(start, end)]


class BranchGraph(Frozen, eq=False):
    """The graph of a branch, as matrices.

    - ``powers``: those of :func:`hop_powers`
    - ``lines``: ``lines[node, c]`` is the input line that is input c of a node
    """

    powers: tuple[sparse.csr_array, ...]
    lines: IntArray


class GraphParameters(Checked):
    """The topology-adaptive graph convolutions of a network (Du et al. 2017), one for each of its branches.

    - ``taxel_edges``: pairs of 1-based taxel numbers of a fingertip, the lower first, each pair once; ``name``: the
      kind of graph that they are, see :func:`locsnn_compile.data.taxel_graph.taxel_graph`
    - ``hops``: a node receives from nodes up to so many edges away
    - ``features``: outputs of each node on the time axis, where nodes are taxels
    - ``step_features``: outputs of each node on the location axis, where nodes are the time steps of the recording,
      each joined to the next
    """

    name: PlainName
    taxel_edges: tuple[tuple[int, int], ...]
    hops: Annotated[int, between(1, MAX_HOPS)] = 3
    features: Annotated[int, between(1, MAX_FEATURES)] = 64
    step_features: Annotated[int, between(1, MAX_FEATURES)] = 8

    called = "graph"

    def size(self, branch: str, sensor: SensorLayout, steps: int) -> tuple[int, int, int]:
        """Return (nodes, inputs per node, features per node) of a branch's graph convolution.

        The nodes of the time branch are the taxels. All fingertips share them, and each adds its polarities to the
        inputs. The nodes of the location branch are the time steps, with one input: the event of a step at a location.
        """
        if branch == "time":
            return sensor.taxels, sensor.surfaces * sensor.polarities, self.features
        return steps, 1, self.step_features

    def of_branch(self, branch: str, sensor: SensorLayout, steps: int) -> BranchGraph:
        """Return the graph of a branch; on the location axis, every time step is joined to the next.

        The inputs of a taxel are its polarities on the first fingertip, then those on the next. Channels are numbered
        as in :class:`~locsnn_compile.data.sensor.SensorLayout`.
        """
        nodes, inputs, _ = self.size(branch, sensor, steps)
        if branch == "location":
            edges = tuple((t, t + 1) for t in range(1, steps))  # numbered from 1, as taxels are
            lines_of_steps = np.arange(nodes, dtype=np.int64)[:, np.newaxis]
            return BranchGraph(hop_powers(edges, nodes, self.hops), lines_of_steps)
        channels = np.arange(sensor.channels, dtype=np.int64).reshape(
            sensor.surfaces, nodes, sensor.polarities
        )
        lines = channels.transpose(1, 0, 2).reshape(nodes, inputs)
        return BranchGraph(hop_powers(self.taxel_edges, nodes, self.hops), lines)

    def check(self, taxels: int) -> None:
        """Raise ``InputError`` for an edge that is not a pair of ``taxels`` taxels."""
        edges: set[tuple[int, int]] = set()
        for a, b in self.taxel_edges:
            if not rises((a, b), 1, taxels):
                what = "an edge is not a pair of taxels with the lower number first"
                fix = "Correct the graph."
                raise InputError(
                    "taxel graph", what, measured=f"got {a!r}-{b!r} against 1..{taxels}", fix=fix
                )
            if (a, b) in edges:
                raise InputError(
                    "taxel graph", f"edge {a}-{b} is given twice", fix="Give every edge once."
                )
            edges.add((a, b))


def hop_powers(
    edges: tuple[tuple[int, int], ...], nodes: int, hops: int
) -> tuple[sparse.csr_array, ...]:
    """Return the matrices A^0, A^1, ... A^hops, each (nodes, nodes), float64.

    Entry [i, j] of A^k is how strongly node i receives from node j over k edges. A = D^(-1/2) B D^(-1/2), with the
    adjacency matrix B and the degrees D of the undirected graph. A node without edges receives from itself only.
    """
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2) - 1
    # Both directions of every edge.
    rows, columns = np.concatenate([ends, ends[:, ::-1]]).T
    adjacency = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(nodes, nodes))
    degree = adjacency.sum(axis=1)
    # The maximum only avoids a division by 0 where the result is not used.
    scale = sparse.diags_array(np.where(degree > 0, 1 / np.sqrt(np.maximum(degree, 1)), 0.0))
    step = sparse.csr_array(scale @ adjacency @ scale)
    powers = [sparse.csr_array(sparse.eye_array(nodes))]
    for _ in range(hops):
        powers.append(sparse.csr_array(powers[-1] @ step))
    return tuple(powers)


def spread_weights(weight: AnyArray, graph: BranchGraph) -> sparse.csr_array:
    """Return a graph convolution as the synapses of an ordinary layer, (nodes * features, lines), float64.

    ``weight`` (features, (hops + 1) * inputs), shared by all nodes, has the weights of each hop next to each other.
    Neuron ``node * features + f`` is feature f of a node.
    """
    of_hop = np.split(weight.astype(np.float64), len(graph.powers), axis=1)
    parts = (
        sparse.kron(power, part, format="csr")
        for power, part in zip(graph.powers, of_hop, strict=True)
    )
    # The sum has a column for each input of each node in turn; sorting puts the columns in order of the lines.
    order = np.argsort(graph.lines.ravel())
    spread = sparse.csr_array(sparse.csc_array(sum(parts))[:, order])
    spread.sort_indices()
    return spread
