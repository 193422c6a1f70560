"""Stop a recording early: when its winner can no longer change, or when its lead is one that has proved enough.

The proof. Whatever the inputs do, the registers of a readout compartment stay at or below a run in which every source
spikes in every step, none of its negative weights counts, and no spike resets it. For u = rz(u) + q, v = rz(v) + u +
bias + joined, and the clipping of v all grow with what they are given, as long as nothing wraps, which
:func:`hw_model.prove_range` tells. So in a step in which that run stays at or below the threshold there is no spike,
and with a refractory count of k at most one in any k steps: this bounds the spikes that each class can still win.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic.fixed_point import IntArray, clip, decay
from hw_model.description.counts import BY_CORE, Counts, total
from hw_model.engine.compiled import in_parts
from hw_model.engine.playing import Spikes, read_streams
from hw_model.engine.probes import Kind, Probe
from hw_model.engine.trace import ByteArray
from hw_model.errors import InputError
from hw_model.io.given import checked
from hw_model.io.shown import shown
from hw_model.mapping.graph import Phase, Readout
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.range_proof import prove_range
from hw_model.simulation import SimulationResult, simulate
from hw_model.streaming.session import Session, leads

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stops:
    """Where each recording of a batch stops, and what was done until then.

    ``steps`` (batch,), over all phases run, of ``all_steps``; ``prediction`` (batch,) there, ``final`` (batch,) without
    stopping; ``counts`` until there, ``all_counts`` without stopping, of all recordings together, in the counts that
    cost energy (:data:`hw_model.description.counts.BY_CORE`).
    """

    __repr__ = shown

    steps: IntArray
    all_steps: int
    prediction: IntArray
    final: IntArray
    counts: Counts
    all_counts: Counts


@checked
def stop_when_proven(program: ChipProgram, spikes: Spikes) -> Stops:
    """Stop every recording as soon as no remaining spike can change its winner, whatever the inputs may still do.

    ``spikes``: (batch, steps, channels) of 0 and 1, or a mapping of streams. A program without a readout is an
    ``InputError``.
    """
    groups = tuple(member for name in _readout(program).populations for member in _members(program, name))
    probe: tuple[Kind | Probe, ...] = ("spikes", "activity", Probe("u", groups), Probe("v", groups))
    result = simulate(program, _batch(program, spikes), probe=probe)
    steps = _Proof(program, result).stops()
    lengths = _lengths(result)
    counts = total(
        _until(result, phase, b, int(steps[b]) - before) for phase, before in lengths for b in range(len(steps))
    )
    all_counts = total(_until(result, phase, b, None) for phase, _ in lengths for b in range(len(steps)))
    all_steps = sum(len(items[0].count("spikes")) for items in result.activity.values())
    return Stops(steps, all_steps, result.prediction, result.prediction, counts, all_counts)


@checked
def stop_at_margin(program: ChipProgram, spikes: Spikes, margin: float, psi: float | None = None) -> Stops:
    """Stop reading a recording as soon as its best class leads by ``margin``; transposed phases then run once.

    Steps count the recording's, of which the phases that play it as it comes run as many. ``psi`` as for
    :class:`hw_model.Session`.
    """
    streams = to_the_end(program, spikes)
    scores = timestep_scores(program, streams, psi)
    rows = scores.shape[1]
    steps = _first_lead(scores, margin)
    each = np.arange(len(steps))
    seen = np.arange(rows)[None, :, None] < steps[:, None, None]
    result = simulate(program, streams, probe=("activity",))
    stopped = simulate(program, {name: array * seen for name, array in streams.items()}, probe=("activity",))
    turned = {item.phase for item in program.inputs if item.positions is not None}
    counts = total(
        _until(stopped, phase, b, None if phase in turned else int(steps[b]))
        for phase in result.activity
        for b in range(len(steps))
    )
    all_counts = total(_until(result, phase, b, None) for phase in result.activity for b in range(len(steps)))
    final = np.asarray(scores[:, -1].argmax(axis=1), dtype=np.int64)
    return Stops(steps, rows, scores[each, steps - 1].argmax(axis=1), final, counts, all_counts)


@checked
def calibrate_margin(program: ChipProgram, spikes: Spikes, agreement: float, psi: float | None = None) -> float:
    """Return the smallest lead at which, on these recordings, at least ``agreement`` of the stops predict as the end.

    Give validation recordings: the margin is fitted to them. Where no lead is enough it is infinite.
    """
    if not 0.0 <= agreement <= 1.0:
        raise InputError("agreement", "it is a share", measured=f"{agreement} against 0 to 1", fix="Correct it.")
    scores = timestep_scores(program, spikes, psi)
    predictions, lead_over_time = scores.argmax(axis=2), leads(scores)
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
    streams = to_the_end(program, spikes)

    def part(start: int, stop: int) -> list[FloatArray]:
        session = Session(program, psi)
        found = []
        for b in range(start, stop):
            session.reset()
            found.append(session.push({name: array[b] for name, array in streams.items()}).scores)
        return found

    batch = len(next(iter(streams.values())))
    return np.stack([scores for scores_of_part in in_parts(part, batch) for scores in scores_of_part])


def _batch(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    streams, _ = read_streams(program, spikes)
    if 0 in next(iter(streams.values())).shape[:2]:
        raise InputError("spikes", "there is no recording, or it has no steps", fix="Give some.")
    return streams


def to_the_end(program: ChipProgram, spikes: Spikes) -> dict[str, ByteArray]:
    """Return every stream, (batch, steps, channels), followed by silence until the phases that play it so end."""
    streams = _batch(program, spikes)
    turned = {item.phase for item in program.inputs if item.positions is not None}
    last = max((phase.steps or 0 for phase in program.phases if phase.name not in turned), default=0)
    missing = max(0, last - next(iter(streams.values())).shape[1])
    return {name: np.pad(array, ((0, 0), (0, missing), (0, 0))) for name, array in streams.items()}


def _readout(program: ChipProgram) -> Readout:
    if program.readout is None:
        raise InputError(f"program {program.name!r}", "has no readout, so nothing wins", fix="Read the spikes.")
    if program.readout.potentials_from is not None:
        raise InputError(
            f"program {program.name!r}", "predicts by potentials, which no spike settles", fix="Play whole recordings."
        )
    return program.readout


def _first_lead(scores: FloatArray, margin: float) -> IntArray:
    """Return the first step, counted from 1, with that lead; the last one where there is none, (batch,)."""
    enough = leads(scores) >= margin
    enough[:, -1] = True
    return np.asarray(enough.argmax(axis=1) + 1, dtype=np.int64)


def _lengths(result: SimulationResult) -> list[tuple[str, int]]:
    """Return every phase with the steps before it."""
    found, before = [], 0
    for phase, items in result.activity.items():
        found.append((phase, before))
        before += len(items[0].count("spikes"))
    return found


def _until(result: SimulationResult, phase: str, recording: int, steps: int | None) -> Counts:
    """Count a phase of a recording up to a step; None: all of it."""
    activity = result.activity[phase][recording]
    rows = slice(None if steps is None else max(0, steps))
    return Counts(**{name: int(activity.count(name)[rows].sum()) for name in BY_CORE})


class _Proof:
    """What is known of a batch that was run to its end, asked as if it had been run only so far."""

    def __init__(self, program: ChipProgram, result: SimulationResult) -> None:
        readout = program.readout
        assert readout is not None
        self._phases: list[tuple[int, list[_Voter]]] = []
        for phase in program.phases:
            voters = [
                _Voter(program, phase, name, weight, result)
                for name, weight in zip(readout.populations, readout.weights, strict=True)
                if name in program.columns_of(phase.name)
            ]
            self._phases.append((len(result.activity[phase.name][0].count("spikes")), voters))
        self._batch, _, self._classes = result.spikes[readout.populations[0]].shape
        self._all = sum(steps for steps, _ in self._phases)
        # Scores of weights that are not whole are rounded: equal ones then prove nothing.
        whole = all(float(weight).is_integer() for weight in readout.weights)
        self._slack = 0.0 if whole else 1e-9 * sum(map(abs, readout.weights)) * self._all

    def stops(self) -> IntArray:
        """Search for the first step by halves: what is proven after a step is proven after every later one."""
        low, high = np.zeros(self._batch, dtype=np.int64), np.full(self._batch, self._all, dtype=np.int64)
        while (low < high).any():
            middle = (low + high) // 2
            settled = self._settled(middle)
            high = np.where(settled, middle, high)
            low = np.where(settled, low, np.minimum(middle + 1, high))
        return high

    def _settled(self, step: IntArray) -> npt.NDArray[np.bool_]:
        """Tell for each recording whether its winner stands after ``step`` steps, counted over all phases."""
        score, gain, loss = np.zeros((3, self._batch, self._classes))
        before = 0
        for steps, voters in self._phases:
            done = np.clip(step - before, 0, steps)
            for voter in voters:
                score += voter.weight * voter.spikes_until(done)
                possible = voter.spikes_after(done)
                gain += max(voter.weight, 0.0) * possible
                loss += max(-voter.weight, 0.0) * possible
            before += steps
        winner = score.argmax(axis=1)
        each = np.arange(self._batch)
        least = (score - loss)[each, winner][:, None] - self._slack
        most = score + gain
        most[each, winner] = -np.inf
        # A tie goes to the first class: those before the winner must stay below it.
        earlier = np.arange(self._classes)[None] < winner[:, None]
        settled: npt.NDArray[np.bool_] = np.where(earlier, most < least, most <= least).all(axis=1)
        return settled


@dataclass(frozen=True, eq=False)
class _Member:
    """One group of a readout's bundle, (n,) each: what its compartments keep, and their largest charge and drive."""

    name: str
    decay_u: IntArray
    decay_v: IntArray
    charge: IntArray
    bias: IntArray
    vmin: IntArray
    vmax: IntArray
    parent: str | None


class _Voter:
    """A readout population in its phase."""

    def __init__(self, program: ChipProgram, phase: Phase, name: str, weight: float, result: SimulationResult) -> None:
        self.weight = weight
        self._members = [_member(program, phase.name, member) for member in _members(program, name)]
        self._threshold = _each(program, phase.name, name, lambda core: core.threshold_voltage)
        self._refractory = _each(program, phase.name, name, lambda core: core.setting("refractory"))
        self._safe = all(_cannot_wrap(program, phase.name, member.name) for member in self._members)
        spikes = result.spikes[name]
        self.steps = spikes.shape[1]
        before = np.zeros((len(spikes), 1, spikes.shape[2]), dtype=np.int64)
        self.counts = np.concatenate((before, spikes.cumsum(axis=1, dtype=np.int64)), axis=1)
        free_from = np.where(spikes, np.arange(self.steps)[:, None] + self._refractory, 0)
        self._free_from = np.concatenate((before, np.maximum.accumulate(free_from, axis=1)), axis=1)
        self._u = {member.name: result.u[member.name] for member in self._members}
        self._v = {member.name: result.v[member.name] for member in self._members}

    def spikes_until(self, step: IntArray) -> IntArray:
        """Return the spikes in the first steps, (batch, n)."""
        return np.asarray(self.counts[np.arange(len(step)), step])

    def spikes_after(self, step: IntArray) -> IntArray:
        """Return how many spikes there can be after them at the most, (batch, n)."""
        each, last = np.arange(len(step)), np.maximum(step - 1, 0)
        started = (step > 0)[:, None]
        u = {name: np.where(started, kept[each, last], 0) for name, kept in self._u.items()}
        v = {name: np.where(started, kept[each, last], 0) for name, kept in self._v.items()}
        found = np.zeros(self.counts[:, 0].shape, dtype=np.int64)
        free_from = self._free_from[each, step] - step[:, None]
        for ahead in range(int((self.steps - step).max(initial=0))):
            joined: dict[str | None, IntArray] = {}
            for member in self._members:
                u[member.name] = decay(u[member.name], member.decay_u) + member.charge
                drive = u[member.name] + member.bias + joined.get(member.name, np.zeros_like(found))
                voltage = clip(decay(v[member.name], member.decay_v) + drive, member.vmin, member.vmax)
                # A spike, or a refractory step, brings the v of a spiking compartment to 0, which may be higher.
                v[member.name] = voltage if member.parent else np.maximum(voltage, 0)
                joined[member.parent] = joined.get(member.parent, np.zeros_like(found)) + v[member.name]
            can = (voltage > self._threshold) | (not self._safe)
            spikes = can & (ahead >= free_from) & (step[:, None] + ahead < self.steps)
            found += spikes
            free_from = np.where(spikes, ahead + self._refractory, free_from)
        return found


def _members(program: ChipProgram, name: str) -> list[str]:
    """Return the groups joined to a group, children first, and the group itself last."""
    found, begun = [], [name]
    while begun:
        found.append(begun.pop())
        begun += [child for child, parent in program.joined_to.items() if parent == found[-1]]
    return found[::-1]


def _each(program: ChipProgram, phase: str, name: str, values: Callable[[Core], IntArray | int]) -> IntArray:
    """Return what ``values`` gives for the compartments of a core, for those of a group, (n,)."""
    return program.by_column(phase, values)[program.columns_of(phase)[name]]


def _member(program: ChipProgram, phase: str, name: str) -> _Member:
    return _Member(
        name=name,
        decay_u=_each(program, phase, name, lambda core: core.setting("decay_u")),
        decay_v=_each(program, phase, name, lambda core: core.setting("decay_v")),
        charge=_each(program, phase, name, _largest_charge),
        bias=_each(program, phase, name, lambda core: core.bias),
        vmin=_each(program, phase, name, lambda core: core.vmin),
        vmax=_each(program, phase, name, lambda core: core.vmax),
        parent=program.joined_to.get(name),
    )


def _largest_charge(core: Core) -> IntArray:
    charge = np.zeros(core.compartments, dtype=np.int64)
    np.add.at(charge, core.axons.target, np.maximum(core.effective_weights, 0))
    return charge


@lru_cache(maxsize=8)
def _proof(program: ChipProgram) -> dict[int, npt.NDArray[np.bool_]]:
    return {found.core: found.cannot_wrap for found in prove_range(program)}


def _cannot_wrap(program: ChipProgram, phase: str, name: str) -> bool:
    return bool(_each(program, phase, name, lambda core: _proof(program)[core.number].astype(np.int64)).all())
