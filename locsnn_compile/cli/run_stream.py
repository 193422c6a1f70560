"""``locsnn run --stream``: play recordings step by step, show what is predicted so far, and keep time.

A *lead* is the score of the best class less that of the second. The score of a class is its spike
count so far (time-weighted with ``--psi``), so a lead is a number of spikes.
"""

import argparse
import math
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TextIO

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

_CLEAR_LINE = "\r\x1b[K"
"""Moves the cursor to the start of the terminal's line, and clears the line."""
LABEL = "the label"
"""What predictions over time are compared with."""
LAST_PREDICTION = "the prediction after the last step"
"""What they are compared with if the recordings have no labels."""
_SUMMARY_MOMENTS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Parts of a recording after which the summary gives a figure."""
OnStep = Callable[[int, int, float], None]
"""Called after every step with (steps so far, class predicted, its lead over the second)."""


class Streamed(Frozen, eq=False):
    """What was known after every step of a recording, or until it was stopped; arrays (steps,).

    - ``prediction``: the class with the best score, the first of equal ones
    - ``lead``: by how much its score exceeds the second
    - ``seconds``: how long the step took here
    - ``decided``: the prediction, or -1 where all classes tie, so that nothing is predicted
    """

    prediction: IntArray
    lead: FloatArray
    seconds: FloatArray
    decided: IntArray

    @property
    def changes(self) -> tuple[Change, ...]:
        """Each change of the prediction, from the first lead on.

        Before the first lead all classes are equal, and the prediction is class 0 for no reason.
        """
        leading_steps = np.flatnonzero(self.lead > 0)
        if not len(leading_steps):
            return ()
        first = int(leading_steps[0])
        # diff[i] compares steps first + i and first + i + 1, and the later of them is the change.
        later_changes = first + 1 + np.flatnonzero(np.diff(self.prediction[first:]))
        return tuple(
            Change(t + 1, int(self.prediction[t]), float(self.lead[t]))
            for t in [first, *later_changes.tolist()]
        )

    def filled(self, steps: int) -> IntArray:
        """Return what is decided after each of ``steps`` steps; after a stop it stays."""
        missing = steps - len(self.decided)
        return np.pad(self.decided, (0, missing), mode="edge")


def stream(
    session: hw.Session,
    rows: Mapping[str, ByteArray],
    margin: float | None = None,
    on_step: OnStep | None = None,
) -> Streamed:
    """Play a recording step by step; stop when the lead reaches the margin, if there is one.

    ``rows`` has the recording, (steps, channels), by input stream. The session is reset first.
    """
    session.reset()
    steps = _steps_of(rows)
    prediction = np.zeros(steps, dtype=np.int64)
    decided_class = np.zeros(steps, dtype=np.int64)
    lead = np.zeros(steps)
    seconds = np.zeros(steps)
    played = 0
    while played < steps:
        start = time.perf_counter()
        result = session.push({name: array[played] for name, array in rows.items()})
        seconds[played] = time.perf_counter() - start
        # Arrays of the result are (rows pushed, ...), here one row.
        prediction[played] = result.prediction[0]
        decided_class[played] = decided(result.scores, result.tie_class)[0]
        lead[played] = result.lead[0]
        played += 1
        if on_step:
            on_step(played, int(result.prediction[0]), float(result.lead[0]))
        if margin is not None and result.lead[0] >= margin:
            break
    return Streamed(
        prediction=prediction[:played],
        lead=lead[:played],
        seconds=seconds[:played],
        decided=decided_class[:played],
    )


def step_latency(streamed: Sequence[Streamed]) -> StepLatency:
    """Return how long the steps of all recordings took."""
    seconds = np.concatenate([recording.seconds for recording in streamed])
    return StepLatency(
        mean=float(seconds.mean()),
        p99=float(np.quantile(seconds, 0.99)),
        worst=float(seconds.max()),
    )


def right_over_time(streamed: Sequence[Streamed], right: ArrayLike, steps: int) -> FloatArray:
    """Return the share of recordings that predict the right class after each step, (steps,).

    ``right`` has the class of each recording, (recordings,), or -1 if it is right to predict nothing:
    a prediction is -1 where all classes tie.
    """
    predictions = np.stack([recording.filled(steps) for recording in streamed])
    shares: FloatArray = (predictions == np.asarray(right)[:, None]).mean(axis=0)
    return shares


class LiveLine:
    """Writes lines to a stream; on a terminal, a line of :meth:`show` is replaced by the next line."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.is_terminal = stream.isatty()

    def show(self, line: str) -> None:
        """Write a line. On a terminal the next one replaces it; elsewhere it stays."""
        if not self.is_terminal:
            self.write(line)
            return
        self.close()
        # Without a line break, and shorter than the terminal is wide: of a line that wraps, only the
        # last part could be cleared.
        width = shutil.get_terminal_size().columns - 1
        print(line[:width], end="", file=self._stream, flush=True)

    def write(self, line: str) -> None:
        """Write a line that stays."""
        self.close()
        print(line, file=self._stream, flush=True)

    def close(self) -> None:
        """Clear the line that the next one would replace, if the stream is a terminal."""
        if self.is_terminal:
            print(end=_CLEAR_LINE, file=self._stream)


def stream_all(
    args: argparse.Namespace,
    program: hw.ChipProgram,
    recordings: Recordings,
    outcomes: Sequence[Outcome],
    margin: float | None,
) -> tuple[list[Outcome], StreamFigures]:
    """Stream and show every recording; return the outcomes with their changes, and the figures of all.

    ``outcomes`` are those of the whole recordings. ``margin`` is the lead that ends a recording.
    """
    step_seconds = _step_seconds(args, program, recordings)
    session = hw.Session(program, args.psi)
    # The first pushes load compiled code, which must not count towards the time of a step.
    stream(hw.Session(program, args.psi), _rows_of(program, recordings, 0))
    streamed: list[Streamed] = []
    outcomes_with_changes: list[Outcome] = []
    # JSON is all that --json prints: then a bar shows the progress instead of a line.
    live_line = nullcontext() if args.json else closing(LiveLine(sys.stdout))
    with live_line as line, progress_bar("streaming", show=args.json) as progress:
        for i, outcome in enumerate(outcomes):
            rows = _rows_of(program, recordings, i)
            steps = _steps_of(rows)  # equal for all recordings of a file
            on_step = _step_shower(line, i, steps, step_seconds) if line else None
            streamed_recording = stream(session, rows, margin, on_step)
            streamed.append(streamed_recording)
            outcome_with_changes = replace(outcome, changes=streamed_recording.changes)
            outcomes_with_changes.append(outcome_with_changes)
            if line:
                is_stopped = margin is not None and bool(streamed_recording.lead[-1] >= margin)
                line.write(
                    _final_line(outcome_with_changes, streamed_recording, stopped=is_stopped)
                )
            if progress:
                progress(i + 1, len(outcomes))
    if recordings.labels is not None:
        right = recordings.labels
        right_is = LABEL
    else:
        right = np.array([-1 if outcome.tied else outcome.prediction for outcome in outcomes])
        right_is = LAST_PREDICTION
    latency = step_latency(streamed)
    real_time_factor = None
    worst_real_time_factor = None
    if step_seconds is not None:
        real_time_factor = step_seconds / latency.mean
        worst_real_time_factor = step_seconds / latency.worst
    figures = StreamFigures(
        psi=args.psi,
        step_seconds=step_seconds,
        step_latency_seconds=latency,
        real_time_factor=real_time_factor,
        worst_real_time_factor=worst_real_time_factor,
        right_is=right_is,
        right=tuple(right_over_time(streamed, right, steps).tolist()),
    )
    return outcomes_with_changes, figures


def stream_lines(figures: StreamFigures) -> list[str]:
    """Return a line on predictions over time, and one on the pace."""
    right = figures.right
    step_seconds = figures.step_seconds
    shares = []
    for part in _SUMMARY_MOMENTS:
        step = max(1, round(part * len(right)))  # a recording of one or two steps has no step 0
        moment = f"step {step}" if step_seconds is None else _seconds(step, step_seconds)
        shares.append(f"{right[step - 1]:.3f} after {moment}")
    heading = "accuracy over time" if figures.right_is == LABEL else "already the last prediction"
    latency = figures.step_latency_seconds
    pace = (
        f"a step took {seconds(latency.mean)} on average, 99 % of them at most "
        f"{seconds(latency.p99)}, the longest {seconds(latency.worst)}"
    )
    return [f"{heading}: {', '.join(shares)}", f"{pace}; {_pace_of_sensor(figures)}"]


def _pace_of_sensor(figures: StreamFigures) -> str:
    """Return how the pace here compares with that of the sensor."""
    factor = figures.real_time_factor
    worst_factor = figures.worst_real_time_factor
    if figures.step_seconds is None or factor is None or worst_factor is None:
        return "the length of a step at the sensor is not known: give --step-seconds"
    return (
        f"at the sensor it takes {seconds(figures.step_seconds)}: {ratio(factor)} times as "
        f"fast as real time, {ratio(worst_factor)} times in the longest step"
    )


def _rows_of(program: hw.ChipProgram, recordings: Recordings, number: int) -> dict[str, ByteArray]:
    """Return a recording, (steps, channels), by input stream.

    Silence follows it until the phases that play it end, as in a whole recording.
    """
    batch = to_the_end(program, recordings.spikes[number : number + 1])
    return {name: array[0] for name, array in batch.items()}


def _steps_of(rows: Mapping[str, ByteArray]) -> int:
    """Return the steps of a recording; all of its streams have the same."""
    return len(next(iter(rows.values())))


def _step_shower(line: LiveLine, recording: int, steps: int, step_seconds: float | None) -> OnStep:
    """Return a callback that shows each new prediction and, on a terminal, each new lead.

    Where lines stay, in a file or pipe, every new lead would be a line too many.
    """
    last_shown: tuple[int, float] | None = None

    def on_step(step: int, prediction: int, lead: float) -> None:
        nonlocal last_shown
        if last_shown is None:
            is_news = lead > 0  # before that, all classes are equal
        else:
            shown_prediction, shown_lead = last_shown
            has_new_lead = line.is_terminal and lead != shown_lead
            is_news = prediction != shown_prediction or has_new_lead
        if not is_news:
            return
        last_shown = (prediction, lead)
        moment = "" if step_seconds is None else f"  {_seconds(step, step_seconds)}"
        place = f"recording {recording}  step {step} of {steps}{moment}"
        line.show(f"{place}  class {prediction}  lead {lead_text(lead)}")

    return on_step


def _seconds(step: int, step_seconds: float) -> str:
    """Return the time after a step, with enough decimals to tell steps apart."""
    # Steps of 0.02 s need two decimals: -log10(0.02) is 1.7.
    decimals = max(0, math.ceil(-math.log10(step_seconds)))
    return f"{step * step_seconds:.{decimals}f} s"


def lead_text(lead: float) -> str:
    """Return a lead in spikes as text; time-weighted leads begin far below one spike."""
    if 0 < lead < 0.01:
        return "under 0.01"
    return f"{lead:.3g}" if lead < 1000 else f"{lead:,.0f}"


def _final_line(outcome: Outcome, streamed: Streamed, *, stopped: bool) -> str:
    """Return the line that stays for a recording: its last prediction, and since when it holds."""
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
    """Return the width of a step at the sensor in seconds; None if nothing states it.

    The recordings have the width that they or the options state. Otherwise the report of the build
    may have it: the duration of a recording at the sensor, by the steps of the time phase.
    """
    if recordings.step_seconds is not None:
        return recordings.step_seconds
    try:
        recording_ns = read_report(Path(args.program))["latency"]["recording_ns"]
    except (InputError, KeyError, TypeError):  # no report, or one without this figure
        return None
    steps = next((phase.steps for phase in program.phases if phase.axis == "time"), None)
    if not isinstance(recording_ns, int | float) or not steps:
        return None
    return recording_ns / steps * 1e-9
