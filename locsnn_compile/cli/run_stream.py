"""The part of ``locsnn run`` that plays recordings step by step, shows what is predicted so far, and keeps time."""

import argparse
import math
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

import hw_model as hw
from hw_model.mapping.graph import decided
from hw_model.streaming.early_stop import to_the_end
from hw_model.values import ArrayLike, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.cli.diff import read_report
from locsnn_compile.cli.outcomes import Change, Outcome, StepLatency, StreamFigures
from locsnn_compile.cli.shell import progress_bar
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.report.format import ratio, seconds

_CLEAR = "\r\x1b[K"
LABEL = "the label"
LAST_PREDICTION = "the prediction after the last step"
"""What a prediction is compared with over time, without labels."""
_MOMENTS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of a recording after which the summary gives a figure."""
OnStep = Callable[[int, int, float], None]
"""Called after every step with (steps so far, class predicted, its lead over the second)."""


class Streamed(Frozen, eq=False):
    """What was known after every step of a recording, or until it was stopped; arrays (steps,).

    ``prediction`` is the class with the best score, ``lead`` by how much, ``seconds`` how long the step took here.
    ``decided`` is the prediction, or -1 where all classes tie, so that nothing is predicted.
    """

    prediction: IntArray
    lead: FloatArray
    seconds: FloatArray
    decided: IntArray

    @property
    def changes(self) -> tuple[Change, ...]:
        """Each change of the prediction, from the first lead on."""
        with_lead = np.flatnonzero(self.lead > 0)
        if not len(with_lead):
            return ()
        first = int(with_lead[0])
        turns = first + 1 + np.flatnonzero(np.diff(self.prediction[first:]))
        return tuple(
            Change(t + 1, int(self.prediction[t]), float(self.lead[t]))
            for t in [first, *turns.tolist()]
        )

    def filled(self, steps: int) -> IntArray:
        """Return what is decided after each of the first steps, (steps,); after a stop it stays."""
        return np.pad(self.decided, (0, steps - len(self.decided)), mode="edge")


def stream(
    session: hw.Session,
    rows: Mapping[str, ByteArray],
    margin: float | None = None,
    on_step: OnStep | None = None,
) -> Streamed:
    """Reset a session and push a recording, (steps, channels) by stream; stop when the lead reaches a margin."""
    session.reset()
    steps = len(next(iter(rows.values())))
    prediction = np.zeros(steps, dtype=np.int64)
    sure_prediction = np.zeros(steps, dtype=np.int64)
    lead = np.zeros(steps)
    step_seconds = np.zeros(steps)
    played = 0
    while played < steps:
        start = time.perf_counter()
        known = session.push({name: array[played] for name, array in rows.items()})
        step_seconds[played] = time.perf_counter() - start
        prediction[played] = known.prediction[0]
        sure_prediction[played] = decided(known.scores, known.tie_class)[0]
        lead[played] = known.lead[0]
        played += 1
        if on_step:
            on_step(played, int(known.prediction[0]), float(known.lead[0]))
        if margin is not None and known.lead[0] >= margin:
            break
    return Streamed(
        prediction[:played], lead[:played], step_seconds[:played], sure_prediction[:played]
    )


def step_latency(streamed: Sequence[Streamed]) -> StepLatency:
    """Return how long steps took."""
    seconds = np.concatenate([recording.seconds for recording in streamed])
    return StepLatency(
        mean=float(seconds.mean()),
        p99=float(np.quantile(seconds, 0.99)),
        worst=float(seconds.max()),
    )


def right_over_time(streamed: Sequence[Streamed], wanted: ArrayLike, steps: int) -> FloatArray:
    """Return the share of recordings that predict the wanted class (recordings,) after each step, (steps,).

    Where all classes tie, nothing is predicted: only a wanted -1 says so.
    """
    predictions = np.stack([one.filled(steps) for one in streamed])
    shares: FloatArray = (predictions == np.asarray(wanted)[:, None]).mean(axis=0)
    return shares


class LiveLine:
    """Writes lines to a stream; on a terminal :meth:`show` replaces the line that it last wrote."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.watched = stream.isatty()

    def show(self, line: str) -> None:
        """Write a line. On a terminal the next one replaces it; elsewhere it stays."""
        if not self.watched:
            return self.say(line)
        self.close()
        print(line[: shutil.get_terminal_size().columns - 1], end="", file=self._stream, flush=True)

    def say(self, line: str) -> None:
        """Write a line that stays."""
        self.close()
        print(line, file=self._stream, flush=True)

    def close(self) -> None:
        """On a terminal, clear the line that would be replaced."""
        print(end=_CLEAR if self.watched else "", file=self._stream)


def stream_all(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    outcomes: Sequence[Outcome],
    margin: float | None,
) -> tuple[list[Outcome], StreamFigures]:
    """Stream and show every recording; return the outcomes with their changes, and the figures of all."""
    step_seconds = _step_seconds(args, program, recordings)
    session = hw.Session(program, args.psi)
    # The first pushes load compiled code, which must not count towards the time of a step.
    stream(hw.Session(program, args.psi), _rows(to_the_end(program, recordings.spikes[:1])))
    streamed: list[Streamed] = []
    with_changes: list[Outcome] = []
    watched = nullcontext() if args.json else closing(LiveLine(sys.stdout))
    with watched as line, progress_bar("streaming", show=args.json) as progress:
        for i, outcome in enumerate(outcomes):
            played = _rows(to_the_end(program, recordings.spikes[i : i + 1]))
            steps = len(next(iter(played.values())))
            on_step = _shown(line, i, steps, step_seconds) if line else None
            item = stream(session, played, margin, on_step)
            streamed.append(item)
            with_changes.append(replace(outcome, changes=item.changes))
            if line:
                stopped = margin is not None and bool(item.lead[-1] >= margin)
                line.say(_settled(with_changes[-1], item, stopped=stopped))
            if progress:
                progress(i + 1, len(outcomes))
    if recordings.labels is not None:
        wanted = recordings.labels
        right_is = LABEL
    else:
        wanted = np.array([-1 if outcome.tied else outcome.prediction for outcome in outcomes])
        right_is = LAST_PREDICTION
    latency = step_latency(streamed)
    figures = StreamFigures(
        psi=args.psi,
        step_seconds=step_seconds,
        step_latency_seconds=latency,
        real_time_factor=step_seconds and step_seconds / latency.mean,
        worst_real_time_factor=step_seconds and step_seconds / latency.worst,
        right_is=right_is,
        right=tuple(right_over_time(streamed, wanted, steps).tolist()),
    )
    return with_changes, figures


def stream_lines(figures: StreamFigures) -> list[str]:
    """Return a line on predictions over time, and one on the pace."""
    right = figures.right
    step_seconds = figures.step_seconds
    shown = []
    for part in _MOMENTS:
        step = max(1, round(part * len(right)))
        moment = f"step {step}" if step_seconds is None else _seconds(step, step_seconds)
        shown.append(f"{right[step - 1]:.3f} after {moment}")
    what = "accuracy over time" if figures.right_is == LABEL else "already the last prediction"
    latency = figures.step_latency_seconds
    pace = (
        f"a step took {seconds(latency.mean)} on average, 99 % of them at most "
        f"{seconds(latency.p99)}, the longest {seconds(latency.worst)}"
    )
    return [f"{what}: {', '.join(shown)}", f"{pace}; {_pace_of_sensor(figures)}"]


def _pace_of_sensor(figures: StreamFigures) -> str:
    factor = figures.real_time_factor
    worst_factor = figures.worst_real_time_factor
    if figures.step_seconds is None or factor is None or worst_factor is None:
        return "the length of a step at the sensor is not known: give --step-seconds"
    return (
        f"at the sensor it takes {seconds(figures.step_seconds)}: {ratio(factor)} times as "
        f"fast as real time, {ratio(worst_factor)} times in the longest step"
    )


def _rows(streams: dict[str, Any]) -> dict[str, Any]:
    """Return the single recording of a batch, by stream."""
    return {name: array[0] for name, array in streams.items()}


def _shown(line: LiveLine, recording: int, steps: int, step_seconds: float | None) -> OnStep:
    """Return a callback that shows each new prediction and, on a terminal, each new lead."""
    shown: tuple[int, float] | None = None

    def on_step(step: int, prediction: int, lead: float) -> None:
        nonlocal shown
        silent = shown is None and lead <= 0
        same = (
            shown is not None and shown[0] == prediction and not (line.watched and shown[1] != lead)
        )
        if silent or same:
            return
        shown = (prediction, lead)
        moment = "" if step_seconds is None else f"  {_seconds(step, step_seconds)}"
        place = f"recording {recording}  step {step} of {steps}{moment}"
        line.show(f"{place}  class {prediction}  lead {lead_text(lead)}")

    return on_step


def _seconds(step: int, step_seconds: float) -> str:
    """Return the time after a step, with enough decimals to tell steps apart."""
    return f"{step * step_seconds:.{max(0, math.ceil(-math.log10(step_seconds)))}f} s"


def lead_text(lead: float) -> str:
    """Return a lead in spikes as text; time-weighted leads begin far below one spike."""
    if 0 < lead < 0.01:
        return "under 0.01"
    return f"{lead:.3g}" if lead < 1000 else f"{lead:,.0f}"


def _settled(outcome: Outcome, streamed: Streamed, *, stopped: bool) -> str:
    predicted = f"class {streamed.prediction[-1]}"
    if streamed.decided[-1] < 0:
        predicted = "all classes tie"
    label = "" if outcome.label is None else f"  label {outcome.label}"
    since = f"  since step {outcome.changes[-1].step}" if outcome.changes else ""
    end = f", stopped after step {len(streamed.prediction)}" if stopped else ""
    return f"recording {outcome.recording}: {predicted}{label}{since}{end}"


def _step_seconds(
    args: argparse.Namespace, program: hw.ChipProgram, recordings: Recordings
) -> float | None:
    """Return how long a step is, from the recordings, the options or the report of the build."""
    if recordings.step_seconds is not None:
        return recordings.step_seconds
    try:
        recording_ns = read_report(Path(args.program))["latency"]["recording_ns"]
    except (InputError, KeyError, TypeError):
        return None
    steps = next((phase.steps for phase in program.phases if phase.axis == "time"), None)
    return recording_ns / steps * 1e-9 if isinstance(recording_ns, int | float) and steps else None
