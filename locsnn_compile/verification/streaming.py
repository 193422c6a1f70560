"""Recordings pushed row by row to a session, with the time of every step, and how predictions change on the way."""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

import hw_model as hw
from hw_model.values import ArrayLike, ByteArray, FloatArray, Frozen, IntArray

OnStep = Callable[[int, int, float], None]
"""Called after every step with (steps so far, class predicted, its lead over the second)."""


class Streamed(Frozen, eq=False):
    """What was known after every step of a recording, or until it was stopped; arrays (steps,).

    ``prediction`` is the class with the best score, ``lead`` by how much, ``seconds`` how long the step took here.
    """

    prediction: IntArray
    lead: FloatArray
    seconds: FloatArray

    @property
    def changes(self) -> list[tuple[int, int, float]]:
        """(step counted from 1, class, lead) for each change of the prediction, from the first lead on."""
        led = np.flatnonzero(self.lead > 0)
        if not len(led):
            return []
        start = int(led[0])
        at = [start, *(start + 1 + np.flatnonzero(np.diff(self.prediction[start:]))).tolist()]
        return [(t + 1, int(self.prediction[t]), float(self.lead[t])) for t in at]

    def filled(self, steps: int) -> IntArray:
        """Return the prediction after each of so many steps, (steps,); after a stop it stays."""
        return np.pad(self.prediction, (0, steps - len(self.prediction)), mode="edge")


def stream(
    session: hw.Session, rows: Mapping[str, ByteArray], margin: float | None = None, on_step: OnStep | None = None
) -> Streamed:
    """Reset a session and push a recording, (steps, channels) by stream; stop when the lead reaches a margin."""
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


def step_latency(streamed: Sequence[Streamed]) -> dict[str, float]:
    """Return the seconds per step: the mean, the 99th percentile and the longest."""
    seconds = np.concatenate([one.seconds for one in streamed])
    return {"mean": float(seconds.mean()), "p99": float(np.quantile(seconds, 0.99)), "worst": float(seconds.max())}


def right_over_time(streamed: Sequence[Streamed], wanted: ArrayLike, steps: int) -> FloatArray:
    """Return the share of recordings that predict the wanted class (recordings,) after each step, (steps,)."""
    predictions = np.stack([one.filled(steps) for one in streamed])
    shares: FloatArray = (predictions == np.asarray(wanted)[:, None]).mean(axis=0)
    return shares
