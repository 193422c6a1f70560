"""Stop a recording early: when its winner can no longer change, when its lead is one that has proved enough, or in
silence.
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
from hw_model.io.given import checked
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
    """Stop every recording as soon as nothing that remains can change its winner, whatever the inputs may still do.

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
    # Steps are counted over all phases, one after the other.
    until: dict[str, IntArray] = {}
    steps_before = 0
    for phase, activity in result.activity.items():
        until[phase] = steps - steps_before
        steps_before += activity[0].steps
    return _stops(
        steps=steps,
        all_steps=proof.all_steps,
        prediction=result.prediction,
        final=result.prediction,
        spent=_spent(program, result, until),
        whole=_spent(program, result, {}),
    )


def _probes_of_proof(program: ChipProgram, readout: Readout) -> list[Probe]:
    """Return probes of what a proof reads: registers of the readout and its dendrites, and what the readout counts."""
    groups = [group for name in readout.populations for group in joined_groups(program, name)]
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
    """Stop reading a recording as soon as its best class leads by ``margin``; transposed phases then run once.

    Steps are those of the recording, which phases that play it as it comes also run. It is followed by silence until
    those of them that have ``steps`` end; one that has none lasts as long. ``psi`` as for :class:`hw_model.Session`.
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
    assert program.readout is not None  # sessions without one are refused
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
    """Stop reading a recording after ``silence`` steps without an event, once everything is at rest.

    Transposed phases then run once. Steps are those of the recording, as for :func:`stop_at_margin`. What comes later
    is not seen; silence before the first event counts as well.
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
    silent_steps = _lasting(np.asarray(events == 0))
    resting_steps = _lasting(_is_resting(program, whole, _rows(streams)))
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
    """Mark the steps in which no phase that plays a recording as it comes has work to do, (batch, rows)."""
    phases = _as_it_comes(program)
    recordings = len(next(iter(result.activity.values())))
    is_resting = np.ones((recordings, rows), dtype=np.bool_)
    for phase in phases:
        for recording, activity in enumerate(result.activity[phase]):
            active = activity.by_piece["neuron_updates_active"].sum(axis=1)
            is_resting[recording, : len(active)] &= active == 0
    return is_resting


def _steps_until_arrival(program: ChipProgram) -> int:
    """Return after how many steps a spike has acted wherever it goes, in phases that play recordings as they come."""
    longest_delay = 0
    for phase in _as_it_comes(program):
        for core in program.cores_of(phase):
            longest_delay = max(longest_delay, int(core.axons.delay.max(initial=0)))
    return int(loihi.acts_at(0, longest_delay))


@checked
def calibrate_margin(
    program: ChipProgram, spikes: Spikes, agreement: float, psi: float | None = None
) -> float:
    """Return the smallest lead at which at least ``agreement`` of these recordings predict what they do at the end.

    Give validation recordings: the margin is fitted to them. Where no lead is enough it is infinite.
    """
    if not 0.0 <= agreement <= 1.0:
        raise InputError(
            "agreement",
            "it must be a share",
            measured=f"{agreement} against 0 to 1",
            fix="Correct it.",
        )
    scores = timestep_scores(program, spikes, psi)
    assert program.readout is not None  # sessions without one are refused
    predictions = winning(scores, program.readout.tie_class)
    lead_over_time = leads(scores)
    margins = np.unique(lead_over_time[lead_over_time > 0])
    agreeing = np.full(len(margins), len(scores))
    for prediction, lead in zip(predictions, lead_over_time, strict=True):
        # A margin stops at the first lead that reaches it, which is larger than all before.
        larger_before = np.maximum.accumulate(np.append(0.0, lead[:-1]))
        record_steps = np.flatnonzero(lead > larger_before)
        record_leads = np.append(0.0, lead[record_steps])
        # Margins low..high stop at a record: those above the record before, up to its own lead.
        reached = np.searchsorted(margins, record_leads, side="right")
        for step, low, high in zip(record_steps, reached[:-1], reached[1:], strict=True):
            agreeing[low:high] -= prediction[step] != prediction[-1]
    enough = np.flatnonzero(agreeing / len(scores) >= agreement)
    return float(margins[enough[0]]) if len(enough) else float("inf")


@checked
def timestep_scores(program: ChipProgram, spikes: Spikes, psi: float | None = None) -> FloatArray:
    """Return the class scores after every step of every recording, (batch, steps, classes), recordings in threads.

    Recordings that are shorter than the program's are followed by silence.
    """
    return np.stack(
        pushed_each(program, to_the_end(program, spikes), lambda pushed: pushed.scores, psi)
    )


def pushed_each(
    program: ChipProgram,
    streams: Mapping[str, ByteArray],
    take: Callable[[StepScores], T],
    psi: float | None = None,
) -> list[T]:
    """Push every recording (batch, steps, channels) to a session, in threads; return what is taken of each."""

    def push_some(start: int, stop: int) -> list[T]:
        session = Session(program, psi)
        result = []
        for recording in range(start, stop):
            session.reset()
            pushed = session.push({name: rows[recording] for name, rows in streams.items()})
            result.append(take(pushed))
        return result

    recordings = len(next(iter(streams.values())))
    return [result for some in in_parts(push_some, recordings) for result in some]


def _batch(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    streams, _ = read_streams(program, spikes)
    if 0 in next(iter(streams.values())).shape[:2]:
        raise InputError("spikes", "there is no recording, or it has no steps", fix="Give some.")
    return streams


def to_the_end(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    """Return every stream, (batch, steps, channels), followed by silence until the phases that play it so end."""
    streams = _batch(program, spikes)
    live_phases = _as_it_comes(program)
    steps = [phase.steps or 0 for phase in program.phases if phase.name in live_phases]
    missing = max(0, max(steps, default=0) - _rows(streams))
    return {name: np.pad(array, ((0, 0), (0, missing), (0, 0))) for name, array in streams.items()}


def _rows(streams: Mapping[str, ByteArray]) -> int:
    return int(next(iter(streams.values())).shape[1])


def _as_it_comes(program: ChipProgram) -> list[str]:
    """Return the phases that play recordings as they come, not transposed."""
    transposed = {item.phase for item in program.inputs if item.positions is not None}
    return [phase.name for phase in program.phases if phase.name not in transposed]


def _first_step(is_enough: BoolArray) -> IntArray:
    """Return the first step, counted from 1, that is enough (batch, steps); the last where there is none, (batch,)."""
    steps = is_enough.shape[1]
    first = np.where(is_enough.any(axis=1), is_enough.argmax(axis=1) + 1, steps)
    return np.asarray(first, dtype=np.int64)


def _lasting(condition: BoolArray) -> IntArray:
    """Return for how many steps a condition has held after each step, (batch, steps)."""
    step = np.arange(1, condition.shape[1] + 1)
    last_broken = np.maximum.accumulate(np.where(condition, 0, step), axis=1)
    return np.asarray(step - last_broken)


class Spent(Frozen, eq=False):
    """What all recordings took together."""

    counts: Counts
    latency_ns: float


def _read_until(
    program: ChipProgram, streams: Mapping[str, ByteArray], steps: IntArray
) -> tuple[SimulationResult, Spent]:
    """Play recordings of which the first steps (batch,) are read; phases that play them as they come end there."""
    is_read = np.arange(_rows(streams))[None, :, None] < steps[:, None, None]
    streams_read = {name: array * is_read for name, array in streams.items()}
    stopped = simulate(program, streams_read, probe=("activity",))
    return stopped, _spent(program, stopped, dict.fromkeys(_as_it_comes(program), steps))


def _spent(program: ChipProgram, result: SimulationResult, until: Mapping[str, IntArray]) -> Spent:
    """Add up what recordings took: in the phases of ``until`` that many steps (batch,), in the others all."""
    profile = program.chip.costs
    counts = dict.fromkeys(BY_CORE, 0)
    latency_ns = 0.0
    for phase, activity in result.activity.items():
        for recording, steps in enumerate(activity):
            run = slice(None)
            if phase in until:
                # Below 0 where the recording stopped in a phase before.
                run = slice(max(0, int(until[phase][recording])))
            for name in counts:
                counts[name] += int(steps.count(name)[run].sum())
            step_ns = step_times(program, phase, steps, profile).step_ns
            latency_ns += float(step_ns[run].sum())
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
