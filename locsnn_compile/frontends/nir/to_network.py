"""From a NIR graph to a Network: linear nodes are multiplied out, and every neuron node becomes a population.

As on the chip, a spike takes one step from one population to the next. In frameworks it takes none: their output at
step t behind k populations comes at step t + k here, where k is the longest path (:mod:`.paths`).
"""

import math
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np
from scipy import sparse

from hw_model.values import FloatArray, Frozen
from locsnn_compile.data.channels import Channels, image_channels
from locsnn_compile.data.recordings import STEP_SECONDS
from locsnn_compile.errors import InputError, check_known, check_same, listed
from locsnn_compile.frontends.nir.flat import (
    NEURONS,
    READOUTS,
    FlatGraph,
    flatten_graph,
    linear_order,
    targets_of,
)
from locsnn_compile.frontends.nir.graph import NirGraph, NirNode, read_nir
from locsnn_compile.frontends.nir.host_layers import divide_graph
from locsnn_compile.frontends.nir.neurons import (
    DT_SECONDS,
    WITH_FLOOR,
    Discretisation,
    Reading,
    Reset,
    Stated,
    integration_assumptions,
    neurons_of,
    nir_assumptions,
)
from locsnn_compile.frontends.nir.paths import Paths
from locsnn_compile.frontends.nir.signals import Signal, Term
from locsnn_compile.frontends.parts import STEPS, Parts
from locsnn_compile.frontends.relays import add_relays
from locsnn_compile.network.network import (
    HostLayers,
    HostOutput,
    InputView,
    Network,
    Population,
)
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import Projection, matrix

BIAS = "nir/bias"
"""The population of one neuron that spikes in every step and adds the biases; names of nodes have no slash."""
START = "nir/start"
"""The population of one neuron that spikes once, in the first step, and sets potentials to rest."""
INPUTS = "nir/inputs"
"""The input of a graph with several inputs: their lines one after the other, by name, as HDF5 lists nodes."""


def load_nir(
    path: Path,
    dt: float | None = None,
    reset: str | None = None,
    discretisation: str | None = None,
    floor: float | None = None,
    *,
    relay_delays: bool = False,
    host_layers: str | None = None,
) -> Network:
    """Read a NIR file and return its network; options as in :func:`locsnn_compile.frontends.load`."""
    where = f"model {path.name!r}"
    graph, data = read_nir(path, where)
    how: Discretisation = _one_of(discretisation or "euler", Discretisation, "discretisation")
    after: Reset = _one_of(reset or "zero", Reset, "reset")
    known_dt = _dt_seconds(dt, graph)
    reading = Reading(known_dt or DT_SECONDS, how, after, _checked_floor(floor))
    flat = flatten_graph(graph, where)
    if floor is not None and not flat.named(*WITH_FLOOR):
        what = "no neuron of this graph has a potential that a floor would hold"
        raise InputError(f"{where}, --floor", what, fix="Leave it out.")
    readings = dict.fromkeys(flat.nodes, reading)
    built, host = divided_parts(flat, readings, where, host_layers, relays=relay_delays)
    parts = built.parts
    open_questions = (
        *nir_assumptions(flat, known_dt, reset, discretisation),
        *integration_assumptions(flat, known_dt, where),
    )
    origin = graph if dt is None else graph.with_metadata(dt=np.array(dt))
    said: dict[str, Any] = {"any_length": True, "origin": origin}
    said["assumptions"] = (*open_questions, *built.assumed)
    said["inputs"] = image_of(flat)
    if host is not None:
        said |= {"host": host, "inputs": None, "origin": None}
        said["assumptions"] += (host.sentence,)
    usual = _number(graph, "step_seconds")
    return parts.network_of_file(path, data, parts.views[0].lines, STEPS, usual, **said)


class GraphParts(Frozen, eq=False):
    """The parts of a graph's network, and a sentence for each thing that was assumed.

    ``depths``: how many steps behind the input each population fires, by name.
    """

    parts: Parts
    assumed: tuple[str, ...]
    depths: Mapping[str, int]


def divided_parts(
    flat: FlatGraph,
    readings: Mapping[str, Reading],
    where: str,
    host_layers: str | None,
    *,
    relays: bool,
) -> tuple[GraphParts, HostLayers | None]:
    """Return the parts that run on the chip, and the layers before them that run on the host, if any do."""
    if host_layers is None:
        return parts_of(flat, readings, where, relays=relays), None
    divided = divide_graph(flat, host_layers, _in_order(flat), where)
    first = parts_of(divided.host, readings, where, relays=False)
    sends = tuple(HostOutput(name, first.depths[name]) for name in divided.sent)
    lines = first.parts.views[0].lines
    network = first.parts.network(name="host", channels=lines, steps=STEPS, any_length=True)
    rest = parts_of(divided.chip, readings, where, relays=relays)
    return rest, HostLayers(network, sends, divided.input_shape)


def parts_of(
    flat: FlatGraph, readings: Mapping[str, Reading], where: str, *, relays: bool
) -> GraphParts:
    """Return the parts of a graph's network.

    ``readings`` has how the neurons of each node are read, by its name; all count in the same step.
    ``relays``: neurons carry delays that are too long for a synapse.
    """
    view = _input(flat, where)
    signals = _signals(flat, view, next(iter(readings.values())).dt, where)
    parts, order = Parts([view]), _in_order(flat)
    arriving = {name: _arriving(flat, signals, name, f"{where}, node {name!r}") for name in order}
    paths = Paths(
        ((term.source, name) for name in order for term in arriving[name].terms), [view.name], order
    )
    for found in order:
        place, size = f"{where}, node {found!r}", flat.size(found)
        given = arriving[found].aligned(
            {t.source: paths.late(t.source, found) for t in arriving[found].terms}
        )
        stated = neurons_of(flat.nodes[found], given, size, readings[found], place)
        parts.populations.append(Population(found, "time", size, stated.neuron))
        parts.projections += _onto(found, stated, paths.depths[found]).projections(found)
    sources = {projection.source for projection in parts.projections}
    # The second one is inhibited by its own spike, through a current that never decays.
    for name, decay_u in ((BIAS, 1.0), (START, 0.0)):
        if name in sources:
            once = Cuba.of(1, decay_u=decay_u, decay_v=1.0, threshold=1.0, bias=2.0)
            parts.populations.append(Population(name, "time", 1, once, helper=True))
    if START in sources:
        parts.projections.append(Projection(START, START, matrix(np.array([[-8.0]]), np.float64)))
    outputs = _outputs(flat, where)
    parts.outputs = dict.fromkeys(outputs, _potentials_from(flat, outputs, paths.depths, where))
    relayed = add_relays(parts) if relays else ()
    assumed = (*relayed, *_slow_loops(arriving, paths), *_left_out(flat))
    return GraphParts(parts, assumed, paths.depths)


def image_of(flat: FlatGraph) -> Channels | None:
    """Return the pixels of an Input of shape (C, H, W); None for other shapes, and for several inputs."""
    inputs = flat.named("Input")
    return image_channels(flat.shapes[inputs[0]]) if len(inputs) == 1 else None


def _slow_loops(arriving: dict[str, Signal], paths: Paths) -> tuple[str, ...]:
    """Return a sentence on the connection that is slowest against a framework's, if a loop has one."""
    rows = (
        (t.delay + paths.late(t.source, name), t.source, name)
        for name in arriving
        for t in arriving[name].terms
    )
    early, source, target = min(rows, default=(0, "", ""))
    steps = "a step" if early == -1 else f"{-early} steps"
    said = "A loop over several populations takes a step for each of them here, and one step in a framework"
    return (f"{said}: spikes of {source!r} reach {target!r} {steps} later.",) if early < 0 else ()


def _left_out(flat: FlatGraph) -> tuple[str, ...]:
    """Return a sentence on weights that lead nowhere, if there are any."""
    idle = [
        repr(name)
        for name, targets in targets_of(flat.sources).items()
        if name in flat.layers and not targets
    ]
    return (f"The weights of {listed(idle)} feed no node and were left out.",) if idle else ()


def _onto(name: str, stated: Stated, depth: int) -> Signal:
    """Return all input of a population: its signal, constants, its own spikes, and what sets it to rest."""
    neuron, terms = stated.neuron, list(stated.signal.terms)
    for onset in stated.signal.constants:
        terms.append(Term(BIAS, depth - 1 + onset.delay, _column(onset.values)))
    if stated.own.any():
        terms.append(Term(name, 0, sparse.csr_array(sparse.diags_array(-stated.own))))
    if stated.first.any():
        # The bias acts from step 0; this is what is missing in step 1, and the current forgets it in step 2.
        missing = stated.first * (1 - neuron.decay_v) ** 2
        terms.append(Term(START, 0, _column(missing)))
        if (neuron.decay_u < 1).any():
            terms.append(Term(START, 1, _column(-(1 - neuron.decay_u) * missing)))
    if np.any(stated.driven):
        # With the constant, whose current grows, this makes the potential the rest in the first step of the layer.
        terms.append(
            Term(START, depth - 1, _column(stated.driven * (1 - neuron.decay_u * neuron.decay_v)))
        )
        terms.append(
            Term(
                START, depth, _column(-stated.driven * (1 - neuron.decay_u) * (1 - neuron.decay_v))
            )
        )
    return Signal(stated.signal.size, tuple(terms), stated.signal.constants)


def _column(values: FloatArray) -> Any:
    return sparse.csr_array(values[:, None])


def _one_of(name: str, kind: Any, what: str) -> Any:
    """Return a name if it is one of a literal type's values; ``InputError`` otherwise."""
    check_known(f"{what} {name!r}", "is not known", name, get_args(kind))
    return name


def _dt_seconds(dt: float | None, graph: NirGraph) -> float | None:
    """Return the step of the constants that is given, or the one in a file that we wrote; None without either."""
    return _number(graph, "dt") if dt is None else _checked_seconds(dt, "dt")


def _checked_floor(floor: float | None) -> float | None:
    if floor is not None and not math.isfinite(floor):
        what = "the floor must be a finite number"
        raise InputError("floor", what, measured=f"{floor}", fix="Give the lowest potential.")
    return floor


def _number(graph: NirGraph, name: str) -> float | None:
    """Return the seconds in an entry of the metadata, as in files that we wrote; None without it."""
    held = graph.metadata.get(name)
    if held is None or isinstance(held, str) or held.size != 1:
        return None
    return _checked_seconds(float(held.reshape(-1)[0]), name)


def _checked_seconds(seconds: float, name: str) -> float:
    if not STEP_SECONDS.holds(seconds):
        what = "a step must last more than 0 s and at most 1e+06 s"
        raise InputError(name, what, measured=f"{seconds:g}", fix="Give the seconds per step.")
    return seconds


def _input(flat: FlatGraph, where: str) -> InputView:
    """Return the view of a graph's inputs; refuse a graph without inputs or neurons, or with an integrator."""
    for name in flat.named("I"):
        what = "an integrator without leak or threshold overflows every register"
        raise InputError(
            f"{where}, node {name!r}", what, fix="Use an LI with a long tau, or an IF."
        )
    names = flat.named("Input")
    if not names:
        raise InputError(
            where, "a graph needs an Input", fix="Add an Input node before the first weights."
        )
    for name in names:
        for source in flat.sources[name]:
            place, fix = f"{where}, node {name!r}", "Connect it to the nodes that the Input feeds."
            raise InputError(
                place, "an edge leads into an Input", measured=f"from {source!r}", fix=fix
            )
    if not flat.named(*NEURONS):
        raise InputError(where, "it has no neurons", fix="Export a network with LIF neurons.")
    return InputView(
        names[0] if len(names) == 1 else INPUTS, "time", sum(flat.size(name) for name in names)
    )


def _in_order(flat: FlatGraph) -> list[str]:
    """Return the neurons sorted by distance from an input, because files hold nodes and edges in any order."""
    far, targets = dict.fromkeys(flat.named("Input"), 0), targets_of(flat.sources)
    waiting = deque(far)
    while waiting:
        name = waiting.popleft()
        for target in targets[name]:
            if target not in far:
                far[target] = far[name] + 1
                waiting.append(target)
    return sorted(flat.named(*NEURONS), key=lambda name: far.get(name, len(flat.nodes)))


def _signals(flat: FlatGraph, view: InputView, dt: float, where: str) -> dict[str, Signal]:
    """Return the output of every node: of neurons and inputs their spikes, of linear nodes a function of these."""
    signals = {name: Signal.of_source(name, flat.size(name)) for name in flat.named(*NEURONS)}
    first = 0
    for name in flat.named("Input"):
        size = flat.size(name)
        lines = sparse.csr_array(sparse.eye_array(size, view.lines, k=first))
        signals[name] = Signal(size, (Term(view.name, 0, lines),))
        first += size
    for name in linear_order(flat.nodes, flat.sources):
        if name not in signals:
            place = f"{where}, node {name!r}"
            signals[name] = _passed(flat, name, _arriving(flat, signals, name, place), dt, place)
    return signals


def _arriving(flat: FlatGraph, signals: dict[str, Signal], name: str, where: str) -> Signal:
    """Return the sum of a node's inputs; refuse graded values of a readout, which cannot be sent on."""
    sources = flat.sources[name]
    sizes = {flat.size(source) for source in sources}
    if len(sizes) > 1:
        raise InputError(
            where,
            "its inputs differ in size",
            measured=f"{sorted(sizes)}",
            fix="Make them one size.",
        )
    graded = [source for source in sources if flat.nodes[source].kind in READOUTS]
    if graded and flat.nodes[name].kind not in ("Output", "Pass", "Flatten"):
        fix = "End the graph at that node, or make it a LIF."
        raise InputError(
            where,
            f"it takes the potential of {graded[0]!r}, and the chip sends spikes only",
            fix=fix,
        )
    size = sizes.pop() if sizes else flat.size(name)
    if flat.nodes[name].kind in NEURONS:
        check_same(
            size,
            flat.size(name),
            where,
            "its input has another size",
            fix="Give it a neuron for each value.",
        )
    return Signal.total((signals[source] for source in sources), size)


def _passed(flat: FlatGraph, name: str, signal: Signal, dt: float, where: str) -> Signal:
    """Return the output of a linear node for a signal."""
    node, size = flat.nodes[name], signal.size
    if node.kind in ("Output", "Pass", "Flatten"):
        return signal
    if node.kind == "Scale":
        return signal.scaled(node.each("scale", size, "value", where))
    if node.kind == "Delay":
        return signal.delayed(_delay_steps(node, size, dt, where))
    layer = flat.layers[name]
    check_same(
        size, layer.weights.shape[1], where, "its input has another size", fix="Correct its weight."
    )
    return signal.through(layer.weights, layer.constant, where)


def _delay_steps(node: NirNode, size: int, dt: float, where: str) -> Any:
    """Return delays in whole steps, (size,)."""
    steps = node.each("delay", size, "value", where) / dt
    whole = np.rint(steps)
    bad = steps[(steps < -0.01) | (np.abs(steps - whole) > 0.01) | (whole > 1e6)]
    if bad.size:
        what, fix = (
            "a delay is not a whole number of steps from 0 to 1e+06",
            "Correct it, or give another --dt.",
        )
        raise InputError(where, what, measured=f"{bad[0]:g} steps of {dt:g} s", fix=fix)
    return whole.astype(np.int64)


def _potentials_from(
    flat: FlatGraph, outputs: tuple[str, ...], depth: dict[str, int], where: str
) -> int | None:
    """Return the step from which potentials of readouts equal those of a framework; None if outputs spike."""
    graded = [name for name in outputs if flat.nodes[name].kind in READOUTS]
    if graded and len(graded) < len(outputs):
        fix = "Keep outputs of one kind."
        raise InputError(
            f"{where}, node {graded[0]!r}", "some outputs are potentials, others spikes", fix=fix
        )
    return max(depth[name] for name in graded) if graded else None


def _outputs(flat: FlatGraph, where: str) -> tuple[str, ...]:
    """Return the populations that are read out: those that reach an Output directly, or through a Flatten."""
    found: list[str] = []
    waiting = flat.named("Output")
    if not waiting:
        raise InputError(
            where, "a graph needs an Output", fix="Add an Output node behind the last neurons."
        )
    while waiting:
        name = waiting.pop(0)
        kind = flat.nodes[name].kind
        if kind in NEURONS:
            found.append(name)
        elif kind in ("Output", "Pass", "Flatten") and flat.sources[name]:
            waiting.extend(flat.sources[name])
        else:
            what = f"it outputs the values of {kind}, but the chip outputs spikes"
            fix = "End the graph in a LIF, or in an LI whose potential is read."
            raise InputError(f"{where}, node {name!r}", what, fix=fix)
    outputs = tuple(dict.fromkeys(found))
    sizes = {flat.size(name) for name in outputs}
    if len(sizes) > 1:
        raise InputError(
            where, "its outputs differ in size", measured=f"{sorted(sizes)}", fix="Keep one Output."
        )
    return outputs
