"""From a NIR graph to a Network: linear nodes are multiplied out, and every neuron node becomes a population.

As on the chip, a spike takes one step from one population to the next. In frameworks it takes none: their output at
step t, k populations behind the input, comes at step t + k here, where k is the longest path (:mod:`.paths`).

The steps are: read the file (:mod:`.graph`), flatten inner graphs (:mod:`.flat`), find inputs and outputs
(:mod:`.ends`), sum what arrives at each neuron node through linear ones (:mod:`.linear_nodes`), and turn its equations
into steps (:mod:`.neurons`). Options and metadata are read in :mod:`.options`.
"""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from hw_model.values import Frozen
from locsnn_compile.errors import InputError, listed
from locsnn_compile.frontends.nir.ends import image_of, input_view, outputs_of, potentials_from
from locsnn_compile.frontends.nir.flat import NEURONS, FlatGraph, flatten_graph, targets_of
from locsnn_compile.frontends.nir.graph import read_nir
from locsnn_compile.frontends.nir.host_layers import divide_graph
from locsnn_compile.frontends.nir.linear_nodes import arriving_at, signals_of
from locsnn_compile.frontends.nir.neurons import (
    WITH_FLOOR,
    NirNeurons,
    Reading,
    integration_assumptions,
    neurons_of,
    nir_assumptions,
)
from locsnn_compile.frontends.nir.options import checked_dt, checked_reading, metadata_seconds
from locsnn_compile.frontends.nir.paths import Paths
from locsnn_compile.frontends.nir.signals import Signal, Term, as_column, on_diagonal
from locsnn_compile.frontends.parts import DEFAULT_STEPS, FileFacts, Parts
from locsnn_compile.frontends.relays import add_relays
from locsnn_compile.network.network import HostLayers, HostOutput, Network, Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import Projection, matrix

BIAS = "nir/bias"
"""The population of one neuron that spikes in every step and adds the biases; nodes have no slash in their names."""
START = "nir/start"
"""The population of one neuron that spikes once, in the first step, and sets potentials to rest."""
HELPER_THRESHOLD = 1.0
"""The threshold of both helper neurons, in a unit of their own."""
HELPER_BIAS = 2.0
"""The bias of both helper neurons: twice the threshold, so that they spike even if its integer is rounded down."""
START_INHIBITION = -8.0
"""The weight of the starting neuron onto itself.

After its first spike, a current of -8 that never decays outweighs the bias of 2 in every later step.
"""


def load_nir(  # noqa: PLR0913 - what the options of a NIR file say
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
    known_dt = checked_dt(dt, graph)
    reading = checked_reading(known_dt, reset, discretisation, floor)
    flat = flatten_graph(graph, where)
    if floor is not None and not flat.named(*WITH_FLOOR):
        what = "no neuron of this graph has a potential that a floor would hold"
        raise InputError(f"{where}, --floor", what, fix="Leave it out.")
    readings = dict.fromkeys(flat.nodes, reading)
    on_chip, host = divided_parts(flat, readings, where, host_layers, relays=relay_delays)
    assumptions = (
        *nir_assumptions(flat, dt=known_dt, reset=reset, discretisation=discretisation),
        *integration_assumptions(flat, known_dt, where),
        *on_chip.assumed,
    )
    # Written again, the file states the step that it was read with.
    origin = graph if dt is None else graph.with_metadata(dt=np.array(dt))
    facts = FileFacts(
        any_length=True, inputs=image_of(flat), origin=origin, assumptions=assumptions
    )
    return on_chip.parts.network_of_file(
        path,
        data,
        channels=on_chip.parts.views[0].lines,
        steps=DEFAULT_STEPS,
        step_seconds=metadata_seconds(graph, "step_seconds"),
        facts=facts if host is None else facts.behind(host),
    )


class GraphParts(Frozen, eq=False):
    """The parts of a graph's network.

    ``assumed`` has a sentence for each assumption. ``depths`` is by how many steps each population fires later than
    in a framework, by name.
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
    """Return the parts that run on the chip, and the layers before them that run on the host, or None."""
    if host_layers is None:
        return parts_of(flat, readings, where, relays=relays), None
    divided = divide_graph(flat, host_layers, _nearest_first(flat), where)
    on_host = parts_of(divided.host, readings, where, relays=False)
    sends = tuple(HostOutput(name, on_host.depths[name]) for name in divided.sent)
    lines = on_host.parts.views[0].lines
    network = on_host.parts.network(
        name="host", channels=lines, steps=DEFAULT_STEPS, any_length=True
    )
    on_chip = parts_of(divided.chip, readings, where, relays=relays)
    return on_chip, HostLayers(network, sends, divided.input_shape)


def parts_of(
    flat: FlatGraph, readings: Mapping[str, Reading], where: str, *, relays: bool
) -> GraphParts:
    """Return the parts of a graph's network.

    ``readings`` says how the neurons of each node are read, by its name; all have the same ``dt``. With ``relays``,
    relay neurons carry delays that are too long for a synapse.
    """
    view = input_view(flat, where)
    dt = next(iter(readings.values())).dt
    signals = signals_of(flat, view, dt, where)
    names = _nearest_first(flat)
    arriving = {name: arriving_at(flat, signals, name, where) for name in names}
    paths = Paths(_pairs(arriving), [view.name], names)
    parts = Parts([view])
    for name in names:
        steps_late = {term.source: paths.late(term.source, name) for term in arriving[name].terms}
        signal = arriving[name].aligned(steps_late)
        place = f"{where}, node {name!r}"
        _add_node(parts, flat, name, signal, readings[name], paths.depths[name], place)
    _add_helpers(parts)
    outputs = outputs_of(flat, where)
    from_step = potentials_from(flat, outputs, paths.depths, where)
    parts.outputs = dict.fromkeys(outputs, from_step)
    relayed = add_relays(parts) if relays else ()
    assumed = (*relayed, *_slow_loops(arriving, paths), *_left_out(flat))
    return GraphParts(parts, assumed, paths.depths)


def _pairs(arriving: Mapping[str, Signal]) -> Iterator[tuple[str, str]]:
    """Yield the names of a source and of the population that its spikes reach, for every term."""
    for target, signal in arriving.items():
        for term in signal.terms:
            yield term.source, target


def _add_node(  # noqa: PLR0913 - what earlier steps made, each used once
    parts: Parts,
    flat: FlatGraph,
    name: str,
    signal: Signal,
    reading: Reading,
    depth: int,
    place: str,
) -> None:
    """Add the population of a neuron node, and the projections onto it; ``depth`` is that of :mod:`.paths`."""
    size = flat.size(name)
    neurons = neurons_of(flat.nodes[name], signal, size, reading, place)
    parts.populations.append(Population(name, "time", size, neurons.neuron))
    parts.projections += _all_input(name, neurons, depth).projections(name)


def _add_helpers(parts: Parts) -> None:
    """Add the helper neurons that projections start from: one spikes in every step, the other in the first step."""
    sources = {projection.source for projection in parts.projections}
    if BIAS in sources:
        parts.populations.append(_helper(BIAS, current_decay=1.0))
    if START in sources:
        # Its own spike inhibits it through a current that never decays, so it does not spike again.
        parts.populations.append(_helper(START, current_decay=0.0))
        onto_itself = matrix(np.array([[START_INHIBITION]]), np.float64)
        parts.projections.append(Projection(START, START, onto_itself))


def _helper(name: str, current_decay: float) -> Population:
    """Return the population of one neuron that spikes by its bias alone."""
    neuron = Cuba.of(
        1, decay_u=current_decay, decay_v=1.0, threshold=HELPER_THRESHOLD, bias=HELPER_BIAS
    )
    return Population(name, "time", 1, neuron, helper=True)


def _slow_loops(arriving: Mapping[str, Signal], paths: Paths) -> tuple[str, ...]:
    """Return a sentence about the connection that is latest, compared with a framework, if a loop makes one late."""
    # The delay that every connection needs, with its ends; below 0 if its spikes come too late.
    delays = [
        (term.delay + paths.late(term.source, target), term.source, target)
        for target, signal in arriving.items()
        for term in signal.terms
    ]
    needed, source, target = min(delays, default=(0, "", ""))
    if needed >= 0:
        return ()
    return (
        "A loop over several populations takes a step for each of them here, and one step in a framework: "
        f"spikes of {source!r} reach {target!r} {_steps_late(-needed)} later.",
    )


def _steps_late(steps: int) -> str:
    """Return a number of steps as words."""
    return "a step" if steps == 1 else f"{steps} steps"


def _left_out(flat: FlatGraph) -> tuple[str, ...]:
    """Return a sentence about weights that lead to no node, if there are any."""
    idle = [
        repr(name)
        for name, targets in targets_of(flat.sources).items()
        if name in flat.layers and not targets
    ]
    if not idle:
        return ()
    return (f"The weights of {listed(idle)} feed no node and were left out.",)


def _all_input(name: str, neurons: NirNeurons, depth: int) -> Signal:
    """Return all input of a population as terms: its signal, constants, resets, and the start at its rest.

    A spike takes a step to arrive. So a helper's spike with a delay of ``depth - 1`` arrives in step
    ``depth``, the first in which the population sees the recording.
    """
    terms = (
        *neurons.signal.terms,
        *_constants(neurons.signal, depth),
        *_resets(name, neurons),
        *_starts(neurons),
        *_driven_starts(neurons, depth),
    )
    return replace(neurons.signal, terms=terms)


def _constants(signal: Signal, depth: int) -> Iterator[Term]:
    """Yield the constants of a signal as spikes of the neuron that spikes in every step."""
    for onset in signal.constants:
        yield Term(BIAS, depth - 1 + onset.delay, as_column(onset.values))


def _resets(name: str, neurons: NirNeurons) -> Iterator[Term]:
    """Yield the synapses from each neuron to itself that take the threshold after a spike, if there are any."""
    if neurons.reset_charge.any():
        yield Term(name, 0, on_diagonal(-neurons.reset_charge))


def _starts(neurons: NirNeurons) -> Iterator[Term]:
    """Yield spikes of the start neuron that set potentials to their start, if that is not 0, from step 1 on.

    With ``v(-1) = start``, ``(1 - decay_v)^2 * start`` of it is left in step 1, which a potential that starts
    at 0 lacks; the bias, which acts from step 0 on, is the same for both.
    """
    start = neurons.start_potential
    if not start.any():
        return
    decay_u = neurons.neuron.decay_u
    decay_v = neurons.neuron.decay_v
    missing = start * (1 - decay_v) ** 2
    yield Term(START, 0, as_column(missing))
    if (decay_u < 1).any():
        # The current keeps a share of this charge, which is cancelled in step 2.
        yield Term(START, 1, as_column(-(1 - decay_u) * missing))


def _driven_starts(neurons: NirNeurons, depth: int) -> Iterator[Term]:
    """Yield spikes of the start neuron that lift neurons that spike without input to their rest.

    They act in the first step of their layer. The signal's constant adds ``decay_u * decay_v * rest`` to the current in
    every step. With the two terms here, the current is ``rest`` in the first step and ``decay_v * rest`` from the next
    one on, with which the potential stays at the rest.
    """
    rest = neurons.driven_rest
    if not rest.any():
        return
    decay_u = neurons.neuron.decay_u
    decay_v = neurons.neuron.decay_v
    yield Term(START, depth - 1, as_column(rest * (1 - decay_u * decay_v)))
    yield Term(START, depth, as_column(-rest * (1 - decay_u) * (1 - decay_v)))


def _nearest_first(flat: FlatGraph) -> list[str]:
    """Return the neuron nodes sorted by distance from an input, because files hold nodes and edges in any order."""
    distance = dict.fromkeys(flat.named("Input"), 0)
    targets = targets_of(flat.sources)
    waiting = deque(distance)
    while waiting:
        name = waiting.popleft()
        for target in targets[name]:
            if target not in distance:
                distance[target] = distance[name] + 1
                waiting.append(target)
    unreached = len(flat.nodes)
    return sorted(flat.named(*NEURONS), key=lambda name: distance.get(name, unreached))
