"""Where the difference between float network and chip comes from, stage by stage.

A float network becomes a chip program in stages. A twin runs any of them as on the chip and the others exactly. The
budget says which spikes each stage changes alone, which all others change without it, and which all change together;
the cause says what each stage adds to the potential that decided the first spike that differs.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import lru_cache
from operator import methodcaller
from typing import Literal, get_args

from hw_model.description.chip import Registers
from hw_model.values import ByteArray, FloatArray, Frozen, Sums, picked
from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import Neuron
from locsnn_compile.network.projections import values_of
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import ReferenceResult, evaluate
from locsnn_compile.verification.error_budget.forms import forms_of
from locsnn_compile.verification.error_budget.numbers import GroupNumbers, Numbers
from locsnn_compile.verification.error_budget.twin import Twin, run_twins
from locsnn_compile.verification.matching import Divergence, PopulationMatch, Progress, ScoreMatch
from locsnn_compile.verification.observation import Observation, Observed, neuron_steps

Stage = Literal["kernel", "weights", "decays", "states", "thresholds", "delays", "wraps_clips"]
"""What a twin has as on the chip instead of exact:

- ``kernel``: the neuron model, if the strategy's differs from the network's
- ``weights``: weights and biases rounded onto the grid, also those of refractory kernels
- ``decays``: those of the chip's grid, with the gain of each kernel that fits them best
- ``states``: what a decay leaves in a register is truncated to an integer
- ``thresholds``: a spike if v exceeds the chip's, instead of v >= theta
- ``delays``: whole steps, which they already are in the network
- ``wraps_clips``: charge and current wrap, the voltage clips
"""
STAGES: tuple[Stage, ...] = get_args(Stage)
TAILS: Literal["tails"] = "tails"
"""A stage of networks that cut their kernels: their twins have whole kernels, as the chip has."""
AnyStage = Stage | Literal["tails"]


class Phase(Frozen, eq=False):
    """The populations of one phase in exact and in chip numbers, both for the float neurons and for the program's."""

    name: str
    registers: Registers
    float_neurons: Numbers
    program_neurons: Numbers

    @property
    def on_grid(self) -> bool:
        """Whether no stage changes a number: all exact numbers are the chip's."""
        return all(pair.exact is pair.chip for pair in self.program_neurons.groups)


@lru_cache(maxsize=1)
def phases_of(levels: Levels) -> tuple[Phase, ...]:
    """Return every phase of a lowered network."""
    registers, populations = levels.program.chip.registers, levels.quantized.populations
    phases = []
    for phase in levels.network.phases:
        forms = [
            forms_of(q.population.neuron, levels, q)
            for q in populations
            if q.population.phase == phase.name
        ]
        numbers = sum((float_neurons for float_neurons, _ in forms), start=Numbers())
        exact = all(float_neurons is program_neurons for float_neurons, program_neurons in forms)
        program = (
            numbers
            if exact
            else sum((program_neurons for _, program_neurons in forms), start=Numbers())
        )
        phases.append(Phase(phase.name, registers, numbers, program))
    return tuple(phases)


def lines_of(network: Network, phase: Phase, recordings: ByteArray) -> dict[str, ByteArray]:
    """Return the spikes (batch, steps, lines) of the inputs of a phase."""
    return {view.name: view.play(recordings) for view in network.views if view.phase == phase.name}


def twin_with(phase: Phase, stages: Collection[Stage]) -> Twin:
    """Return the twin of a phase with some stages as on the chip and the others exact."""
    numbers = phase.program_neurons if "kernel" in stages else phase.float_neurons
    taken = [name for name, stage in _OF_STAGE.items() if stage in stages]
    groups = (
        replace(pair.exact, bias=_bias(pair, stages), **picked(pair.chip, *taken))
        for pair in numbers.groups
    )
    which = {"rounded": "weights" in stages, "chip_decays": "decays" in stages}
    synapses = (replace(pair.exact, weights=pair.weights(**which)) for pair in numbers.synapses)
    return Twin(
        tuple(groups), tuple(s for s in synapses if values_of(s.weights).any()), phase.registers
    )


def _twins(phase: Phase, variants: Sequence[Collection[Stage]]) -> list[Twin]:
    if phase.on_grid:
        return [twin_with(phase, STAGES)] * len(variants)
    return [twin_with(phase, variant) for variant in variants]


def working(phases: Collection[Phase]) -> list[Stage]:
    """Return the stages that can change any number of these phases; the others need not be run."""
    same = all(phase.float_neurons is phase.program_neurons for phase in phases)
    return [stage for stage in STAGES if stage != "delays" and not (same and stage == "kernel")]


_OF_STAGE: dict[str, Stage] = {
    "keep_u": "decays",
    "keep_v": "decays",
    "threshold": "thresholds",
    "truncates": "states",
    "limited": "wraps_clips",
}
"""What a stage takes from the chip's group, by field."""


def _bias(pair: GroupNumbers, stages: Collection[Stage]) -> FloatArray:
    """Return exact or rounded biases, fitted to exact or to rounded decays."""
    bias = (pair.chip if "weights" in stages else pair.exact).bias
    if ("weights" in stages) == ("decays" in stages):
        return bias
    return bias * pair.bias_ratio if "decays" in stages else bias / pair.bias_ratio


NEURON_STEPS_AT_ONCE = 1 << 22
"""Neurons times steps of all variants held at a time, so memory does not grow with the number of recordings."""


class Deviation(Sums, eq=False):
    """How a variant differs from the float network: in spikes by population, predicted classes, and class scores."""

    by_population: Mapping[str, PopulationMatch] = field(default_factory=dict)
    predictions_changed: int = 0
    scores: ScoreMatch = ScoreMatch()

    @property
    def spikes(self) -> PopulationMatch:
        """All populations together."""
        return sum(self.by_population.values(), start=PopulationMatch())


class StageErrors(Frozen, eq=False):
    """The difference between float network and chip over ``samples`` recordings, stage by stage.

    ``alone[stage]``: the float network with this stage as on the chip. ``without[stage]``: the chip with this stage
    exact. Stages that change no number are in neither. ``together``: all stages, which is the chip. ``unexplained``
    counts the spikes in which the twin without stages differs from the float reference, and the twin with all stages
    from the simulator: 0 if no stage is missing. ``kernel_tail``: the float network with its kernels cut where
    slayerPytorch cuts them. The chip does not do that, but it matters to networks trained that way; None without such
    kernels. Where the network itself cuts them, that is the stage :data:`TAILS`: it alone is the network with whole
    kernels, with which other stages alone are compared.
    """

    samples: int
    alone: Mapping[AnyStage, Deviation]
    without: Mapping[AnyStage, Deviation]
    together: Deviation
    unexplained: int
    kernel_tail: Deviation | None


def error_budget(
    observed: Observed, numbers: tuple[int, ...], progress: Progress | None = None
) -> StageErrors:
    """Break the difference down on the recordings with these numbers."""
    levels = observed.levels
    network = levels.network
    whole = _each(network, methodcaller("whole"))
    cuts = network.cuts_kernels
    cut = network if cuts else _each(whole, methodcaller("cut"))
    phases = phases_of(levels)
    stages = working(phases)
    variants: list[Collection[Stage]] = [(), stages, *([stage] for stage in stages)]
    variants += [[other for other in stages if other != stage] for stage in stages]
    twins = [(phase, _twins(phase, variants)) for phase in phases]
    unexplained = 0
    tallies = [Deviation()] * (len(variants) + whole.by_strategy)
    at_once = max(1, NEURON_STEPS_AT_ONCE // (len(variants) * neuron_steps(whole)))
    done = 0
    for seen in observed.closely(numbers):
        for start in range(0, len(seen), at_once):
            chunk = _Chunk(levels, seen, slice(start, start + at_once))
            own = chunk.reference()
            wanted = chunk.evaluated(whole) if cuts else own
            played = _play(whole, levels.quantized, twins, chunk.recordings)
            unexplained += _different(played[0][0], wanted.spikes)
            unexplained += _different(played[1][0], chunk.chip_spikes())
            if whole.by_strategy:
                cut_short = own if cuts else chunk.evaluated(cut)
                played.append(played[1] if cuts else (cut_short.spikes, cut_short.scores))
            # With whole kernels, the network is what other stages alone change, and what is left
            # without the tails.
            each_stage = len(stages)
            references = [own, own, *[wanted] * each_stage, *[own] * each_stage, wanted]
            tallies = [
                so_far + _deviation(whole, reference, *variant)
                for so_far, reference, variant in zip(tallies, references, played, strict=False)
            ]
            done += len(chunk.recordings)
            if progress:
                progress(done, len(numbers))
    exact, together, *of_variants = tallies
    last = of_variants.pop() if whole.by_strategy else None
    alone = dict[AnyStage, Deviation](zip(stages, of_variants, strict=False))
    without = dict[AnyStage, Deviation](zip(stages, of_variants[len(stages) :], strict=True))
    if cuts and last is not None:
        alone[TAILS], without[TAILS] = exact, last
    return StageErrors(len(numbers), alone, without, together, unexplained, None if cuts else last)


class _Chunk(Frozen, eq=False):
    """Some recordings of an observation, few enough for the twins of all variants."""

    levels: Levels
    seen: Observation
    rows: slice

    @property
    def recordings(self) -> ByteArray:
        return self.seen.recordings[self.rows]

    def reference(self) -> ReferenceResult:
        """Return what the network itself does."""
        whole = self.seen.reference
        spikes = {name: array[self.rows] for name, array in whole.spikes.items()}
        potential = {name: array[self.rows] for name, array in whole.potential.items()}
        return ReferenceResult(spikes, potential, whole.scores[self.rows], whole.tie_class)

    def evaluated(self, network: Network) -> ReferenceResult:
        """Return what another float network does."""
        registers = self.levels.program.chip.registers
        return evaluate(network, self.recordings, registers=registers)

    def chip_spikes(self) -> dict[str, ByteArray]:
        return {name: array[self.rows] for name, array in self.seen.chip.spikes.items()}


def _each(network: Network, changed: Callable[[Neuron], Neuron]) -> Network:
    """Return a network with its neurons changed."""
    return replace(
        network,
        populations=tuple(replace(p, neuron=changed(p.neuron)) for p in network.populations),
    )


def _deviation(
    network: Network, wanted: ReferenceResult, spikes: Mapping[str, ByteArray], scores: FloatArray
) -> Deviation:
    """Compare a variant with the float network."""
    spikes_of = {
        p.name: PopulationMatch.of(wanted.spikes[p.name], spikes[p.name])
        for p in network.own_populations
    }
    changed = int((network.readout.decided(scores) != network.readout.decided(wanted.scores)).sum())
    return Deviation(spikes_of, changed, ScoreMatch.of(wanted.scores, scores))


_Played = tuple[Mapping[str, ByteArray], FloatArray]
"""Spikes by population, and class scores."""


def _play(
    network: Network,
    quantized: QuantizedNetwork,
    twins: Sequence[tuple[Phase, Sequence[Twin]]],
    recordings: ByteArray,
) -> list[_Played]:
    """Play some recordings to the twins of every variant, whose potentials are in units of the registers."""
    readout, traces = quantized.readout, []
    for phase, of_phase in twins:
        kept = tuple(sorted({group.name for group in of_phase[0].groups} & set(readout.from_step)))
        different = list(dict.fromkeys(of_phase))
        ran = run_twins(different, lines_of(network, phase, recordings), potentials=kept)
        traces.append([ran[different.index(twin)] for twin in of_phase])
    played: list[_Played] = []
    for variant in zip(*traces, strict=True):
        spikes, potential = (
            {name: array for trace in variant for name, array in getattr(trace, kind).items()}
            for kind in ("spikes", "potential")
        )
        played.append((spikes, readout.scores(spikes, potential) / quantized.score_scale))
    return played


def _different(spikes: Mapping[str, ByteArray], others: Mapping[str, ByteArray]) -> int:
    return sum(int((array != others[name]).sum()) for name, array in spikes.items())


class Cause(Frozen, eq=False):
    """The difference of the two potentials at the first spike that differs, stage by stage.

    Until then all spikes are equal, so each stage can be judged by itself: ``moved[stage]`` is how far it alone moves
    the float potential, in the float network's units, and ``together`` is how far all stages move it. ``enough`` lists
    the stages that alone make the neuron decide as on the chip. Stages that change no number are left out.
    """

    moved: Mapping[AnyStage, float]
    together: float
    enough: tuple[AnyStage, ...]

    @property
    def rest(self) -> float:
        """What the stages add only in combination."""
        return self.together - sum(self.moved.values())

    @property
    def largest(self) -> AnyStage:
        """The stage that moves the potential furthest in the direction of the difference."""
        return max(
            self.moved,
            key=lambda stage: self.moved[stage] if self.together >= 0 else -self.moved[stage],
        )


def find_cause(observed: Observed, first: Divergence) -> Cause:
    """Explain the first divergence."""
    levels = observed.levels
    network = levels.network
    phases = phases_of(levels)
    population = levels.quantized.population(first.population)
    phase = next(phase for phase in phases if phase.name == population.population.phase)
    until = slice(0, first.step + 1)
    seen = observed.recording(first.recording)
    lines = {
        name: played[:, until] for name, played in lines_of(network, phase, seen.recordings).items()
    }
    equal = {name: spikes[:, until] for name, spikes in seen.reference.spikes.items()}
    scale = float(population.scale[first.neuron])

    stages = working(phases)
    variants = [(), stages, *([stage] for stage in stages)]
    twins = [twin_with(phase, variant) for variant in variants]
    traces = run_twins(twins, lines, forced=equal, potentials=(first.population,))
    at = (0, first.step, first.neuron)
    # For each variant, the potential in float units and whether the neuron spikes.
    (exact, decides), (chip, fires), *others = (
        (
            float(trace.potential[first.population][at]) / scale,
            bool(trace.spikes[first.population][at]),
        )
        for trace in traces
    )
    alone = dict(zip(stages, others, strict=True))
    moved: dict[AnyStage, float] = {
        stage: potential - exact for stage, (potential, _) in alone.items()
    }
    decisions: dict[AnyStage, bool] = {stage: decision for stage, (_, decision) in alone.items()}
    begin = exact
    if network.cuts_kernels:
        # Twins have whole kernels: what a stage does to the network's own potential, it does without them.
        begin = first.reference_potential
        decisions = {stage: begin + far >= first.threshold for stage, far in moved.items()} | {
            TAILS: decides
        }
        moved[TAILS] = exact - begin
    enough = tuple(stage for stage, decision in decisions.items() if decision == fires)
    return Cause(moved, chip - begin, enough)
