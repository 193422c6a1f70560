"""Where the error of a program comes from: its budget, the cause of the first divergence, and the margins."""

import numpy as np

from hw_model.values import ByteArray, Shown
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.verification.error_budget.budget import StageErrors, error_budget
from locsnn_compile.verification.error_budget.cause import Cause, find_cause
from locsnn_compile.verification.error_budget.stages import neuron_steps
from locsnn_compile.verification.margins import Margins, margins
from locsnn_compile.verification.matching import Divergence, Progress

SAMPLE = 16
"""Recordings of a report's diagnosis, unless more are asked for: each is evaluated some fifteen times."""
NEURON_STEPS = 1 << 22
"""A diagnosis of a large network takes fewer recordings, so that all their neurons and steps are no more than this."""


class Diagnosis(Shown):
    """A diagnosis over the recordings of these numbers, out of ``available``.

    ``budget`` is None where every population is on the grid from the start: nothing is rounded, and there is nothing to
    take apart. ``cause`` is None where no spike differs, or there is no budget.
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
    """Diagnose a program over at most so many recordings (None: all), evenly spread over those at hand.

    ``recordings`` (samples, steps, channels), of the network's own steps and channels; ``first`` is where they first
    diverge.
    """
    network = levels.network
    chosen = spread_sample(network, len(recordings), samples)
    played = recordings[list(chosen)]
    float_network = not all(population.on_grid for population in network.populations)
    return Diagnosis(
        recordings=chosen,
        available=len(recordings),
        budget=error_budget(levels, played, progress) if float_network else None,
        cause=find_cause(levels, recordings[first.recording], first) if first and float_network else None,
        margins=margins(levels, played),
    )


def spread_sample(network: Network, available: int, samples: int | None) -> tuple[int, ...]:
    """Return the numbers of the recordings to take, first and last among them where there are two."""
    if samples is None:
        return tuple(range(available))
    many = max(1, min(available, samples, NEURON_STEPS // neuron_steps(network)))
    return tuple(int(i) for i in np.linspace(0, available - 1, many).round())
