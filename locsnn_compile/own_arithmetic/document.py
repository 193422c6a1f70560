"""Entries of report.json that all chips with an arithmetic of their own share.

No energies of such chips are published. An unknown figure is None, and the entry next to it says why it is missing.
The order of fields is the order of entries in report.json: first :class:`FirstEntries`, then those of a family, then
:class:`LastEntries`.
"""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any, Protocol, Self, TypedDict

from locsnn_compile.baselines.operations import ANN_NAMES
from locsnn_compile.network.network import Network
from locsnn_compile.own_arithmetic.comparison import ChipCounts, ProgramMatch
from locsnn_compile.report.figures.document import SCHEMA, GateFigures, ModelFigures
from locsnn_compile.report.figures.entries import Entry, IfKnown
from locsnn_compile.report.figures.host import HostFigures, host_figures
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
from locsnn_compile.report.figures.resources import ProgramUse, SkippedFigures
from locsnn_compile.report.grounds import Grounds


class EnergyNotKnown(Entry):
    """The entry ``energy`` if no energy is known; ``not_included`` says why."""

    profile: None = None
    source: None = None
    per_sample_pj: None = None
    breakdown_pj: None = None
    not_included: tuple[str, ...] = field(kw_only=True)


class TimeNotKnown(Entry):
    """The entry ``latency`` if no time on the chip is known; ``basis`` says why.

    ``recording_ns`` is the duration of the recording itself, or None if that is unknown, too.
    """

    profile: None = None
    per_sample_ns: None = None
    per_sample_cycles: None = None
    critical_core: None = None
    basis: str = field(kw_only=True)
    timed: bool = False
    recording_ns: float | None = None


class RecordingTime(Protocol):
    """The entry ``latency`` of any family."""

    @property
    def per_sample_ns(self) -> float | None:
        """The time of a recording on the chip; None if it is unknown."""


class FirstEntries(Entry):
    """The entries of report.json before those of a family.

    Every ``per_sample`` figure is a mean over the recordings of the check.
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
    latency: RecordingTime
    resources: ProgramUse
    ann_comparison: Mapping[str, NotDefined]
    skipped: SkippedFigures
    input: InputFigures
    assumptions: tuple[str, ...]
    gates: tuple[GateFigures, ...]

    @property
    def energy_pj(self) -> None:
        """The energy of a recording, which is unknown."""

    @property
    def energy_profile(self) -> None:
        """The table of energies that was used: none."""

    @property
    def latency_ns(self) -> float | None:
        """The time of a recording on the chip; None if it is unknown."""
        return self.latency.per_sample_ns

    def with_gates(self, gates: tuple[GateFigures, ...]) -> Self:
        """Return a copy with these gates (limits that figures must meet)."""
        return replace(self, gates=gates)


class LastEntries(Entry):
    """The entries of report.json after those of a family."""

    strategy_choice: None
    chance: IfKnown[ChanceFigures]
    classes: IfKnown[tuple[str, ...]]
    host: IfKnown[HostFigures]


class CheckEntries(TypedDict):
    """The entries that follow from a network and its check, whatever the chip."""

    schema: str
    model: ModelFigures
    match: MatchFigures
    accuracy: Accuracy | None
    operations: OperationFigures
    ann_comparison: Mapping[str, NotDefined]
    input: InputFigures
    assumptions: tuple[str, ...]
    gates: tuple[GateFigures, ...]
    strategy_choice: None
    chance: ChanceFigures | None
    classes: tuple[str, ...] | None
    host: HostFigures | None


def check_entries(
    network: Network,
    match: ProgramMatch[Any],
    grounds: Grounds,
    overflows: Overflows,
    extra_spikes: float | None = None,
) -> CheckEntries:
    """Return the entries that follow from a network and its check, whatever the chip.

    ``extra_spikes`` is for chips whose neurons can spike several times in a step: the number of spikes beyond the first
    of a neuron in a step, per recording.
    """
    return CheckEntries(
        schema=SCHEMA,
        model=ModelFigures(network.name, network.sha256, ()),
        match=match_figures(network, match, grounds, overflows),
        accuracy=accuracy_figures(match.accuracy),
        operations=_operations(match, extra_spikes),
        ann_comparison={name: NotDefined() for name in ANN_NAMES},
        input=InputFigures(0.0, {}),
        assumptions=tuple(grounds.assumptions),
        gates=(),
        strategy_choice=None,
        chance=chance_figures(match.chance),
        classes=tuple(network.class_names or ()) or None,
        host=host_figures(network),
    )


def _operations(match: ProgramMatch[Any], extra_spikes: float | None) -> OperationFigures:
    """Return the counted operations per recording, in all and by phase, next to those of the published method."""
    samples = match.samples
    return OperationFigures(
        per_sample=_per_sample(match.total_counts, samples),
        by_branch={
            name: _per_sample(counts, samples) for name, counts in match.counts_by_phase.items()
        },
        extra_spikes=extra_spikes,
        published_method=_published(match),
    )


def _per_sample(counts: ChipCounts, samples: int) -> OperationCounts:
    """Return counts as means per recording."""
    return OperationCounts(
        synaptic_ops=counts.synaptic_ops / samples,
        neuron_updates=counts.neuron_updates / samples,
        spikes=counts.spikes / samples,
        input_events=counts.input_events / samples,
        transpose_events=counts.transpose_events / samples,
    )


def _published(match: ProgramMatch[Any]) -> PublishedOperations:
    """Return the operations per recording as the published method counts them, from the trained network."""
    by_branch = {phase: count / match.samples for phase, count in match.additions.items()}
    additions = sum(by_branch.values())
    transpose_events = match.total_counts.transpose_events / match.samples
    return PublishedOperations(
        additions=additions,
        additions_by_branch=by_branch,
        transpose_events=transpose_events,
        operations=additions + transpose_events,
    )


def skipped_entry(
    grounds: Grounds, *, events_dropped: int, synapses_pruned: int = 0, biases_lost: int = 0
) -> SkippedFigures:
    """Return the entry ``skipped``. These chips play every step, and their programs have all neurons, so both are 0."""
    return SkippedFigures(
        steps=0,
        events_dropped=events_dropped,
        binning=binning_figures(grounds.binned),
        synapses_pruned=synapses_pruned,
        biases_lost=biases_lost,
        compartments_pruned=0,
    )


def recording_ns(network: Network, grounds: Grounds) -> float | None:
    """Return the duration of a recording in ns, or None if the duration of a step is unknown."""
    if grounds.step_seconds is None:
        return None
    return network.steps * grounds.step_seconds * 1e9
