"""How predictions settle while recordings play, as a report follows them, and what stopping early saves."""

from collections.abc import Callable, Mapping
from functools import reduce

import numpy as np

import hw_model as hw
from hw_model.engine.usable import why_not_compiled
from hw_model.streaming.outcomes import StepScores
from hw_model.streaming.psi import check_psi, location_share
from hw_model.values import ByteArray, FloatArray, Frozen, added
from locsnn_compile.cluster.spread import Spread, here
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network
from locsnn_compile.verification.diagnosis import spread_sample
from locsnn_compile.verification.matching import Progress
from locsnn_compile.verification.observation import Observed

PSI = 10.0
"""For the time-weighted prediction, unless another is given. Published: 15 for Objects, 10 Containers, 2 Slip."""
SAMPLE = 64
"""Most recordings that a report follows."""
WORK = 1 << 31
"""Most neuron updates of a report if every step ran the location branch again: a few seconds."""
QUICK, AT_LEAST = 1 << 28, 16
"""A report takes at most QUICK neuron updates, but follows at least AT_LEAST recordings."""
TOGETHER = "together"
TIME_WEIGHTED = "time_weighted"


class OverTime(Frozen, eq=False):
    """Predictions after every step of the recordings with these numbers, out of ``available``.

    ``right[prediction]`` (steps,) is the share of recordings for which a prediction is right after each step: that of
    each axis alone, of both together, and time-weighted by ``psi`` (Kang et al. 2022). Without labels, ``labelled`` is
    False and the prediction after the last step counts as right. If all scores tie, nothing is predicted: it is wrong
    with a label, and a recording that ends in a tie without one is left out. ``proven`` is where each could stop.
    """

    recordings: tuple[int, ...]
    available: int
    labelled: bool
    psi: float
    right: Mapping[str, FloatArray]
    proven: hw.Stops


def over_time(observed: Observed, psi: float = PSI) -> OverTime | str:
    """Follow the predictions of a program over some of the recordings, evenly spread, or say why not.

    A psi below 0 is an ``InputError``.
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
        hw.Session(program)
    except InputError as error:
        return f"{error.where} {error.what}"
    many = min(SAMPLE, WORK // work, max(AT_LEAST, QUICK // work))
    chosen = spread_sample(levels.network, len(recordings), many)
    played = recordings[list(chosen)]
    scores = _scores(program, played, psi)
    readout = levels.network.readout
    wanted = readout.decided(scores[TOGETHER][:, -1]) if labels is None else labels[list(chosen)]
    known = np.full(len(wanted), labels is not None) | (wanted >= 0)
    if not known.any():
        return "all class scores tie after the last step of every recording"
    return OverTime(
        recordings=chosen,
        available=len(recordings),
        labelled=labels is not None,
        psi=psi,
        right={
            name: (readout.decided(scores_of_axis) == wanted[:, None])[known].mean(axis=0)
            for name, scores_of_axis in scores.items()
        },
        proven=hw.stop_when_proven(program, played),
    )


def stop_all(
    stop: Callable[[ByteArray], hw.Stops],
    recordings: ByteArray,
    progress: Progress | None = None,
    chunk: int = SAMPLE,
    spread: Spread = here,
) -> hw.Stops:
    """Stop recordings chunk by chunk, so memory does not grow with their number."""
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
    again = {"time": 1, "location": network.steps}
    return sum(p.size * network.steps_of(p.phase) * again[p.axis] for p in network.populations)


def _scores(program: hw.ChipProgram, recordings: ByteArray, psi: float) -> dict[str, FloatArray]:
    """Return the class scores (batch, steps, classes) after every step, by prediction; one axis has just one."""
    readout = program.readout
    assert readout is not None
    axis_of: dict[str, str] = {
        name: phase.axis for phase in program.phases for name in program.columns_of(phase.name)
    }
    voters = list(zip(readout.populations, readout.weights, strict=True))

    def votes(pushed: StepScores) -> dict[str, FloatArray]:
        outputs = {**pushed.spikes, **pushed.potential}
        return reduce(
            added,
            ({axis_of[name]: weight * outputs[name].astype(np.float64)} for name, weight in voters),
        )

    from hw_model.streaming.early_stop import pushed_each  # numba: only where it can be used

    each = pushed_each(program, {next(iter(program.streams)): recordings}, votes)
    by_axis = {axis: np.stack([scores[axis] for scores in each]) for axis in each[0]}
    together = sum(by_axis.values(), start=np.zeros_like(next(iter(by_axis.values()))))
    if len(by_axis) == 1:
        return {TOGETHER: together}
    steps = recordings.shape[1]
    of_location = location_share(psi, np.arange(1, steps + 1), steps)[:, None]
    weighted = (1.0 - of_location) * by_axis["time"] + of_location * by_axis["location"]
    return {**by_axis, TOGETHER: together, TIME_WEIGHTED: weighted}
