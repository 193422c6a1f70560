"""Entries of report.json on the program itself, not on recordings.

They are the use of the chip's limits, what compiling left out, how numbers were rounded, and which
registers are proven never to overflow. The *open core* is our own RTL: one core of hardware that plays all
cores of a program, one after the other, and whose memories are known word by word.

A field with the mark ``INLINED`` holds an entry whose keys stand next to those of the outer one, without nesting.
"""

from collections.abc import Mapping
from typing import Annotated

import hw_model as hw
from hw_model.description.chip import Mesh
from hw_model.description.counts import total
from hw_model.description.open_core import MemoryUse
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.targets import target_of
from hw_model.values import AnyArray
from locsnn_compile.network.quantized import KernelFit, QuantizedNetwork, QuantizedPopulation
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.figures.entries import INLINED, Entry, IfKnown
from locsnn_compile.report.figures.match import BinningFigures, binning_figures
from locsnn_compile.report.figures.spread import Place, place
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.verification.matching import Match


class LimitUse(Entry):
    """How much of a limit is in use; for a limit that each core has, the use of the fullest core."""

    used: int
    limit: int


class MemoryFigures(Entry):
    """How full a memory is: the words that the program fills, the words that it has, and the bits of a word."""

    used_words: int
    words: int
    word_bits: int

    @property
    def used_bits(self) -> int:
        """The bits that the program fills."""
        return self.used_words * self.word_bits

    @property
    def bits(self) -> int:
        """The bits of the whole memory."""
        return self.words * self.word_bits


class MeshSize(Entry):
    """The number of chips of a target, the cores of each, and the tiles of a chip in columns and rows."""

    chips: int
    cores_per_chip: int
    tiles: Annotated[Mesh, INLINED]


class CoreContents(Entry):
    """How many compartments, synapses, axons and table entries a core holds."""

    compartments: int
    synapses: int
    synapse_words: int
    axons_in: int
    axons_out: int
    synapse_formats: int
    compartment_profiles: int
    threshold_profiles: int


class CoreUse(Entry):
    """The place of a core, and what it holds."""

    place: Annotated[Place, INLINED]
    contents: Annotated[CoreContents, INLINED]


class ProgramUse(Entry):
    """What a program takes of a chip of any kind; ``limits`` are by name, such as ``compartments``.

    ``cores`` counts cores of hardware.
    """

    cores: int
    compartments: int
    synapses: int
    synapse_bits: int
    axons_in: int
    axons_out: int
    limits: Mapping[str, LimitUse]


class ResourceFigures(ProgramUse):
    """``resources``: what the program takes of the chip, and of each core.

    ``by_core`` has an entry for each core of the program; the open core plays them all, so its ``cores`` is 1.
    ``memories`` are those of an open core; a mesh has the limits of its cores instead.
    """

    mesh: MeshSize
    by_core: tuple[CoreUse, ...]
    memories: IfKnown[Mapping[str, MemoryFigures]] = None


class SkippedFigures(Entry):
    """``skipped``: steps skipped, events dropped, synapses and compartments pruned, biases lost.

    ``steps`` are those that the engine skipped because they could not change anything. Biases are lost
    where they round to 0. ``binning`` is absent where recordings were not sorted from events.
    """

    steps: int
    events_dropped: int
    binning: IfKnown[BinningFigures]
    synapses_pruned: int
    biases_lost: int
    compartments_pruned: int


Shared = int | float | tuple[int | float, int | float]
"""The value that all neurons share, or else the least and the largest."""


class PopulationNumbers(Entry):
    """How a population was rounded to the chip's integers.

    ``scale`` is the number of register units per unit of the network's potential. ``weight_exponents``
    are those of the projections onto it, in order. ``kernel_fit`` is None for neurons without kernels.
    """

    strategy: str
    scale: Shared
    threshold_mantissa: Shared
    decay_u: Shared
    decay_v: Shared
    kernel_fit: KernelFit | None
    weight_exponents: tuple[int, ...]


class ProvenRange(Entry):
    """What is proven about the registers of a group of compartments, for any input.

    ``cannot_wrap`` and ``cannot_clip`` count the compartments that no input can bring to wrap or clip.
    If every source spikes at most once in ``safe_period_steps`` steps, none of the compartments does
    either; None if no period that was tried is long enough.
    """

    compartments: int
    cannot_wrap: int
    cannot_clip: int
    safe_period_steps: int | None


def resource_figures(program: ChipProgram, steps: int) -> ResourceFigures:
    """Return what a program takes, for recordings of ``steps`` steps."""
    target = target_of(program.chip)
    by_core = tuple(_core_use(program, core) for core in program.cores)
    contents = [core.contents for core in by_core]
    # Longer recordings need more of an open core, which keeps the events of a recording for location neurons.
    uses = target.limits_used(program, steps)
    synapse_words = sum(core.synapse_words for core in contents)
    return ResourceFigures(
        cores=target.cores_used(program),
        compartments=sum(core.compartments for core in contents),
        synapses=sum(core.synapses for core in contents),
        synapse_bits=synapse_words * program.chip.synapse_memory.word_bits,
        axons_in=sum(core.axons_in for core in contents),
        axons_out=sum(core.axons_out for core in contents),
        limits={name: LimitUse(use.used, use.limit) for name, use in uses.items()},
        mesh=MeshSize(program.chip.chips, program.chip.limits.cores_per_chip, program.chip.mesh),
        by_core=by_core,
        memories=_memories(target.memories_used(program, steps)),
    )


def _memories(uses: Mapping[str, MemoryUse]) -> dict[str, MemoryFigures] | None:
    """Return the figures of memories by name; None for a target that has limits instead."""
    figures = {name: MemoryFigures(*use) for name, use in uses.items()}
    return figures or None


def _core_use(program: ChipProgram, core: Core) -> CoreUse:
    contents = CoreContents(
        compartments=core.compartments,
        synapses=len(core.axons.target),
        synapse_words=core.axons.synapse_words,
        axons_in=core.axons.input_axons,
        axons_out=core.axons.output_axons,
        synapse_formats=len(core.axons.formats),
        compartment_profiles=len(core.profiles),
        threshold_profiles=len(core.thresholds),
    )
    return CoreUse(place(program, core), contents)


def skipped_figures(levels: Levels, match: Match, grounds: Grounds) -> SkippedFigures:
    """Return what was skipped, dropped, pruned or lost."""
    counts = total(match.counts)
    program = levels.program
    # Every compartment gets a core, so the difference is 0; it is computed so that the report shows it.
    built = sum(group.size for group in levels.compartments.groups)
    placed = sum(core.compartments for core in program.cores)
    return SkippedFigures(
        steps=counts.skipped_steps,
        events_dropped=counts.events_dropped,
        binning=binning_figures(grounds.binned),
        synapses_pruned=program.synapses_pruned,
        biases_lost=sum(population.biases_lost for population in levels.quantized.populations),
        compartments_pruned=built - placed,
    )


def population_numbers(quantized: QuantizedNetwork) -> dict[str, PopulationNumbers]:
    """Return ``quantization``: how each population was rounded, by its name."""
    return {
        population.population.name: _numbers(quantized, population)
        for population in quantized.populations
    }


def _numbers(quantized: QuantizedNetwork, population: QuantizedPopulation) -> PopulationNumbers:
    name = population.population.name
    exponents = [p.exponent for p in quantized.projections if p.target == name]
    return PopulationNumbers(
        strategy=population.strategy,
        scale=shared_value(population.scale),
        threshold_mantissa=shared_value(population.neuron.threshold),
        decay_u=shared_value(population.neuron.decay_u),
        decay_v=shared_value(population.neuron.decay_v),
        kernel_fit=population.fit,
        weight_exponents=tuple(exponents),
    )


def shared_value(values: AnyArray) -> Shared:
    """Return the value that all neurons share, or else the least and the largest, as Python's own numbers."""
    low = values.min().item()
    high = values.max().item()
    return low if low == high else (low, high)


def proven_ranges(program: ChipProgram) -> dict[str, ProvenRange]:
    """Return ``range``: what is proven about each group of compartments, by its name.

    The proof goes core by core, but a group may spread over several cores. So its results are first
    brought to columns: one entry per compartment of a phase, in which each group is a contiguous range.
    """
    core_ranges = hw.prove_range(program)
    proofs = {core.number: proof for core, proof in zip(program.cores, core_ranges, strict=True)}
    ranges = {}
    for phase in program.phases:
        cannot_wrap = program.by_column(phase.name, lambda core: proofs[core.number].cannot_wrap)
        cannot_clip = program.by_column(phase.name, lambda core: proofs[core.number].cannot_clip)
        safe_period = program.by_column(phase.name, lambda core: proofs[core.number].safe_period)
        # A program calls its groups of compartments populations, too: here they are one range of columns each.
        for group, columns in program.columns_of(phase.name).items():
            periods = safe_period[columns]
            # A period of 0 means that no period that was tried is long enough for the compartment.
            has_safe_period = periods.all()
            ranges[group] = ProvenRange(
                compartments=program.populations[group],
                cannot_wrap=int(cannot_wrap[columns].sum()),
                cannot_clip=int(cannot_clip[columns].sum()),
                safe_period_steps=int(periods.max()) if has_safe_period else None,
            )
    return ranges
