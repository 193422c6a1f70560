"""report.json of a program for SpiNNaker as a type, with the keys that the reports of all targets share.

Energy is None, with the reason, since no published table was checked. Time is that of a board that keeps up with its
steps of a millisecond.
"""

from collections.abc import Mapping

from hw_model.arithmetic import spinnaker
from hw_model.spinnaker.network import SpinnakerNetwork, SpinnakerPopulation
from hw_model.spinnaker.playing import SpinnakerCounts
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.spinnaker.range import reach_of, safe_period
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.own_arithmetic.document import (
    EnergyNotKnown,
    FirstEntries,
    LastEntries,
    check_entries,
    recording_ns,
    skipped_entry,
)
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.report.figures.match import Overflows, SpikesCompared, spikes_compared
from locsnn_compile.report.figures.resources import LimitUse, ProgramUse, Shared, shared_value
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.spinnaker.comparison import SpinnakerMatch
from locsnn_compile.spinnaker.lower import LoweredSpinnaker, ScaledPopulation
from locsnn_compile.spinnaker.own_choice import STEPS_PER_SECOND, own_shifts

NO_TABLE = "no table of the energies of this chip was checked"
STEP_NS = 1e6
"""A step of a board takes a millisecond."""
REAL_TIME = "a board that keeps up takes 1 ms a step; loading it takes longer, and is not included"
WORD_BITS = 32
"""A synapse is a word of memory."""


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
    """The numbers of a population's neurons on SpiNNaker.

    An integer weight of 1 is ``weight_unit_na``, and a potential of 1 is ``potential_unit_mv``. Pairs, such as shifts
    and largest sums per step, are for excitation, then inhibition.
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


class ProvenRange(Entry):
    """The input rate up to which a population is proven not to overflow, from its stored integers.

    If every source spikes at most once in ``safe_period`` steps, no ring buffer can saturate and no number can wrap: 1
    means any input, 0 that nothing is proven. This is a rate of ``events_per_second`` per source. The shares say how
    much of each limit is used in the worst case, with spikes in every step; above 1, a number may not fit.
    """

    safe_period: int
    events_per_second: float
    ring_share: float
    current_share: float
    potential_share: float

    @classmethod
    def of(cls, network: SpinnakerNetwork, name: str) -> "ProvenRange":
        """Return what can be proven of a population."""
        reach = reach_of(network, name)
        period = safe_period(network, name)
        return cls(
            safe_period=period,
            events_per_second=STEPS_PER_SECOND / period if period else 0.0,
            ring_share=reach.ring_share,
            current_share=reach.current_share,
            potential_share=reach.potential_share,
        )


class OwnScale(Entry):
    """The shifts that sPyNNaker would choose for a population, and how its spikes would compare with the program's.

    With these shifts, ``equal_spikes`` of the ``program_spikes`` still occur, at the same neuron and step. Both are
    None if our engine does not model such large shifts.
    """

    ring_shifts: tuple[int, int]
    program_spikes: int | None
    equal_spikes: int | None


class _OwnEntries(FirstEntries):
    """The entries of report.json up to those that only SpiNNaker has.

    ``integers_match`` compares the program with the integers that it was made from.
    """

    latency: RealTime
    quantization: Mapping[str, SpinnakerNumbers]
    integers_match: Mapping[str, SpikesCompared]
    range_proof: Mapping[str, ProvenRange]
    own_scale: Mapping[str, OwnScale]


class SpinnakerFigures(LastEntries, _OwnEntries):
    """report.json; every ``per_sample`` figure is a mean over the recordings of the check."""


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
        **check_entries(network, match, grounds, _overflows(match)),
        target=program.chip.name,
        strategy=quantized.strategy,
        weight_bits=max(projection.weight_bits for projection in quantized.projections),
        energy=EnergyNotKnown(not_included=(NO_TABLE,)),
        latency=_time(network, grounds),
        resources=_resources(program),
        skipped=skipped_entry(
            grounds,
            events_dropped=match.total_counts.events_dropped,
            synapses_pruned=quantized.weights_pruned,
            biases_lost=sum(population.biases_lost for population in quantized.populations),
        ),
        quantization={
            scaled.name: _numbers(quantized, scaled, program.network.population(scaled.name))
            for scaled in lowered.scaled
        },
        integers_match={name: spikes_compared(spikes) for name, spikes in match.integers.items()},
        range_proof={
            population.name: ProvenRange.of(program.network, population.name)
            for population in program.network.populations
        },
        own_scale=_own_scale(program, match),
    )


def _overflows(match: SpinnakerMatch) -> Overflows:
    """Return how often numbers wrapped or saturated; the report calls the latter clips."""
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


def _time(network: Network, grounds: Grounds) -> RealTime:
    steps = sum(network.steps_of(phase.name) for phase in network.phases)
    return RealTime(steps * STEP_NS, recording_ns(network, grounds))


def _resources(program: SpinnakerProgram) -> ProgramUse:
    """Return what the program uses of the board. Phases run one after the other, so the largest one counts."""
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
    """Return the number of neurons on the fullest core."""
    return max(min(population.size, population.neurons_per_core) for population in populations)


def _numbers(
    quantized: QuantizedNetwork, scaled: ScaledPopulation, population: SpinnakerPopulation
) -> SpinnakerNumbers:
    """Return the numbers of a population: as rounded (``quantized``), scaled, and stored (``population``)."""
    parameters = population.parameters
    integers = quantized.population(scaled.name)
    weight_unit = scaled.scales.weight_unit
    return SpinnakerNumbers(
        strategy=integers.strategy,
        scale=shared_value(integers.scale),
        weight_unit_na=weight_unit,
        potential_unit_mv=scaled.scales.potential_unit,
        largest_sums_na=(
            scaled.sums.excitatory * weight_unit,
            scaled.sums.inhibitory * weight_unit,
        ),
        ring_shifts=population.shifts,
        weights_rounded=scaled.weights_rounded,
        tau_m_ms=shared_value(parameters.tau_m / spinnaker.ONE),
        tau_syn_ms=shared_value(parameters.tau_syn / spinnaker.ONE),
        c_m_nf=shared_value(parameters.c_m / spinnaker.ONE),
        v_thresh_mv=shared_value(parameters.v_thresh / spinnaker.ONE),
        current_decay_error=scaled.current_decay_error,
    )


def _own_scale(program: SpinnakerProgram, match: SpinnakerMatch) -> dict[str, OwnScale]:
    """Return sPyNNaker's own shifts of each population, with the spikes that they leave, if these were played."""
    shifts = own_shifts(program.network)
    if match.own_scale is None:
        return {
            name: OwnScale(own, program_spikes=None, equal_spikes=None)
            for name, own in shifts.items()
        }
    return {
        name: OwnScale(shifts[name], spikes.reference_spikes, spikes.common_spikes)
        for name, spikes in match.own_scale.items()
    }
