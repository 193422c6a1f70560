"""Build the figures of a report: :class:`ReportFigures` has a field for every key of report.json.

``report_figures`` takes what the compiler and the check produced and calls one function per key, each in
a module of this folder. The pages and the terminal show the same figures in words.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Protocol, Self

from hw_model.description.counts import total
from hw_model.targets import target_of
from hw_model.values import Frozen
from locsnn_compile.network.network import Member
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.figures.bounds import BoundFigures, bound_figures
from locsnn_compile.report.figures.checks import (
    BudgetFigures,
    CauseFigures,
    ChoiceFigures,
    MarginFigures,
    NotFollowed,
    OverTimeFigures,
    budget_figures,
    cause_figures,
    choice_figures,
    margin_figures,
    over_time_figures,
)
from locsnn_compile.report.figures.energy import EnergyFigures, energy_figures
from locsnn_compile.report.figures.entries import (
    INLINED,
    NULLS,
    Entry,
    IfKnown,
    LeftOut,
)
from locsnn_compile.report.figures.host import HostFigures, host_figures
from locsnn_compile.report.figures.latency import LatencyFigures, latency_figures
from locsnn_compile.report.figures.match import (
    Accuracy,
    ChanceFigures,
    InputFigures,
    MatchFigures,
    Overflows,
    accuracy_figures,
    chance_figures,
    input_figures,
    match_figures,
)
from locsnn_compile.report.figures.operations import (
    Conventional,
    OperationFigures,
    conventional_networks,
    operation_figures,
)
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.figures.registers import OverflowFigures, overflow_figures
from locsnn_compile.report.figures.resources import (
    PopulationNumbers,
    ProgramUse,
    ProvenRange,
    ResourceFigures,
    SkippedFigures,
    population_numbers,
    proven_ranges,
    resource_figures,
    skipped_figures,
)
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.request.choose_strategy import Choice
from locsnn_compile.request.without_overflows import OverflowSearch
from locsnn_compile.verification.diagnosis import Diagnosis
from locsnn_compile.verification.event_peaks import EventPeaks
from locsnn_compile.verification.matching import Match
from locsnn_compile.verification.over_time import OverTime
from locsnn_compile.verification.wide_registers import WideComparison

SCHEMA = "locsnn-report/1"
"""The name and version of the format of report.json; its first entry."""


class MemberFigures(Entry):
    """A member of a committee (networks whose class scores are added up): its cores, energy and time.

    The energy is that of its compartments, and the time is what it would take without the others. Both
    are None if unknown, as where one core hosts all members, one after the other.
    """

    member: Annotated[Member, INLINED]
    cores: int
    per_sample_pj: float | None
    per_sample_ns: float | None


class ModelFigures(Entry):
    """The network that was compiled; ``members`` is empty unless it is a committee."""

    name: str
    sha256: str | None
    members: tuple[MemberFigures, ...]


class GateFigures(Entry):
    """A gate: a bound that the user sets on a figure, and the measured value, None if nothing was measured."""

    name: str
    bound: float
    measured: float | None
    passed: bool


class ReportFigures(Entry):
    """All figures of report.json, in the order of its keys; ``per_sample`` is a mean over the recordings of the check.

    The annotations say which keys are absent, null or inlined; see ``figures/entries.py``.
    """

    schema: str
    model: ModelFigures
    target: str
    strategy: str
    weight_bits: int
    match: MatchFigures
    accuracy: Accuracy | None
    chance: IfKnown[ChanceFigures]
    classes: IfKnown[tuple[str, ...]]
    operations: OperationFigures
    host: IfKnown[HostFigures]
    energy: Annotated[EnergyFigures | None, NULLS]
    activity: IfKnown[Mapping[str, Mapping[str, float]]]
    latency: LatencyFigures
    resources: ResourceFigures
    ann_comparison: Conventional
    skipped: SkippedFigures
    input: InputFigures
    assumptions: tuple[str, ...]
    gates: tuple[GateFigures, ...]
    quantization: Mapping[str, PopulationNumbers]
    range: Mapping[str, ProvenRange]
    overflows: IfKnown[OverflowFigures]
    bounds: IfKnown[BoundFigures]
    error_budget: Annotated[BudgetFigures | None, LeftOut(without="margins")]
    margins: IfKnown[MarginFigures]
    over_time: IfKnown[OverTimeFigures | NotFollowed]
    strategy_choice: ChoiceFigures | None
    placed: IfKnown[PlacedFigures] = None

    @property
    def energy_pj(self) -> float | None:
        """Mean energy per recording; None if unknown."""
        return None if self.energy is None else self.energy.per_sample_pj

    @property
    def energy_profile(self) -> str | None:
        """The name of the cost profile that the energy is computed with; None if the energy is unknown."""
        return None if self.energy is None else self.energy.profile

    @property
    def latency_ns(self) -> float | None:
        """Mean time per recording; None if unknown."""
        return self.latency.per_sample_ns if self.latency.timed else None

    def with_gates(self, gates: tuple[GateFigures, ...]) -> Self:
        """Return the same figures with these gates."""
        return replace(self, gates=gates)


class SharedFigures(Protocol):
    """The figures that the reports of all kinds of targets have, by which gates and commands read any of them."""

    @property
    def schema(self) -> str:
        """The version of the document's keys."""

    @property
    def model(self) -> ModelFigures:
        """The network that was compiled."""

    @property
    def target(self) -> str:
        """The name of the chip."""

    @property
    def strategy(self) -> str:
        """How neurons were lowered."""

    @property
    def weight_bits(self) -> int:
        """The widest weights."""

    @property
    def match(self) -> MatchFigures:
        """How the program on the chip compares with the network."""

    @property
    def accuracy(self) -> Accuracy | None:
        """The accuracy of both sides; None without labels."""

    @property
    def chance(self) -> ChanceFigures | None:
        """The test against chance; None without enough labels."""

    @property
    def operations(self) -> OperationFigures:
        """The operations of both sides."""

    @property
    def energy_pj(self) -> float | None:
        """Mean energy per recording; None if unknown."""

    @property
    def energy_profile(self) -> str | None:
        """The name of the cost profile that the energy is computed with; None if the energy is unknown."""

    @property
    def latency_ns(self) -> float | None:
        """Mean time per recording; None if unknown."""

    @property
    def resources(self) -> ProgramUse:
        """What the program takes."""

    @property
    def skipped(self) -> SkippedFigures:
        """What was skipped, dropped, pruned or lost."""

    @property
    def input(self) -> InputFigures:
        """How many steps recordings have before their first event, where a phase waits for it."""

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What the figures rest on, in sentences."""

    @property
    def gates(self) -> tuple[GateFigures, ...]:
        """Bounds that the build must keep."""

    def with_gates(self, gates: tuple[GateFigures, ...], /) -> Self:
        """Return the same figures with these gates."""


class Findings(Frozen, eq=False):
    """The results of further checks beyond the match; None for a check that was not made.

    - ``diagnosis``: the error budget, the margins, and the cause of the first divergence
    - ``followed``: predictions over time, or the reason why there are none
    - ``choice``: the settings that ``auto`` compared, and the one that it chose
    - ``wide``: the match with registers too wide to wrap or clip, or the reason why there is none
    - ``search``: other settings that were tried because registers wrapped or clipped
    - ``peaks``: the rates of events that bounds on time are stated for
    """

    diagnosis: Diagnosis | None = None
    followed: OverTime | str | None = None
    choice: Choice | None = None
    wide: WideComparison | str | None = None
    search: OverflowSearch | None = None
    peaks: EventPeaks | None = None


_NOTHING = Findings()


def report_figures(
    levels: Levels, match: Match, grounds: Grounds, findings: Findings = _NOTHING
) -> ReportFigures:
    """Return the figures of a build.

    ``levels`` is the network at all levels of compiling, and ``match`` the comparison of the program with
    the network. The gates are still empty: they are checked against these figures and added afterwards.
    """
    network = levels.network
    program = levels.program
    target = target_of(program.chip)
    counts = total(match.counts)
    diagnosis = findings.diagnosis
    energy = energy_figures(program, match, network, grounds.step_seconds)
    operations = operation_figures(match)
    overflows = Overflows(counts.wraps, counts.clips, match.wraps_and_clips)
    over_time = None
    if findings.followed:
        over_time = over_time_figures(findings.followed, program, grounds.step_seconds)
    return ReportFigures(
        schema=SCHEMA,
        model=ModelFigures(network.name, network.sha256, _members(levels, match, energy)),
        target=program.chip.name,
        strategy=program.provenance["strategy"],
        weight_bits=max(projection.weight_bits for projection in levels.quantized.projections),
        match=match_figures(network, match, grounds, overflows, _cause(diagnosis)),
        accuracy=accuracy_figures(match.accuracy),
        chance=chance_figures(match.chance),
        classes=tuple(network.class_names or ()) or None,
        operations=operations,
        host=host_figures(network),
        energy=energy,
        activity=target.memory_accesses(program, network.steps, counts, match.samples),
        latency=latency_figures(program, match, network.steps, grounds.step_seconds),
        resources=resource_figures(program, network.steps),
        ann_comparison=conventional_networks(
            network, operations, None if energy is None else energy.per_sample_pj
        ),
        skipped=skipped_figures(levels, match, grounds),
        input=input_figures(network, match),
        assumptions=tuple(grounds.assumptions),
        gates=(),
        quantization=population_numbers(levels.quantized),
        range=proven_ranges(program),
        overflows=overflow_figures(network, match, findings.wide, findings.search),
        bounds=bound_figures(program, match, network.steps, findings.peaks, grounds.step_seconds),
        error_budget=None if diagnosis is None else budget_figures(diagnosis),
        margins=None if diagnosis is None else margin_figures(diagnosis),
        over_time=over_time,
        strategy_choice=choice_figures(findings.choice),
    )


def _cause(diagnosis: Diagnosis | None) -> CauseFigures | None:
    return None if diagnosis is None else cause_figures(diagnosis.cause)


def _members(
    levels: Levels, match: Match, energy: EnergyFigures | None
) -> tuple[MemberFigures, ...]:
    return tuple(_member(member, levels, match, energy) for member in levels.network.members)


def _member(
    member: Member, levels: Levels, match: Match, energy: EnergyFigures | None
) -> MemberFigures:
    target = target_of(levels.program.chip)
    # Everything of a member is named ``member/...``. Members do not share a core, so the first group
    # of compartments on a core says whose it is.
    prefix = f"{member.name}/"
    cores = [core for core in levels.program.cores if core.slices[0].group.startswith(prefix)]
    per_sample_pj = None
    per_sample_ns = None
    if energy is not None:
        populations = energy.by_population_pj.items()
        per_sample_pj = math.fsum(
            population.pj for name, population in populations if name.startswith(prefix)
        )
    if target.timed and target.times_cores:
        per_sample_ns = match.member_ns[member.name] / match.samples
    return MemberFigures(member, len(cores), per_sample_pj, per_sample_ns)
