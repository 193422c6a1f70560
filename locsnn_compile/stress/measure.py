"""Measure a case: lower it, play it to the float network and the chip, and compare potentials and spikes.

The chip's side is computed by a *twin*: a float64 program that takes the step of a compartment with the chip's own
numbers, one *stage* after the other (rounded weights, rounded decays, cut states, wraps and clips, ...). With all
stages it equals the chip, and with some it shows what each stage adds. Both sides can be *forced* to send the spikes of
the float network, so that one different spike does not make all that follows different.

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
"""The seed of the recordings for which weights are rounded.

Random weights have ``SEED`` and the random input of cases ``SEED + 1``, so that these are recordings of their own.
"""
COARSE = 0.01
"""A decay is named if it fades faster or slower than asked for by more than this share. Chosen by hand."""
PROBES: tuple[Any, ...] = ("spikes", "u", "v", "potential")
"""What of every compartment is recorded to compare two engines: spikes, and registers after and before a reset."""
WITHOUT_LIMITS = tuple(stage for stage in STAGES if stage != "wraps_clips")
"""The stages of a chip whose registers hold any number."""


class FloatRun(Frozen, eq=False):
    """Spikes and potentials of the float network.

    In :class:`Sides` they are (samples, steps, n), and potentials in counts of the chip's registers. For a long run
    (``stress/run.py``) they are (steps, n), in the network's own units.
    """

    spikes: ByteArray
    potential: FloatArray


class Sides:
    """The float network and the chip's numbers, both played the same recordings (samples, steps, channels).

    - ``phase``: the exact and the chip's numbers of all compartments, from which twins are made
    - ``lines``: the spikes of the inputs, (samples, steps, lines), by the name of the input
    - ``threshold``: of each neuron, (n,), in counts of the registers
    - ``float``: what the float network does
    """

    def __init__(self, levels: Levels, recordings: ByteArray) -> None:
        # The network of a case has a single population, and so a single phase.
        (phase,) = phases_of(levels)
        if levels.network.populations[0].on_grid:
            phase = _with_real_numbers(phase)
        self.phase = phase
        self.lines = lines_of(levels.network, phase, recordings)
        self.threshold = thresholds(levels.quantized.population(POPULATION))
        self.float = self._float_run(levels, recordings)

    def forced(self, *stages: Stage) -> FloatArray:
        """Return the potential with some stages as on the chip, if the float network's spikes are sent.

        The potential is (samples, steps, n). With no stage, all numbers are exact.
        """
        float_spikes = {POPULATION: self.float.spikes}
        twin = twin_with(self.phase, stages)
        trace = run_twin(twin, self.lines, forced=float_spikes, potentials=(POPULATION,))
        return trace.potential[POPULATION]

    def free(self) -> TwinTrace:
        """Return what the twin does with all stages and its own spikes: the program must give the same integers."""
        return run_twin(twin_with(self.phase, STAGES), self.lines, potentials=(POPULATION,))

    def bound(self) -> dict[Source, FloatArray]:
        """Bound the error of the potential if the float network's spikes are sent, by source.

        The error of another neuron model, such as that of strategy ``reset``, is not among the sources.
        """
        float_spikes = {POPULATION: self.float.spikes}
        return error_bound(self.phase.program_neurons, POPULATION, self.lines, float_spikes)

    def model_error(self) -> FloatArray:
        """Return how far the strategy's neuron model alone moves the potential, (samples, steps, n).

        0 for strategies whose model is that of the float network.
        """
        if self.phase.float_neurons is self.phase.program_neurons:
            return np.zeros_like(self.float.potential)
        # All numbers exact, but laid out as the strategy's neuron model.
        return np.abs(self.forced("kernel") - self.float.potential)

    def _float_run(self, levels: Levels, recordings: ByteArray) -> FloatRun:
        """Evaluate the float network.

        Neurons on the grid are integers of the chip already. Their float network has the same numbers, but its states
        are not truncated, wrapped or clipped: it is the twin without any stage.
        """
        quantized = levels.quantized.population(POPULATION)
        if quantized.population.on_grid:
            trace = run_twin(twin_with(self.phase, ()), self.lines, potentials=(POPULATION,))
            return FloatRun(trace.spikes[POPULATION], trace.potential[POPULATION])
        result = evaluate(levels.network, recordings, potentials=True)
        potential_in_registers = result.potential[POPULATION] * quantized.scale
        return FloatRun(result.spikes[POPULATION], potential_in_registers)


def thresholds(quantized: QuantizedPopulation) -> FloatArray:
    """Return the thresholds in counts of the registers, (n,)."""
    in_registers: FloatArray = quantized.population.thresholds * quantized.scale
    if quantized.population.on_grid:
        # Errors are divided by thresholds, so a threshold mantissa of 0 counts as 1.
        return np.maximum(in_registers, loihi.in_registers(1.0))
    return in_registers


def _with_real_numbers(phase: Phase) -> Phase:
    """Return a phase of on-grid neurons whose exact side has the chip's parameters and registers for any real number.

    By default, the exact side of on-grid neurons is the chip itself, so no error would be measured.
    """
    groups = tuple(
        GroupNumbers(exact=replace(pair.chip, truncates=False, limited=False), chip=pair.chip)
        for pair in phase.program_neurons.groups
    )
    numbers = Numbers(groups, phase.program_neurons.synapses)
    return replace(phase, float_neurons=numbers, program_neurons=numbers)


def lowered(case: Case, chip: hw.Chip, steps: int | None = None) -> Levels:
    """Lower a case by its strategy; the program has ``steps`` steps, by default those of the case.

    Weights are rounded for random recordings as long as those of the case, but not for the same ones: on those, the
    result is checked.
    """
    network = case.network
    check_network(network)
    drawn = random_input(network.steps, channels=network.channels, seed=CALIBRATION_SEED)
    recordings = Recordings(drawn, labels=None, step_seconds=None, source="random")
    calibration = None
    if not network.populations[0].on_grid:
        calibration = calibrate(network, recordings, chip.registers)
    # "native" is no strategy that ``lower`` knows: the chip has such neurons, and all strategies lower them equally.
    strategy = "dendrite" if case.strategy == NATIVE else case.strategy
    if steps is not None:
        network = replace(network, steps=steps)
    return lower(network, chip, case.weight_bits, strategy, case.rounding, calibration)


def measure(case: Case, chip: hw.Chip) -> Measured:
    """Measure a case; errors of the compiler are raised.

    For the figures ``spikes``, ``wraps`` and ``clips``, each side sends its own spikes. For all others, both sides send
    the spikes of the float network.
    """
    levels = lowered(case, chip)
    # "stress" names the recordings in errors.
    recordings = case.network.fit(case.recordings, "stress")
    sides = Sides(levels, recordings)
    simulated = hw.simulate(levels.program, recordings, probe=("spikes", "potential"))

    float_potential = sides.float.potential
    threshold = sides.threshold
    chip_potential = sides.forced(*STAGES)

    # The bound is derived for registers that never overflow, so it is compared with those.
    unlimited_potential = sides.forced(*WITHOUT_LIMITS)
    model_error = sides.model_error()
    bound_by_source = sides.bound()
    bound = model_error + sum(bound_by_source.values())
    # float64 rounds sums relative to the largest number that went into them.
    largest_so_far = np.maximum.accumulate(np.abs(float_potential), axis=1)
    slack = FLOAT_ROUNDING * (largest_so_far + threshold)
    is_within = np.abs(unlimited_potential - float_potential) <= bound + slack
    # Not ">", because a difference that is not a number (NaN) must count as outside.
    is_outside = ~is_within

    # Would the chip, with the float network's spikes so far, decide to spike where the float network did?
    mantissa = levels.quantized.population(POPULATION).neuron.threshold
    chip_decides_to_spike = chip_potential > loihi.threshold_of(mantissa)
    differs = chip_decides_to_spike != sides.float.spikes.astype(np.bool_)
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
        overflowed=int((chip_potential != unlimited_potential).sum()),
        outside=int(is_outside.sum()),
        coarse_decays=_coarse_decays(sides),
        odd_engine=_differing_engine(levels, sides, recordings, simulated),
    )


def _lost_weights(levels: Levels, sides: Sides) -> Lost:
    """Count the weights other than 0 that are 0 on the chip.

    A weight may be several synapses on the chip, which together stand for it: it counts once.
    """
    weights = 0
    for projection in levels.network.projections:
        matrix = projection.held
        weights += int((values_of(matrix) != 0).sum())
    weights_on_chip = 0
    for pair in sides.phase.program_neurons.synapses:
        # All other synapses lead from a neuron to itself: they stand for the refractory kernel, not for a weight.
        if pair.exact.source in sides.lines:
            weights_on_chip += int((values_of(pair.chip) != 0).sum())
    return Lost(lost=weights - weights_on_chip, of=weights)


def _lost_biases(levels: Levels) -> Lost:
    """Count the biases other than 0 that are 0 on the chip."""
    rounded = [
        population
        for population in levels.quantized.populations
        if not population.population.on_grid
    ]
    return Lost(
        lost=sum(population.biases_lost for population in rounded),
        of=sum(int(population.population.neuron.biased.sum()) for population in rounded),
    )


def _coarse_decays(sides: Sides) -> tuple[str, ...]:
    """Return a sentence for each decay that its grid changes by more than ``COARSE``.

    An alpha kernel has one time constant in the model. On the chip, its two decays may differ, because they then
    fit it better together; their mean is compared.
    """
    sentences = []
    for pair in sides.phase.program_neurons.groups:
        exact_u = _decay_of(pair.exact.keep_u)
        exact_v = _decay_of(pair.exact.keep_v)
        chip_u = _decay_of(pair.chip.keep_u)
        chip_v = _decay_of(pair.chip.keep_v)
        has_one_time_constant = exact_u == exact_v
        if has_one_time_constant:
            decays = [(exact_u, (chip_u + chip_v) / 2)]
        else:
            decays = [(exact_u, chip_u), (exact_v, chip_v)]
        for exact, on_chip in decays:
            if abs(on_chip - exact) > COARSE * exact:
                direction = "faster" if on_chip > exact else "slower"
                percent = 100 * abs(on_chip - exact) / exact
                sentences.append(
                    f"a decay of {exact:.4g} in 4096 is {on_chip:g}: it fades {percent:.2g} % {direction}"
                )
    # Several dendrites of a kind have the same decays, and give the same sentence.
    return tuple(dict.fromkeys(sentences))


def _decay_of(keep: FloatArray) -> float:
    """Return the decay, in 4096ths, of a group of which a step keeps the share ``keep``.

    The first neuron stands for the group: all neurons of a case have equal decays.
    """
    return float(loihi_inverse.decay_of_share(1.0 - keep.flat[0]))


def _differing_engine(
    levels: Levels, sides: Sides, recordings: ByteArray, simulated: hw.SimulationResult
) -> str | None:
    """Return the name of the first of four computations that differs from the fast engine; None if none does.

    The population's own integer arithmetic and the float64 twin play all recordings. The reference engine, which is
    slow, and the fast engine without skipping (idle steps are computed as well) play only the first.
    """
    integer_network = levels.quantized.on_grid()
    integers = evaluate(
        integer_network,
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
    """Return whether spikes, registers, wraps and clips by population, and all counts but skipped steps are equal."""
    # How many idle steps are skipped is up to the engine.
    left_counts = {**dict(left.counts), "skipped_steps": 0}
    right_counts = {**dict(right.counts), "skipped_steps": 0}
    # ``events`` are the wraps and clips of each population.
    if left_counts != right_counts or left.events != right.events:
        return False
    for kind in PROBES:
        for name, array in getattr(left, kind).items():
            if not np.array_equal(array, getattr(right, kind)[name]):
                return False
    return True
