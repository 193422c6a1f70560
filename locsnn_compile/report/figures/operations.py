"""Entries of report.json on operations, of three kinds.

They are those that the chip counts, those on paper, as publications count them from spikes and
fan-out, and those of conventional (not spiking) networks on the same input.
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

    A branch is a phase of the program, such as steps over time. ``extra_spikes`` are those beyond
    the first of a neuron in a step, on chips whose cores can send several.
    """

    per_sample: OperationCounts
    by_branch: Mapping[str, OperationCounts]
    extra_spikes: IfKnown[float]
    published_method: PublishedOperations


class ConventionalNetwork(Entry):
    """A conventional network on the same input.

    Ratios say how many times as much it takes as the spiking network: ``ratio`` in operations on
    paper, ``chip_ratio`` in synaptic operations of the chip, and ``energy_ratio`` in energy. A
    ratio to nothing is None. Energies are by kind of arithmetic, such as fp32.
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
    """Return the operations that the chip counts, and those on paper."""
    return OperationFigures(
        per_sample=_per_sample(total(match.counts), match.samples),
        by_branch={
            name: _per_sample(counts, match.samples)
            for name, counts in match.counts_by_phase.items()
        },
        # A neuron of these chips sends at most one spike in a step.
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
    network: Network, operations: OperationFigures, own_pj: float | None
) -> Conventional:
    """Return the published comparison at this network's input size, by conventional network.

    ``own_pj`` is the energy of the spiking network per recording, None where it is not known.
    """
    return {name: _conventional(name, network, operations, own_pj) for name in paper.ANN_NAMES}


def _conventional(
    name: str, network: Network, operations: OperationFigures, own_pj: float | None
) -> ConventionalNetwork | NotDefined:
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
            arithmetic: _ratio(pj, own_pj) for arithmetic, pj in energy_by_arithmetic.items()
        },
        energy_source=paper.ANN_ENERGY_SOURCE,
        energy_not_included=tuple(paper.ANN_NOT_INCLUDED),
    )


def _ratio(conventional: float, spiking: float | None) -> float | None:
    """Return how many times as much a conventional network takes; None if the other takes nothing."""
    return conventional / spiking if spiking else None


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
