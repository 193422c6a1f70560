"""The stages in which a float network becomes a chip program, and a twin with any of them as on the chip."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal, get_args

from hw_model.description.chip import Registers
from hw_model.values import ByteArray, FloatArray, Frozen
from locsnn_compile.network.network import Network
from locsnn_compile.network.projections import values_of
from locsnn_compile.pipeline import Levels
from locsnn_compile.verification.error_budget.forms import forms_of
from locsnn_compile.verification.error_budget.numbers import GroupNumbers, Numbers, SynapseNumbers
from locsnn_compile.verification.error_budget.twin import Twin, TwinGroup, TwinSynapses

Stage = Literal["kernel", "weights", "decays", "states", "thresholds", "delays", "wraps_clips"]
"""What is as on the chip, and not exact:

- ``kernel``: the neuron model, where the strategy has another one than the network
- ``weights``: weights and biases, rounded onto the grid; those of refractory kernels too
- ``decays``: multiples of 1/4096, and the gain of each kernel is the one that fits best with them
- ``states``: what a decay leaves of a register is cut to an integer
- ``thresholds``: a spike where v > 64 * threshold, in place of v >= theta
- ``delays``: whole steps, as they are in the network already
- ``wraps_clips``: charge and current wrap, the voltage clips
"""
STAGES: tuple[Stage, ...] = get_args(Stage)


class Phase(Frozen, eq=False):
    """The populations of one phase, in exact numbers and in the chip's: by the float neurons, and by the program's."""

    name: str
    registers: Registers
    float_neurons: Numbers
    program_neurons: Numbers


def phases_of(levels: Levels) -> tuple[Phase, ...]:
    """Return every phase of a lowered network."""
    registers, populations = levels.program.chip.registers, levels.quantized.populations
    phases = []
    for phase in levels.network.phases:
        forms = [forms_of(q.population.neuron, levels, q) for q in populations if q.population.phase == phase.name]
        numbers = _joined([float_neurons for float_neurons, _ in forms])
        exact = all(float_neurons is program_neurons for float_neurons, program_neurons in forms)
        program = numbers if exact else _joined([program_neurons for _, program_neurons in forms])
        phases.append(Phase(phase.name, registers, numbers, program))
    return tuple(phases)


def _joined(populations: Sequence[Numbers]) -> Numbers:
    return Numbers(
        tuple(group for numbers in populations for group in numbers.groups),
        tuple(synapses for numbers in populations for synapses in numbers.synapses),
    )


def lines_of(network: Network, phase: Phase, recordings: ByteArray) -> dict[str, ByteArray]:
    """Return the spikes (batch, steps, lines) of the inputs of a phase."""
    return {view.name: view.play(recordings) for view in network.views if view.phase == phase.name}


def neuron_steps(network: Network) -> int:
    """Return neurons times steps of one recording: what its evaluation takes."""
    return sum(population.size * network.steps_of(population.phase) for population in network.populations)


def twin_with(phase: Phase, stages: Collection[Stage]) -> Twin:
    """Return the twin of a phase with some stages as on the chip and the others exact."""
    numbers = phase.program_neurons if "kernel" in stages else phase.float_neurons
    return Twin(
        tuple(_group(pair, stages) for pair in numbers.groups),
        tuple(s for pair in numbers.synapses if values_of((s := _synapses(pair, stages)).weights).any()),
        phase.registers,
    )


def working(phases: Collection[Phase], stage: Stage) -> bool:
    """Return whether a stage changes any number of these phases; one that changes none need not be run."""
    if stage == "kernel":
        return any(phase.float_neurons is not phase.program_neurons for phase in phases)
    return stage != "delays"


def _group(pair: GroupNumbers, stages: Collection[Stage]) -> TwinGroup:
    exact, chip = pair.exact, pair.chip
    decays = chip if "decays" in stages else exact
    return replace(
        exact,
        keep_u=decays.keep_u,
        keep_v=decays.keep_v,
        threshold=(chip if "thresholds" in stages else exact).threshold,
        bias=_bias(pair, stages),
        truncates=(chip if "states" in stages else exact).truncates,
        limited=(chip if "wraps_clips" in stages else exact).limited,
    )


def _synapses(pair: SynapseNumbers, stages: Collection[Stage]) -> TwinSynapses:
    weights = pair.weights(rounded="weights" in stages, chip_decays="decays" in stages)
    return replace(pair.exact, weights=weights)


def _bias(pair: GroupNumbers, stages: Collection[Stage]) -> FloatArray:
    """Return exact or rounded biases, fitted to exact or rounded decays."""
    bias = (pair.chip if "weights" in stages else pair.exact).bias
    if ("weights" in stages) == ("decays" in stages):
        return bias
    return bias * pair.bias_ratio if "decays" in stages else bias / pair.bias_ratio
