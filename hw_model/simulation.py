"""Play recordings to a program, phase by phase, and collect spikes, registers and counts under population names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from hw_model.activity import StepActivity, count_activity
from hw_model.counts import Counts, total
from hw_model.errors import InputError, did_you_mean
from hw_model.fixed_point import IntArray
from hw_model.playing import Spikes, play, read_streams
from hw_model.probes import PhaseProbes, Probe, read_probes
from hw_model.program import ChipProgram
from hw_model.trace import EVENTS, KINDS, ByteArray, Kind, PhaseInput, PhaseTrace, Window

Engine = Literal["fast", "reference"]
ENGINES: tuple[Engine, ...] = get_args(Engine)
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """What a simulation found; arrays are (batch, steps, n), or (steps, n) where one recording was given.

    ``spikes[name]`` for every population that can spike, ``u[name]``, ``v[name]`` and ``potential[name]`` (v as the
    threshold saw it) for every group of compartments, each only if it was asked for.
    """

    spikes: Mapping[str, ByteArray]
    u: Mapping[str, IntArray]
    v: Mapping[str, IntArray]
    potential: Mapping[str, IntArray]
    activity: Mapping[str, tuple[StepActivity, ...]]
    """By phase, one entry a recording."""
    events: Mapping[str, Mapping[str, int]]
    """``events[population]``: its wraps and clips by kind, over all recordings; left out where there are none."""
    scores: FloatArray | None
    """Class scores of the readout, (batch, classes) or (classes,); None without a readout."""

    @cached_property
    def per_recording(self) -> tuple[Counts, ...]:
        """Counts of every recording."""
        return tuple(total(a.counts for a in phases) for phases in zip(*self.activity.values(), strict=True))

    @cached_property
    def counts(self) -> Counts:
        """Counts of all recordings together."""
        return total(self.per_recording)

    @cached_property
    def counts_by_phase(self) -> dict[str, Counts]:
        """Counts of all recordings together, by phase."""
        return {phase: total(a.counts for a in found) for phase, found in self.activity.items()}

    @property
    def prediction(self) -> npt.NDArray[np.int64]:
        """Class with the highest score, the first of equals; (batch,) or a scalar array."""
        if self.scores is None:
            raise InputError("prediction", "the program has no readout", fix="Read the spikes.")
        return np.asarray(np.argmax(self.scores, axis=-1), dtype=np.int64)


def simulate(
    program: ChipProgram,
    spikes: Spikes,
    steps: int | None = None,
    engine: Engine = "fast",
    probe: Sequence[Kind | Probe] = ("spikes",),
) -> SimulationResult:
    """Run recordings through a program.

    ``spikes``: 0 or 1, (steps, channels) or (batch, steps, channels); a mapping by stream name where a program has
    several inputs. An input spike of row t acts at step t + 1. ``steps`` of phases that the program does not fix; by
    default the rows given. ``probe``: what to keep, each a kind (``"spikes"``, ``"u"``, ``"v"``, ``"potential"``) of
    all populations and steps, or a :class:`hw_model.Probe` of chosen ones; nothing else is held. Both engines give the
    same integers. Bad arguments are an ``InputError``.
    """
    if engine not in ENGINES:
        raise InputError(f"engine {engine!r}", "does not exist", fix=did_you_mean(engine, ENGINES))
    if steps is not None and steps < 1:
        raise InputError("steps", "nothing to simulate", measured=f"{steps} against at least 1", fix="Raise steps.")
    probes = read_probes(program, probe)
    streams, batched = read_streams(program, spikes)
    run_phase = _engine(engine)

    kept: dict[Kind, dict[str, list[IntArray]]] = {kind: {} for kind in KINDS}
    activity: dict[str, list[StepActivity]] = {phase.name: [] for phase in program.phases}
    events: dict[str, IntArray] = {}
    scores: list[FloatArray] = []
    for i in range(len(next(iter(streams.values())))):
        score: list[FloatArray] = []
        for phase in program.phases:
            played = play(program, phase, {name: array[i] for name, array in streams.items()}, steps)
            wanted = PhaseProbes(program, phase.name, probes, played.steps)
            trace = run_phase(program, phase.name, played, wanted.windows())
            activity[phase.name].append(count_activity(program, phase.name, played, trace))
            for kind in probes:
                found = trace.spikes if kind == "spikes" else trace.registers[kind]
                for name, array in wanted.by_population(kind, found).items():
                    kept[kind].setdefault(name, []).append(array)
            _add_events(program, phase.name, trace, events)
            score.append(_score(program, phase.name, trace))
        scores.append(np.sum(score, axis=0))

    results = {
        kind: {name: np.stack(arrays) if batched else arrays[0] for name, arrays in by_name.items()}
        for kind, by_name in kept.items()
    }
    return SimulationResult(
        spikes={name: array.astype(np.uint8, copy=False) for name, array in results["spikes"].items()},
        u=results["u"],
        v=results["v"],
        potential=results["potential"],
        activity={phase: tuple(items) for phase, items in activity.items()},
        events={name: _named(counts) for name, counts in events.items() if counts.any()},
        scores=None if program.readout is None else (np.stack(scores) if batched else scores[0]),
    )


def _engine(engine: Engine) -> Callable[[ChipProgram, str, PhaseInput, dict[Kind, Window]], PhaseTrace]:
    if engine == "reference":
        from hw_model.engine_reference import run_phase

        return run_phase
    from hw_model.engine_fast import run_phase as run_phase_fast  # numba: imported only when it is used

    return run_phase_fast


def _add_events(program: ChipProgram, phase: str, trace: PhaseTrace, events: dict[str, IntArray]) -> None:
    """Add up wraps and clips by population."""
    for piece, columns in program.columns_of(phase):
        before = events.get(piece.group, np.zeros(len(EVENTS), dtype=np.int64))
        events[piece.group] = before + trace.events[:, columns].sum(axis=1)


def _named(counts: IntArray) -> dict[str, int]:
    return {event: int(n) for event, n in zip(EVENTS, counts, strict=True)}


def _score(program: ChipProgram, phase: str, trace: PhaseTrace) -> FloatArray:
    """Return what the populations of a phase add to the class scores, (classes,)."""
    if program.readout is None:
        return np.zeros(1)
    readout = program.readout
    scores = np.zeros(program.populations[readout.populations[0]])
    sums = trace.spikes.sum(axis=0, dtype=np.int64)
    for piece, columns in program.columns_of(phase):
        if piece.group in readout.populations:
            weight = readout.weights[readout.populations.index(piece.group)]
            scores[piece.start : piece.stop] += weight * sums[columns]
    return scores
