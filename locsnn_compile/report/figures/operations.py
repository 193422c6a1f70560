"""Entries of report.json on operations: those of the chip, those on paper, and those of conventional networks."""

import math
from collections.abc import Mapping

import hw_model as hw
from hw_model.description.counts import Counts, total
from locsnn_compile.baselines import operations as paper
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import Entry, IfKnown
from locsnn_compile.verification.matching import Match


class OperationCounts(Entry):
    """What the chip counts, mean per recording."""

    synaptic_ops: float
    neuron_updates: float
    spikes: float
    input_events: float
    transpose_events: float


class PublishedOperations(Entry):
    """Operations on paper: spikes of the reference times fan-out, and events through the transpose buffer."""

    additions: float
    additions_by_branch: Mapping[str, float]
    transpose_events: float
    operations: float


class OperationFigures(Entry):
    """``operations``: of the chip, in all and by branch, and of the published method.

    ``extra_spikes`` are those beyond the first of a neuron in a step, where cores can send several.
    """

    per_sample: OperationCounts
    by_branch: Mapping[str, OperationCounts]
    extra_spikes: IfKnown[float]
    published_method: PublishedOperations


class ConventionalNetwork(Entry):
    """A conventional network on the same input.

    ``ratio`` is to the float network's operations on paper, and ``chip_ratio`` to the program's
    synaptic operations; they are None if there are no such operations.
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
    """A conventional network that is not defined for this network's input."""

    operations: None = None
    ratio: None = None
    chip_ratio: None = None


Conventional = Mapping[str, ConventionalNetwork | NotDefined]


def operation_figures(match: Match) -> OperationFigures:
    """Return the operations of both sides."""
    return OperationFigures(
        per_sample=_per_sample(total(match.counts), match.samples),
        by_branch={
            name: _per_sample(counts, match.samples)
            for name, counts in match.counts_by_phase.items()
        },
        extra_spikes=None,
        published_method=_published(match),
    )


def _per_sample(counts: Counts, samples: int) -> OperationCounts:
    return OperationCounts(
        synaptic_ops=counts.synaptic_ops / samples,
        neuron_updates=counts["neuron_updates"] / samples,
        spikes=counts.spikes / samples,
        input_events=counts.input_events / samples,
        transpose_events=counts.transpose_events / samples,
    )


def _published(match: Match) -> PublishedOperations:
    by_branch = {axis: n / match.samples for axis, n in match.additions.items()}
    transposed = total(match.counts).transpose_events / match.samples
    additions = math.fsum(by_branch.values())
    return PublishedOperations(additions, by_branch, transposed, additions + transposed)


def conventional_networks(
    network: Network, operations: OperationFigures, own_pj: float | None
) -> Conventional:
    """Return the published comparison at this network's input size."""
    return {name: _conventional(name, network, operations, own_pj) for name in paper.ANN_NAMES}


def _conventional(
    name: str, network: Network, operations: OperationFigures, own_pj: float | None
) -> ConventionalNetwork | NotDefined:
    counts = _ann_counts(name, network)
    if counts is None:
        return NotDefined()
    on_paper = operations.published_method.operations
    on_chip = operations.per_sample.synaptic_ops
    energies = paper.ann_energy_pj(counts)
    return ConventionalNetwork(
        operations=counts.operations,
        ratio=counts.operations / on_paper if on_paper else None,
        chip_ratio=counts.operations / on_chip if on_chip else None,
        macs=counts.macs,
        multiplications=counts.multiplications,
        additions=counts.additions,
        energy_pj=energies,
        energy_ratio={name: pj / own_pj if own_pj else None for name, pj in energies.items()},
        energy_source=paper.ANN_ENERGY_SOURCE,
        energy_not_included=tuple(paper.ANN_NOT_INCLUDED),
    )


def _ann_counts(name: str, network: Network) -> paper.AnnCounts | None:
    """Return the operations of an artificial network on this input; None if it is not defined for it."""
    if network.sensor is None:
        return None
    try:
        return paper.ann_counts(
            name, sensor=network.sensor, steps=network.steps, classes=network.classes
        )
    except hw.InputError:  # no frames, or a recording too short for that network's kernels
        return None
