"""Multiply the linear nodes of a NIR graph out, into the :class:`Signal` that arrives at every neuron node.

A signal is a sum of weighted, delayed spikes of populations and input lines, so linear nodes in a row become one
matrix. The chip has no linear nodes: what they do must become weights and delays of synapses.
"""

import numpy as np
from scipy import sparse

from hw_model.values import IntArray
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.frontends.nir.flat import NEURONS, PASSING, READOUTS, FlatGraph, linear_order
from locsnn_compile.frontends.nir.graph import NirNode
from locsnn_compile.frontends.nir.signals import Signal, Term
from locsnn_compile.network.network import InputView

WHOLE_WITHIN = 0.01
"""A delay counts as a whole number of steps if it is within this share of a step of one. Files hold delays in seconds,
as rounded floats. Chosen by hand: far above the rounding of a float, far below a fraction that is meant."""
LONGEST_DELAY = 1e6
"""In steps. A longer delay is taken for a mistake of unit, such as one in milliseconds."""
ANOTHER_SIZE = "its input has another size"
"""Says of a node that its input has another number of values than the node takes."""


def signals_of(flat: FlatGraph, view: InputView, dt: float, where: str) -> dict[str, Signal]:
    """Return the output of every node as a signal: spikes of neurons and inputs, or a linear function of these.

    ``dt`` is the length of a step in seconds. Neurons and inputs come first, since all other signals consist of theirs.
    """
    signals = {name: Signal.of_source(name, flat.size(name)) for name in flat.named(*NEURONS)}
    first_line = 0
    for name in flat.named("Input"):
        size = flat.size(name)
        # The view has the lines of all Inputs one after the other; those of this one begin at ``first_line``.
        lines = sparse.csr_array(sparse.eye_array(size, view.lines, k=first_line))
        signals[name] = Signal(size, (Term(source=view.name, delay=0, weights=lines),))
        first_line += size
    for name in linear_order(flat.nodes, flat.sources):
        if name not in signals:
            arriving = arriving_at(flat, signals, name, where)
            signals[name] = _passed(flat, name, arriving, dt, f"{where}, node {name!r}")
    return signals


def arriving_at(flat: FlatGraph, signals: dict[str, Signal], name: str, where: str) -> Signal:
    """Return the sum of a node's inputs.

    Raises ``InputError`` for inputs of different sizes, and for potentials of a readout, which the chip cannot send on.
    """
    place = f"{where}, node {name!r}"
    sources = flat.sources[name]
    sizes = {flat.size(source) for source in sources}
    if len(sizes) > 1:
        raise InputError(
            place,
            "its inputs differ in size",
            measured=f"{sorted(sizes)}",
            fix="Make them one size.",
        )
    # A readout never spikes, so its output is a potential. It may pass on unchanged to an Output of the graph, where it
    # is read, but no neuron or weight can take it.
    graded = [source for source in sources if flat.nodes[source].kind in READOUTS]
    if graded and flat.nodes[name].kind not in PASSING:
        fix = "End the graph at that node, or make it a LIF."
        raise InputError(
            place,
            f"it takes the potential of {graded[0]!r}, and the chip sends spikes only",
            fix=fix,
        )
    size = sizes.pop() if sizes else flat.size(name)
    if flat.nodes[name].kind in NEURONS:
        check_same(
            size,
            flat.size(name),
            place,
            ANOTHER_SIZE,
            fix="Give it a neuron for each value.",
        )
    return Signal.total((signals[source] for source in sources), size)


def _passed(flat: FlatGraph, name: str, signal: Signal, dt: float, where: str) -> Signal:
    """Return the output of a node without neurons for a signal."""
    node = flat.nodes[name]
    size = signal.size
    if node.kind in PASSING:
        return signal
    if node.kind == "Scale":
        return signal.scaled(node.each("scale", size, of="value", where=where))
    if node.kind == "Delay":
        return signal.delayed(_delay_steps(node, size, dt, where))
    # Only nodes with weights are left, for which flattening the graph has made layers.
    layer = flat.layers[name]
    columns = layer.weights.shape[1]
    check_same(size, columns, where, ANOTHER_SIZE, fix="Correct its weight.")
    return signal.through(layer.weights, layer.constant, where)


def _delay_steps(node: NirNode, size: int, dt: float, where: str) -> IntArray:
    """Return the delays of a Delay node in whole steps, (size,); raise ``InputError`` for other delays."""
    delays_seconds = node.each("delay", size, of="value", where=where)
    # The longest delays of float64 overflow to infinity, which is then refused as too long, without a warning.
    with np.errstate(over="ignore", invalid="ignore"):
        steps = delays_seconds / dt
        whole = np.rint(steps)
        is_whole = np.abs(steps - whole) <= WHOLE_WITHIN  # False for nan
    is_in_range = (steps >= -WHOLE_WITHIN) & (whole <= LONGEST_DELAY)
    refused = steps[~(is_whole & is_in_range)]
    if refused.size:
        raise InputError(
            where,
            "a delay is not a whole number of steps from 0 to 1e+06",
            measured=f"{refused[0]:g} steps of {dt:g} s",
            fix="Correct it, or give another --dt.",
        )
    return whole.astype(np.int64)
