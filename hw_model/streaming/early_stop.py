"""Rules that stop a recording early, and what that saves of steps, energy and time.

- :func:`stop_when_proven`: when the winning class can no longer change, whatever the inputs do
- :func:`stop_at_margin`: when the winning class leads by a margin; :func:`calibrate_margin` fits it to recordings
- :func:`stop_in_silence`: when no event has come for some steps, and all compartments are at rest

Each takes a batch of recordings that are known to their end, and returns :class:`Stops`. Time phases play a recording
*as it comes*, step by step; location phases play it *transposed*, channel by channel, when it is over.

``psi``, which some functions take, is for hybrid programs, which have both kinds of phases. It is how steeply the
weight of the location phase in the class scores rises while a recording plays (:mod:`hw_model.streaming.psi`). With
None, the program's own weights are used.
"""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from hw_model.accounting.cost import step_times
from hw_model.arithmetic import loihi
from hw_model.description.counts import BY_CORE, Counts
from hw_model.engine.playing import Spikes, read_streams
from hw_model.engine.probes import Kind, Probe
from hw_model.engine.threads import in_parts
from hw_model.errors import InputError
from hw_model.io.arguments import checked
from hw_model.mapping.graph import Readout, winning
from hw_model.program.chip_program import ChipProgram
from hw_model.simulation import SimulationResult, simulate
from hw_model.streaming.outcomes import StepScores, Stops, leads
from hw_model.streaming.population_bounds import joined_groups
from hw_model.streaming.proof import Proof
from hw_model.streaming.session import Session
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray

T = TypeVar("T")


@checked
def stop_when_proven(program: ChipProgram, spikes: Spikes) -> Stops:
    """Stop every recording as soon as its winner is proven: nothing that the inputs may still do can change it.

    ``spikes``: (batch, steps, channels) of 0 and 1, or a mapping of streams. A program without a readout is an
    ``InputError``.
    """
    readout = program.readout
    if readout is None:
        raise InputError(
            f"program {program.name!r}", "has no readout, so nothing wins", fix="Read the spikes."
        )
    streams = _batch(program, spikes)
    result = simulate(program, streams, probe=("activity", *_probes_of_proof(program, readout)))
    proof = Proof(program, readout, result, _rows(streams))
    steps = proof.stops()
    # The steps of the proof are counted over all phases, one after the other. For each phase, count from its start.
    until: dict[str, IntArray] = {}
    steps_before = 0
    for phase, activity in result.activity.items():
        until[phase] = steps - steps_before
        steps_before += activity[0].steps
    return _stops(
        steps=steps,
        all_steps=proof.all_steps,
        # A proof stops only where the prediction is already that of the whole recording.
        prediction=result.prediction,
        final=result.prediction,
        spent=_spent(program, result, until),
        whole=_spent(program, result, {}),
    )


def _probes_of_proof(program: ChipProgram, readout: Readout) -> list[Probe]:
    """Return the probes that a proof needs.

    These are u and v of the readout's populations and all groups joined to them, and the spikes or potentials that the
    readout reads.
    """
    groups = [group for name in readout.populations for group in joined_groups(program, name)]
    # from_step has the populations that are read by their potentials; all others are read by their spikes.
    spiking = [name for name in readout.populations if name not in readout.from_step]
    names_of: dict[Kind, list[str]] = {
        "u": groups,
        "v": groups,
        "spikes": spiking,
        "potential": list(readout.from_step),
    }
    return [Probe(kind, tuple(names)) for kind, names in names_of.items() if names]


@checked
def stop_at_margin(
    program: ChipProgram, spikes: Spikes, margin: float, psi: float | None = None
) -> Stops:
    """Stop reading a recording as soon as its best class leads by ``margin``; location phases then run once.

    Steps are counted in the recording. If it is shorter than a time phase, silence follows until the end of the phase;
    a time phase without ``steps`` lasts as long as the recording. For ``psi``, see :class:`hw_model.Session`.
    """
    if not margin > 0:
        raise InputError(
            "margin",
            "it must be above 0",
            measured=f"got {margin}",
            fix="Use that of calibrate_margin.",
        )
    streams = to_the_end(program, spikes)
    scores = timestep_scores(program, streams, psi)
    steps = _first_step(leads(scores) >= margin)
    # `timestep_scores` has refused programs without a readout.
    assert program.readout is not None
    prediction_after = winning(scores, program.readout.tie_class)
    whole = simulate(program, streams, probe=("activity",))
    _, spent = _read_until(program, streams, steps)
    return _stops(
        steps=steps,
        all_steps=scores.shape[1],
        prediction=prediction_after[np.arange(len(steps)), steps - 1],
        final=prediction_after[:, -1],
        spent=spent,
        whole=_spent(program, whole, {}),
    )


@checked
def stop_in_silence(program: ChipProgram, spikes: Spikes, silence: int) -> Stops:
    """Stop reading a recording after ``silence`` steps without an event, once all compartments are at rest.

    Location phases then run once. Steps are counted as for :func:`stop_at_margin`. Events that come later are lost;
    silence before the first event counts, too.
    """
    if silence < 1:
        raise InputError(
            "silence",
            "it is not a number of steps",
            measured=f"got {silence}",
            fix="Give 1 or more.",
        )
    streams = to_the_end(program, spikes)
    whole = simulate(program, streams, probe=("activity",))
    events = sum(stream.sum(axis=2, dtype=np.int64) for stream in streams.values())
    silent_steps = _unbroken_steps(np.asarray(events == 0))
    resting_steps = _unbroken_steps(_is_resting(program, whole, _rows(streams)))
    # A spike may be under way while nothing moves, so silence and rest must last as long as the longest delay.
    arrival_steps = _steps_until_arrival(program)
    is_silent = silent_steps >= max(silence, arrival_steps)
    is_at_rest = resting_steps >= arrival_steps
    steps = _first_step(is_silent & is_at_rest)
    stopped, spent = _read_until(program, streams, steps)
    return _stops(
        steps=steps,
        all_steps=_rows(streams),
        prediction=stopped.prediction,
        final=whole.prediction,
        spent=spent,
        whole=_spent(program, whole, {}),
    )


def _is_resting(program: ChipProgram, result: SimulationResult, rows: int) -> BoolArray:
    """Return whether no compartment of any time phase is active in each step, (batch, rows)."""
    phases = _time_phases(program)
    recordings = len(next(iter(result.activity.values())))
    is_resting = np.ones((recordings, rows), dtype=np.bool_)
    for phase in phases:
        for recording, activity in enumerate(result.activity[phase]):
            # A piece is the part of a group of compartments that lies on one core: the sum is over all of them.
            active = activity.by_piece["neuron_updates_active"].sum(axis=1)
            # A phase that is shorter than the recording is at rest after its end.
            is_resting[recording, : len(active)] &= active == 0
    return is_resting


def _steps_until_arrival(program: ChipProgram) -> int:
    """Return after how many steps every spike of a time phase has arrived at all its targets."""
    longest_delay = 0
    for phase in _time_phases(program):
        for core in program.cores_of(phase):
            longest_delay = max(longest_delay, int(core.axons.delay.max(initial=0)))
    return int(loihi.acts_at(0, longest_delay))


@checked
def calibrate_margin(
    program: ChipProgram, spikes: Spikes, agreement: float, psi: float | None = None
) -> float:
    """Return the smallest margin at which at least a share ``agreement`` of the recordings predict as at their end.

    Give validation recordings, since the margin is fitted to them. If no margin is enough, the result is infinite.
    """
    if not 0.0 <= agreement <= 1.0:
        raise InputError(
            "agreement",
            "it must be a share",
            measured=f"{agreement} against 0 to 1",
            fix="Correct it.",
        )
    scores = timestep_scores(program, spikes, psi)
    # `timestep_scores` has refused programs without a readout.
    assert program.readout is not None
    predictions = winning(scores, program.readout.tie_class)
    lead_over_time = leads(scores)
    # A recording stops at its first step whose lead reaches the margin. So a margin between two neighbouring leads of
    # these recordings stops every recording where the larger of the two does: no other margins need to be tried.
    margins = np.unique(lead_over_time[lead_over_time > 0])
    # agreeing[m] is how many recordings predict with margins[m] what they predict at the end. Start with all of them.
    agreeing = np.full(len(margins), len(scores))
    for prediction, lead in zip(predictions, lead_over_time, strict=True):
        # A recording can stop only at a peak: a step whose lead is larger than all leads before it.
        largest_before = np.maximum.accumulate(np.append(0.0, lead[:-1]))
        peak_steps = np.flatnonzero(lead > largest_before)
        peak_leads = np.append(0.0, lead[peak_steps])
        # margins[low:high] stop at a peak: those above the previous peak's lead, up to this one's. Margins above the
        # last peak never stop the recording, so with them it predicts as at its end.
        reached = np.searchsorted(margins, peak_leads, side="right")
        for step, low, high in zip(peak_steps, reached[:-1], reached[1:], strict=True):
            agreeing[low:high] -= prediction[step] != prediction[-1]
    enough = np.flatnonzero(agreeing / len(scores) >= agreement)
    return float(margins[enough[0]]) if len(enough) else float("inf")


@checked
def timestep_scores(program: ChipProgram, spikes: Spikes, psi: float | None = None) -> FloatArray:
    """Return the class scores after every step of every recording, (batch, steps, classes).

    Recordings are played in threads. One that is shorter than the program's time phases is followed by silence.
    """
    streams = to_the_end(program, spikes)
    return np.stack(pushed_each(program, streams, lambda pushed: pushed.scores, psi))


def pushed_each(
    program: ChipProgram,
    streams: Mapping[str, ByteArray],
    take: Callable[[StepScores], T],
    psi: float | None = None,
) -> list[T]:
    """Push every recording (batch, steps, channels) to a session, in threads; return ``take(scores)`` of each.

    ``take`` picks what is needed, so that the scores of all recordings are not in memory at once.
    """

    def push_range(start: int, stop: int) -> list[T]:
        # A session holds the state of one recording, so each thread has its own.
        session = Session(program, psi)
        result = []
        for recording in range(start, stop):
            session.reset()
            pushed = session.push({name: rows[recording] for name, rows in streams.items()})
            result.append(take(pushed))
        return result

    recordings = len(next(iter(streams.values())))
    return [result for results in in_parts(push_range, recordings) for result in results]


def _batch(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    """Return every stream as (batch, steps, channels); raise InputError for no recording or no step."""
    streams, _ = read_streams(program, spikes)
    if 0 in next(iter(streams.values())).shape[:2]:
        raise InputError("spikes", "there is no recording, or it has no steps", fix="Give some.")
    return streams


def to_the_end(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    """Return every stream, (batch, steps, channels), padded with silence until the last time phase ends."""
    streams = _batch(program, spikes)
    time_phases = _time_phases(program)
    steps = [phase.steps or 0 for phase in program.phases if phase.name in time_phases]
    missing = max(0, max(steps, default=0) - _rows(streams))
    return {name: np.pad(array, ((0, 0), (0, missing), (0, 0))) for name, array in streams.items()}


def _rows(streams: Mapping[str, ByteArray]) -> int:
    """Return the steps of the recordings, which are equal in all streams."""
    return int(next(iter(streams.values())).shape[1])


def _time_phases(program: ChipProgram) -> list[str]:
    """Return the time phases: those that play recordings as they come, not transposed."""
    transposed = {item.phase for item in program.inputs if item.positions is not None}
    return [phase.name for phase in program.phases if phase.name not in transposed]


def _first_step(is_enough: BoolArray) -> IntArray:
    """Return the first step, counted from 1, that is enough, or the last step if none is, (batch,).

    ``is_enough`` is (batch, steps).
    """
    steps = is_enough.shape[1]
    first = np.where(is_enough.any(axis=1), is_enough.argmax(axis=1) + 1, steps)
    return np.asarray(first, dtype=np.int64)


def _unbroken_steps(condition: BoolArray) -> IntArray:
    """Return for how many steps without a break a condition has held after each step, (batch, steps)."""
    step = np.arange(1, condition.shape[1] + 1)
    # The last step so far at which the condition did not hold; 0 if it has always held.
    last_broken = np.maximum.accumulate(np.where(condition, 0, step), axis=1)
    return np.asarray(step - last_broken)


class Spent(Frozen, eq=False):
    """What all recordings of a batch cost together: counts, from which energy follows, and time."""

    counts: Counts
    latency_ns: float


def _read_until(
    program: ChipProgram, streams: Mapping[str, ByteArray], steps: IntArray
) -> tuple[SimulationResult, Spent]:
    """Play only the first ``steps`` (batch,) of the recordings; time phases end there, and location phases run in full.

    Returns the result, and the cost up to there.
    """
    is_read = np.arange(_rows(streams))[None, :, None] < steps[:, None, None]
    streams_read = {name: array * is_read for name, array in streams.items()}
    stopped = simulate(program, streams_read, probe=("activity",))
    return stopped, _spent(program, stopped, dict.fromkeys(_time_phases(program), steps))


def _spent(program: ChipProgram, result: SimulationResult, until: Mapping[str, IntArray]) -> Spent:
    """Return the cost of all recordings: of the first ``until[phase]`` (batch,) steps of a phase, else of all steps."""
    profile = program.chip.costs
    # Only these counts are kept for every step, so only they can be cut at a stop. The others of a simulation, such as
    # wraps and clips, are totals of whole recordings, and stay 0 here.
    counts = dict.fromkeys(BY_CORE, 0)
    latency_ns = 0.0
    for phase, activity in result.activity.items():
        for recording, steps in enumerate(activity):
            steps_run = slice(None)
            if phase in until:
                # The number is negative if the recording stopped in an earlier phase.
                steps_run = slice(max(0, int(until[phase][recording])))
            for name in counts:
                counts[name] += int(steps.count(name)[steps_run].sum())
            step_ns = step_times(program, phase, steps, profile).step_ns
            latency_ns += float(step_ns[steps_run].sum())
    return Spent(Counts(**counts), latency_ns)


def _stops(
    *,
    steps: IntArray,
    all_steps: int,
    prediction: IntArray,
    final: IntArray,
    spent: Spent,
    whole: Spent,
) -> Stops:
    """Return the :class:`Stops`; ``spent`` is the cost with stopping, ``whole`` without."""
    return Stops(
        steps=steps,
        all_steps=all_steps,
        prediction=prediction,
        final=final,
        counts=spent.counts,
        all_counts=whole.counts,
        latency_ns=spent.latency_ns,
        all_latency_ns=whole.latency_ns,
    )
