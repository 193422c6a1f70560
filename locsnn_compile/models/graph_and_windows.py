"""First layers that are not dense, in plain values and as matrices: graph convolutions and windows.

In ``window-snn``, hidden neuron ``(i * windows + w) * levels + k`` spikes if channel ``walk[i]`` had at least
``levels[k]`` events in window ``w``. Nothing here imports torch, so that the compiler can read descriptions and make
the synapses without it.
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
"""Largest number of hidden neurons that an output hears, if it hears several taxels.

The charge register then holds all of their weights at once. With 4,096, weights of the networks
in docs/research/results.md lost up to two bits.
"""
AXONS_OF_CORE = 4_096
"""Input axons of a core of the chip, and so the largest number of hidden neurons that an output can hear."""
MAX_WINDOW_NEURONS = 131_072
"""Largest number of hidden neurons of a network: 128 cores of 1,024."""
MAX_HOPS = 16
MAX_FEATURES = 1024
_NAME = Must(
    lambda text: 0 < len(text) <= 200 and text.isprintable() and not {"/", "\\"} & {*text},
    "that is a name",
)
PlainName = Annotated[str, _NAME]
"""Up to 200 printable characters without slashes."""


def rises(values: Sequence[Any], least: int, most: int) -> bool:
    """Tell whether values are one or more whole numbers from ``least`` to ``most``, each above the previous one."""
    whole = all(type(value) is int and least <= value <= most for value in values)
    return whole and bool(values) and list(values) == sorted(set(values))


def require_rising(
    where: str, values: Sequence[object], least: int, most: int, what: str, fix: str
) -> None:
    """Raise ``InputError`` unless :func:`rises` holds; ``what`` names the numbers."""
    if not rises(values, least, most):
        measured = f"got {list(values)!r:.80} against {least}..{most}"
        raise InputError(
            where,
            f"they must be {what}, each larger than the one before",
            measured=measured,
            fix=fix,
        )


class WindowParameters(Checked):
    """Windows of ``steps`` time steps, one every ``stride`` steps, and the numbers of events to tell apart, ``levels``.

    With the published bins of 20 ms, these values make a window 0.12 s long.
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
            1,
            self.steps,
            "numbers of events",
            "Give, for example, 1 2.",
        )

    def starts(self, steps: int) -> IntArray:
        """Return the first step of every window in a recording of ``steps`` steps; ``InputError`` if none fits."""
        what, fix = "one window is longer than they are", "Use shorter windows (window_steps)."
        check_most(self.steps, steps, "recordings", what, unit="steps", fix=fix)
        return np.arange(0, steps - self.steps + 1, self.stride, dtype=np.int64)

    def of_channel(self, steps: int) -> int:
        """Return how many hidden neurons hear one channel of a recording of ``steps`` steps."""
        return len(self.starts(steps)) * len(self.levels)

    def synapses(self, steps: int, channels: int) -> sparse.csr_array:
        """Return the weights onto the hidden neurons, all 1: (channels * windows * levels, channels * steps), float64.

        Line ``i * steps + t`` carries the event of channel ``walk[i]`` at time step t.
        """
        starts, levels = self.starts(steps), len(self.levels)
        heard = (starts[:, np.newaxis] + np.arange(self.steps)).repeat(levels, axis=0)
        first = self.steps * np.arange(len(heard) + 1)
        of_one = sparse.csr_array(
            (np.ones(heard.size), heard.reshape(-1), first), shape=(len(heard), steps)
        )
        return sparse.csr_array(sparse.kron(sparse.eye_array(channels), of_one, format="csr"))


def output_parts(hidden_of_taxel: Sequence[int] | IntArray) -> list[slice]:
    """Return the hidden neurons of each output population: as many taxels as :data:`HEARD_BY_OUTPUT` allows, or one.

    ``hidden_of_taxel`` is the number of hidden neurons of every taxel of the walk. Raises ``InputError`` if a single
    taxel has too many.
    """
    parts: list[slice] = []
    start = end = 0
    for size in map(int, hidden_of_taxel):
        what, fix = (
            "one taxel has more hidden neurons than an output can receive from",
            "Use a larger window_stride",
        )
        check_most(size, AXONS_OF_CORE, "windows", what, fix=f"{fix}, or fewer window_levels.")
        if end > start and end + size - start > HEARD_BY_OUTPUT:
            parts.append(slice(start, end))
            start = end
        end += size
    return [*parts, slice(start, end)]


class BranchGraph(Frozen, eq=False):
    """The graph of a branch: ``powers`` are those of :func:`hop_powers`; ``lines[node, c]`` is the line of an input."""

    powers: tuple[sparse.csr_array, ...]
    lines: IntArray


class GraphParameters(Checked):
    """The topology-adaptive graph convolutions of a network (Du et al. 2017), one for each of its branches.

    ``taxel_edges`` are pairs of 1-based taxel numbers of a fingertip, the lower first, each pair once; ``name`` says
    how they were found. A node hears nodes up to ``hops`` edges away and has ``features`` outputs. On the location
    axis, nodes are the time steps of the recording, joined to their neighbours in time, with ``step_features`` outputs.
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
            edges = tuple((t, t + 1) for t in range(1, steps))
            return BranchGraph(
                hop_powers(edges, nodes, self.hops), np.arange(nodes, dtype=np.int64)[:, np.newaxis]
            )
        channels = np.arange(sensor.channels, dtype=np.int64).reshape(
            sensor.surfaces, nodes, sensor.polarities
        )
        lines = channels.transpose(1, 0, 2).reshape(nodes, inputs)
        return BranchGraph(hop_powers(self.taxel_edges, nodes, self.hops), lines)

    def check(self, taxels: int) -> None:
        """Raise ``InputError`` for an edge that is not a pair of ``taxels`` taxels."""
        seen: set[tuple[int, int]] = set()
        for a, b in self.taxel_edges:
            if not rises((a, b), 1, taxels):
                what = "an edge is not a pair of taxels with the lower number first"
                fix = "Correct the graph."
                raise InputError(
                    "taxel graph", what, measured=f"got {a!r}-{b!r} against 1..{taxels}", fix=fix
                )
            if (a, b) in seen:
                raise InputError(
                    "taxel graph", f"edge {a}-{b} is given twice", fix="Give every edge once."
                )
            seen.add((a, b))


def hop_powers(
    edges: tuple[tuple[int, int], ...], nodes: int, hops: int
) -> tuple[sparse.csr_array, ...]:
    """Return the matrices A^0, A^1, ... A^hops, each (nodes, nodes), float64: how strongly a node hears the others.

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
    return tuple(powers)


def spread_weights(weight: AnyArray, graph: BranchGraph) -> sparse.csr_array:
    """Return the weights of single neurons in a graph convolution, (nodes * features, lines), float64.

    ``weight`` (features, (hops + 1) * inputs) has the weights of each hop next to each other. Neuron
    ``node * features + f`` is feature f of a node.
    """
    of_hop = np.split(weight.astype(np.float64), len(graph.powers), axis=1)
    parts = (
        sparse.kron(power, part, format="csr")
        for power, part in zip(graph.powers, of_hop, strict=True)
    )
    order = np.argsort(graph.lines.ravel())
    spread = sparse.csr_array(sparse.csc_array(sum(parts))[:, order])
    spread.sort_indices()
    return spread
