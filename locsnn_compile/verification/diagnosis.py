"""Where the error of a program comes from: its budget, the cause of the first divergence, and the margins.

Margins compare the distance of potentials from their threshold with the error of the chip's arithmetic, and say how
full registers get. The error is that of a single neuron: both sides get the float network's spikes, so no earlier
difference is carried along. Where the error is larger than the distance, a spike may change.
"""

import math
from collections.abc import Mapping

import numpy as np

import hw_model as hw
from hw_model.arithmetic.fixed_point import WEIGHT_SHIFT
from hw_model.description.chip import Registers
from hw_model.mapping.graph import Compartments
from hw_model.values import (
    AnyArray,
    BoolArray,
    ByteArray,
    FloatArray,
    Frozen,
    IntArray,
    Shown,
    added,
)
from locsnn_compile.network.network import Network, Population
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.error_budget import budget as stages
from locsnn_compile.verification.error_budget.budget import (
    Cause,
    StageErrors,
    error_budget,
    find_cause,
)
from locsnn_compile.verification.error_budget.twin import run_twin
from locsnn_compile.verification.matching import CHUNK, Divergence, Progress

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


def margins(levels: Levels, recordings: ByteArray) -> Margins:
    """Measure margins over recordings (samples, steps, channels) with the network's steps and channels."""
    network, registers = levels.network, levels.program.chip.registers
    watched: dict[str, list[tuple[AnyArray, ...]]] = {p.name: [] for p in network.populations}
    peaks: dict[str, IntArray] = {
        group.name: np.zeros(2, dtype=np.int64) for group in levels.compartments.groups
    }
    events: dict[str, dict[str, int]] = {}
    for start in range(0, len(recordings), CHUNK):
        chunk = recordings[start : start + CHUNK]
        wanted = evaluate(network, chunk, potentials=True, registers=registers)
        for phase in stages.phases_of(levels):
            names = tuple(p.name for p in network.populations if p.phase == phase.name)
            lines = stages.lines_of(network, phase, chunk)
            chip = run_twin(
                stages.twin_with(phase, stages.STAGES),
                lines,
                forced=wanted.spikes,
                potentials=names,
            )
            for name in names:
                potential = chip.potential[name] / levels.quantized.population(name).scale
                otherwise = wanted.spikes[name] != chip.spikes[name]
                watched[name].append((wanted.potential[name], potential, otherwise))
        found = hw.simulate(levels.program, chunk, probe=("u", "potential"))
        events = added(events, {name: dict(counts) for name, counts in found.events.items()})
        for name, so_far in peaks.items():
            peaks[name] = np.maximum(
                so_far, [np.abs(values[name]).max() for values in (found.u, found.potential)]
            )
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


def _register_use(
    group: Compartments, registers: Registers, peaks: IntArray, events: Mapping[str, int]
) -> RegisterUse:
    """Return the use of a group, by the peaks of u and of v as the threshold saw it, and counts of wraps and clips."""
    # A floor is a lower end that potentials are meant to reach: what is left is room above.
    limits = 1 << registers.current_bits, int(group.vmax.min())
    wraps = events.get("charge_wraps", 0) + events.get("current_wraps", 0)
    return RegisterUse(
        int(peaks[0]), limits[0], int(peaks[1]), limits[1], wraps, events.get("voltage_clips", 0)
    )


def _thresholds(population: Population) -> FloatArray:
    """Return the thresholds (n,) in the units of the potential; a threshold of 0 counts as a weight of 1."""
    thresholds = population.thresholds
    return np.where(thresholds == 0, float(1 << WEIGHT_SHIFT), thresholds)


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
    levels: Levels,
    recordings: ByteArray,
    first: Divergence | None,
    *,
    samples: int | None = SAMPLE,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose a program on at most ``samples`` of the recordings (None: all), evenly spread.

    ``recordings`` are (samples, steps, channels) with the network's steps and channels; ``first`` is where the sides
    first diverge on them.
    """
    network = levels.network
    chosen = spread_sample(network, len(recordings), samples)
    played = recordings[list(chosen)]
    float_network = network.has_float_weights
    return Diagnosis(
        recordings=chosen,
        available=len(recordings),
        budget=error_budget(levels, played, progress) if float_network else None,
        cause=find_cause(levels, recordings[first.recording], first)
        if first and float_network
        else None,
        margins=margins(levels, played),
    )


def spread_sample(network: Network, available: int, samples: int | None) -> tuple[int, ...]:
    """Return the numbers of the recordings to take, evenly spread from the first to the last."""
    if samples is None:
        return tuple(range(available))
    many = max(1, min(available, samples, NEURON_STEPS // stages.neuron_steps(network)))
    return tuple(int(i) for i in np.linspace(0, available - 1, many).round())
