"""Measure a case: lower it, play it to the float network and the chip, and compare potentials and spikes.

Every way to compute a program must give the same integers; one that does not is named.
"""

from dataclasses import replace
from typing import Any

import numpy as np

import hw_model as hw
from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.values import ByteArray, FloatArray, Frozen
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.check import check_network
from locsnn_compile.network.projections import values_of
from locsnn_compile.network.quantized import QuantizedPopulation
from locsnn_compile.pipeline import Levels, lower
from locsnn_compile.reference.evaluate import calibrate, evaluate
from locsnn_compile.settings import NATIVE
from locsnn_compile.stress.bounds import Source, error_bound
from locsnn_compile.stress.cases.case import POPULATION, SEED, Case, random_input
from locsnn_compile.stress.row import Lost, Measured
from locsnn_compile.verification.error_budget.budget import (
    STAGES,
    Phase,
    Stage,
    lines_of,
    phases_of,
    twin_with,
)
from locsnn_compile.verification.error_budget.numbers import GroupNumbers, Numbers
from locsnn_compile.verification.error_budget.twin import TwinTrace, run_twin
from locsnn_compile.verification.matching import PopulationMatch

FLOAT_ROUNDING = 1e-9
"""Share of a potential or threshold that float64 itself may round by: far less than a unit of a register."""
CALIBRATION_SEED = SEED + 2
COARSE = 0.01
"""A decay is named if it fades faster or slower than asked for by more than this share."""
PROBES: tuple[Any, ...] = ("spikes", "u", "v", "potential")
WITHOUT_LIMITS = tuple(stage for stage in STAGES if stage != "wraps_clips")


class FloatRun(Frozen, eq=False):
    """Spikes and potentials of the float network, (samples, steps, n), in units of the registers.

    For a long run they are (steps, n), in the network's own units.
    """

    spikes: ByteArray
    potential: FloatArray


class Sides:
    """The float network and the chip's numbers, both played the same recordings (samples, steps, channels)."""

    def __init__(self, levels: Levels, recordings: ByteArray) -> None:
        (phase,) = phases_of(levels)
        self.phase = _with_real_numbers(phase) if levels.network.populations[0].on_grid else phase
        self.lines = lines_of(levels.network, phase, recordings)
        self.threshold = thresholds(levels.quantized.population(POPULATION))
        self.float = self._float(levels, recordings)

    def forced(self, *stages: Stage) -> FloatArray:
        """Return the potential with some stages as on the chip if the float network's spikes are sent."""
        sent = {POPULATION: self.float.spikes}
        trace = run_twin(
            twin_with(self.phase, stages), self.lines, forced=sent, potentials=(POPULATION,)
        )
        return trace.potential[POPULATION]

    def free(self) -> TwinTrace:
        """Return what the twin does with all stages and its own spikes, which the program must do as well."""
        return run_twin(twin_with(self.phase, STAGES), self.lines, potentials=(POPULATION,))

    def bound(self) -> dict[Source, FloatArray]:
        """Bound the error of the potential if the float network's spikes are sent, without that of the neuron model."""
        return error_bound(
            self.phase.program_neurons, POPULATION, self.lines, {POPULATION: self.float.spikes}
        )

    def model_error(self) -> FloatArray:
        """Return how far the strategy's neuron model alone moves the potential, (samples, steps, n)."""
        if self.phase.float_neurons is self.phase.program_neurons:
            return np.zeros_like(self.float.potential)
        return np.abs(self.forced("kernel") - self.float.potential)

    def _float(self, levels: Levels, recordings: ByteArray) -> FloatRun:
        """Evaluate in float64; on-grid neurons as the same numbers without cuts, wraps and clips."""
        population = levels.quantized.population(POPULATION)
        if population.population.on_grid:
            trace = run_twin(twin_with(self.phase, ()), self.lines, potentials=(POPULATION,))
            return FloatRun(trace.spikes[POPULATION], trace.potential[POPULATION])
        result = evaluate(levels.network, recordings, potentials=True)
        return FloatRun(result.spikes[POPULATION], result.potential[POPULATION] * population.scale)


def thresholds(q: QuantizedPopulation) -> FloatArray:
    """Return the thresholds in units of the registers, (n,); a mantissa of 0 counts as 1."""
    in_registers: FloatArray = q.population.thresholds * q.scale
    if q.population.on_grid:
        return np.maximum(in_registers, loihi.in_registers(1.0))
    return in_registers


def _with_real_numbers(phase: Phase) -> Phase:
    """Return a phase of on-grid neurons whose exact side has registers for any real number."""
    groups = tuple(
        GroupNumbers(replace(pair.chip, truncates=False, limited=False), pair.chip)
        for pair in phase.program_neurons.groups
    )
    numbers = Numbers(groups, phase.program_neurons.synapses)
    return replace(phase, float_neurons=numbers, program_neurons=numbers)


def lowered(case: Case, chip: hw.Chip, steps: int | None = None) -> Levels:
    """Lower a case by its strategy; ``steps`` if its recordings are longer or shorter than those for rounding.

    Weights are rounded for random recordings other than those of the case.
    """
    network = case.network
    check_network(network)
    drawn = random_input(network.steps, channels=network.channels, seed=CALIBRATION_SEED)
    recordings = Recordings(drawn, labels=None, step_seconds=None, source="random")
    calibration = None
    if not network.populations[0].on_grid:
        calibration = calibrate(network, recordings, chip.registers)
    strategy = "dendrite" if case.strategy == NATIVE else case.strategy
    if steps is not None:
        network = replace(network, steps=steps)
    return lower(network, chip, case.weight_bits, strategy, case.rounding, calibration)


def measure(case: Case, chip: hw.Chip) -> Measured:
    """Measure a case; errors of the compiler are raised."""
    levels = lowered(case, chip)
    recordings = case.network.fit(case.recordings, "stress")
    sides = Sides(levels, recordings)
    simulated = hw.simulate(levels.program, recordings, probe=("spikes", "potential"))
    float_potential = sides.float.potential
    threshold = sides.threshold
    chip_potential = sides.forced(*STAGES)
    unlimited = sides.forced(*WITHOUT_LIMITS)
    model_error = sides.model_error()
    bound_by_source = sides.bound()
    bound = model_error + sum(bound_by_source.values())
    largest_so_far = np.maximum.accumulate(np.abs(float_potential), axis=1)
    slack = FLOAT_ROUNDING * (largest_so_far + threshold)
    # A difference that is not a number is outside as well.
    is_outside = ~(np.abs(unlimited - float_potential) <= bound + slack)
    mantissa = levels.quantized.population(POPULATION).neuron.threshold
    chip_spikes = chip_potential > loihi.threshold_of(mantissa)
    differs = chip_spikes != sides.float.spikes.astype(np.bool_)
    is_tied = np.abs(float_potential - threshold) <= FLOAT_ROUNDING * threshold
    return Measured(
        spikes=PopulationMatch.of(sides.float.spikes, simulated.spikes[POPULATION]),
        error_thresholds=float((np.abs(chip_potential - float_potential) / threshold).max()),
        bound_thresholds=float((bound / threshold).max()),
        bound_parts_thresholds={
            source: float((part / threshold).max()) for source, part in bound_by_source.items()
        },
        model_error_thresholds=float((model_error / threshold).max()),
        decisions=differs.size,
        decisions_otherwise=int(differs.sum()),
        of_these_ties=int((differs & is_tied).sum()),
        wraps=simulated.counts.wraps,
        clips=simulated.counts.clips,
        weights=_lost_weights(levels, sides),
        biases=_lost_biases(levels),
        overflowed=int((chip_potential != unlimited).sum()),
        outside=int(is_outside.sum()),
        coarse_decays=_coarse_decays(sides),
        odd_engine=_differing_engine(levels, sides, recordings, simulated),
    )


def _lost_weights(levels: Levels, sides: Sides) -> Lost:
    """Count the weights other than 0 that are 0 on the chip, over all synapses that stand for one."""
    of = sum(int((values_of(p.held) != 0).sum()) for p in levels.network.projections)
    inputs = [
        pair for pair in sides.phase.program_neurons.synapses if pair.exact.source in sides.lines
    ]
    return Lost(of - sum(int((values_of(pair.chip) != 0).sum()) for pair in inputs), of)


def _lost_biases(levels: Levels) -> Lost:
    rounded = [q for q in levels.quantized.populations if not q.population.on_grid]
    return Lost(
        sum(q.biases_lost for q in rounded),
        sum(int(q.population.neuron.biased.sum()) for q in rounded),
    )


def _coarse_decays(sides: Sides) -> tuple[str, ...]:
    """Name the decays that their grid changes by more than ``COARSE``; of two that stand for one, the mean."""
    sentences = []
    for pair in sides.phase.program_neurons.groups:
        exact_u = _decay_of(pair.exact.keep_u)
        exact_v = _decay_of(pair.exact.keep_v)
        chip_u = _decay_of(pair.chip.keep_u)
        chip_v = _decay_of(pair.chip.keep_v)
        decays = [(exact_u, chip_u), (exact_v, chip_v)]
        if exact_u == exact_v:
            decays = [(exact_u, (chip_u + chip_v) / 2)]
        for exact, on_chip in decays:
            if abs(on_chip - exact) > COARSE * exact:
                way = "faster" if on_chip > exact else "slower"
                percent = 100 * abs(on_chip - exact) / exact
                sentences.append(
                    f"a decay of {exact:.4g} in 4096 is {on_chip:g}: it fades {percent:.2g} % {way}"
                )
    return tuple(dict.fromkeys(sentences))


def _decay_of(keep: FloatArray) -> float:
    """Return the decay, in 4096ths, of the first neuron of a group, of what a step keeps."""
    return float(loihi_inverse.decay_of_share(1.0 - keep.flat[0]))


def _differing_engine(
    levels: Levels, sides: Sides, recordings: ByteArray, simulated: hw.SimulationResult
) -> str | None:
    """Name the first of four computations that differs from what the fast engine gives; None if none does.

    The population's own integer arithmetic and the float64 twin play all recordings; the reference engine and the fast
    engine without skipping play the first.
    """
    integers = evaluate(
        levels.quantized.on_grid(),
        recordings,
        potentials=True,
        registers=levels.program.chip.registers,
    )
    computations: dict[str, Any] = {
        "the integer evaluation of the population": integers,
        "the float64 twin of the compartments": sides.free(),
    }
    for name, computed in computations.items():
        if not np.array_equal(computed.spikes[POPULATION], simulated.spikes[POPULATION]):
            return name
        if not np.array_equal(computed.potential[POPULATION], simulated.potential[POPULATION]):
            return name
    program = levels.program
    first_recording = recordings[:1]
    fast = hw.simulate(program, first_recording, probe=PROBES)
    reference = hw.simulate(program, first_recording, engine="reference", probe=PROBES)
    if not _are_equal(fast, reference):
        return "the reference engine"
    without_skipping = hw.simulate(program, first_recording, probe=PROBES, skip=False)
    if not _are_equal(fast, without_skipping):
        return "the fast engine without skipping"
    return None


def _are_equal(left: hw.SimulationResult, right: hw.SimulationResult) -> bool:
    """Compare spikes, registers, wraps and clips by population, and all counts but skipped steps."""
    left_counts = {**dict(left.counts), "skipped_steps": 0}
    right_counts = {**dict(right.counts), "skipped_steps": 0}
    if left_counts != right_counts or left.events != right.events:
        return False
    for kind in PROBES:
        for name, array in getattr(left, kind).items():
            if not np.array_equal(array, getattr(right, kind)[name]):
                return False
    return True
