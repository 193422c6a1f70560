"""Entries of report.json on operations, counted in three ways.

- on the chip: what the simulator counts while it plays recordings
- on paper: how publications on such networks count, as spikes times fan-out
- for comparison: the operations of conventional (not spiking) networks on the same input
"""

import math
from collections.abc import Mapping

import hw_model as hw
from hw_model.description.counts import Counts, total
from locsnn_compile.baselines import operations as paper
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import Entry, IfKnown
from locsnn_compile.verification.matching import Match


class OperationCounts(Entry):
    """What the simulator counts on the chip, as means per recording."""

    synaptic_ops: float
    neuron_updates: float
    spikes: float
    input_events: float
    transpose_events: float


class PublishedOperations(Entry):
    """Operations as publications count them: spikes of the reference times fan-out, plus buffered events.

    The events are those that go through the transpose buffer, from which location neurons read.
    """

    additions: float
    additions_by_branch: Mapping[str, float]
    transpose_events: float
    operations: float


class OperationFigures(Entry):
    """``operations``: on the chip, in all and by branch, and as publications count them.

    A branch is a phase of the program, such as steps over time. ``extra_spikes`` are those beyond
    the first of a neuron in a step, on chips whose cores can send several.
    """

    per_sample: OperationCounts
    by_branch: Mapping[str, OperationCounts]
    extra_spikes: IfKnown[float]
    published_method: PublishedOperations


class ConventionalNetwork(Entry):
    """What a conventional network takes on the same input.

    A ratio says how many times as much it takes as the spiking network: ``ratio`` in operations on
    paper, ``chip_ratio`` in synaptic operations on the chip, and ``energy_ratio`` in energy. It is None
    where the spiking network takes nothing. Energies are by kind of arithmetic, such as fp32.
    """

    operations: int
    ratio: float | None
    chip_ratio: float | None
    macs: int
    multiplications: int
    additions: int
    energy_pj: Mapping[str, float]
    energy_ratio: Mapping[str, float | None]
    energy_source: str
    energy_not_included: tuple[str, ...]


class NotDefined(Entry):
    """Stands for a conventional network that is not defined for the input of the spiking network."""

    operations: None = None
    ratio: None = None
    chip_ratio: None = None


Conventional = Mapping[str, ConventionalNetwork | NotDefined]
"""Conventional networks by name."""


def operation_figures(match: Match) -> OperationFigures:
    """Return the operations that the chip counts, and those on paper."""
    return OperationFigures(
        per_sample=_per_sample(total(match.counts), match.samples),
        by_branch={
            name: _per_sample(counts, match.samples)
            for name, counts in match.counts_by_phase.items()
        },
        # A neuron of the chips that this module reports on sends at most one spike per step.
        extra_spikes=None,
        published_method=_published(match),
    )


def _per_sample(counts: Counts, samples: int) -> OperationCounts:
    """Return the mean operations of a recording from those of all recordings."""
    return OperationCounts(
        synaptic_ops=counts.synaptic_ops / samples,
        neuron_updates=counts["neuron_updates"] / samples,
        spikes=counts.spikes / samples,
        input_events=counts.input_events / samples,
        transpose_events=counts.transpose_events / samples,
    )


def _published(match: Match) -> PublishedOperations:
    """Return the operations as the papers count them: additions, and events that are transposed."""
    by_branch = {phase: count / match.samples for phase, count in match.additions.items()}
    additions = math.fsum(by_branch.values())
    transpose_events = total(match.counts).transpose_events / match.samples
    return PublishedOperations(
        additions=additions,
        additions_by_branch=by_branch,
        transpose_events=transpose_events,
        operations=additions + transpose_events,
    )


def conventional_networks(
    network: Network, operations: OperationFigures, spiking_pj: float | None
) -> Conventional:
    """Return the comparison with each conventional network of the publication, at this network's input size.

    ``spiking_pj`` is the energy of the spiking network per recording, None if unknown.
    """
    return {name: _conventional(name, network, operations, spiking_pj) for name in paper.ANN_NAMES}


def _conventional(
    name: str, network: Network, operations: OperationFigures, spiking_pj: float | None
) -> ConventionalNetwork | NotDefined:
    """Return the comparison with one conventional network, on paper and on the chip."""
    counts = _ann_counts(name, network)
    if counts is None:
        return NotDefined()
    on_paper = operations.published_method.operations
    on_chip = operations.per_sample.synaptic_ops
    energy_by_arithmetic = paper.ann_energy_pj(counts)
    return ConventionalNetwork(
        operations=counts.operations,
        ratio=_ratio(counts.operations, on_paper),
        chip_ratio=_ratio(counts.operations, on_chip),
        macs=counts.macs,
        multiplications=counts.multiplications,
        additions=counts.additions,
        energy_pj=energy_by_arithmetic,
        energy_ratio={
            arithmetic: _ratio(pj, spiking_pj) for arithmetic, pj in energy_by_arithmetic.items()
        },
        energy_source=paper.ANN_ENERGY_SOURCE,
        energy_not_included=tuple(paper.ANN_NOT_INCLUDED),
    )


def _ratio(conventional: float, spiking: float | None) -> float | None:
    """Return how many times as much a conventional network takes; None if the spiking one takes nothing known."""
    return conventional / spiking if spiking else None


def _ann_counts(name: str, network: Network) -> paper.AnnCounts | None:
    """Return the operations of a conventional network on the input of ``network``; None if it is not defined for it."""
    if network.sensor is None:
        return None
    try:
        return paper.ann_counts(
            name, sensor=network.sensor, steps=network.steps, classes=network.classes
        )
    except hw.InputError:
        # The input has no frames, or the recording is too short for the kernels of the conventional network.
        return None
