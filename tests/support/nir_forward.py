"""An independent simulator of NIR graphs, written from NIR's equations: step by step and node by node.

It shares nothing with the project: convolutions are loops over the output, states have the units of the equations, and a
spike reaches all nodes in the step in which it occurs.

``how`` is the way to integrate an equation over a step: ``euler`` loses dt / tau of a state, ``hold`` loses
1 - exp(-dt / tau), and ``exact`` is the solution at the end of a step whose inputs are charges at its start.

``reset`` says what a spike does to the potential: ``zero``, ``subtract``, ``none``, or as snnTorch does it a step later:
``late-zero`` (of ``Synaptic``: the potential is 0 in the step after) and ``late-subtract``.
"""

import networkx as nx
import numpy as np

NEURONS = ("IF", "LIF", "LI", "CubaLIF", "CubaLI", "Threshold")
"""Kinds of nodes with a state or a threshold."""


def run(graph, spikes, dt, how="euler", reset="zero"):
    """Return the outputs of every node by name, (steps, *shape), for input spikes (steps, *shape)."""
    order = nx.DiGraph(graph.edges)
    order.add_nodes_from(graph.nodes)
    feedback = feedback_edges(graph, order)
    order.remove_edges_from(feedback)
    states = {name: {} for name in graph.nodes}
    outputs = {name: [] for name in graph.nodes}
    for row in spikes:
        now = {}
        for name in nx.topological_sort(order):
            node = graph.nodes[name]
            if kind_of(node) == "Input":
                now[name] = row
                continue
            arriving = [
                now[source]
                for source, target in graph.edges
                if target == name and (source, target) not in feedback
            ]
            # Feedback edges carry the outputs of the previous step, and nothing in the first one.
            for source, target in feedback:
                if target == name:
                    before = outputs[source]
                    arriving.append(before[-1] if before else no_spikes(graph.nodes[source]))
            now[name] = step(node, sum_of(arriving), states[name], dt, how, reset)
        for name, value in now.items():
            outputs[name].append(np.asarray(value))
    return {name: np.array(rows) for name, rows in outputs.items()}


def kind_of(node):
    """Return the name of a node's class, such as ``LIF``."""
    return type(node).__name__


def sum_of(arriving):
    """Return the sum of inputs in the shape of the first; they have equally many numbers, but may be flat or images."""
    if not arriving:
        return 0.0
    total = sum(np.asarray(values, dtype=float).reshape(-1) for values in arriving)
    return np.asarray(total).reshape(np.shape(arriving[0]))


def no_spikes(neuron):
    """Return zeros in the shape of a neuron node."""
    return np.zeros(np.shape(neuron.threshold if hasattr(neuron, "threshold") else neuron.r))


def feedback_edges(graph, order):
    """Return the edges that close a loop: spikes of a neuron return to neurons that every path to it passes.

    Such an edge takes a step. A loop without one has several entrances, and so no natural order.
    """
    neurons = {name for name, node in graph.nodes.items() if kind_of(node) in NEURONS}
    (start,) = (name for name, node in graph.nodes.items() if kind_of(node) == "Input")
    # The immediate dominator of a node is the last node that all paths from the input to it have in common.
    dominator = nx.immediate_dominators(order, start)

    def dominators(name):
        above = dominator.get(name, name)
        return {name} if above == name else {name} | dominators(above)

    def next_neurons(name):
        """Return the neurons that a node reaches without passing other neurons."""
        if name in neurons:
            return {name}
        return set().union(*(next_neurons(after) for after in order.successors(name)))

    return [
        (source, target)
        for source, target in order.edges
        if source in neurons and next_neurons(target) & dominators(source)
    ]


def step(node, x, state, dt, how="euler", reset="zero"):
    """Return the output of a node for one step of its input, and update its state."""
    kind = kind_of(node)
    if kind in NEURONS and np.size(x) == np.size(no_spikes(node)):
        x = np.reshape(x, np.shape(no_spikes(node)))
    if kind == "Output":
        return x
    if kind == "Flatten":
        return np.reshape(x, -1)
    if kind == "Linear":
        return node.weight @ np.reshape(x, -1)
    if kind == "Affine":
        return node.weight @ np.reshape(x, -1) + node.bias
    if kind == "Scale":
        return node.scale * x
    if kind == "Delay":
        line = state.setdefault("line", [])
        line.append(np.reshape(x, -1))
        steps = np.rint(np.reshape(node.delay, -1) / dt).astype(int)
        return np.array([line[-1 - d][i] if d < len(line) else 0.0 for i, d in enumerate(steps)])
    if kind in ("Conv1d", "Conv2d"):
        return convolve(node, x)
    if kind in ("SumPool2d", "AvgPool2d"):
        return pool(node, x, kind == "AvgPool2d")
    if kind == "Threshold":
        return (x > node.threshold) * 1.0
    shape = np.broadcast_shapes(np.shape(x), np.shape(node.r))
    # An IF node has no leak; it starts from its reset potential.
    rest = np.broadcast_to(getattr(node, "v_leak", getattr(node, "v_reset", 0.0)), shape)
    v = state.get("v", rest)
    i = state.get("i", np.zeros(shape))
    fired_before = state.get("fired", np.zeros(shape, dtype=bool))

    def lost(tau):
        """Return the share of a state that decays in a step."""
        return dt / tau if how == "euler" else 1 - np.exp(-dt / tau)

    if kind == "IF":
        v = v + dt * node.r * x
    elif how == "exact":
        v, i = solution(node, v, i, x, dt)
    elif kind in ("LIF", "LI"):
        v = v + lost(node.tau) * (node.v_leak - v + node.r * x)
    else:
        i = i + lost(node.tau_syn) * (node.w_in * x - i)
        v = v + lost(node.tau_mem) * (node.v_leak - v + node.r * i)
    if kind in ("LI", "CubaLI"):
        state.update(v=v, i=i)
        return v
    if reset == "late-subtract":
        v = v - fired_before * (node.v_threshold - node.v_reset)
    if reset == "late-zero":
        v = np.where(fired_before, node.v_reset, v)
    fired = v > node.v_threshold
    if reset == "subtract":
        v = v - fired * (node.v_threshold - node.v_reset)
    elif reset not in ("late-subtract", "none"):
        v = np.where(fired, node.v_reset, v)
    state.update(v=v, i=i, fired=fired)
    return fired * 1.0


def solution(node, v, i, x, dt):
    """Return the potential and the current of leaky neurons a step after charges x arrived.

    Charges arrive at the current, or at the potential of a LIF node, which has no current.
    """
    if not hasattr(node, "tau_syn"):
        charged = v - node.v_leak + dt * node.r / node.tau * x
        return node.v_leak + np.exp(-dt / node.tau) * charged, i
    i = i + dt * node.w_in / node.tau_syn * x
    of_current, of_membrane = np.exp(-dt / node.tau_syn), np.exp(-dt / node.tau_mem)
    # The solution of tau_mem v' = v_leak - v + r i with i decaying with tau_syn, for unequal time constants, which all
    # graphs of the tests have.
    from_current = node.tau_syn / (node.tau_syn - node.tau_mem) * (of_current - of_membrane)
    rest = node.v_leak
    return rest + of_membrane * (v - rest) + node.r * i * from_current, of_current * i


def convolve(node, x):
    """Return the convolution (channels, *size) of an input (channels, *size) in one or two dimensions, plus the bias."""
    axes = node.weight.ndim - 2
    stride = per_axis(node.stride, axes)
    dilation = per_axis(node.dilation, axes)
    kernel = node.weight.shape[2:]
    extent = [dilation[a] * (kernel[a] - 1) + 1 for a in range(axes)]  # that a kernel covers
    padded = np.pad(x, [(0, 0), *paddings(node, extent)])
    size = [(padded.shape[1 + a] - extent[a]) // stride[a] + 1 for a in range(axes)]
    outputs = len(node.weight)
    channels_per_group = node.weight.shape[1]
    result = np.zeros((outputs, *size))
    for o in range(outputs):
        group = o // (outputs // node.groups)
        channels = slice(group * channels_per_group, (group + 1) * channels_per_group)
        for place in np.ndindex(*size):
            starts = [place[a] * stride[a] for a in range(axes)]
            window = [slice(starts[a], starts[a] + extent[a], dilation[a]) for a in range(axes)]
            products = padded[(channels, *window)] * node.weight[o]
            result[(o, *place)] = products.sum() + node.bias[o]
    return result


def per_axis(value, axes):
    """Return a parameter for each axis; it may be given once for all."""
    return np.broadcast_to(np.reshape(value, -1), axes)


def paddings(node, extent):
    """Return the padding (before, after) of each axis.

    "same" keeps the size of the input; if the padding is odd, the larger half comes after, as in torch.
    """
    if not isinstance(node.padding, str):
        return [(p, p) for p in per_axis(node.padding, len(extent))]
    if node.padding == "valid":
        return [(0, 0)] * len(extent)
    return [((covered - 1) // 2, covered - 1 - (covered - 1) // 2) for covered in extent]


def pool(node, x, average):
    """Return sums or averages of windows of an image (channels, rows, columns)."""
    kernel_height, kernel_width = per_axis(node.kernel_size, 2)
    stride_y, stride_x = per_axis(node.stride, 2)
    padding_y, padding_x = per_axis(node.padding, 2)
    padded = np.pad(x, [(0, 0), (padding_y, padding_y), (padding_x, padding_x)])
    rows = (padded.shape[1] - kernel_height) // stride_y + 1
    columns = (padded.shape[2] - kernel_width) // stride_x + 1
    result = np.zeros((len(x), rows, columns))
    for row, column in np.ndindex(rows, columns):
        top = row * stride_y
        left = column * stride_x
        window = padded[:, top : top + kernel_height, left : left + kernel_width]
        result[:, row, column] = window.sum(axis=(1, 2))
    return result / (kernel_height * kernel_width) if average else result
