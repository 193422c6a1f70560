"""The diagnosis of a program for the report: where its differences from the float network come from.

It has three parts. The *error budget* breaks all differences down by stage of the compiler, and the *cause* explains
the first one (:mod:`locsnn_compile.verification.error_budget`). The *margins* compare the distance of potentials from
their threshold with the error of the chip's arithmetic, and say how full registers get. That error is of a single
neuron: both sides get the float network's spikes, so no earlier difference is carried along. Where the error is
larger than the distance, a spike may change.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hw_model.arithmetic import loihi
from hw_model.description.chip import Registers
from hw_model.mapping.graph import Compartments
from hw_model.values import (
    AnyArray,
    BoolArray,
    FloatArray,
    Frozen,
    IntArray,
    Shown,
    added,
)
from locsnn_compile.network.network import Network, Population
from locsnn_compile.pipeline import Levels
from locsnn_compile.verification.error_budget import budget as stages
from locsnn_compile.verification.error_budget.budget import (
    Cause,
    StageErrors,
    error_budget,
    find_cause,
)
from locsnn_compile.verification.error_budget.twin import run_twin
from locsnn_compile.verification.matching import Divergence, Progress
from locsnn_compile.verification.observation import Observation, Observed, neuron_steps

NEAREST = (0.0001, 0.001, 0.01, 0.1, 0.5)
"""Quantiles of the distance from the threshold that are reported, over all neurons and steps (*neuron steps*)."""
LARGEST = (0.5, 0.95, 1.0)
"""Quantiles of the error that are reported: the median, the 95th percentile and the largest."""
EDGES = np.logspace(-6.0, 1.0, 29)
"""Edges of the bins of both histograms, in thresholds, four per decade; the end bins also count what lies beyond."""


class PopulationMargins(Frozen, eq=False):
    """Distances of potentials from the threshold at every neuron and step, in thresholds, without sign.

    ``nearest[p]`` is the distance below which a share p of them lies; ``error[p]`` is the same for the chip's error.
    ``within_error`` is the share of neuron steps whose distance is not larger than their error, so a spike may change;
    ``decided_otherwise`` is the share in which a spike does change. Histograms (bins,) are counts over :data:`EDGES`;
    errors of exactly 0 are left out.
    """

    neuron_steps: int
    nearest: Mapping[float, float]
    error: Mapping[float, float]
    within_error: float
    decided_otherwise: float
    distance_histogram: IntArray
    error_histogram: IntArray


class RegisterUse(Frozen):
    """Largest magnitudes in a group of compartments on the chip, and the limits of their registers."""

    peak_u: int
    limit_u: int
    peak_v: int
    limit_v: int
    wraps: int
    clips: int

    @property
    def share_u(self) -> float:
        """Largest use of the current register, 0..1."""
        return self.peak_u / self.limit_u

    @property
    def share_v(self) -> float:
        """Largest use of the voltage register, 0..1."""
        return self.peak_v / self.limit_v

    @property
    def headroom_bits(self) -> float | None:
        """How many times the content of the fuller register could double; None if neither was ever used."""
        fullest = max(self.share_u, self.share_v)
        return math.log2(1.0 / fullest) if fullest else None


class Margins(Frozen, eq=False):
    """Margins of every population, and register use of every group of compartments."""

    populations: Mapping[str, PopulationMargins]
    registers: Mapping[str, RegisterUse]


def margins(observed: Observed, numbers: tuple[int, ...]) -> Margins:
    """Measure the margins over the recordings with these ``numbers``, a batch at a time."""
    levels = observed.levels
    network = levels.network
    registers = levels.program.chip.registers
    decisions: dict[str, list[_Decisions]] = {p.name: [] for p in network.populations}
    # The largest magnitudes of u and v so far.
    peaks: dict[str, IntArray] = {
        group.name: np.zeros(2, dtype=np.int64) for group in levels.compartments.groups
    }
    events: dict[str, dict[str, int]] = {}
    for observation in observed.closely(numbers):
        for name, of_batch in _decisions(levels, observation).items():
            decisions[name].append(of_batch)
        chip = observation.chip
        events = added(events, {name: dict(counts) for name, counts in chip.events.items()})
        for name, so_far in peaks.items():
            highest = [np.abs(values[name]).max() for values in (chip.u, chip.potential)]
            peaks[name] = np.maximum(so_far, highest)
    return Margins(
        populations={
            p.name: _population_margins(_thresholds(p), decisions[p.name])
            for p in network.populations
        },
        registers={
            group.name: _register_use(
                group, registers, peaks[group.name], events.get(group.name, {})
            )
            for group in levels.compartments.groups
        },
    )


class _Decisions(NamedTuple):
    """What the neurons of a population decide in a batch of recordings, on both sides; arrays (batch, steps, n).

    Potentials are in the unit of the float network. ``differs`` marks where only one side spikes.
    """

    reference_potential: AnyArray
    chip_potential: FloatArray
    differs: BoolArray


def _decisions(levels: Levels, observation: Observation) -> dict[str, _Decisions]:
    """Return the decisions of every population, by name; the chip's neurons get the spikes of the float network."""
    network = levels.network
    reference = observation.reference
    decisions: dict[str, _Decisions] = {}
    for phase in stages.phases_of(levels):
        names = tuple(p.name for p in network.populations if p.phase == phase.name)
        lines = stages.lines_of(network, phase, observation.recordings)
        # The simulator cannot be given spikes, so the chip is its twin with all stages.
        twin = stages.twin_with(phase, stages.STAGES)
        chip = run_twin(twin, lines, forced=reference.spikes, potentials=names)
        for name in names:
            decisions[name] = _Decisions(
                reference_potential=reference.potential[name],
                chip_potential=chip.potential[name] / levels.quantized.population(name).scale,
                differs=reference.spikes[name] != chip.spikes[name],
            )
    return decisions


def _register_use(
    group: Compartments, registers: Registers, peaks: IntArray, events: Mapping[str, int]
) -> RegisterUse:
    """Return the register use of a group.

    ``peaks`` are the largest magnitudes of u, and of v before a reset; ``events`` counts wraps and clips by kind.
    """
    return RegisterUse(
        peak_u=int(peaks[0]),
        limit_u=registers.half_current,
        peak_v=int(peaks[1]),
        # Only the upper limit: a lower one may be a floor, which potentials are meant to reach.
        limit_v=int(group.vmax.min()),
        wraps=events.get("charge_wraps", 0) + events.get("current_wraps", 0),
        clips=events.get("voltage_clips", 0),
    )


def _thresholds(population: Population) -> FloatArray:
    """Return the thresholds (n,) in the units of the potential, to divide by.

    Integer neurons can have a threshold of 0; the unit of weights takes its place.
    """
    thresholds = population.thresholds
    return np.where(thresholds == 0, loihi.in_registers(1.0), thresholds)


def _population_margins(
    thresholds: FloatArray, decisions: Sequence[_Decisions]
) -> PopulationMargins:
    """Compare both potentials of a population with the thresholds (n,), over all batches."""
    reference = np.concatenate([batch.reference_potential for batch in decisions])
    chip = np.concatenate([batch.chip_potential for batch in decisions])
    differs = np.concatenate([batch.differs for batch in decisions])
    distance = (np.abs(reference - thresholds) / thresholds).ravel()
    error = (np.abs(chip - reference) / thresholds).ravel()
    return PopulationMargins(
        neuron_steps=len(distance),
        nearest=_quantiles(distance, NEAREST),
        error=_quantiles(error, LARGEST),
        within_error=float(((distance <= error) & (error > 0)).mean()),
        decided_otherwise=int(differs.sum()) / len(distance),
        distance_histogram=_histogram(distance),
        error_histogram=_histogram(error[error > 0]),
    )


def _quantiles(values: FloatArray, shares: tuple[float, ...]) -> dict[float, float]:
    """Return the quantiles of values, by share."""
    return dict(zip(shares, np.quantile(values, shares).tolist(), strict=True))


def _histogram(values: FloatArray) -> IntArray:
    """Return the counts of values between :data:`EDGES`; the end bins also count what lies beyond."""
    counts, _ = np.histogram(np.clip(values, EDGES[0], EDGES[-1]), EDGES)
    return counts.astype(np.int64)


SAMPLE = 16
"""Default number of recordings of a report's diagnosis. It is small, because each is evaluated about fifteen times:
with each stage alone, without each stage, and so on."""
NEURON_STEPS = 1 << 22
"""Largest number of neurons times steps of a diagnosis, for all recordings together: large networks are diagnosed on
fewer recordings. Chosen by hand, for a few seconds."""


class Diagnosis(Shown):
    """A diagnosis over the recordings with the numbers ``recordings``, out of ``available``.

    ``budget`` is None if every population is on the grid from the start: nothing is rounded, so there is no error to
    break down. ``cause`` is None if no spike differs or there is no budget.
    """

    recordings: tuple[int, ...]
    available: int
    budget: StageErrors | None
    cause: Cause | None
    margins: Margins


def diagnose(
    observed: Observed,
    first: Divergence | None,
    *,
    samples: int | None = SAMPLE,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose a program on at most ``samples`` of the recordings (None: all), evenly spread.

    ``first`` is where the sides first diverge on them.
    """
    numbers = spread_sample(observed.network, len(observed), samples)
    budget = None
    cause = None
    if observed.network.has_float_weights:
        budget = error_budget(observed, numbers, progress)
        if first is not None:
            cause = find_cause(observed, first)
    return Diagnosis(
        recordings=numbers,
        available=len(observed),
        budget=budget,
        cause=cause,
        margins=margins(observed, numbers),
    )


def spread_sample(network: Network, available: int, samples: int | None) -> tuple[int, ...]:
    """Return the numbers of at most ``samples`` recordings (None: all), evenly spread from the first to the last."""
    if samples is None:
        return tuple(range(available))
    count = max(1, min(available, samples, NEURON_STEPS // neuron_steps(network)))
    return tuple(int(number) for number in np.linspace(0, available - 1, count).round())
