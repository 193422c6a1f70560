"""Turn a nested NIR graph into one flat graph, with checked edges, output shapes, and weights as matrices.

A node of an inner graph is named ``outer.inner``; the Input and Output of that graph become nodes of kind ``Pass``. A
node with weights (dense, convolution, pooling) gets a :class:`Layer`, a sparse matrix and a constant.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import InputError, check_known, check_same
from locsnn_compile.frontends.linear_maps import (
    Shape,
    Window,
    check_entries,
    check_shape,
    convolution,
    pooling,
)
from locsnn_compile.frontends.nir.graph import Edge, NirGraph, NirNode

NEURONS = ("IF", "LIF", "CubaLIF", "Threshold", "LI", "CubaLI")
"""Kinds of nodes that become populations; the last two never spike."""
READOUTS = ("LI", "CubaLI")
"""Kinds of neurons that never spike, and whose potentials are read out."""
PASSING = ("Output", "Pass", "Flatten")
"""Kinds of nodes whose outputs are their inputs, unchanged: spikes or potentials."""


class FlatGraph(Frozen, eq=False):
    """A NIR graph without inner graphs; every mapping is by the name of a node.

    ``sources`` are the nodes that feed each node, ``shapes`` the shape of its output, and ``layers`` the matrix of a
    node with weights.
    """

    nodes: Mapping[str, NirNode]
    sources: Mapping[str, Sequence[str]]
    shapes: Mapping[str, Shape]
    layers: "Mapping[str, Layer]"

    def size(self, name: str) -> int:
        """Return the number of outputs of a node."""
        return math.prod(self.shapes[name])

    def named(self, *kinds: str) -> list[str]:
        """Return the names of the nodes of some kinds, in file order."""
        return [name for name, node in self.nodes.items() if node.kind in kinds]


def flatten_graph(graph: NirGraph, where: str) -> FlatGraph:
    """Flatten a graph.

    Raises ``InputError`` for edges to nodes that do not exist, circles without a neuron, and shapes that do not fit.
    """
    nodes, pairs = _flat(graph, where, "", top=True)
    sources: dict[str, list[str]] = {name: [] for name in nodes}
    for source, target in dict.fromkeys(pairs):
        sources[target].append(source)
    try:
        linear_order(nodes, sources)
    except CycleError as error:
        # graphlib gives the circle with its first node again at the end.
        circle = " -> ".join(error.args[1][:-1][:6])[:200]
        what, fix = "a loop of edges has no neuron", "Put a neuron into the loop."
        raise InputError(where, what, measured=circle, fix=fix) from None
    shapes, layers = _shapes(nodes, sources, where)
    spread = {name: with_spread_parameters(node, shapes[name]) for name, node in nodes.items()}
    return FlatGraph(spread, sources, shapes, layers)


def with_spread_parameters(node: NirNode, shape: Shape) -> NirNode:
    """Return a node whose parameters have one number per output, if the file has one number per channel.

    The output has ``shape``, such as (C, H, W); a parameter of shape (C, 1, 1) is repeated along its axes of one entry.
    Parameters of other shapes stay as they are: they are checked where they are used.
    """
    if node.kind not in (*NEURONS, "Scale", "Delay"):
        return node
    parameters = dict(node.parameters)
    for name, values in node.parameters.items():
        if not isinstance(values, str) and _spreads(values.shape, shape):
            parameters[name] = np.broadcast_to(values, shape)
    return NirNode(node.kind, parameters)


def _spreads(parameter_shape: Shape, shape: Shape) -> bool:
    """Return whether a parameter of more than one number has to be repeated to fill a shape."""
    if math.prod(parameter_shape) in (1, math.prod(shape)) or len(parameter_shape) != len(shape):
        return False
    return all(axis in (1, size) for axis, size in zip(parameter_shape, shape, strict=True))


def linear_order(nodes: Mapping[str, NirNode], sources: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the nodes, each after those that feed it in the same step.

    Raises ``CycleError`` for a circle without a neuron.
    """
    # A neuron ends a path of linear nodes: its spikes arrive in a later step.
    linear_sources = {
        target: [source for source in feeding if nodes[source].kind not in NEURONS]
        for target, feeding in sources.items()
    }
    return list(TopologicalSorter(linear_sources).static_order())


def targets_of(sources: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Return the nodes that each node feeds, by name, in file order."""
    targets: dict[str, list[str]] = {name: [] for name in sources}
    for target, feeding in sources.items():
        for source in feeding:
            targets[source].append(target)
    return targets


def _flat(
    graph: NirGraph, where: str, prefix: str, *, top: bool = False
) -> tuple[dict[str, NirNode], list[Edge]]:
    """Return the nodes of a graph and of the graphs inside it, and the edges between them.

    Names get the ``prefix``, which is ``outer.`` for a graph that is the node ``outer``. ``top``: the graph is not
    inside another, so its Input and Output are those of the network.
    """
    nodes: dict[str, NirNode] = {}
    edges: list[Edge] = []
    # A node of this graph can become several nodes: the one that its incoming edges lead to, and the one that its
    # outgoing edges come from.
    entry_of: dict[str, str] = {}
    exit_of: dict[str, str] = {}
    for name, node in graph.nodes.items():
        full_name = prefix + name
        entry_of[name] = full_name
        exit_of[name] = full_name
        inner_edges: list[Edge] = []
        if isinstance(node, NirGraph):
            inner_nodes, inner_edges = _flat(node, where, f"{full_name}.")
            entry_of[name] = f"{full_name}.{_only_end(node, 'Input', where, full_name)}"
            exit_of[name] = f"{full_name}.{_only_end(node, 'Output', where, full_name)}"
        elif has_input_matrix(node):
            weights = f"{full_name} (w_in)"
            inner_nodes = without_input_matrix(node, weights, full_name)
            inner_edges = [(weights, full_name)]
            entry_of[name] = weights
        elif node.kind in ("Input", "Output") and not top:
            inner_nodes = {full_name: NirNode("Pass", node.parameters)}
        else:
            inner_nodes = {full_name: node}
        for inner_name in inner_nodes:
            if inner_name in nodes:
                what = f"two nodes are called {inner_name[:60]!r}"
                raise InputError(where, what, fix="Rename one.")
        nodes |= inner_nodes
        edges += inner_edges
    place = where if top else f"{where}, graph {prefix.rstrip('.')[:60]!r}"
    for source, target in graph.edges:
        for end in (source, target):
            edge = f"{source[:60]!r} -> {target[:60]!r}"
            what = f"the edge {edge} names a node that does not exist"
            check_known(place, what, end, graph.nodes)
        edges.append((exit_of[source], entry_of[target]))
    return nodes, edges


def has_input_matrix(node: NirNode) -> bool:
    """Return whether the ``w_in`` of a neuron node is a matrix (neurons, inputs), not one number per neuron.

    If the other parameters are matrices too, the neurons form an image, with one number per neuron.
    """
    if node.kind not in ("CubaLIF", "CubaLI") or "w_in" not in node.parameters:
        return False
    shape = node.array("w_in").shape
    other_shapes = [node.array(name).shape for name in node.parameters if name != "w_in"]
    neurons = max(other_shapes, key=math.prod)
    # A single column is one number per neuron, whatever its shape.
    if len(shape) != 2 or len(neurons) > 1 or shape[1] == 1:
        return False
    return math.prod(neurons) in (1, shape[0])


def without_input_matrix(node: NirNode, weights: str, neurons: str) -> dict[str, NirNode]:
    """Return the two nodes that replace a node with an input matrix: a Linear, and neurons without ``w_in`` (1)."""
    linear = NirNode("Linear", {"weight": node.parameters["w_in"]})
    others = {name: value for name, value in node.parameters.items() if name != "w_in"}
    return {weights: linear, neurons: NirNode(node.kind, others)}


def _only_end(graph: NirGraph, kind: str, where: str, name: str) -> str:
    """Return the name of the only Input, or Output, of an inner graph; raise ``InputError`` unless there is one."""
    names = [
        inner
        for inner, node in graph.nodes.items()
        if isinstance(node, NirNode) and node.kind == kind
    ]
    what = f"a graph inside a graph needs one {kind}"
    fix = "Split it into graphs of one input and one output."
    check_same(len(names), 1, f"{where}, node {name!r}", what, fix=fix)
    return names[0]


def _shapes(
    nodes: Mapping[str, NirNode], sources: Mapping[str, Sequence[str]], where: str
) -> "tuple[dict[str, Shape], dict[str, Layer]]":
    """Return the output shape of every node, and the layers of nodes with weights.

    Shapes spread along the edges, from nodes that know their own. A node that still lacks the shape of its input is
    skipped, and visited again when one of its sources has got a shape.
    """
    shapes: dict[str, Shape] = {}
    layers: dict[str, Layer] = {}
    targets = targets_of(sources)
    waiting = deque(
        name for name, node in nodes.items() if node.kind == "Input" or not sources[name]
    )
    # In a circle, start with neurons whose parameters show their shape. If an axis has one entry, it may have to be
    # repeated to the size of the input, so these neurons are taken only if no other node is waiting.
    sized = [name for name, node in nodes.items() if node.kind in NEURONS and _own_shape(node)]
    certain = [name for name in sized if 1 not in _own_shape(nodes[name])]
    waiting.extend(certain)
    uncertain = deque(name for name in sized if name not in certain)
    while waiting or uncertain:
        if not waiting:
            waiting.append(uncertain.popleft())
        name = waiting.popleft()
        if name in shapes:
            continue
        input_shape = next((shapes[source] for source in sources[name] if source in shapes), None)
        node = nodes[name]
        place = f"{where}, node {name!r}"
        if node.kind in WITH_WEIGHTS:
            if not sources[name]:
                raise InputError(
                    place, "no node feeds it", fix="Connect it to the input, or remove it."
                )
            layer = layer_of(node, input_shape, place)
            if layer is None:
                continue
            layers[name] = layer
            shape = layer.shape
        else:
            passed_shape = _passed_shape(node, input_shape, place)
            if passed_shape is None:
                continue
            shape = passed_shape
        check_shape(shape, place)
        shapes[name] = shape
        waiting.extend(targets[name])
    for name in nodes:
        if name not in shapes:
            raise InputError(
                f"{where}, node {name!r}",
                "its size cannot be found",
                fix="Connect it to the input.",
            )
    return shapes, layers


def _own_shape(node: NirNode) -> Shape:
    """Return the shape of a neuron's parameters; () if these are single numbers."""
    arrays = [value.shape for value in node.parameters.values() if not isinstance(value, str)]
    try:
        shape = np.broadcast_shapes(*arrays)
    except ValueError:
        shape = max(arrays, key=math.prod)
    return shape if math.prod(shape) > 1 else ()


def _passed_shape(node: NirNode, input_shape: Shape | None, where: str) -> Shape | None:
    """Return the output shape of a node without weights; None if it depends on an input shape that is still unknown."""
    if node.kind == "Input":
        return _as_shape(node, "shape", where)
    if node.kind in NEURONS:
        parameter_shape = _own_shape(node)
        if input_shape is None:
            return parameter_shape or None
        return _joined(parameter_shape, input_shape, where)
    if node.kind == "Flatten" and input_shape is not None:
        return _flattened(node, input_shape)
    return input_shape


def _flattened(node: NirNode, input_shape: Shape) -> Shape:
    """Return the output shape of a Flatten for an input shape without a batch axis.

    Some exporters count the batch as axis 0, others do not, and the file does not state it. Later weights only depend
    on the order of the values, which joining axes does not change, so either reading is right: axes are counted as if
    there were no batch, and if such axes do not exist, all axes are joined.
    """
    start = _axis_of(node, "start_dim", len(input_shape))
    end = _axis_of(node, "end_dim", len(input_shape))
    if not 0 <= start <= end < len(input_shape):
        return (math.prod(input_shape),)
    return (*input_shape[:start], math.prod(input_shape[start : end + 1]), *input_shape[end + 1 :])


def _axis_of(node: NirNode, name: str, axes: int) -> int:
    """Return the number of an axis of a Flatten; a negative number in the file counts from the last axis."""
    axis = int(node.array(name).reshape(-1)[0])
    return axis + axes if axis < 0 else axis


def _as_shape(node: NirNode, name: str, where: str) -> Shape:
    """Return a parameter that is a shape."""
    values = node.array(name).reshape(-1)
    if not values.size or (values != np.rint(values)).any() or np.abs(values).max() > 2**40:
        raise InputError(
            where,
            "its shape is not made of whole numbers",
            measured=f"{values[:6]}",
            fix="Correct it.",
        )
    return tuple(int(v) for v in values)


def _joined(parameter_shape: Shape, input_shape: Shape, where: str) -> Shape:
    """Return the shape of neurons, given those of their parameters and of their input.

    It is their own if both have the same size, and otherwise that of the input, to which parameters are broadcast.
    """
    if not parameter_shape or math.prod(parameter_shape) == math.prod(input_shape):
        return parameter_shape or input_shape
    try:
        if np.broadcast_shapes(parameter_shape, input_shape) == input_shape:
            return input_shape
    except ValueError:
        pass
    fix = "Give one number per neuron."
    raise InputError(
        where,
        "its parameters do not fit its input",
        measured=f"{parameter_shape} against {input_shape}",
        fix=fix,
    )


WITH_WEIGHTS = ("Linear", "Affine", "Conv1d", "Conv2d", "SumPool2d", "AvgPool2d")
"""Kinds of nodes that get a :class:`Layer`."""


class Layer(Frozen, eq=False):
    """A node with weights as a matrix: ``weights @ inputs + constant``.

    ``weights`` (outputs, inputs) are CSR, the ``constant`` is (outputs,) or 0, and ``shape`` is that of the outputs.
    """

    weights: Any
    constant: FloatArray | float
    shape: Shape


def layer_of(node: NirNode, input_shape: Shape | None, where: str) -> Layer | None:
    """Return the layer of a node of :data:`WITH_WEIGHTS`; None while the input shape that it needs is unknown."""
    if node.kind in ("Linear", "Affine"):
        return _dense(node, where)
    if input_shape is None and "input_shape" not in node.parameters:
        return None
    if node.kind in ("Conv1d", "Conv2d"):
        return _convolved(node, input_shape or (), where)
    return _pooled(node, input_shape or (), where)


def _dense(node: NirNode, where: str) -> Layer:
    """Return the layer of a Linear or Affine node."""
    weight = node.array("weight")
    if weight.ndim != 2:
        raise InputError(
            where,
            "its weight is not a matrix",
            measured=f"{weight.shape}",
            fix="Give (outputs, inputs).",
        )
    check_entries(weight.size, where)
    bias = (
        node.each("bias", len(weight), of="output", where=where) if node.kind == "Affine" else 0.0
    )
    return Layer(sparse.csr_array(weight.astype(np.float64)), bias, (len(weight),))


def _image(node: NirNode, input_shape: Shape, where: str) -> Shape:
    """Return the input shape (channels, *spatial) of a convolution: the node's parameter, or that of its source."""
    weight = node.array("weight")
    axes = 1 if node.kind == "Conv1d" else 2
    if weight.ndim != axes + 2:
        raise InputError(
            where,
            "its weight has the wrong axes",
            measured=f"{weight.shape}",
            fix="Give (out, in, ...).",
        )
    if "input_shape" in node.parameters:
        channels = weight.shape[1] * _ints(node, "groups", 1, where)[0]
        return (channels, *_ints(node, "input_shape", axes, where))
    image = _unbatched(input_shape, axes)
    if len(image) != axes + 1:
        raise InputError(
            where,
            "its input is not an image",
            measured=f"{input_shape}",
            fix="Set its input_shape.",
        )
    return image


def _convolved(node: NirNode, input_shape: Shape, where: str) -> Layer:
    """Return the layer of a Conv1d or Conv2d node."""
    image = _image(node, input_shape, where)
    weight = node.array("weight").astype(np.float64)
    (groups,) = _ints(node, "groups", 1, where)
    window = _window(node, weight.shape[2:], where)
    weights, shape = convolution(weight, image, window, groups=groups, where=where)
    bias = node.each("bias", shape[0], of="channel", where=where)
    pixels = math.prod(shape[1:])
    return Layer(weights, np.repeat(bias, pixels), shape)


def _pooled(node: NirNode, input_shape: Shape, where: str) -> Layer:
    """Return the layer of a SumPool2d or AvgPool2d node."""
    image = _unbatched(input_shape, axes=2)
    kernel = _ints(node, "kernel_size", 2, where)
    if len(image) != 3:
        raise InputError(
            where,
            "its input is not an image",
            measured=f"{input_shape}",
            fix="Pool before flattening.",
        )
    if min(kernel) < 1:
        raise InputError(
            where, "its kernel is smaller than 1", measured=f"{kernel}", fix="Correct it."
        )
    # An average divides by the size of the kernel, padding included, which is torch's default.
    weight = 1.0 / math.prod(kernel) if node.kind == "AvgPool2d" else 1.0
    window = _window(node, kernel, where)
    weights, shape = pooling(np.broadcast_to(weight, kernel), image, window, where=where)
    return Layer(weights, 0.0, shape)


def _unbatched(shape: Shape, axes: int) -> Shape:
    """Return the shape of an image without the leading batch axis of length one that some exporters keep."""
    has_batch_axis = len(shape) == axes + 2 and shape[0] == 1
    return shape[1:] if has_batch_axis else shape


def _window(node: NirNode, kernel: Shape, where: str) -> Window:
    """Return the window of a convolution or pooling: stride, padding and dilation; pooling has no dilation."""
    axes = len(kernel)
    padding = node.parameters["padding"]
    stride = _ints(node, "stride", axes, where)
    dilation: Shape = (1,) * axes
    if "dilation" in node.parameters:
        dilation = _ints(node, "dilation", axes, where)
    if not isinstance(padding, str):
        return Window.padded(stride, _ints(node, "padding", axes, where), dilation)
    check_known(where, f"padding {padding[:60]!r} is not known", padding, ("same", "valid"))
    if padding == "same" and set(stride) != {1}:
        raise InputError(
            where, "padding 'same' needs stride 1", measured=f"{stride}", fix="Give numbers."
        )
    if padding == "valid":
        return Window.padded(stride, (0,) * axes, dilation)
    # As torch pads for 'same': if the number of pixels is odd, the extra one comes after the image.
    total = [d * (k - 1) for d, k in zip(dilation, kernel, strict=True)]
    ends = tuple((pixels // 2, pixels - pixels // 2) for pixels in total)
    return Window(stride, ends, dilation)


def _ints(node: NirNode, name: str, axes: int, where: str) -> tuple[int, ...]:
    """Return a parameter of whole numbers, one per axis; a single number stands for all."""
    values = node.array(name)
    if (
        values.size not in (1, axes)
        or (values != np.rint(values)).any()
        or np.abs(values).max(initial=0) > 1e9
    ):
        raise InputError(
            where,
            f"{name} must be {axes} whole numbers",
            measured=f"{values.shape}",
            fix="Correct it.",
        )
    return tuple(int(v) for v in np.broadcast_to(values.reshape(-1), (axes,)))
