"""Measure a case: lower it, play it, and compare potentials and spikes with the float network's."""

from __future__ import annotations

import numpy as np

import hw_model as hw
from hw_model.fixed_point import DECAY_ONE
from locsnn_compile.error_budget.stages import STAGES
from locsnn_compile.matching import PopulationMatch, fit_recordings
from locsnn_compile.matrices import values_of
from locsnn_compile.neurons import Cuba
from locsnn_compile.pipeline import Levels, lower
from locsnn_compile.stress.bounds import SOURCES, error_bound
from locsnn_compile.stress.case import NATIVE, POPULATION, Case
from locsnn_compile.stress.engines import odd_one_out
from locsnn_compile.stress.row import Lost, Measured
from locsnn_compile.stress.sides import Sides

FLOAT_ROUNDING = 1e-9
"""Share of a potential, or of a threshold, that float64's own rounding may come to: far less than a register's unit."""
COARSE = 0.01
"""A decay that fades faster or slower than asked for by more than this share is named."""
WITHOUT_LIMITS = tuple(stage for stage in STAGES if stage != "wraps_clips")


def lowered(case: Case, chip: hw.Chip) -> Levels:
    """Lower a case by its strategy."""
    return lower(case.network, chip, case.weight_bits, "dendrite" if case.strategy == NATIVE else case.strategy)


def measure(case: Case, chip: hw.Chip) -> Measured:
    """Return what is measured of a case; an error of the compiler is raised."""
    levels = lowered(case, chip)
    recordings = fit_recordings(case.network, case.recordings, "stress")
    sides = Sides(levels, recordings)
    found = hw.simulate(levels.program, recordings, probe=("spikes", "potential"))
    wanted, unit = sides.float, sides.threshold
    chip_side, unlimited = sides.forced(*STAGES), sides.forced(*WITHOUT_LIMITS)
    model_error = sides.model_error()
    bound = error_bound(sides.phase.program_neurons, POPULATION, sides.lines, {POPULATION: wanted.spikes})
    slack = FLOAT_ROUNDING * (np.maximum.accumulate(np.abs(wanted.potential), axis=1) + unit)
    outside = ~(np.abs(unlimited - wanted.potential) <= model_error + bound.total + slack)
    decided = chip_side > 64.0 * levels.quantized.population(POPULATION).neuron.threshold
    otherwise = decided != wanted.spikes.astype(np.bool_)
    tied = np.abs(wanted.potential - unit) <= FLOAT_ROUNDING * unit
    return Measured(
        spikes=PopulationMatch.of(wanted.spikes, found.spikes[POPULATION]),
        error=float((np.abs(chip_side - wanted.potential) / unit).max()),
        bound=float(((model_error + bound.total) / unit).max()),
        parts={source: float((bound.parts[source] / unit).max()) for source in SOURCES},
        model_error=float((model_error / unit).max()),
        otherwise=int(otherwise.sum()),
        ties=int((otherwise & tied).sum()),
        decisions=otherwise.size,
        overflowed=int((chip_side != unlimited).sum()),
        wraps=found.counts.wraps,
        clips=found.counts.clips,
        weights=lost_weights(levels),
        biases=_lost_biases(levels),
        coarse_decays=_coarse_decays(sides),
        outside=int(outside.sum()),
        odd_engine=odd_one_out(levels, sides, recordings, found),
    )


def lost_weights(levels: Levels) -> Lost:
    """Count the weights other than 0 that the chip has as 0; a kernel of no gain loses them too."""
    lost = of = 0
    for given, held in zip(levels.network.projections, levels.quantized.projections, strict=True):
        there = values_of(getattr(given, "weights", held.mantissa)) != 0
        of += int(there.sum())
        lost += int((there & (values_of(held.mantissa) == 0)).sum())
    return Lost(lost, of)


def _lost_biases(levels: Levels) -> Lost:
    lost = of = 0
    for q in levels.quantized.populations:
        if isinstance(q.population.neuron, Cuba):
            there = q.population.neuron.bias != 0
            of += int(there.sum())
            lost += int((there & (getattr(q.neuron, "bias_mantissa") == 0)).sum())  # noqa: B009 - a ChipCuba by then
    return Lost(lost, of)


def _coarse_decays(sides: Sides) -> tuple[str, ...]:
    """Name the decays that the grid of 1/4096 changes by more than ``COARSE``."""
    found = []
    for pair in sides.phase.program_neurons.groups:
        for register in ("u", "v"):
            exact = float((1.0 - getattr(pair.exact, f"keep_{register}")).flat[0]) * DECAY_ONE
            held = round(float((1.0 - getattr(pair.chip, f"keep_{register}")).flat[0]) * DECAY_ONE)
            if abs(held - exact) > COARSE * exact:
                way = "faster" if held > exact else "slower"
                share = abs(held - exact) / exact
                found.append(f"a decay of {exact:.4g} in 4096 is {held}: it fades {100 * share:.2g} % {way}")
    return tuple(dict.fromkeys(found))
