"""Where the error of a program comes from: its budget, the cause of the first divergence, and the margins.

Margins compare the distance of potentials from their threshold with the error of the chip's arithmetic, and say how
full registers get. The error is that of a single neuron: both sides get the float network's spikes, so no earlier
difference is carried along. Where the error is larger than the distance, a spike may change.
"""

import math
from collections.abc import Mapping

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
"""Shares of the neuron steps, those nearest to the threshold first, for which the distance is given."""
LARGEST = (0.5, 0.95, 1.0)
"""Shares of the neuron steps for which the error is given: the median, the 95th percentile and the largest."""
EDGES = np.logspace(-6.0, 1.0, 29)
"""Edges of the bins of both histograms, in thresholds, four per decade; the end bins also count what lies beyond."""


class PopulationMargins(Frozen, eq=False):
    """Distances of potentials from the threshold at every neuron and step, in thresholds, without sign.

    ``nearest[p]`` is the distance below which a share p of them lies; ``error[p]`` is the same for the chip's error.
    ``within_error`` is the share of neuron steps whose distance is not larger than their error, so a spike may change;
    ``decided_otherwise`` is the share where one does. Histograms (bins,) are counts; errors of exactly 0 are left out.
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
        """How often the fuller register could double; None if neither was ever used."""
        fullest = max(self.share_u, self.share_v)
        return math.log2(1.0 / fullest) if fullest else None


class Margins(Frozen, eq=False):
    """Margins of every population, and register use of every group of compartments."""

    populations: Mapping[str, PopulationMargins]
    registers: Mapping[str, RegisterUse]


def margins(observed: Observed, numbers: tuple[int, ...]) -> Margins:
    """Measure margins over the recordings with these numbers."""
    levels = observed.levels
    network = levels.network
    registers = levels.program.chip.registers
    watched: dict[str, list[tuple[AnyArray, ...]]] = {p.name: [] for p in network.populations}
    peaks: dict[str, IntArray] = {
        group.name: np.zeros(2, dtype=np.int64) for group in levels.compartments.groups
    }
    events: dict[str, dict[str, int]] = {}
    for seen in observed.closely(numbers):
        for name, decisions in _decisions(levels, seen).items():
            watched[name].append(decisions)
        chip = seen.chip
        events = added(events, {name: dict(counts) for name, counts in chip.events.items()})
        for name, so_far in peaks.items():
            highest = [np.abs(values[name]).max() for values in (chip.u, chip.potential)]
            peaks[name] = np.maximum(so_far, highest)
    return Margins(
        populations={
            p.name: _measured(
                _thresholds(p), *map(np.concatenate, zip(*watched[p.name], strict=True))
            )
            for p in network.populations
        },
        registers={
            group.name: _register_use(
                group, registers, peaks[group.name], events.get(group.name, {})
            )
            for group in levels.compartments.groups
        },
    )


def _decisions(levels: Levels, seen: Observation) -> dict[str, tuple[AnyArray, ...]]:
    """Return, by population, both potentials and where the decision differs, (batch, steps, n).

    The chip's neurons get the spikes of the float network.
    """
    network = levels.network
    reference = seen.reference
    decisions: dict[str, tuple[AnyArray, ...]] = {}
    for phase in stages.phases_of(levels):
        names = tuple(p.name for p in network.populations if p.phase == phase.name)
        lines = stages.lines_of(network, phase, seen.recordings)
        twin = stages.twin_with(phase, stages.STAGES)
        chip = run_twin(twin, lines, forced=reference.spikes, potentials=names)
        for name in names:
            potential = chip.potential[name] / levels.quantized.population(name).scale
            otherwise = reference.spikes[name] != chip.spikes[name]
            decisions[name] = (reference.potential[name], potential, otherwise)
    return decisions


def _register_use(
    group: Compartments, registers: Registers, peaks: IntArray, events: Mapping[str, int]
) -> RegisterUse:
    """Return the use of a group, by the peaks of u and of v as the threshold saw it, and counts of wraps and clips."""
    # A floor is a lower end that potentials are meant to reach: what is left is room above.
    voltage_limit = int(group.vmax.min())
    wraps = events.get("charge_wraps", 0) + events.get("current_wraps", 0)
    clips = events.get("voltage_clips", 0)
    return RegisterUse(
        int(peaks[0]), registers.half_current, int(peaks[1]), voltage_limit, wraps, clips
    )


def _thresholds(population: Population) -> FloatArray:
    """Return the thresholds (n,) in the units of the potential; a threshold of 0 counts as a weight of 1."""
    thresholds = population.thresholds
    return np.where(thresholds == 0, loihi.in_registers(1.0), thresholds)


def _measured(
    thresholds: FloatArray, wanted: AnyArray, chip: FloatArray, otherwise: BoolArray
) -> PopulationMargins:
    """Compare both potentials (samples, steps, n) with the thresholds (n,); ``otherwise`` marks differing decisions."""
    distance = (np.abs(wanted - thresholds) / thresholds).ravel()
    error = (np.abs(chip - wanted) / thresholds).ravel()
    return PopulationMargins(
        neuron_steps=len(distance),
        nearest=_quantiles(distance, NEAREST),
        error=_quantiles(error, LARGEST),
        within_error=float(((distance <= error) & (error > 0)).mean()),
        decided_otherwise=int(otherwise.sum()) / len(distance),
        distance_histogram=_histogram(distance),
        error_histogram=_histogram(error[error > 0]),
    )


def _quantiles(values: FloatArray, shares: tuple[float, ...]) -> dict[float, float]:
    return dict(zip(shares, np.quantile(values, shares).tolist(), strict=True))


def _histogram(values: FloatArray) -> IntArray:
    counts, _ = np.histogram(np.clip(values, EDGES[0], EDGES[-1]), EDGES)
    return counts.astype(np.int64)


SAMPLE = 16
"""Recordings in a report's diagnosis, unless more are asked for: each is evaluated about fifteen times."""
NEURON_STEPS = 1 << 22
"""Neurons times steps of a diagnosis at most: large networks are diagnosed on fewer recordings."""


class Diagnosis(Shown):
    """A diagnosis over the recordings with these numbers, out of ``available``.

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
    rounds = observed.network.has_float_weights
    return Diagnosis(
        recordings=numbers,
        available=len(observed),
        budget=error_budget(observed, numbers, progress) if rounds else None,
        cause=find_cause(observed, first) if first and rounds else None,
        margins=margins(observed, numbers),
    )


def spread_sample(network: Network, available: int, samples: int | None) -> tuple[int, ...]:
    """Return the numbers of the recordings to take, evenly spread from the first to the last."""
    if samples is None:
        return tuple(range(available))
    many = max(1, min(available, samples, NEURON_STEPS // neuron_steps(network)))
    return tuple(int(i) for i in np.linspace(0, available - 1, many).round())
