"""Play a recording to a program row by row, as a sensor would send it, and time every step."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import hw_model as hw
from hw_model.arithmetic.fixed_point import IntArray
from hw_model.engine.trace import ByteArray

FloatArray = npt.NDArray[np.float64]

OnStep = Callable[[int, int, float], None]
"""Called after every step with (steps so far, class predicted, its lead over the second)."""


@dataclass(frozen=True, eq=False)
class Streamed:
    """What was known after every step of a recording, arrays (steps,); where it was stopped, until then.

    ``prediction``: the class with the best score; ``lead``: by how much; ``seconds``: how long the step took here.
    """

    prediction: IntArray
    lead: FloatArray
    seconds: FloatArray

    @property
    def changes(self) -> list[tuple[int, int, float]]:
        """(step counted from 1, class, lead) wherever the prediction changed, from the first lead on."""
        led = np.flatnonzero(self.lead > 0)
        if not len(led):
            return []
        start = int(led[0])
        at = [start, *(start + 1 + np.flatnonzero(np.diff(self.prediction[start:]))).tolist()]
        return [(t + 1, int(self.prediction[t]), float(self.lead[t])) for t in at]

    def filled(self, steps: int) -> IntArray:
        """Return the prediction after each of so many steps; after a stop it stays, (steps,)."""
        return np.pad(self.prediction, (0, steps - len(self.prediction)), mode="edge")


def stream(
    session: hw.Session, rows: Mapping[str, ByteArray], margin: float | None = None, on_step: OnStep | None = None
) -> Streamed:
    """Reset a session and push a recording, (steps, channels) by stream; stop where the lead reaches a margin."""
    session.reset()
    steps = len(next(iter(rows.values())))
    prediction, lead, seconds = np.zeros(steps, dtype=np.int64), np.zeros(steps), np.zeros(steps)
    done = 0
    while done < steps:
        start = time.perf_counter()
        found = session.push({name: array[done] for name, array in rows.items()})
        seconds[done] = time.perf_counter() - start
        prediction[done], lead[done] = found.prediction[0], found.lead[0]
        done += 1
        if on_step:
            on_step(done, int(prediction[done - 1]), float(lead[done - 1]))
        if margin is not None and lead[done - 1] >= margin:
            break
    return Streamed(prediction[:done], lead[:done], seconds[:done])


@dataclass(frozen=True)
class StepLatency:
    """Seconds that a step took: on average, what 99 % of the steps took at most, and the longest."""

    mean: float
    p99: float
    worst: float


def step_latency(streamed: Sequence[Streamed]) -> StepLatency:
    """Return how long the steps of recordings took."""
    seconds = np.concatenate([one.seconds for one in streamed])
    return StepLatency(float(seconds.mean()), float(np.quantile(seconds, 0.99)), float(seconds.max()))


def right_over_time(streamed: Sequence[Streamed], wanted: npt.ArrayLike, steps: int) -> FloatArray:
    """Return the share of recordings whose prediction is the wanted class (recordings,) after each step, (steps,)."""
    predictions = np.stack([one.filled(steps) for one in streamed])
    shares: FloatArray = (predictions == np.asarray(wanted)[:, None]).mean(axis=0)
    return shares
