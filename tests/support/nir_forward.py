"""NIR graphs run by the book: step by step, node by node, no latency. It knows nothing of the project.

Independent of it in everything: convolutions by loops over the output, states in the equations' own units. ``how`` is
``euler``, dt / tau of everything, ``hold``, 1 - exp(-dt / tau), or ``exact``: the solution of the
equations at the end of a step, for inputs that are charges at its start. ``reset``: ``zero``, ``subtract``, and as snnTorch
does with its delay ``late-zero`` (of ``Synaptic``: the potential is 0 in the step after) and ``late-subtract``; with
``none`` a spike changes nothing.
"""

import networkx as nx
import numpy as np

NEURONS = (("IF",), ("LIF", "LI", "CubaLIF", "CubaLI", "Threshold"))


def run(graph, spikes, dt, how="euler", reset="zero"):
    """Return what every node gives, by name, (steps, *shape), for input spikes (steps, *shape)."""
    order = nx.DiGraph(graph.edges)
    order.add_nodes_from(graph.nodes)
    back = closing(graph, order)
    order.remove_edges_from(back)
    state, gives = {}, {name: [] for name in graph.nodes}
    for row in spikes:
        now = {}
        for name in nx.topological_sort(order):
            parts = [now[a] for a, b in graph.edges if b == name and (a, b) not in back]
            late = [
                gives[a][-1] if gives[a] else nothing(graph.nodes[a]) for a, b in back if b == name
            ]
            arriving = (
                sum(np.asarray(p, dtype=float).reshape(-1) for p in [*parts, *late])
                if parts or late
                else 0.0
            )
            if parts or late:
                arriving = np.asarray(arriving).reshape(np.shape([*parts, *late][0]))
            now[name] = (
                row
                if type(graph.nodes[name]).__name__ == "Input"
                else step(graph.nodes[name], arriving, state.setdefault(name, {}), dt, how, reset)
            )
        for name, value in now.items():
            gives[name].append(np.asarray(value))
    return {name: np.array(rows) for name, rows in gives.items()}


def nothing(neuron):
    """Return no spikes of a neuron node."""
    return np.zeros(np.shape(neuron.threshold if hasattr(neuron, "threshold") else neuron.r))


def closing(graph, order):
    """Return the edges by which a neuron's spikes return to a population that all ways to this neuron lead through.

    They take a step. A loop without such an edge has several entrances, and no order of its own.
    """
    neurons = {k for k, n in graph.nodes.items() if type(n).__name__ in sum(NEURONS, ())}
    (start,) = (k for k, n in graph.nodes.items() if type(n).__name__ == "Input")
    above = nx.immediate_dominators(order, start)

    def passed(name):
        return {name} if above.get(name, name) == name else {name} | passed(above[name])

    def next_neurons(name):
        return (
            {name}
            if name in neurons
            else set().union(*(next_neurons(after) for after in order.successors(name)))
        )

    return [(a, b) for a, b in order.edges if a in neurons and next_neurons(b) & passed(a)]


def step(node, x, state, dt, how="euler", reset="zero"):
    """Return what a node gives for one step of its input."""
    kind = type(node).__name__
    if kind in sum(NEURONS, ()) and np.size(x) == np.size(nothing(node)):
        x = np.reshape(x, np.shape(nothing(node)))
    if kind in ("Output", "Flatten"):
        return np.reshape(x, -1) if kind == "Flatten" else x
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
    rest = np.broadcast_to(getattr(node, "v_leak", getattr(node, "v_reset", 0.0)), shape)
    v, i, before = (
        state.get("v", rest),
        state.get("i", np.zeros(shape)),
        state.get("fired", np.zeros(shape, dtype=bool)),
    )

    def lost(tau):
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
        v = v - before * (node.v_threshold - node.v_reset)
    if reset == "late-zero":
        v = np.where(before, node.v_reset, v)
    fired = v > node.v_threshold
    if reset == "subtract":
        v = v - fired * (node.v_threshold - node.v_reset)
    elif reset not in ("late-subtract", "none"):
        v = np.where(fired, node.v_reset, v)
    state.update(v=v, i=i, fired=fired)
    return fired * 1.0


def solution(node, v, i, x, dt):
    """Return the potential and the current of leaky neurons a step after charges x arrived at both."""
    if not hasattr(node, "tau_syn"):
        charged = v - node.v_leak + dt * node.r / node.tau * x
        return node.v_leak + np.exp(-dt / node.tau) * charged, i
    i = i + dt * node.w_in / node.tau_syn * x
    of_current, of_membrane = np.exp(-dt / node.tau_syn), np.exp(-dt / node.tau_mem)
    # tau_mem v' = v_leak - v + r i, with i falling by tau_syn; the two are never equal here.
    from_current = node.tau_syn / (node.tau_syn - node.tau_mem) * (of_current - of_membrane)
    rest = node.v_leak
    return rest + of_membrane * (v - rest) + node.r * i * from_current, of_current * i


def convolve(node, x):
    axes = node.weight.ndim - 2
    stride, dilation = (
        np.broadcast_to(np.reshape(getattr(node, k), -1), axes) for k in ("stride", "dilation")
    )
    kernel = node.weight.shape[2:]
    if isinstance(node.padding, str):
        pads = (
            [(0, 0)] * axes
            if node.padding == "valid"
            else [
                ((d * (k - 1)) // 2, d * (k - 1) - (d * (k - 1)) // 2)
                for d, k in zip(dilation, kernel, strict=True)
            ]
        )
    else:
        pads = [(p, p) for p in np.broadcast_to(np.reshape(node.padding, -1), axes)]
    padded = np.pad(x, [(0, 0), *pads])
    outs = [
        (padded.shape[1 + a] - dilation[a] * (kernel[a] - 1) - 1) // stride[a] + 1
        for a in range(axes)
    ]
    result = np.zeros((len(node.weight), *outs))
    per = node.weight.shape[1]
    for o in range(len(node.weight)):
        first = o // (len(node.weight) // node.groups) * per
        for at in np.ndindex(*outs):
            window = tuple(
                slice(a * s, a * s + d * (k - 1) + 1, d)
                for a, s, d, k in zip(at, stride, dilation, kernel, strict=True)
            )
            result[(o, *at)] = (
                padded[(slice(first, first + per), *window)] * node.weight[o]
            ).sum() + node.bias[o]
    return result


def pool(node, x, average):
    (kh, kw), (sh, sw), (ph, pw) = (
        np.broadcast_to(np.reshape(v, -1), 2) for v in (node.kernel_size, node.stride, node.padding)
    )
    padded = np.pad(x, [(0, 0), (ph, ph), (pw, pw)])
    rows, columns = (padded.shape[1] - kh) // sh + 1, (padded.shape[2] - kw) // sw + 1
    result = np.zeros((len(x), rows, columns))
    for r, c in np.ndindex(rows, columns):
        result[:, r, c] = padded[:, r * sh : r * sh + kh, c * sw : c * sw + kw].sum(axis=(1, 2))
    return result / (kh * kw) if average else result
