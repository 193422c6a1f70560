"""A lowered case as both sides see it: numbers side by side, and the float network's own spikes and potentials."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hw_model.engine.trace import ByteArray
from locsnn_compile.network.neurons import FloatArray
from locsnn_compile.network.quantized import QuantizedPopulation
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.stress.cases.case import POPULATION
from locsnn_compile.verification.error_budget.numbers import GroupNumbers, Numbers
from locsnn_compile.verification.error_budget.stages import STAGES, Phase, Stage, lines_of, phases_of, twin_with
from locsnn_compile.verification.error_budget.twin import TwinTrace, run_twin


@dataclass(frozen=True, eq=False)
class Float:
    """Spikes and potentials of the float network, (samples, steps, n), potentials in units of the registers.

    Of a long run (steps, n), in the network's own units.
    """

    spikes: ByteArray
    potential: FloatArray


class Sides:
    """The float network and the chip's numbers, played the same recordings (samples, steps, channels)."""

    def __init__(self, levels: Levels, recordings: ByteArray) -> None:
        (phase,) = phases_of(levels)
        self.phase = _with_real_numbers(phase) if levels.network.populations[0].on_grid else phase
        self.lines = lines_of(levels.network, phase, recordings)
        self.threshold = thresholds(levels.quantized.population(POPULATION))
        self.float = self._float(levels, recordings)

    def forced(self, *stages: Stage) -> FloatArray:
        """Return the potential with some stages as on the chip, the float network's spikes sent in place of its own."""
        sent = {POPULATION: self.float.spikes}
        trace = run_twin(twin_with(self.phase, stages), self.lines, forced=sent, potentials=(POPULATION,))
        return trace.potential[POPULATION]

    def free(self) -> TwinTrace:
        """Return what the twin does by itself with all stages on: what the program must do."""
        return run_twin(twin_with(self.phase, STAGES), self.lines, potentials=(POPULATION,))

    def model_error(self) -> FloatArray:
        """Return how far another neuron model or strategy alone moves the potential, (samples, steps, n)."""
        if self.phase.float_neurons is self.phase.program_neurons:
            return np.zeros_like(self.float.potential)
        return np.abs(self.forced("kernel") - self.float.potential)

    def _float(self, levels: Levels, recordings: ByteArray) -> Float:
        """Evaluate in float64; on-grid neurons as the same numbers without cuts, wraps and clips."""
        population = levels.quantized.population(POPULATION)
        if population.population.on_grid:
            trace = run_twin(twin_with(self.phase, ()), self.lines, potentials=(POPULATION,))
            return Float(trace.spikes[POPULATION], trace.potential[POPULATION])
        found = evaluate(levels.network, recordings, potentials=True)
        return Float(found.spikes[POPULATION], found.potential[POPULATION] * population.scale)


def thresholds(q: QuantizedPopulation) -> FloatArray:
    """Return what a threshold is in the registers, (n,); of a mantissa of 0, one unit of it."""
    found: FloatArray = q.population.thresholds * q.scale
    return np.maximum(found, 64.0) if q.population.on_grid else found


def _with_real_numbers(phase: Phase) -> Phase:
    """Return a phase of on-grid neurons whose exact side holds any real number, in place of the chip's integers."""
    groups = tuple(
        GroupNumbers(replace(pair.chip, truncates=False, limited=False), pair.chip)
        for pair in phase.program_neurons.groups
    )
    numbers = Numbers(groups, phase.program_neurons.synapses)
    return replace(phase, float_neurons=numbers, program_neurons=numbers)
