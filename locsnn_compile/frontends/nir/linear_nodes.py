"""Multiply the linear nodes of a NIR graph out, into the :class:`Signal` that arrives at every neuron node.

A signal is a sum of weighted, delayed spikes of populations and input lines, so linear nodes in a row become one
matrix.
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
"""A delay counts as a whole number of steps if it is this near to one: files hold it in seconds, as a rounded float."""
LONGEST_DELAY = 1e6
"""In steps. A longer delay is taken for a mistake of unit, such as one in milliseconds."""
ANOTHER_SIZE = "its input has another size"


def signals_of(flat: FlatGraph, view: InputView, dt: float, where: str) -> dict[str, Signal]:
    """Return the output of every node as a signal: spikes of neurons and inputs, or a linear function of these."""
    signals = {name: Signal.of_source(name, flat.size(name)) for name in flat.named(*NEURONS)}
    first_line = 0
    for name in flat.named("Input"):
        size = flat.size(name)
        # The view has the lines of all Inputs one after the other; those of this one begin at ``first_line``.
        lines = sparse.csr_array(sparse.eye_array(size, view.lines, k=first_line))
        signals[name] = Signal(size, (Term(view.name, 0, lines),))
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
        return signal.scaled(node.each("scale", size, "value", where))
    if node.kind == "Delay":
        return signal.delayed(_delay_steps(node, size, dt, where))
    layer = flat.layers[name]
    columns = layer.weights.shape[1]
    check_same(size, columns, where, ANOTHER_SIZE, fix="Correct its weight.")
    return signal.through(layer.weights, layer.constant, where)


def _delay_steps(node: NirNode, size: int, dt: float, where: str) -> IntArray:
    """Return the delays of a Delay node in whole steps, (size,); raise ``InputError`` for other delays."""
    steps = node.each("delay", size, "value", where) / dt
    whole = np.rint(steps)
    is_negative = steps < -WHOLE_WITHIN
    is_fraction = np.abs(steps - whole) > WHOLE_WITHIN
    is_too_long = whole > LONGEST_DELAY
    refused = steps[is_negative | is_fraction | is_too_long]
    if refused.size:
        raise InputError(
            where,
            "a delay is not a whole number of steps from 0 to 1e+06",
            measured=f"{refused[0]:g} steps of {dt:g} s",
            fix="Correct it, or give another --dt.",
        )
    return whole.astype(np.int64)
