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
        found = evaluate(levels.network, recordings, potentials=True)
        return FloatRun(found.spikes[POPULATION], found.potential[POPULATION] * population.scale)


def thresholds(q: QuantizedPopulation) -> FloatArray:
    """Return the thresholds in units of the registers, (n,); a mantissa of 0 counts as 1."""
    found: FloatArray = q.population.thresholds * q.scale
    return np.maximum(found, loihi.in_registers(1.0)) if q.population.on_grid else found


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
    recordings = Recordings(drawn, None, None, "random")
    calibration = (
        None if network.populations[0].on_grid else calibrate(network, recordings, chip.registers)
    )
    strategy = "dendrite" if case.strategy == NATIVE else case.strategy
    wanted = network if steps is None else replace(network, steps=steps)
    return lower(wanted, chip, case.weight_bits, strategy, case.rounding, calibration)


def measure(case: Case, chip: hw.Chip) -> Measured:
    """Measure a case; errors of the compiler are raised."""
    levels = lowered(case, chip)
    recordings = case.network.fit(case.recordings, "stress")
    sides = Sides(levels, recordings)
    found = hw.simulate(levels.program, recordings, probe=("spikes", "potential"))
    wanted, unit = sides.float, sides.threshold
    chip_side, unlimited = sides.forced(*STAGES), sides.forced(*WITHOUT_LIMITS)
    model_error, parts = sides.model_error(), sides.bound()
    bound = model_error + sum(parts.values())
    slack = FLOAT_ROUNDING * (np.maximum.accumulate(np.abs(wanted.potential), axis=1) + unit)
    outside = ~(np.abs(unlimited - wanted.potential) <= bound + slack)
    decided = chip_side > loihi.threshold_of(
        levels.quantized.population(POPULATION).neuron.threshold
    )
    otherwise = decided != wanted.spikes.astype(np.bool_)
    tied = np.abs(wanted.potential - unit) <= FLOAT_ROUNDING * unit
    return Measured(
        spikes=PopulationMatch.of(wanted.spikes, found.spikes[POPULATION]),
        error_thresholds=float((np.abs(chip_side - wanted.potential) / unit).max()),
        bound_thresholds=float((bound / unit).max()),
        bound_parts_thresholds={
            source: float((part / unit).max()) for source, part in parts.items()
        },
        model_error_thresholds=float((model_error / unit).max()),
        decisions=otherwise.size,
        decisions_otherwise=int(otherwise.sum()),
        of_these_ties=int((otherwise & tied).sum()),
        wraps=found.counts.wraps,
        clips=found.counts.clips,
        weights=_lost_weights(levels, sides),
        biases=_lost_biases(levels),
        overflowed=int((chip_side != unlimited).sum()),
        outside=int(outside.sum()),
        coarse_decays=_coarse_decays(sides),
        odd_engine=_odd_one_out(levels, sides, recordings, found),
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
    found = []
    for pair in sides.phase.program_neurons.groups:
        (u, v), (held_u, held_v) = (
            [
                float(loihi_inverse.decay_of_share(1.0 - keep.flat[0]))
                for keep in (group.keep_u, group.keep_v)
            ]
            for group in (pair.exact, pair.chip)
        )
        both = [(u, (held_u + held_v) / 2)] if u == v else [(u, held_u), (v, held_v)]
        for exact, held in both:
            if abs(held - exact) > COARSE * exact:
                way = "faster" if held > exact else "slower"
                changed = 100 * abs(held - exact) / exact
                found.append(
                    f"a decay of {exact:.4g} in 4096 is {held:g}: it fades {changed:.2g} % {way}"
                )
    return tuple(dict.fromkeys(found))


def _odd_one_out(
    levels: Levels, sides: Sides, recordings: ByteArray, found: hw.SimulationResult
) -> str | None:
    """Name the first of four computations that differs from ``found`` by the fast engine; None if none does.

    The population's own integer arithmetic and the float64 twin play all recordings; the reference engine and the fast
    engine without skipping play the first.
    """
    integers = evaluate(
        levels.quantized.on_grid(),
        recordings,
        potentials=True,
        registers=levels.program.chip.registers,
    )
    others: dict[str, Any] = {"the integer evaluation of the population": integers}
    others["the float64 twin of the compartments"] = sides.free()
    for name, other in others.items():
        for its, wanted in ((other.spikes, found.spikes), (other.potential, found.potential)):
            if not np.array_equal(its[POPULATION], wanted[POPULATION]):
                return name
    first = hw.simulate(levels.program, recordings[:1], probe=PROBES)
    if not _same(
        first, hw.simulate(levels.program, recordings[:1], engine="reference", probe=PROBES)
    ):
        return "the reference engine"
    if not _same(first, hw.simulate(levels.program, recordings[:1], probe=PROBES, skip=False)):
        return "the fast engine without skipping"
    return None


def _same(one: hw.SimulationResult, other: hw.SimulationResult) -> bool:
    """Compare spikes, registers, wraps and clips by population, and all counts but skipped steps."""
    counted = [{**dict(result.counts), "skipped_steps": 0} for result in (one, other)]
    kept = (
        (array, getattr(other, kind)[name])
        for kind in PROBES
        for name, array in getattr(one, kind).items()
    )
    return (
        counted[0] == counted[1]
        and one.events == other.events
        and all(np.array_equal(*both) for both in kept)
    )
