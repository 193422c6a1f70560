"""Play recordings to a program, phase by phase, and collect spikes, registers and counts under population names."""

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, lru_cache, partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from hw_model.accounting.activity import StepActivity, count_steps, count_totals
from hw_model.description.counts import Counts, total
from hw_model.engine.playing import Player, Spikes, length_of, play, read_streams, steps_of
from hw_model.engine.probes import KINDS, Kind, Probe, ProbedPopulation, phase_probes, read_probes
from hw_model.engine.trace import EVENTS, TOTALS, PhaseInput, PhaseTrace, Register, Window
from hw_model.engine.usable import fix_of, why_not_compiled
from hw_model.errors import InputError, check_known, check_most
from hw_model.io.given import checked
from hw_model.mapping.graph import MAX_STEPS, Phase, largest, winning
from hw_model.program.chip_program import ChipProgram
from hw_model.values import AnyArray, ByteArray, FloatArray, IntArray, Shown, joined

Engine = Literal["fast", "reference"]
ENGINES: tuple[Engine, ...] = get_args(Engine)

_log = logging.getLogger("locsnn")
_EVENTS = slice(TOTALS.index(EVENTS[0]), TOTALS.index(EVENTS[-1]) + 1)
MAX_TOGETHER = 1 << 26
"""Spikes, 0 or 1, that are held at a time before they are counted: recordings go in parts of at most this many."""
MAX_REMEMBERED = 1 << 18
"""Spikes, 0 or 1, of an empty recording that is kept for later ones."""


class SimulationResult(Shown):
    """What a simulation found; arrays are (batch, steps, n), or (steps, n) where one recording was given.

    ``spikes[name]`` for every population that can spike, ``u[name]``, ``v[name]`` and ``potential[name]`` (v as the
    threshold saw it) for every group of compartments, each only if it was asked for.
    """

    spikes: Mapping[str, ByteArray]
    u: Mapping[str, IntArray]
    v: Mapping[str, IntArray]
    potential: Mapping[str, IntArray]
    activity: Mapping[str, tuple[StepActivity, ...]]
    """By phase, one entry a recording; only if it was asked for."""
    count_tables: Mapping[str, IntArray]
    """By phase, (batch, counts): a column for each of :data:`hw_model.description.counts.COUNTED`."""
    events: Mapping[str, Mapping[str, int]]
    """``events[population]``: its wraps and clips by kind, over all recordings; left out where there are none."""
    scores: FloatArray | None
    """Class scores of the readout, (batch, classes) or (classes,); None without a readout."""
    tie_class: int | None = None
    """The class that is predicted where all scores tie; None: the program names none."""

    @cached_property
    def per_recording(self) -> tuple[Counts, ...]:
        """Counts of every recording."""
        return tuple(
            Counts(*row) for row in np.sum(list(self.count_tables.values()), axis=0).tolist()
        )

    @cached_property
    def counts(self) -> Counts:
        """Counts of all recordings together."""
        return total(self.counts_by_phase.values())

    @cached_property
    def counts_by_phase(self) -> dict[str, Counts]:
        """Counts of all recordings together, by phase."""
        return {
            phase: Counts(*table.sum(axis=0).tolist()) for phase, table in self.count_tables.items()
        }

    @property
    def prediction(self) -> IntArray:
        """Class with the highest score, the first of equals; (batch,) or a scalar array.

        Where all scores tie, it is the readout's class for ties or, as nothing is predicted, class 0.
        """
        if self.scores is None:
            raise InputError("prediction", "the program has no readout", fix="Read the spikes.")
        return np.asarray(winning(self.scores, self.tie_class), dtype=np.int64)


@checked
def simulate(
    program: ChipProgram,
    spikes: Spikes,
    steps: int | None = None,
    engine: Engine = "fast",
    probe: Sequence[Kind | Probe] = ("spikes",),
    skip: bool = True,
) -> SimulationResult:
    """Run recordings through a program.

    - ``spikes``: 0 or 1, (steps, channels) or (batch, steps, channels); for a program with several inputs, a mapping by
      stream name. An input spike of row t acts at step t + 1
    - ``steps``: of phases whose length the program does not fix; by default the number of rows or, for transposed
      inputs, of all visits
    - ``engine``: ``"fast"`` or ``"reference"``; both give the same integers
    - ``probe``: what to keep. Each is a kind (``"spikes"``, ``"u"``, ``"v"``, ``"potential"``) for all populations and
      steps, or a :class:`hw_model.Probe` for some. ``"activity"`` keeps the counts of every step and core, which
      latency needs. Nothing else is kept
    - ``skip``: the fast engine leaves out what cannot change anything. Without it, every compartment is updated in
      every step, and only ``skipped_steps`` differs

    Raises ``InputError`` for bad arguments.
    """
    check_known(f"engine {engine!r}", "does not exist", engine, ENGINES)
    return play_recordings(program, spikes, steps, probe, *_engine(engine, skip), engine == "fast")


Run = Callable[[ChipProgram, str, PhaseInput, dict[Register, Window]], PhaseTrace]
"""Plays some recordings to a phase of a program, and keeps of registers what the windows ask for."""


class _Playback(NamedTuple):
    """How recordings are played: all that those of one call have in common.

    ``rows``: of every recording; ``steps``: of phases whose length the program does not fix.
    """

    program: ChipProgram
    probes: tuple[Probe, ...]
    rows: int
    steps: int | None
    is_batch: bool
    run_phase: Run
    player: Player

    @property
    def spikes_of_recording(self) -> int:
        """Numbers of 0 and 1 that a recording's spikes take, at most."""
        compartments = sum(self.program.populations.values())
        return max(1, compartments * self.longest_phase)

    @property
    def longest_phase(self) -> int:
        """The most steps of a phase."""
        return _longest_phase(self.program, self.rows, self.steps)


def play_recordings(  # noqa: PLR0913 - public: each is an option of its own
    program: ChipProgram,
    spikes: Spikes,
    steps: int | None,
    probe: Sequence[Kind | Probe],
    run_phase: Run,
    player: Player,
    remember: bool = False,
) -> SimulationResult:
    """Do what :func:`simulate` does with any engine: ``run_phase`` plays some recordings to a phase.

    ``remember``: an empty recording is played once, and later ones are given copies.
    """
    _check_steps(steps)
    probes = read_probes(program, probe)
    streams, is_batch = read_streams(program, spikes, listed=True)
    batch, rows = next(iter(streams.values())).shape[:2]
    if batch == 0 or (rows == 0 and steps is None):
        raise InputError(
            "spikes",
            "nothing to simulate",
            measured=f"recordings: {batch}, steps: {rows}",
            fix="Give some recordings and steps.",
        )
    playback = _Playback(program, tuple(probes.values()), rows, steps, is_batch, run_phase, player)
    is_small = batch == 1 and playback.spikes_of_recording <= MAX_REMEMBERED
    if remember and is_small and not any(array.max(initial=0) for array in streams.values()):
        return _copied_result(_of_nothing(playback))
    return _played(streams, playback)


def _check_steps(steps: int | None) -> None:
    if steps is None:
        return
    if steps < 1:
        raise InputError(
            "steps",
            "nothing to simulate",
            measured=f"{steps} against at least 1",
            fix="Raise steps.",
        )
    check_most(steps, MAX_STEPS, "steps", "a simulation does not hold so many", fix="Lower steps.")


@lru_cache(maxsize=8)
def _of_nothing(playback: _Playback) -> SimulationResult:
    """Return the result of an empty recording, which nobody changes."""
    streams = {}
    for name, channels in playback.program.streams.items():
        streams[name] = np.zeros((1, playback.rows, channels), dtype=np.uint8)
    return _played(streams, playback)


def _copied_result(result: SimulationResult) -> SimulationResult:
    return SimulationResult(**_copied(vars(result)))


def _copied(value: Any) -> Any:
    """Return a value with arrays, and what holds them, of its own."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(map(_copied, value))
    return StepActivity(**_copied(vars(value))) if isinstance(value, StepActivity) else value


def _played(streams: Mapping[str, ByteArray], playback: _Playback) -> SimulationResult:
    """Play recordings, as many at a time as can be held, and keep what the probes ask for."""
    program = playback.program
    player = playback.player
    plans = _plans(program, playback.probes, playback.rows, playback.steps)
    collected = _Collected(playback)
    batch = len(next(iter(streams.values())))
    together = max(1, MAX_TOGETHER // playback.spikes_of_recording)
    for start in range(0, batch, together):
        stop = min(start + together, batch)
        events = {}
        for name, array in streams.items():
            events[name] = player.list_events(name, array[start:stop])
        voting: dict[str, AnyArray] = {}
        for plan in plans:
            played = play(program, plan.phase, events, playback.steps, player)
            trace = playback.run_phase(program, plan.phase.name, played, plan.windows)
            collected.add(plan, played, trace)
            voting |= plan.voting(trace)
        if program.readout is not None:
            collected.scores.append(program.readout.weighed(voting))
    return collected.result()


class _Plan(NamedTuple):
    """A phase, and what to keep of it.

    - ``windows``: registers that the engine keeps
    - ``probed``: what the probes ask for
    - ``deciding``: potentials by which the readout predicts
    - ``counted``: columns of the populations whose spikes the readout counts
    """

    phase: Phase
    windows: dict[Register, Window]
    probed: list[ProbedPopulation]
    deciding: list[ProbedPopulation]
    counted: dict[str, slice]

    def voting(self, trace: PhaseTrace) -> dict[str, AnyArray]:
        """Return what the readout weighs, by population, (batch, n): largest potentials, or numbers of spikes."""
        voting: dict[str, AnyArray] = {}
        arrays = _arrays_of(trace)
        for population in self.deciding:
            voting[population.name] = largest(population.taken_from(arrays), 0)
        for name, columns in self.counted.items():
            voting[name] = trace.fired[:, columns]
        return voting


def _arrays_of(trace: PhaseTrace) -> dict[Kind, AnyArray]:
    """Return what an engine keeps of a phase, by kind."""
    arrays: dict[Kind, AnyArray] = {"spikes": trace.spikes}
    for register, rows in trace.registers.items():
        arrays[register] = rows
    return arrays


@lru_cache(maxsize=16)
def _plans(
    program: ChipProgram, probes: tuple[Probe, ...], rows: int, steps: int | None
) -> list[_Plan]:
    """Return what to keep of each phase, where recordings have ``rows`` rows."""
    readout = program.readout
    first_step_of = {} if readout is None else readout.from_step
    read = () if readout is None else readout.populations
    deciding_probes = []
    for name, first_step in first_step_of.items():
        to_the_end = range(first_step, sys.maxsize)
        deciding_probes.append(Probe("potential", (name,), to_the_end))
    plans = []
    for phase in program.phases:
        phase_steps = steps_of(program, phase, rows, steps)
        columns = program.columns_of(phase.name)
        all_probes = (*probes, *deciding_probes)
        windows_of_phase = phase_probes(program, phase.name, all_probes, phase_steps)
        plan = _Plan(
            phase=phase,
            windows=windows_of_phase.windows,
            probed=[each for probe in probes for each in windows_of_phase.populations[probe]],
            deciding=[
                each for probe in deciding_probes for each in windows_of_phase.populations[probe]
            ],
            counted={
                name: columns[name]
                for name in read
                if name in columns and name not in first_step_of
            },
        )
        plans.append(plan)
    return plans


@lru_cache(maxsize=16)
def _longest_phase(program: ChipProgram, rows: int, steps: int | None) -> int:
    return max(length_of(program, phase, rows, steps) for phase in program.phases)


class _Collected:
    """What is kept of recordings that were played so far."""

    def __init__(self, playback: _Playback) -> None:
        phases = [phase.name for phase in playback.program.phases]
        self.scores: list[FloatArray] = []
        self._playback = playback
        self._keeps_activity = any(probe.kind == "activity" for probe in playback.probes)
        self._arrays: dict[Kind, dict[str, list[AnyArray]]] = {kind: {} for kind in KINDS}
        self._counts: dict[str, list[IntArray]] = {phase: [] for phase in phases}
        self._activity: dict[str, list[StepActivity]] = {}
        self._events: dict[str, IntArray] = {}

    def add(self, plan: _Plan, played: PhaseInput, trace: PhaseTrace) -> None:
        """Keep what is asked for of some recordings in a phase."""
        program = self._playback.program
        phase = plan.phase.name
        self._counts[phase].append(count_totals(program, phase, played, trace))
        if self._keeps_activity:
            activity = self._activity.setdefault(phase, [])
            activity += count_steps(program, phase, played, trace)
        arrays = _arrays_of(trace)
        for population in plan.probed:
            parts = self._arrays[population.kind].setdefault(population.name, [])
            parts.append(population.taken_from(arrays))
        if np.count_nonzero(trace.totals[:, _EVENTS]):
            self._add_events(phase, trace)

    def _add_events(self, phase: str, trace: PhaseTrace) -> None:
        """Add up wraps and clips of a phase, (populations, kinds)."""
        columns = self._playback.program.columns_of(phase).values()
        # A sum over one recording would only copy it.
        of_columns = trace.events[0] if len(trace.events) == 1 else trace.events.sum(axis=0)
        of_populations = np.add.reduceat(
            of_columns, [columns_of_group.start for columns_of_group in columns], axis=1
        )
        self._events[phase] = self._events.get(phase, 0) + of_populations.T

    def result(self) -> SimulationResult:
        """Return what was kept of all recordings."""
        readout = self._playback.program.readout
        return SimulationResult(
            spikes=self._of_kind("spikes"),
            u=self._of_kind("u"),
            v=self._of_kind("v"),
            potential=self._of_kind("potential"),
            activity={phase: tuple(items) for phase, items in self._activity.items()},
            count_tables={phase: joined(tables) for phase, tables in self._counts.items()},
            events=self._events_by_population(),
            scores=None if readout is None else self._whole(self.scores),
            tie_class=None if readout is None else readout.tie_class,
        )

    def _of_kind(self, kind: Kind) -> dict[str, AnyArray]:
        return {name: self._whole(parts) for name, parts in self._arrays[kind].items()}

    def _whole(self, parts: list[AnyArray]) -> AnyArray:
        """Return the arrays of all parts as one; without the axis of recordings, where one was given."""
        if self._playback.is_batch:
            return joined(parts)
        only: AnyArray = parts[0][0]
        return only

    def _events_by_population(self) -> dict[str, dict[str, int]]:
        """Return wraps and clips by kind, of populations that have some."""
        by_population = {}
        for phase, table in self._events.items():
            names = self._playback.program.columns_of(phase)
            for name, numbers in zip(names, table.tolist(), strict=True):
                if any(numbers):
                    by_population[name] = dict(zip(EVENTS, numbers, strict=True))
        return by_population


def _engine(engine: Engine, skip: bool) -> tuple[Run, Player]:
    if engine == "fast" and _compiles():
        return _compiled_engine(skip)
    return _plain_engine(skip and engine == "fast")


@lru_cache(maxsize=2)
def _plain_engine(skip: bool) -> tuple[Run, Player]:
    from hw_model.engine.reference import run_phase

    return partial(run_phase, skip=skip), Player()


@lru_cache(maxsize=2)
def _compiled_engine(skip: bool) -> tuple[Run, Player]:
    from hw_model.engine import fast as engine_fast  # numba: imported only when it is used
    from hw_model.engine.events import list_events, transpose

    return partial(engine_fast.run_phase, skip=skip), Player(list_events, transpose)


def start_compiling() -> None:
    """Let other processes compile what they were asked to, if the fast engine is not compiled."""
    if _compiles():
        from hw_model.engine.fast import start_ahead_if_missing

        start_ahead_if_missing()


@cache
def _compiles() -> bool:
    """Tell whether there is a fast engine here; warn, once, where there is none."""
    reason = why_not_compiled()
    if reason is not None:
        _log.warning(
            "engine 'fast': the plain one plays instead, about a hundred times slower (%s). %s",
            reason,
            fix_of(reason),
        )
    return reason is None
