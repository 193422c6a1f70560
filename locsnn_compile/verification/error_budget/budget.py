"""Where the difference between float network and chip comes from, stage by stage.

A float network becomes a chip program in stages, such as rounding weights or decays. A *twin* (``twin.py``) is a
float64 simulation of the program in which any of the stages can be as on the chip and the others exact. A *variant*
is a choice of stages. The error budget (:func:`error_budget`) plays recordings to variants: it says which spikes each
stage changes alone, which all others change without it, and which all change together. The cause (:func:`find_cause`)
says how much each stage adds to the potential at the first spike that differs.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import lru_cache
from operator import methodcaller
from typing import Literal, NamedTuple, get_args

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
"""The parts of the chip's arithmetic that a twin can have instead of exact numbers:

- ``kernel``: the neuron model of the strategy, if it differs from the network's
- ``weights``: weights and biases rounded onto the grid, also those of refractory kernels
- ``decays``: decays on the chip's grid, with the gain of each kernel that fits them best
- ``states``: after a decay, registers are truncated to integers
- ``thresholds``: a neuron spikes if v exceeds the chip's threshold, instead of if v >= theta
- ``delays``: delays are whole steps, which they already are in the network
- ``wraps_clips``: charge and current wrap, the voltage clips
"""
STAGES: tuple[Stage, ...] = get_args(Stage)
TAILS: Literal["tails"] = "tails"
"""A further stage of networks that cut their kernels: the chip, and so every twin, has whole kernels instead."""
AnyStage = Stage | Literal["tails"]


class Phase(Frozen, eq=False):
    """The populations of one phase in exact and in chip numbers.

    ``float_neurons`` are laid out as the network's neuron model, ``program_neurons`` as the program's; they are the
    same object if the strategy implements the model exactly, apart from rounding.
    """

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
    """Return every phase of a lowered network; kept for the last one, since cause, budget and margins all need it."""
    phases = []
    for phase in levels.network.phases:
        forms = [
            forms_of(q.population.neuron, levels, q)
            for q in levels.quantized.populations
            if q.population.phase == phase.name
        ]
        float_numbers = sum((float_neurons for float_neurons, _ in forms), start=Numbers())
        program_numbers = float_numbers
        if not all(float_neurons is program_neurons for float_neurons, program_neurons in forms):
            program_numbers = sum(
                (program_neurons for _, program_neurons in forms), start=Numbers()
            )
        phases.append(
            Phase(
                name=phase.name,
                registers=levels.program.chip.registers,
                float_neurons=float_numbers,
                program_neurons=program_numbers,
            )
        )
    return tuple(phases)


def lines_of(network: Network, phase: Phase, recordings: ByteArray) -> dict[str, ByteArray]:
    """Return the spikes (batch, steps, lines) of the inputs of a phase."""
    return {view.name: view.play(recordings) for view in network.views if view.phase == phase.name}


def twin_with(phase: Phase, stages: Collection[Stage]) -> Twin:
    """Return the twin of a phase with some stages as on the chip and the others exact."""
    numbers = phase.program_neurons if "kernel" in stages else phase.float_neurons
    fields_as_on_chip = [name for name, stage in _STAGE_OF_FIELD.items() if stage in stages]
    groups = (
        replace(pair.exact, bias=_bias(pair, stages), **picked(pair.chip, *fields_as_on_chip))
        for pair in numbers.groups
    )
    synapses = (
        replace(
            pair.exact,
            weights=pair.weights(rounded="weights" in stages, chip_decays="decays" in stages),
        )
        for pair in numbers.synapses
    )
    # Synapses of weight 0 only cost time.
    synapses_in_use = tuple(s for s in synapses if values_of(s.weights).any())
    return Twin(tuple(groups), synapses_in_use, phase.registers)


def _twins(phase: Phase, variants: Sequence[Collection[Stage]]) -> list[Twin]:
    """Return the twin of every variant; one for all if no stage changes a number, so that it is run only once."""
    if phase.on_grid:
        return [twin_with(phase, STAGES)] * len(variants)
    return [twin_with(phase, variant) for variant in variants]


def working(phases: Collection[Phase]) -> list[Stage]:
    """Return the stages that can change any number of these phases; the others need not be run."""
    has_same_kernels = all(phase.float_neurons is phase.program_neurons for phase in phases)
    idle: set[Stage] = {"delays"}
    if has_same_kernels:
        idle.add("kernel")
    return [stage for stage in STAGES if stage not in idle]


_STAGE_OF_FIELD: dict[str, Stage] = {
    "keep_u": "decays",
    "keep_v": "decays",
    "threshold": "thresholds",
    "truncates": "states",
    "limited": "wraps_clips",
}
"""The stage that takes a field of ``TwinGroup`` from the chip's numbers, by the name of the field."""


def _bias(pair: GroupNumbers, stages: Collection[Stage]) -> FloatArray:
    """Return exact or rounded biases, fitted to exact or to rounded decays.

    The chip's biases are fitted to rounded decays, the exact ones to exact decays. If only one of the two stages is as
    on the chip, the bias is fitted to the other decays.
    """
    is_rounded = "weights" in stages
    has_chip_decays = "decays" in stages
    bias = pair.chip.bias if is_rounded else pair.exact.bias
    if is_rounded == has_chip_decays:
        return bias
    if has_chip_decays:
        return bias * pair.bias_ratio
    return bias / pair.bias_ratio


NEURON_STEPS_AT_ONCE = 1 << 22
"""Largest number of neurons times steps of all variants that are run at a time, so that memory does not grow with the
number of recordings."""


class Deviation(Sums, eq=False):
    """How a variant differs from the float network: in spikes by population, predicted classes, and class scores.

    The deviations of parts of the recordings can be added.
    """

    by_population: Mapping[str, PopulationMatch] = field(default_factory=dict)
    predictions_changed: int = 0
    scores: ScoreMatch = ScoreMatch()

    @property
    def spikes(self) -> PopulationMatch:
        """All populations together."""
        return sum(self.by_population.values(), start=PopulationMatch())


class StageErrors(Frozen, eq=False):
    """The difference between float network and chip over ``samples`` recordings, stage by stage.

    - ``alone[stage]``: the float network with this stage as on the chip
    - ``without[stage]``: the chip with this stage exact; stages that change no number are in neither
    - ``together``: all stages, which is the chip
    - ``unexplained``: the number of spikes in which the twin without stages differs from the float reference, and the
      twin with all stages from the simulator: 0 if no stage is missing
    - ``kernel_tail``: the float network with its kernels cut where slayerPytorch cuts them. The chip does not do that,
      but it matters to networks trained that way. None for neurons without such kernels.

    If the network itself cuts its kernels, that is the stage :data:`TAILS` instead, and ``kernel_tail`` is None. This
    stage alone is the network with whole kernels, with which all other stages alone are compared.
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
    """Break the difference down on the recordings with these ``numbers``."""
    levels = observed.levels
    network = levels.network
    # Twins have whole kernels, as the chip has; the network's own may be cut.
    whole_network = _with_neurons(network, methodcaller("whole"))
    cuts_kernels = network.cuts_kernels
    phases = phases_of(levels)
    stages = working(phases)
    # No stage, all stages, each stage alone, and all stages but one.
    variants: list[Collection[Stage]] = [(), stages, *([stage] for stage in stages)]
    variants += [[other for other in stages if other != stage] for stage in stages]
    twins = [(phase, _twins(phase, variants)) for phase in phases]
    unexplained = 0
    # One more for networks with kernels: the tails of their kernels.
    deviations = [Deviation()] * (len(variants) + whole_network.by_strategy)
    recordings_at_once = max(
        1, NEURON_STEPS_AT_ONCE // (len(variants) * neuron_steps(whole_network))
    )
    done = 0
    for observation in observed.closely(numbers):
        for start in range(0, len(observation), recordings_at_once):
            chunk = _Chunk(levels, observation, slice(start, start + recordings_at_once))
            network_result = chunk.reference()
            whole_result = chunk.evaluate(whole_network) if cuts_kernels else network_result
            played = _play(whole_network, levels.quantized, twins, chunk.recordings)
            no_stage, all_stages = played[:2]
            unexplained += _count_differences(no_stage.spikes, whole_result.spikes)
            unexplained += _count_differences(all_stages.spikes, chunk.chip_spikes())
            if whole_network.by_strategy and cuts_kernels:
                # The chip without the tails: compared with the network of whole kernels.
                played.append(all_stages)
            elif whole_network.by_strategy:
                cut = chunk.evaluate(_with_neurons(whole_network, methodcaller("cut")))
                played.append(_Played(cut.spikes, cut.scores))
            # Each variant has its reference. A stage alone, and the tails, are compared with whole kernels.
            references = [network_result] * 2
            references += [whole_result] * len(stages)
            references += [network_result] * len(stages)
            references.append(whole_result)
            deviations = [
                so_far + _deviation(whole_network, reference, variant)
                for so_far, reference, variant in zip(deviations, references, played, strict=False)
            ]
            done += len(chunk.recordings)
            if progress:
                progress(done, len(numbers))
    exact, together, *of_variants = deviations
    tails = of_variants.pop() if whole_network.by_strategy else None
    alone = dict[AnyStage, Deviation](zip(stages, of_variants, strict=False))
    without = dict[AnyStage, Deviation](zip(stages, of_variants[len(stages) :], strict=True))
    kernel_tail = tails
    if cuts_kernels and tails is not None:
        # The twin without stages has whole kernels, and so only the tails.
        alone[TAILS] = exact
        without[TAILS] = tails
        kernel_tail = None
    return StageErrors(
        samples=len(numbers),
        alone=alone,
        without=without,
        together=together,
        unexplained=unexplained,
        kernel_tail=kernel_tail,
    )


class _Chunk(Frozen, eq=False):
    """Some recordings of an observation, few enough for the twins of all variants."""

    levels: Levels
    observation: Observation
    rows: slice

    @property
    def recordings(self) -> ByteArray:
        """The recordings, (rows, steps, channels)."""
        return self.observation.recordings[self.rows]

    def reference(self) -> ReferenceResult:
        """Return the result of the network itself."""
        result = self.observation.reference
        spikes = {name: array[self.rows] for name, array in result.spikes.items()}
        potential = {name: array[self.rows] for name, array in result.potential.items()}
        return ReferenceResult(spikes, potential, result.scores[self.rows], result.tie_class)

    def evaluate(self, network: Network) -> ReferenceResult:
        """Return the result of another float network."""
        registers = self.levels.program.chip.registers
        return evaluate(network, self.recordings, registers=registers)

    def chip_spikes(self) -> dict[str, ByteArray]:
        """Return the spikes of the program, by population."""
        return {name: array[self.rows] for name, array in self.observation.chip.spikes.items()}


def _with_neurons(network: Network, change: Callable[[Neuron], Neuron]) -> Network:
    """Return a network with ``change`` applied to the neurons of every population."""
    populations = tuple(replace(p, neuron=change(p.neuron)) for p in network.populations)
    return replace(network, populations=populations)


class _Played(NamedTuple):
    """What a variant does: spikes by population, and class scores."""

    spikes: Mapping[str, ByteArray]
    scores: FloatArray


def _deviation(network: Network, reference: ReferenceResult, variant: _Played) -> Deviation:
    """Compare a variant with the float network."""
    by_population = {
        p.name: PopulationMatch.of(reference.spikes[p.name], variant.spikes[p.name])
        for p in network.own_populations
    }
    before = network.readout.decided(reference.scores)
    after = network.readout.decided(variant.scores)
    return Deviation(
        by_population=by_population,
        predictions_changed=int((after != before).sum()),
        scores=ScoreMatch.of(reference.scores, variant.scores),
    )


def _play(
    network: Network,
    quantized: QuantizedNetwork,
    twins: Sequence[tuple[Phase, Sequence[Twin]]],
    recordings: ByteArray,
) -> list[_Played]:
    """Play some recordings to the twins of every variant, phase by phase.

    Twins have potentials in units of the registers, so the readout is that of the integers.
    """
    readout = quantized.readout
    traces_by_phase = []
    for phase, of_phase in twins:
        group_names = {group.name for group in of_phase[0].groups}
        potentials = tuple(sorted(group_names & set(readout.from_step)))
        # Variants may share a twin, which is run once.
        different = list(dict.fromkeys(of_phase))
        lines = lines_of(network, phase, recordings)
        traces = run_twins(different, lines, potentials=potentials)
        traces_by_phase.append([traces[different.index(twin)] for twin in of_phase])
    played: list[_Played] = []
    for traces_of_variant in zip(*traces_by_phase, strict=True):
        spikes: dict[str, ByteArray] = {}
        potential: dict[str, FloatArray] = {}
        for trace in traces_of_variant:
            spikes |= trace.spikes
            potential |= trace.potential
        scores = readout.scores(spikes, potential) / quantized.score_scale
        played.append(_Played(spikes, scores))
    return played


def _count_differences(spikes: Mapping[str, ByteArray], others: Mapping[str, ByteArray]) -> int:
    """Return the number of spikes that only one of two sides has."""
    return sum(int((array != others[name]).sum()) for name, array in spikes.items())


class Cause(Frozen, eq=False):
    """The difference of the two potentials at the first spike that differs, stage by stage.

    Until then all spikes are equal, so each stage can be judged by itself: ``moved[stage]`` is how far it alone moves
    the float potential, in the float network's units, and ``together`` is how far all stages move it. ``enough`` lists
    the stages that alone make the neuron spike, or not spike, as on the chip. Stages that change no number are left
    out.
    """

    moved: Mapping[AnyStage, float]
    together: float
    enough: tuple[AnyStage, ...]

    @property
    def rest(self) -> float:
        """How far the stages move the potential only in combination."""
        return self.together - sum(self.moved.values())

    @property
    def largest(self) -> AnyStage:
        """The stage that moves the potential furthest in the direction of the difference."""
        direction = 1 if self.together >= 0 else -1
        return max(self.moved, key=lambda stage: direction * self.moved[stage])


class _Decision(NamedTuple):
    """The potential of a neuron in one step, in the float network's units, and whether the neuron spikes."""

    potential: float
    spikes: bool


def find_cause(observed: Observed, first: Divergence) -> Cause:
    """Explain the first divergence: play its recording, up to its step, to twins that are given the same spikes."""
    levels = observed.levels
    network = levels.network
    phases = phases_of(levels)
    population = levels.quantized.population(first.population)
    phase = next(phase for phase in phases if phase.name == population.population.phase)
    until = slice(0, first.step + 1)
    observation = observed.recording(first.recording)
    lines = {
        name: spikes[:, until]
        for name, spikes in lines_of(network, phase, observation.recordings).items()
    }
    spikes_until = {name: spikes[:, until] for name, spikes in observation.reference.spikes.items()}
    scale = float(population.scale[first.neuron])

    stages = working(phases)
    variants = [(), stages, *([stage] for stage in stages)]
    twins = [twin_with(phase, variant) for variant in variants]
    traces = run_twins(twins, lines, forced=spikes_until, potentials=(first.population,))
    at = (0, first.step, first.neuron)
    exact, chip, *each_alone = (
        _Decision(
            potential=float(trace.potential[first.population][at]) / scale,
            spikes=bool(trace.spikes[first.population][at]),
        )
        for trace in traces
    )
    alone = dict(zip(stages, each_alone, strict=True))
    moved: dict[AnyStage, float] = {
        stage: decision.potential - exact.potential for stage, decision in alone.items()
    }
    spikes_with: dict[AnyStage, bool] = {
        stage: decision.spikes for stage, decision in alone.items()
    }
    float_potential = exact.potential
    if network.cuts_kernels:
        # Twins have whole kernels, and the network has not. A stage is taken to move the network's own potential as far
        # as it moves that of the twin.
        float_potential = first.reference_potential
        spikes_with = {
            stage: float_potential + distance >= first.threshold
            for stage, distance in moved.items()
        }
        spikes_with[TAILS] = exact.spikes
        moved[TAILS] = exact.potential - float_potential
    enough = tuple(stage for stage, spikes in spikes_with.items() if spikes == chip.spikes)
    return Cause(moved, chip.potential - float_potential, enough)
