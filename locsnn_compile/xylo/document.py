"""report.json of a program for a Xylo as a type, with the keys that the reports of all targets share.

Energy and time are None, with the reason, since neither is published.
"""

from collections.abc import Mapping

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.values import FloatArray, IntArray
from hw_model.xylo.playing import XyloCounts
from hw_model.xylo.program import XyloProgram
from locsnn_compile.own_arithmetic.document import (
    EnergyNotKnown,
    FirstEntries,
    LastEntries,
    TimeNotKnown,
    check_entries,
    recording_ns,
    skipped_entry,
)
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.report.figures.match import Overflows
from locsnn_compile.report.figures.resources import LimitUse, ProgramUse, Shared, shared_value
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.xylo.comparison import XyloMatch
from locsnn_compile.xylo.parts import neurons_of
from locsnn_compile.xylo.quantized import QuantizedXylo

NO_TABLE = "no table of the energies or times of this chip is published"


class XyloNumbers(Entry):
    """The numbers of a population on the chip.

    In a step, a register loses 2^-dash of itself. The errors of decays are relative to the decays of the float network.
    """

    strategy: str
    scale: Shared
    threshold_mantissa: Shared
    dash_syn: Shared
    dash_mem: Shared
    current_decay_error: float
    potential_decay_error: float
    weight_shifts: tuple[int, ...]


class _OwnEntries(FirstEntries):
    """The entries of report.json up to those that only a Xylo has."""

    latency: TimeNotKnown
    quantization: Mapping[str, XyloNumbers]


class XyloFigures(LastEntries, _OwnEntries):
    """report.json; every ``per_sample`` figure is a mean over the recordings of the check."""


def xylo_figures(
    quantized: QuantizedXylo, program: XyloProgram, match: XyloMatch, grounds: Grounds
) -> XyloFigures:
    """Return the figures of a program and its check."""
    network = quantized.parts.network
    counts = match.total_counts
    extra_spikes = counts.extra_spikes / match.samples
    return XyloFigures(
        **check_entries(network, match, grounds, _overflows(counts), extra_spikes),
        target=program.chip.name,
        strategy=program.provenance["strategy"],
        weight_bits=xylo.WEIGHT_BITS,
        energy=EnergyNotKnown(not_included=(NO_TABLE,)),
        latency=TimeNotKnown(basis=NO_TABLE, recording_ns=recording_ns(network, grounds)),
        resources=_resources(program),
        skipped=skipped_entry(grounds, events_dropped=counts.lost_input_events),
        quantization={
            population.name: _population(quantized, population.name)
            for population in quantized.populations
        },
    )


def _overflows(counts: XyloCounts) -> Overflows:
    """Return how often registers overflowed. Xylo's saturate, which the report calls clips; they never wrap."""
    saturations = {
        "current_saturations": counts.current_saturations,
        "change_saturations": counts.change_saturations,
        "potential_saturations": counts.potential_saturations,
    }
    return Overflows(wraps=0, clips=counts.saturations, events={"all neurons": saturations})


def _resources(program: XyloProgram) -> ProgramUse:
    """Return what the program uses of the chip. A weight of 0 is no synapse."""
    network = program.network
    chip = program.chip
    groups = (network.weights_in, network.weights_hidden, network.weights_out)
    synapses = sum(int(np.count_nonzero(weights)) for weights in groups)
    return ProgramUse(
        cores=1,
        compartments=network.hidden.size + network.outputs.size,
        synapses=synapses,
        synapse_bits=synapses * xylo.WEIGHT_BITS,
        axons_in=program.inputs,
        axons_out=network.outputs.size,
        limits={
            "inputs": LimitUse(program.inputs, chip.inputs),
            "hidden_neurons": LimitUse(network.hidden.size, chip.hidden),
            "outputs": LimitUse(network.outputs.size, chip.outputs),
            "currents_of_a_hidden_neuron": LimitUse(network.hidden.states, chip.states),
        },
    )


def _population(quantized: QuantizedXylo, name: str) -> XyloNumbers:
    """Return the numbers of a population, which is one of the hidden ones or the outputs."""
    dash_syn, dash_mem = quantized.dashes_of(name)
    network = quantized.network
    if name == quantized.parts.outputs.name:
        threshold = network.outputs.threshold
        shifts = [network.shift_out]
    else:
        threshold = network.hidden.threshold[quantized.place(name)]
        shifts = [network.shift_in, network.shift_hidden]
    current_error, potential_error = _decay_errors(quantized, name)
    return XyloNumbers(
        strategy="native",
        scale=shared_value(quantized.scales_of(name)),
        threshold_mantissa=shared_value(threshold),
        dash_syn=shared_value(dash_syn),
        dash_mem=shared_value(dash_mem),
        current_decay_error=current_error,
        potential_decay_error=potential_error,
        weight_shifts=tuple(shifts),
    )


def _decay_errors(quantized: QuantizedXylo, name: str) -> tuple[float, float]:
    """Return the largest errors of the decays of a population's currents and potentials."""
    # A network that was trained in the chip's integers has exactly their decays.
    if quantized.parts.on_grid:
        return 0.0, 0.0
    neurons = neurons_of((quantized.parts.network.population(name),))
    dash_syn, dash_mem = quantized.dashes_of(name)
    return _decay_error(neurons.decay_u, dash_syn), _decay_error(neurons.decay_v, dash_mem)


def _decay_error(decay: FloatArray, dash: IntArray) -> float:
    """Return the largest difference between a decay and that of its dash, relative to the decay."""
    return float(np.max(np.abs(xylo.share_lost(dash) - decay) / decay))
