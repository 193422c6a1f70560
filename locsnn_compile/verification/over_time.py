"""How predictions settle while recordings play, for a report, and where each recording could be stopped early.

A streaming session (:class:`hw.Session`) plays the recordings step by step, and gives class scores after every step.
"""

from collections.abc import Callable, Mapping
from functools import reduce

import numpy as np

import hw_model as hw
from hw_model.engine.usable import why_not_compiled
from hw_model.streaming.outcomes import StepScores
from hw_model.streaming.psi import check_psi, location_share
from hw_model.values import ByteArray, FloatArray, Frozen, IntArray, added
from locsnn_compile.cluster.spread import Spread, here
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network
from locsnn_compile.verification.diagnosis import spread_sample
from locsnn_compile.verification.matching import Progress
from locsnn_compile.verification.observation import Observed

PSI = 10.0
"""Default psi of the time-weighted prediction, see :func:`location_share`. Published values: 15 for Objects, 10 for
Containers, 2 for Slip (Kang et al. 2022)."""
SAMPLE = 64
"""Largest number of recordings that a report follows."""
WORK = 1 << 31
"""Largest number of neuron updates of a report, as if every step ran the location branch again: a few seconds."""
QUICK = 1 << 28
"""Number of neuron updates that a report stays below, ..."""
AT_LEAST = 16
"""... unless it would follow fewer than this many recordings."""
TOGETHER = "together"
"""Key of the prediction by both branches, in equal parts."""
TIME_WEIGHTED = "time_weighted"
"""Key of the prediction whose weight moves from the time branch to the location branch."""


class OverTime(Frozen, eq=False):
    """Predictions after every step of the recordings with the numbers ``recordings``, out of ``available``.

    ``right[prediction]`` (steps,) is the share of recordings for which a prediction is right after each step: that of
    each axis alone, of both together, and time-weighted by ``psi`` (Kang et al. 2022). Without labels, ``labelled`` is
    False and the prediction after the last step counts as right. If all scores tie, nothing is predicted: with labels,
    that is wrong; without them, a recording that ends in a tie is left out. ``proven`` has the step at which each
    recording could stop, because its prediction can no longer change.
    """

    recordings: tuple[int, ...]
    available: int
    labelled: bool
    psi: float
    right: Mapping[str, FloatArray]
    proven: hw.Stops


def over_time(observed: Observed, psi: float = PSI) -> OverTime | str:
    """Follow the predictions of a program over some of the recordings, evenly spread.

    Return the reason, as words of the report, if they cannot be followed. Raises ``InputError`` for a psi below 0.
    """
    levels = observed.levels
    recordings = observed.recordings
    labels = observed.labels
    program = levels.program
    check_psi(psi)
    reason = why_not_compiled()
    if reason is not None:
        return f"there are no compiled loops here, {reason}"
    work = _work(levels.network)
    if work > WORK:
        return "the network is too large to be followed step by step within seconds"
    try:
        hw.Session(program)  # refuses programs that cannot be played step by step
    except InputError as error:
        return f"{error.where} {error.what}"
    samples = min(SAMPLE, WORK // work, max(AT_LEAST, QUICK // work))
    chosen = spread_sample(levels.network, len(recordings), samples)
    played = recordings[list(chosen)]
    scores = _scores(program, played, psi)
    readout = levels.network.readout
    if labels is None:
        right_class = readout.decided(scores[TOGETHER][:, -1])
        has_right_class = right_class >= 0
    else:
        right_class = labels[list(chosen)]
        has_right_class = np.full(len(right_class), True)
    if not has_right_class.any():
        return "all class scores tie after the last step of every recording"
    return OverTime(
        recordings=chosen,
        available=len(recordings),
        labelled=labels is not None,
        psi=psi,
        right={
            name: _share_right(
                readout.decided(scores_by_step)[has_right_class], right_class[has_right_class]
            )
            for name, scores_by_step in scores.items()
        },
        proven=hw.stop_when_proven(program, played),
    )


def _share_right(predictions: IntArray, right_class: IntArray) -> FloatArray:
    """Return the share of predictions (batch, steps) that equal the right classes (batch,), (steps,)."""
    share: FloatArray = (predictions == right_class[:, None]).mean(axis=0)
    return share


def stop_all(
    stop: Callable[[ByteArray], hw.Stops],
    recordings: ByteArray,
    progress: Progress | None = None,
    chunk: int = SAMPLE,
    spread: Spread = here,
) -> hw.Stops:
    """Apply ``stop`` to ``chunk`` recordings at a time, so that memory does not grow with their number.

    Return where each of all recordings stops, with the counts and times of all.
    """
    chunks = (recordings[start : start + chunk] for start in range(0, len(recordings), chunk))
    parts: list[hw.Stops] = []
    for stops in spread(stop, chunks):
        parts.append(stops)
        if progress:
            progress(min(len(parts) * chunk, len(recordings)), len(recordings))
    return hw.Stops(
        steps=np.concatenate([part.steps for part in parts]),
        prediction=np.concatenate([part.prediction for part in parts]),
        final=np.concatenate([part.final for part in parts]),
        counts=reduce(added, [part.counts for part in parts]),
        all_counts=reduce(added, [part.all_counts for part in parts]),
        latency_ns=reduce(added, [part.latency_ns for part in parts]),
        all_latency_ns=reduce(added, [part.all_latency_ns for part in parts]),
        all_steps=parts[0].all_steps,
    )


def _work(network: Network) -> int:
    """Return the neuron updates per recording if the whole location phase ran after every step."""
    runs_per_recording = {"time": 1, "location": network.steps}
    return sum(
        p.size * network.steps_of(p.phase) * runs_per_recording[p.axis] for p in network.populations
    )


def _scores(program: hw.ChipProgram, recordings: ByteArray, psi: float) -> dict[str, FloatArray]:
    """Return the class scores (batch, steps, classes) after every step, by prediction.

    A program with one axis has only the prediction :data:`TOGETHER`.
    """
    readout = program.readout
    assert readout is not None
    axis_of: dict[str, str] = {
        name: phase.axis for phase in program.phases for name in program.columns_of(phase.name)
    }

    def scores_by_axis(pushed: StepScores) -> dict[str, FloatArray]:
        """Return the weighted outputs of the populations that are read, added up by axis."""
        outputs = {**pushed.spikes, **pushed.potential}
        scores_of_population = (
            {axis_of[name]: weight * outputs[name].astype(np.float64)}
            for name, weight in readout.terms
        )
        return reduce(added, scores_of_population)

    from hw_model.streaming.early_stop import pushed_each  # numba: only where it can be used

    stream = next(iter(program.streams))  # networks have a single stream of events
    per_recording = pushed_each(program, {stream: recordings}, scores_by_axis)
    by_axis = {
        axis: np.stack([scores[axis] for scores in per_recording]) for axis in per_recording[0]
    }
    together = sum(by_axis.values(), start=np.zeros_like(next(iter(by_axis.values()))))
    if len(by_axis) == 1:
        return {TOGETHER: together}
    steps = recordings.shape[1]
    share = location_share(psi, np.arange(1, steps + 1), steps)[:, None]
    weighted = (1.0 - share) * by_axis["time"] + share * by_axis["location"]
    return {**by_axis, TOGETHER: together, TIME_WEIGHTED: weighted}
