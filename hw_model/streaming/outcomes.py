"""The results of playing a recording step by step (:class:`StepScores`), and of stopping it early (:class:`Stops`).

They stand in a module of their own, so that reports can use them without loading the compiled loops.
"""

import numpy as np

from hw_model.description.counts import Counts
from hw_model.mapping.graph import winning
from hw_model.values import FloatArray, IntArray, Shown


class StepScores(Shown):
    """The state of the readout after each of the steps that were pushed to a session.

    - ``spikes[name]`` (steps, classes): the spikes so far of a population that is read by its spikes
    - ``potential[name]`` (steps, classes): the largest potentials so far of a population that is read by them
    - ``scores`` (steps, classes): the class scores
    """

    spikes: dict[str, IntArray]
    potential: dict[str, IntArray]
    scores: FloatArray
    tie_class: int | None = None
    """The class that is predicted if all scores are equal; None if the program names none."""

    @property
    def prediction(self) -> IntArray:
        """The class with the highest score after each step, the first one of equal scores, (steps,).

        If all scores are equal, it is the readout's class for ties or, if the readout has none, class 0.
        """
        return np.asarray(winning(self.scores, self.tie_class), dtype=np.int64)

    @property
    def lead(self) -> FloatArray:
        """By how much the best score after each step is above the second, (steps,)."""
        return leads(self.scores)


def leads(scores: FloatArray) -> FloatArray:
    """Return by how much the best of the scores (..., classes) exceeds the second; one score is compared with 0."""
    if scores.shape[-1] == 1:
        return scores[..., 0]
    # Partitioned so that the two largest scores are the last two.
    partitioned = np.partition(scores, -2, axis=-1)
    return np.asarray(partitioned[..., -1] - partitioned[..., -2])


class Stops(Shown):
    """Where each recording of a batch stops, and what it costs with and without stopping.

    - ``steps`` (batch,): the step after which each recording stops, out of ``all_steps``. For :func:`stop_when_proven`,
      these are steps of all phases, one after the other; for the other rules, steps of the recording
    - ``prediction`` (batch,): the prediction at the stop; ``final`` (batch,): the prediction without stopping
    - ``counts``: the counts until the stops, of all recordings together; ``all_counts``: the counts without stopping.
      They hold the counts that cost energy (:data:`hw_model.description.counts.BY_CORE`); all others, such as wraps and
      clips, are 0
    - ``latency_ns``: the time until the stops, by the chip's default profile; ``all_latency_ns``: without stopping
    """

    steps: IntArray
    all_steps: int
    prediction: IntArray
    final: IntArray
    counts: Counts
    all_counts: Counts
    latency_ns: float
    all_latency_ns: float
