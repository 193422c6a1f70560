"""What each stage alone, all but each, and all together change against the float network, spike by spike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter, methodcaller

import hw_model as hw
from hw_model.engine.trace import ByteArray
from hw_model.mapping.graph import Readout
from locsnn_compile.network.network import Network
from locsnn_compile.network.neurons import FloatArray, Neuron
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
from locsnn_compile.verification.error_budget.twin import Twin, run_twin
from locsnn_compile.verification.matching import PopulationMatch, Progress

NEURON_STEPS_AT_ONCE = 1 << 21
"""Neurons times steps that are held at a time, so that memory does not grow with the recordings."""


@dataclass(frozen=True, eq=False)
class Deviation:
    """How a variant of the network differs from the float network: spikes by population, and predicted classes."""

    by_population: Mapping[str, PopulationMatch]
    predictions_changed: int

    @property
    def spikes(self) -> PopulationMatch:
        """All populations together."""
        return sum(self.by_population.values(), start=PopulationMatch())


@dataclass(frozen=True, eq=False)
class StageErrors:
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

    def tally_of(*stages: Stage) -> _Tally:
        twins = [(phase, twin_with(phase, stages)) for phase in phases]
        return _Tally(network, partial(_play, network, levels.quantized.readout, twins))

    alone = {stage: tally_of(stage) for stage in stages}
    without = {stage: tally_of(*(other for other in stages if other != stage)) for stage in stages}
    none, together = tally_of(), tally_of(*stages)
    tail = _Tally(network, lambda chunk: attrgetter("spikes", "scores")(evaluate(cut, chunk, registers=registers)))
    others = [*alone.values(), *without.values(), *([tail] if network.by_strategy else [])]
    unexplained = 0
    at_once = max(1, NEURON_STEPS_AT_ONCE // neuron_steps(network))
    for start in range(0, len(recordings), at_once):
        chunk = recordings[start : start + at_once]
        wanted = evaluate(network, chunk, registers=registers)
        unexplained += _different(none.add(chunk, wanted), wanted.spikes)
        unexplained += _different(together.add(chunk, wanted), hw.simulate(levels.program, chunk).spikes)
        for tally in others:
            tally.add(chunk, wanted)
        if progress:
            progress(start + len(chunk), len(recordings))
    return StageErrors(
        samples=len(recordings),
        alone={stage: tally.result() for stage, tally in alone.items()},
        without={stage: tally.result() for stage, tally in without.items()},
        together=together.result(),
        unexplained=unexplained,
        kernel_tail=tail.result() if network.by_strategy else None,
    )


def _each(network: Network, changed: Callable[[Neuron], Neuron]) -> Network:
    """Return a network with other neurons."""
    return replace(network, populations=tuple(replace(p, neuron=changed(p.neuron)) for p in network.populations))


_Played = tuple[Mapping[str, ByteArray], FloatArray]
"""Spikes by population, and class scores."""


class _Tally:
    """Plays one variant chunk by chunk, and adds up how it differs."""

    def __init__(self, network: Network, play: Callable[[ByteArray], _Played]) -> None:
        self._play = play
        self._by_population = {p.name: PopulationMatch() for p in network.own_populations}
        self._changed = 0

    def add(self, recordings: ByteArray, wanted: ReferenceResult) -> Mapping[str, ByteArray]:
        """Play a chunk; return the variant's spikes."""
        spikes, scores = self._play(recordings)
        for name in self._by_population:
            self._by_population[name] += PopulationMatch.of(wanted.spikes[name], spikes[name])
        self._changed += int((decided(scores) != decided(wanted.scores)).sum())
        return spikes

    def result(self) -> Deviation:
        return Deviation(dict(self._by_population), self._changed)


def _play(network: Network, readout: Readout, twins: Sequence[tuple[Phase, Twin]], recordings: ByteArray) -> _Played:
    """Play a chunk to twins; ``readout`` is that of potentials in registers."""
    spikes: dict[str, ByteArray] = {}
    potential: dict[str, FloatArray] = {}
    for phase, twin in twins:
        read = {group.name for group in twin.groups} & set(readout.populations)
        kept = tuple(sorted(read)) if readout.potentials_from is not None else ()
        trace = run_twin(twin, lines_of(network, phase, recordings), potentials=kept)
        spikes |= trace.spikes
        potential |= trace.potential
    return spikes, readout.scores(spikes, potential)


def _different(spikes: Mapping[str, ByteArray], others: Mapping[str, ByteArray]) -> int:
    return sum(int((array != others[name]).sum()) for name, array in spikes.items())
