"""Turn neurons into compartments that the chip has.

Before: a QuantizedNetwork of SRM populations.
After:  a CompartmentGraph, one phase an axis. Strategy ``dendrite``: each neuron is a memoryless soma, under the
        population's name, to which an alpha dendrite ``name/dendrite`` and a refractory dendrite ``name/refractory``,
        driven by the neuron's own spikes, add their voltages.
"""

from __future__ import annotations

import numpy as np

from hw_model.chip_description import Chip
from hw_model.fixed_point import DECAY_ONE, IntArray
from hw_model.graph import CompartmentGraph, Compartments, Input, Phase, Synapses, check_graph, read_only
from hw_model.weights import SignMode
from locsnn_compile.passes.quantize import REFRACTORY_BITS
from locsnn_compile.quantized import QuantizedNetwork, QuantizedProjection, QuantizedSrm

STRATEGIES = ("auto", "dendrite")
"""``auto`` takes the only lowering there is of SRM neurons: ``dendrite``."""


def lower_neurons(quantized: QuantizedNetwork, chip: Chip) -> CompartmentGraph:
    """Lower every population by the ``dendrite`` strategy; weights that rounded to 0 make no synapse."""
    network = quantized.network
    groups: list[Compartments] = []
    synapses: list[Synapses] = []
    for population in quantized.populations:
        groups += _compartments(population, chip)
        if population.refractory_mantissa:
            synapses.append(_self_synapses(population))
    for projection in quantized.projections:
        synapses += _by_sign(projection)
    graph = CompartmentGraph(
        name=network.name,
        phases=tuple(Phase(axis, axis, network.steps_of(axis)) for axis in network.axes),
        inputs=tuple(
            Input(v.name, v.lines, v.axis, "touch", None if v.positions is None else read_only(v.positions))
            for v in network.views
        ),
        groups=tuple(groups),
        synapses=tuple(synapses),
        readout=network.readout,
        synapses_pruned=sum(int((p.mantissa == 0).sum()) for p in quantized.projections),
        provenance={"model": network.name, "model_sha256": network.sha256, "strategy": "dendrite"},
    )
    check_graph(graph, chip)
    return graph


def _compartments(q: QuantizedSrm, chip: Chip) -> list[Compartments]:
    """The soma keeps nothing (decays 4096), so that the chip's reset changes nothing either."""
    name = q.population.name
    return [
        _group(name, q, chip, decay=DECAY_ONE, joined_to=None),
        _group(f"{name}/dendrite", q, chip, decay=q.decay, joined_to=name),
        _group(f"{name}/refractory", q, chip, decay=q.refractory_decay, joined_to=name),
    ]


def _group(name: str, q: QuantizedSrm, chip: Chip, *, decay: int, joined_to: str | None) -> Compartments:
    def every(value: int) -> IntArray:
        return read_only(np.full(q.population.size, value))

    last = chip.registers.voltage_max
    return Compartments(
        name=name,
        phase=q.population.axis,
        size=q.population.size,
        decay_u=every(decay),
        decay_v=every(decay),
        threshold=every(q.threshold),
        bias_mantissa=every(0),
        bias_exponent=every(0),
        refractory=every(1),
        vmin=every(-last),
        vmax=every(last),
        joined_to=joined_to,
    )


def _self_synapses(q: QuantizedSrm) -> Synapses:
    name, n = q.population.name, q.population.size
    each = np.arange(n)
    return Synapses(
        name,
        f"{name}/refractory",
        source_index=read_only(each),
        target_index=read_only(each),
        mantissa=read_only(np.full(n, q.refractory_mantissa)),
        delay=read_only(np.zeros(n)),
        exponent=q.refractory_exponent,
        weight_bits=REFRACTORY_BITS,
        sign_mode="inhibitory",
    )


def _by_sign(p: QuantizedProjection) -> list[Synapses]:
    """Positive and negative weights in formats of their own: all weight bits are then magnitude."""
    signs: tuple[tuple[SignMode, IntArray], ...] = (
        ("excitatory", np.maximum(p.mantissa, 0)),
        ("inhibitory", np.minimum(p.mantissa, 0)),
    )
    found = []
    for sign_mode, mantissa in signs:
        source, target = np.nonzero(mantissa.T)
        if len(source):
            found.append(
                Synapses(
                    p.source,
                    f"{p.target}/dendrite",
                    source_index=read_only(source),
                    target_index=read_only(target),
                    mantissa=read_only(mantissa[target, source]),
                    delay=read_only(np.zeros(len(source))),
                    exponent=p.exponent,
                    weight_bits=p.weight_bits,
                    sign_mode=sign_mode,
                )
            )
    return found
