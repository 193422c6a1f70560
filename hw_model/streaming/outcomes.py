"""What playing a recording step by step, and stopping it early, give; known without the compiled loops."""

import numpy as np

from hw_model.description.counts import Counts
from hw_model.mapping.graph import winning
from hw_model.values import FloatArray, IntArray, Shown


class StepScores(Shown):
    """The state of the readout after each of some steps.

    ``spikes[name]`` (steps, classes): spikes so far of each population of the readout, or, where its potentials
    predict, ``potential[name]``: the largest so far. ``scores`` (steps, classes).
    """

    spikes: dict[str, IntArray]
    potential: dict[str, IntArray]
    scores: FloatArray
    tie_class: int | None = None
    """The class that is predicted where all scores tie; None: the program names none."""

    @property
    def prediction(self) -> IntArray:
        """Class with the highest score after each step, the first of equals, (steps,).

        Where all scores tie, it is the readout's class for ties or, as nothing is predicted, class 0.
        """
        return np.asarray(winning(self.scores, self.tie_class), dtype=np.int64)

    @property
    def lead(self) -> FloatArray:
        """By how much the best score after each step is above the second, (steps,)."""
        return leads(self.scores)


def leads(scores: FloatArray) -> FloatArray:
    """Return by how much the best of scores (..., classes) is above the second, or above 0 if it is the only one."""
    if scores.shape[-1] == 1:
        return scores[..., 0]
    best = np.partition(scores, -2, axis=-1)
    return np.asarray(best[..., -1] - best[..., -2])


class Stops(Shown):
    """Where each recording of a batch stops, and what was done until then.

    - ``steps``: the step in which each stops, (batch,), out of ``all_steps``. Steps are those of all phases, one after
      the other, if it stops by :func:`stop_when_proven`, and those of the recording if it stops by another rule
    - ``prediction``: at the stop, (batch,); ``final``: without stopping, (batch,)
    - ``counts``: until the stops, of all recordings together; ``all_counts``: without stopping. They hold the counts
      that cost energy (:data:`hw_model.description.counts.BY_CORE`); all others, such as wraps and clips, are 0
    - ``latency_ns``: until the stops, by the chip's default profile; ``all_latency_ns``: without stopping
    """

    steps: IntArray
    all_steps: int
    prediction: IntArray
    final: IntArray
    counts: Counts
    all_counts: Counts
    latency_ns: float
    all_latency_ns: float
