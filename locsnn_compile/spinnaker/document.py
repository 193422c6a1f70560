"""report.json of a program for SpiNNaker as a type, with the keys that the reports of all targets share.

Energy, of which no table was checked, is None and named as missing. Time is that of a board that
keeps up: a millisecond a step.
"""

from collections.abc import Mapping

from hw_model.arithmetic import spinnaker
from hw_model.spinnaker.network import SpinnakerPopulation
from hw_model.spinnaker.playing import SpinnakerCounts
from hw_model.spinnaker.program import SpinnakerProgram
from locsnn_compile.baselines.operations import ANN_NAMES
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.report.figures.document import SCHEMA, GateFigures, ModelFigures
from locsnn_compile.report.figures.entries import Entry, IfKnown
from locsnn_compile.report.figures.match import (
    Accuracy,
    ChanceFigures,
    InputFigures,
    MatchFigures,
    Overflows,
    SpikesCompared,
    accuracy_figures,
    binning_figures,
    chance_figures,
    match_figures,
    spikes_compared,
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
from locsnn_compile.spinnaker.comparison import SpinnakerMatch
from locsnn_compile.spinnaker.lower import LoweredSpinnaker, ScaledPopulation
from locsnn_compile.spinnaker.own_choice import own_shifts

NO_TABLE = "no table of the energies of this chip was checked"
STEP_NS = 1e6
"""A step of a board takes a millisecond."""
REAL_TIME = "a board that keeps up takes 1 ms a step; loading it takes longer, and is not included"
WORD_BITS = 32
"""A synapse is a word of memory."""


class EnergyNotKnown(Entry):
    """``energy``, of which nothing was checked."""

    profile: None = None
    source: None = None
    per_sample_pj: None = None
    breakdown_pj: None = None
    not_included: tuple[str, ...] = (NO_TABLE,)


class RealTime(Entry):
    """``latency`` of a board that keeps up with its steps, phase after phase."""

    per_sample_ns: float
    recording_ns: float | None
    profile: None = None
    per_sample_cycles: None = None
    critical_core: None = None
    basis: str = REAL_TIME
    timed: bool = True


class SpinnakerNumbers(Entry):
    """A population in the numbers of IF_curr_exp, as its neurons share them.

    A weight of 1 of the integers is ``weight_unit_na``, and a potential of 1 ``potential_unit_mv``.
    Shifts and largest sums of a step are those of what excites, then of what inhibits.
    """

    strategy: str
    scale: Shared
    weight_unit_na: float
    potential_unit_mv: float
    largest_sums_na: tuple[float, float]
    ring_shifts: tuple[int, int]
    weights_rounded: int
    tau_m_ms: Shared
    tau_syn_ms: Shared
    c_m_nf: Shared
    v_thresh_mv: Shared
    current_decay_error: float


class OwnScale(Entry):
    """The shifts that sPyNNaker would choose for a population, and what the program would do with them.

    ``equal_spikes`` of the ``program_spikes`` are at the same neuron and step; both are None if
    nobody has checked shifts as large as these.
    """

    ring_shifts: tuple[int, int]
    program_spikes: int | None
    equal_spikes: int | None


class SpinnakerFigures(Entry):
    """report.json; every ``per_sample`` figure is a mean over the recordings of the check.

    ``integers_match`` compares the program with the integers that it was made from.
    """

    schema: str
    model: ModelFigures
    target: str
    strategy: str
    weight_bits: int
    match: MatchFigures
    accuracy: Accuracy | None
    operations: OperationFigures
    energy: EnergyNotKnown
    latency: RealTime
    resources: ProgramUse
    ann_comparison: Mapping[str, NotDefined]
    skipped: SkippedFigures
    input: InputFigures
    assumptions: tuple[str, ...]
    gates: tuple[GateFigures, ...]
    quantization: Mapping[str, SpinnakerNumbers]
    integers_match: Mapping[str, SpikesCompared]
    own_scale: Mapping[str, OwnScale]
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
    def latency_ns(self) -> float:
        """The time of a recording on a board that keeps up."""
        return self.latency.per_sample_ns


def spinnaker_figures(
    quantized: QuantizedNetwork,
    lowered: LoweredSpinnaker,
    program: SpinnakerProgram,
    match: SpinnakerMatch,
    grounds: Grounds,
) -> SpinnakerFigures:
    """Return the figures of a program and its check."""
    network = quantized.network
    return SpinnakerFigures(
        schema=SCHEMA,
        model=ModelFigures(network.name, network.sha256, ()),
        target=program.chip.name,
        strategy=quantized.strategy,
        weight_bits=max(projection.weight_bits for projection in quantized.projections),
        match=match_figures(network, match, grounds, _overflows(match)),
        accuracy=accuracy_figures(match.accuracy),
        operations=_operations(match),
        energy=EnergyNotKnown(),
        latency=_time(network, grounds),
        resources=_resources(program),
        ann_comparison={name: NotDefined() for name in ANN_NAMES},
        skipped=_skipped(quantized, match.total_counts, grounds),
        input=InputFigures(0.0, {}),
        assumptions=tuple(grounds.assumptions),
        gates=(),
        quantization={
            scaled.name: _numbers(quantized, scaled, program.network.population(scaled.name))
            for scaled in lowered.scaled
        },
        integers_match={name: spikes_compared(spikes) for name, spikes in match.integers.items()},
        own_scale=_own_scale(program, match),
        strategy_choice=None,
        chance=chance_figures(match.chance),
        classes=tuple(network.class_names or ()) or None,
    )


def _overflows(match: SpinnakerMatch) -> Overflows:
    counts = match.total_counts
    return Overflows(
        wraps=counts.wraps,
        clips=counts.saturated_weights,
        events={
            f"phase {name}": _events(of_phase) for name, of_phase in match.counts_by_phase.items()
        },
    )


def _events(counts: SpinnakerCounts) -> dict[str, int]:
    return {name: getattr(counts, name) for name in spinnaker.EVENTS}


def _operations(match: SpinnakerMatch) -> OperationFigures:
    samples = match.samples
    by_branch = {name: additions / samples for name, additions in match.additions.items()}
    additions = sum(by_branch.values())
    transposed = match.total_counts.transpose_events / samples
    return OperationFigures(
        per_sample=_per_sample(match.total_counts, samples),
        by_branch={
            name: _per_sample(counts, samples) for name, counts in match.counts_by_phase.items()
        },
        extra_spikes=None,
        published_method=PublishedOperations(
            additions, by_branch, transposed, additions + transposed
        ),
    )


def _per_sample(counts: SpinnakerCounts, samples: int) -> OperationCounts:
    return OperationCounts(
        synaptic_ops=counts.synaptic_ops / samples,
        neuron_updates=counts.neuron_updates / samples,
        spikes=counts.spikes / samples,
        input_events=counts.input_events / samples,
        transpose_events=counts.transpose_events / samples,
    )


def _time(network: Network, grounds: Grounds) -> RealTime:
    steps = sum(network.steps_of(phase.name) for phase in network.phases)
    seconds = grounds.step_seconds
    recording_ns = None if seconds is None else network.steps * seconds * 1e9
    return RealTime(steps * STEP_NS, recording_ns)


def _resources(program: SpinnakerProgram) -> ProgramUse:
    network = program.network
    chip = program.chip
    synapses = sum(len(projection.weight) for projection in network.projections)
    cores = {phase.name: network.cores_of(phase.name) for phase in network.phases}
    return ProgramUse(
        cores=max(cores.values()),
        compartments=sum(population.size for population in network.populations),
        synapses=synapses,
        synapse_bits=synapses * WORD_BITS,
        axons_in=sum(item.size for item in network.inputs),
        axons_out=sum(population.size for population in network.populations),
        limits={
            "cores": LimitUse(max(cores.values()), chip.cores),
            "neurons": LimitUse(_fullest(network.populations), chip.neurons_per_core),
            "bits_of_ring_buffer": LimitUse(
                max(population.ring_bits for population in network.populations), chip.ring_bits
            ),
            "synapses_of_a_source": LimitUse(
                max(network.longest_rows().values(), default=0), chip.synapses_per_row
            ),
        },
    )


def _fullest(populations: tuple[SpinnakerPopulation, ...]) -> int:
    """Return the neurons of the fullest core."""
    return max(min(population.size, population.neurons_per_core) for population in populations)


def _skipped(
    quantized: QuantizedNetwork, counts: SpinnakerCounts, grounds: Grounds
) -> SkippedFigures:
    return SkippedFigures(
        steps=0,
        events_dropped=counts.events_dropped,
        binning=binning_figures(grounds.binned),
        synapses_pruned=quantized.weights_pruned,
        biases_lost=sum(population.biases_lost for population in quantized.populations),
        compartments_pruned=0,
    )


def _numbers(
    quantized: QuantizedNetwork, scaled: ScaledPopulation, population: SpinnakerPopulation
) -> SpinnakerNumbers:
    parameters = population.parameters
    source = quantized.population(scaled.name)
    sums = tuple(each * scaled.scales.weight_unit for each in scaled.sums)
    return SpinnakerNumbers(
        strategy=source.strategy,
        scale=shared_value(source.scale),
        weight_unit_na=scaled.scales.weight_unit,
        potential_unit_mv=scaled.scales.potential_unit,
        largest_sums_na=(sums[0], sums[1]),
        ring_shifts=population.shifts,
        weights_rounded=scaled.weights_rounded,
        tau_m_ms=shared_value(parameters.tau_m / spinnaker.ONE),
        tau_syn_ms=shared_value(parameters.tau_syn / spinnaker.ONE),
        c_m_nf=shared_value(parameters.c_m / spinnaker.ONE),
        v_thresh_mv=shared_value(parameters.v_thresh / spinnaker.ONE),
        current_decay_error=scaled.current_decay_error,
    )


def _own_scale(program: SpinnakerProgram, match: SpinnakerMatch) -> dict[str, OwnScale]:
    shifts = own_shifts(program.network)
    if match.own_scale is None:
        return {name: OwnScale(each, None, None) for name, each in shifts.items()}
    return {
        name: OwnScale(shifts[name], spikes.reference_spikes, spikes.common_spikes)
        for name, spikes in match.own_scale.items()
    }
