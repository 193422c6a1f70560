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
from hw_model.program import ChipProgram
from hw_model.trace import EVENTS, PROBES, ByteArray, PhaseInput, PhaseTrace, Probe

Engine = Literal["fast", "reference"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


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
    scores: npt.NDArray[np.float64] | None
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
    probe: Sequence[Probe] = ("spikes",),
) -> SimulationResult:
    """Run recordings through a program.

    ``spikes``: 0 or 1, (steps, channels) or (batch, steps, channels); a mapping by stream name where a program has
    several inputs. An input spike of row t acts at step t + 1. ``steps`` of phases that the program does not fix; by
    default the rows given. Both engines give the same integers. Bad arguments are an ``InputError``.
    """
    if engine not in ENGINES:
        raise InputError(f"engine {engine!r}", "does not exist", fix=did_you_mean(engine, ENGINES))
    for name in probe:
        if name not in PROBES:
            raise InputError(f"probe {name!r}", "does not exist", fix=did_you_mean(name, PROBES))
    if steps is not None and steps < 1:
        raise InputError("steps", "nothing to simulate", measured=f"{steps} against at least 1", fix="Raise steps.")
    streams, batched = read_streams(program, spikes)
    batch = len(next(iter(streams.values())))

    traces: dict[str, list[PhaseTrace]] = {phase.name: [] for phase in program.phases}
    activity: dict[str, list[StepActivity]] = {phase.name: [] for phase in program.phases}
    for phase in program.phases:
        for i in range(batch):
            played = play(program, phase, {name: array[i] for name, array in streams.items()}, steps)
            trace = _engine(engine)(program, phase.name, played, tuple(probe))
            activity[phase.name].append(count_activity(program, phase.name, played, trace))
            traces[phase.name].append(trace)

    found = {name: _by_population(program, traces, name) for name in PROBES}
    scores = _scores(program, found["spikes"], batch)
    if not batched:
        found = {name: {group: array[0] for group, array in arrays.items()} for name, arrays in found.items()}
    return SimulationResult(
        spikes={name: array.astype(np.uint8) for name, array in found["spikes"].items() if "spikes" in probe},
        u=found["u"],
        v=found["v"],
        potential=found["potential"],
        activity={phase: tuple(items) for phase, items in activity.items()},
        events=_events(program, traces),
        scores=scores if batched or scores is None else scores[0],
    )


def _engine(engine: Engine) -> Callable[[ChipProgram, str, PhaseInput, tuple[Probe, ...]], PhaseTrace]:
    if engine == "reference":
        from hw_model.engine_reference import run_phase

        return run_phase
    from hw_model.engine_fast import run_phase as run_phase_fast  # numba: imported only when it is used

    return run_phase_fast


def _by_population(program: ChipProgram, traces: dict[str, list[PhaseTrace]], probe: Probe) -> dict[str, IntArray]:
    """Gather a probe from the slices of the cores, (batch, steps, n) a population."""
    found: dict[str, IntArray] = {}
    sizes = program.populations
    for phase, recordings in traces.items():
        arrays = [trace.spikes if probe == "spikes" else trace.registers.get(probe) for trace in recordings]
        present = [array for array in arrays if array is not None]
        if not present:
            continue
        stacked = np.stack(present)
        first = 0
        for core in program.cores_of(phase):
            joined = core.setting("joined")
            for piece in core.slices:
                if probe != "spikes" or not joined[piece.offset]:
                    shape = (*stacked.shape[:2], sizes[piece.group])
                    array = found.setdefault(piece.group, np.zeros(shape, dtype=stacked.dtype))
                    here = slice(first + piece.offset, first + piece.offset + piece.size)
                    array[:, :, piece.start : piece.stop] = stacked[:, :, here]
            first += core.compartments
    return found


def _events(program: ChipProgram, traces: dict[str, list[PhaseTrace]]) -> dict[str, dict[str, int]]:
    found: dict[str, IntArray] = {}
    for phase, recordings in traces.items():
        summed = np.sum([trace.events for trace in recordings], axis=0)
        first = 0
        for core in program.cores_of(phase):
            for piece in core.slices:
                here = slice(first + piece.offset, first + piece.offset + piece.size)
                found[piece.group] = found.get(piece.group, np.zeros(3, dtype=np.int64)) + summed[:, here].sum(axis=1)
            first += core.compartments
    return {
        group: {event: int(n) for event, n in zip(EVENTS, counts, strict=True)}
        for group, counts in found.items()
        if counts.any()
    }


def _scores(program: ChipProgram, spikes: dict[str, IntArray], batch: int) -> npt.NDArray[np.float64] | None:
    if program.readout is None:
        return None
    readout = program.readout
    terms = [
        weight * spikes[name].sum(axis=1, dtype=np.int64)
        for name, weight in zip(readout.populations, readout.weights, strict=True)
    ]
    scores: npt.NDArray[np.float64] = np.sum(terms, axis=0, dtype=np.float64).reshape(batch, -1)
    return scores
