"""What each stage alone, all but each, and all together change against the float network, spike by spike."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from operator import methodcaller

import hw_model as hw
from hw_model.mapping.graph import Readout
from hw_model.values import ByteArray, FloatArray, Frozen, Sums
from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import Neuron
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import ReferenceResult, decided, evaluate
from locsnn_compile.verification.error_budget.stages import (
    STAGES,
    Phase,
    Stage,
    lines_of,
    neuron_steps,
    phases_of,
    twin_with,
    working,
)
from locsnn_compile.verification.error_budget.twin import Twin, run_twins
from locsnn_compile.verification.matching import PopulationMatch, Progress

NEURON_STEPS_AT_ONCE = 1 << 22
"""Neurons times steps of all variants that are held at a time, so that memory does not grow with the recordings."""


class Deviation(Sums, eq=False):
    """How a variant of the network differs from the float network: spikes by population, and predicted classes."""

    by_population: Mapping[str, PopulationMatch] = field(default_factory=dict)
    predictions_changed: int = 0

    @property
    def spikes(self) -> PopulationMatch:
        """All populations together."""
        return sum(self.by_population.values(), start=PopulationMatch())


class StageErrors(Frozen, eq=False):
    """The difference between float network and chip over ``samples`` recordings, taken apart.

    ``alone[stage]``: the float network with this stage as on the chip. ``without[stage]``: the chip with this stage
    exact. Stages that change no number are in neither. ``together``: all of them, which is the chip. ``unexplained``
    counts the spikes that the float reference has differently with no stage, and the simulator with all: 0 if nothing
    was forgotten. ``kernel_tail``: the float network with its kernels cut where slayerPytorch cuts them; that is no
    part of the chip, but matters to a network that was trained that way. None without such kernels.
    """

    samples: int
    alone: Mapping[Stage, Deviation]
    without: Mapping[Stage, Deviation]
    together: Deviation
    unexplained: int
    kernel_tail: Deviation | None


def error_budget(levels: Levels, recordings: ByteArray, progress: Progress | None = None) -> StageErrors:
    """Take the difference apart over recordings (samples, steps, channels), of the network's own steps and channels."""
    network, phases = _each(levels.network, methodcaller("whole")), phases_of(levels)
    cut, registers = _each(network, methodcaller("cut")), levels.program.chip.registers
    stages = [stage for stage in STAGES if working(phases, stage)]
    variants: list[Collection[Stage]] = [(), stages, *([stage] for stage in stages)]
    variants += [[other for other in stages if other != stage] for stage in stages]
    twins = [(phase, [twin_with(phase, variant) for variant in variants]) for phase in phases]
    unexplained, tallies = 0, [Deviation()] * (len(variants) + network.by_strategy)
    at_once = max(1, NEURON_STEPS_AT_ONCE // (len(variants) * neuron_steps(network)))
    for start in range(0, len(recordings), at_once):
        chunk = recordings[start : start + at_once]
        wanted = evaluate(network, chunk, registers=registers)
        played = _play(network, levels.quantized.readout, twins, chunk)
        unexplained += _different(played[0][0], wanted.spikes)
        unexplained += _different(played[1][0], hw.simulate(levels.program, chunk, probe=("spikes",)).spikes)
        if network.by_strategy:
            cut_short = evaluate(cut, chunk, registers=registers)
            played.append((cut_short.spikes, cut_short.scores))
        tallies = [so_far + _deviation(network, wanted, *its) for so_far, its in zip(tallies, played, strict=True)]
        if progress:
            progress(start + len(chunk), len(recordings))
    _, together, *found = tallies
    kernel_tail = found.pop() if network.by_strategy else None
    return StageErrors(
        samples=len(recordings),
        alone=dict(zip(stages, found, strict=False)),
        without=dict(zip(stages, found[len(stages) :], strict=True)),
        together=together,
        unexplained=unexplained,
        kernel_tail=kernel_tail,
    )


def _each(network: Network, changed: Callable[[Neuron], Neuron]) -> Network:
    """Return a network with other neurons."""
    return replace(network, populations=tuple(replace(p, neuron=changed(p.neuron)) for p in network.populations))


def _deviation(
    network: Network, wanted: ReferenceResult, spikes: Mapping[str, ByteArray], scores: FloatArray
) -> Deviation:
    """Compare what a variant does with what the float network does."""
    found = {p.name: PopulationMatch.of(wanted.spikes[p.name], spikes[p.name]) for p in network.own_populations}
    return Deviation(found, int((decided(scores) != decided(wanted.scores)).sum()))


_Played = tuple[Mapping[str, ByteArray], FloatArray]
"""Spikes by population, and class scores."""


def _play(
    network: Network, readout: Readout, twins: Sequence[tuple[Phase, Sequence[Twin]]], recordings: ByteArray
) -> list[_Played]:
    """Play a chunk to the twins of every variant; ``readout`` is that of potentials in registers."""
    traces = []
    for phase, of_phase in twins:
        kept = tuple(sorted({group.name for group in of_phase[0].groups} & set(readout.from_step)))
        traces.append(run_twins(of_phase, lines_of(network, phase, recordings), potentials=kept))
    found: list[_Played] = []
    for variant in zip(*traces, strict=True):
        spikes, potential = (
            {name: array for trace in variant for name, array in getattr(trace, kind).items()}
            for kind in ("spikes", "potential")
        )
        found.append((spikes, readout.scores(spikes, potential)))
    return found


def _different(spikes: Mapping[str, ByteArray], others: Mapping[str, ByteArray]) -> int:
    return sum(int((array != others[name]).sum()) for name, array in spikes.items())
