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
from hw_model.mapping.graph import winning
from hw_model.program.chip_program import ChipProgram
from hw_model.simulation import SimulationResult, simulate
from hw_model.streaming.outcomes import StepScores, Stops, leads
from hw_model.streaming.population_bounds import joined_groups
from hw_model.streaming.proof import Proof
from hw_model.streaming.session import Session
from hw_model.values import BoolArray, ByteArray, FloatArray, IntArray

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
    groups = tuple(
        member for name in readout.populations for member in joined_groups(program, name)
    )
    spiking, read = (
        (n for n in readout.populations if n not in readout.from_step),
        tuple(readout.from_step),
    )
    kept: dict[Kind, tuple[str, ...]] = {
        "u": groups,
        "v": groups,
        "spikes": tuple(spiking),
        "potential": read,
    }
    probes = (Probe(kind, names) for kind, names in kept.items() if names)
    result = simulate(program, streams, probe=("activity", *probes))
    proof = Proof(program, readout, result, _rows(streams))
    steps = proof.stops()
    until, before = {}, 0
    for phase, items in result.activity.items():
        until[phase] = steps - before
        before += items[0].steps
    spent, whole = _spent(program, result, until), _spent(program, result, {})
    return _stops(steps, proof.all_steps, result.prediction, result.prediction, spent, whole)


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
    steps = _first(leads(scores) >= margin)
    assert program.readout is not None  # sessions without one are refused
    tie_class = program.readout.tie_class
    prediction = winning(scores[np.arange(len(steps)), steps - 1], tie_class)
    whole = simulate(program, streams, probe=("activity",))
    _, spent = _read_until(program, streams, steps)
    final = winning(scores[:, -1], tie_class)
    return _stops(steps, scores.shape[1], prediction, final, spent, _spent(program, whole, {}))


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
    silent = np.stack([array.sum(axis=2) for array in streams.values()]).sum(axis=0) == 0
    resting, under_way = np.ones_like(silent), 1
    for phase in _as_it_comes(program):
        for b, item in enumerate(whole.activity[phase]):
            active = item.by_piece["neuron_updates_active"].sum(axis=1)
            resting[b, : len(active)] &= active == 0
        # What was sent before has arrived.
        delays = [int(core.axons.delay.max(initial=0)) for core in program.cores_of(phase)]
        under_way = max([under_way, *(loihi.acts_at(0, delay) for delay in delays)])
    steps = _first((_lasting(silent) >= max(silence, under_way)) & (_lasting(resting) >= under_way))
    stopped, spent = _read_until(program, streams, steps)
    return _stops(
        steps,
        _rows(streams),
        stopped.prediction,
        whole.prediction,
        spent,
        _spent(program, whole, {}),
    )


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
        records = np.flatnonzero(lead > np.maximum.accumulate(np.append(0.0, lead[:-1])))
        reached = np.searchsorted(margins, np.append(0.0, lead[records]), side="right")
        for record, low, high in zip(records, reached[:-1], reached[1:], strict=True):
            agreeing[low:high] -= prediction[record] != prediction[-1]
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

    def part(start: int, stop: int) -> list[T]:
        session, found = Session(program, psi), []
        for b in range(start, stop):
            session.reset()
            found.append(take(session.push({name: array[b] for name, array in streams.items()})))
        return found

    return [taken for parts in in_parts(part, len(next(iter(streams.values())))) for taken in parts]


def _batch(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    streams, _ = read_streams(program, spikes)
    if 0 in next(iter(streams.values())).shape[:2]:
        raise InputError("spikes", "there is no recording, or it has no steps", fix="Give some.")
    return streams


def to_the_end(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    """Return every stream, (batch, steps, channels), followed by silence until the phases that play it so end."""
    streams = _batch(program, spikes)
    live = _as_it_comes(program)
    last = max((phase.steps or 0 for phase in program.phases if phase.name in live), default=0)
    missing = max(0, last - _rows(streams))
    return {name: np.pad(array, ((0, 0), (0, missing), (0, 0))) for name, array in streams.items()}


def _rows(streams: Mapping[str, ByteArray]) -> int:
    return int(next(iter(streams.values())).shape[1])


def _as_it_comes(program: ChipProgram) -> list[str]:
    """Return the phases that play recordings as they come, not transposed."""
    turned = {item.phase for item in program.inputs if item.positions is not None}
    return [phase.name for phase in program.phases if phase.name not in turned]


def _first(enough: BoolArray) -> IntArray:
    """Return the first step, counted from 1, with enough (batch, steps); the last one where there is none, (batch,)."""
    enough[:, -1] = True
    return np.asarray(enough.argmax(axis=1) + 1, dtype=np.int64)


def _lasting(still: BoolArray) -> IntArray:
    """Return for how many steps it has been true after each, (batch, steps)."""
    step = np.arange(1, still.shape[1] + 1)
    return np.asarray(step - np.maximum.accumulate(np.where(still, 0, step), axis=1))


Spent = tuple[Counts, float]
"""Counts and nanoseconds of all recordings together."""


def _read_until(
    program: ChipProgram, streams: Mapping[str, ByteArray], steps: IntArray
) -> tuple[SimulationResult, Spent]:
    """Play recordings of which the first steps (batch,) are read; phases that play them as they come end there."""
    seen = np.arange(_rows(streams))[None, :, None] < steps[:, None, None]
    stopped = simulate(
        program, {name: array * seen for name, array in streams.items()}, probe=("activity",)
    )
    return stopped, _spent(program, stopped, dict.fromkeys(_as_it_comes(program), steps))


def _spent(program: ChipProgram, result: SimulationResult, until: Mapping[str, IntArray]) -> Spent:
    """Add up what recordings took: in the phases of ``until`` that many steps (batch,), in the others all."""
    profile = program.chip.costs
    found, ns = dict.fromkeys(BY_CORE, 0), 0.0
    for phase, items in result.activity.items():
        for b, item in enumerate(items):
            rows = slice(max(0, int(until[phase][b])) if phase in until else None)
            found = {name: n + int(item.count(name)[rows].sum()) for name, n in found.items()}
            ns += float(step_times(program, phase, item, profile).step_ns[rows].sum())
    return Counts(**found), ns


def _stops(
    steps: IntArray,
    all_steps: int,
    prediction: IntArray,
    final: IntArray,
    spent: Spent,
    whole: Spent,
) -> Stops:
    return Stops(steps, all_steps, prediction, final, spent[0], whole[0], spent[1], whole[1])
