"""report.json of a program for a Xylo as a type, with the keys that the reports of all targets share.

What no published table tells, energy and time, is None and named as missing.
"""

from collections.abc import Mapping

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.values import FloatArray, IntArray
from hw_model.xylo.playing import XyloCounts
from hw_model.xylo.program import XyloProgram
from locsnn_compile.baselines.operations import ANN_NAMES
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.document import SCHEMA, GateFigures, ModelFigures
from locsnn_compile.report.figures.entries import Entry, IfKnown
from locsnn_compile.report.figures.match import (
    Accuracy,
    ChanceFigures,
    InputFigures,
    MatchFigures,
    Overflows,
    accuracy_figures,
    binning_figures,
    chance_figures,
    match_figures,
)
from locsnn_compile.report.figures.operations import (
    NotDefined,
    OperationCounts,
    OperationFigures,
    PublishedOperations,
)
from locsnn_compile.report.figures.resources import (
    LimitUse,
    ProgramUse,
    Shared,
    SkippedFigures,
    shared_value,
)
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.xylo.comparison import XyloMatch
from locsnn_compile.xylo.parts import neurons_of
from locsnn_compile.xylo.quantized import QuantizedXylo

NO_TABLE = "no table of the energies or times of this chip is published"


class EnergyNotKnown(Entry):
    """``energy``, of which nothing is published."""

    profile: None = None
    source: None = None
    per_sample_pj: None = None
    breakdown_pj: None = None
    not_included: tuple[str, ...] = (NO_TABLE,)


class TimeNotKnown(Entry):
    """``latency``, of which nothing is published; the duration of a recording is None if it is not known."""

    profile: None = None
    per_sample_ns: None = None
    per_sample_cycles: None = None
    critical_core: None = None
    basis: str = NO_TABLE
    timed: bool = False
    recording_ns: float | None = None


class XyloNumbers(Entry):
    """A population in the chip's integers.

    A decay takes away a share of 2^-dash; errors of decays are shares of the float decay.
    """

    strategy: str
    scale: Shared
    threshold_mantissa: Shared
    dash_syn: Shared
    dash_mem: Shared
    current_decay_error: float
    potential_decay_error: float
    weight_shifts: tuple[int, ...]


class XyloFigures(Entry):
    """report.json; every ``per_sample`` figure is a mean over the recordings of the check."""

    schema: str
    model: ModelFigures
    target: str
    strategy: str
    weight_bits: int
    match: MatchFigures
    accuracy: Accuracy | None
    operations: OperationFigures
    energy: EnergyNotKnown
    latency: TimeNotKnown
    resources: ProgramUse
    ann_comparison: Mapping[str, NotDefined]
    skipped: SkippedFigures
    input: InputFigures
    assumptions: tuple[str, ...]
    gates: tuple[GateFigures, ...]
    quantization: Mapping[str, XyloNumbers]
    strategy_choice: None
    chance: IfKnown[ChanceFigures]
    classes: IfKnown[tuple[str, ...]]

    @property
    def energy_pj(self) -> None:
        """No energy is known."""

    @property
    def energy_profile(self) -> None:
        """No table of energy is known."""

    @property
    def latency_ns(self) -> None:
        """No time is known."""


def xylo_figures(
    quantized: QuantizedXylo, program: XyloProgram, match: XyloMatch, grounds: Grounds
) -> XyloFigures:
    """Return the figures of a program and its check."""
    network = quantized.parts.network
    return XyloFigures(
        schema=SCHEMA,
        model=ModelFigures(network.name, network.sha256, ()),
        target=program.chip.name,
        strategy=program.provenance["strategy"],
        weight_bits=xylo.WEIGHT_BITS,
        match=match_figures(network, match, grounds, _overflows(match.total_counts)),
        accuracy=accuracy_figures(match.accuracy),
        operations=_operations(match),
        energy=EnergyNotKnown(),
        latency=_latency(network, grounds),
        resources=_resources(program),
        ann_comparison={name: NotDefined() for name in ANN_NAMES},
        skipped=_skipped(match.total_counts, grounds),
        input=InputFigures(0.0, {}),
        assumptions=tuple(grounds.assumptions),
        gates=(),
        quantization={
            population.name: _population(quantized, population.name)
            for population in quantized.populations
        },
        strategy_choice=None,
        chance=chance_figures(match.chance),
        classes=tuple(network.class_names or ()) or None,
    )


def _operations(match: XyloMatch) -> OperationFigures:
    counts, samples = match.total_counts, match.samples
    additions = match.additions / samples
    per_sample = OperationCounts(
        synaptic_ops=counts.synaptic_ops / samples,
        neuron_updates=counts.neuron_updates / samples,
        spikes=counts.spikes / samples,
        input_events=counts.input_events / samples,
        transpose_events=0.0,
    )
    return OperationFigures(
        per_sample=per_sample,
        by_branch={"time": per_sample},
        extra_spikes=counts.extra_spikes / samples,
        published_method=PublishedOperations(additions, {"time": additions}, 0.0, additions),
    )


def _overflows(counts: XyloCounts) -> Overflows:
    saturations = {
        "current_saturations": counts.current_saturations,
        "change_saturations": counts.change_saturations,
        "potential_saturations": counts.potential_saturations,
    }
    return Overflows(wraps=0, clips=counts.saturations, events={"all neurons": saturations})


def _latency(network: Network, grounds: Grounds) -> TimeNotKnown:
    seconds = grounds.step_seconds
    return TimeNotKnown(recording_ns=None if seconds is None else network.steps * seconds * 1e9)


def _resources(program: XyloProgram) -> ProgramUse:
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


def _skipped(counts: XyloCounts, grounds: Grounds) -> SkippedFigures:
    return SkippedFigures(
        steps=0,
        events_dropped=counts.lost_input_events,
        binning=binning_figures(grounds.binned),
        synapses_pruned=0,
        biases_lost=0,
        compartments_pruned=0,
    )


def _population(quantized: QuantizedXylo, name: str) -> XyloNumbers:
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
    """Return the errors of the decays of current and potential of a population."""
    if quantized.parts.on_grid:
        return 0.0, 0.0
    neurons = neurons_of((quantized.parts.network.population(name),))
    dash_syn, dash_mem = quantized.dashes_of(name)
    return _decay_error(neurons.decay_u, dash_syn), _decay_error(neurons.decay_v, dash_mem)


def _decay_error(decay: FloatArray, dash: IntArray) -> float:
    """Return the largest difference of a decay from that of its dash, as a share of the decay."""
    return float(np.max(np.abs(xylo.share_lost(dash) - decay) / decay))
