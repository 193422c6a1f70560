"""Simulate a program on recordings: :func:`simulate`.

A program runs in phases, one after the other. For each phase the events of the recordings become
spikes on its input lines (:mod:`hw_model.engine.playing`), an engine steps its compartments
(:mod:`hw_model.engine.fast` or :mod:`hw_model.engine.reference`), and this module collects the
spikes, registers and counts that the probes ask for, under the names of populations.
"""

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, lru_cache, partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from hw_model.accounting.activity import StepActivity, count_steps, count_totals
from hw_model.description.counts import Counts, total
from hw_model.engine.playing import Player, Spikes, play, read_streams, steps_of
from hw_model.engine.probes import KINDS, Kind, Probe, ProbedPopulation, phase_probes, read_probes
from hw_model.engine.trace import EVENTS, TOTALS, PhaseInput, PhaseTrace, Register, Window
from hw_model.engine.usable import fix_of, why_not_compiled
from hw_model.errors import InputError, check_known, check_most
from hw_model.io.arguments import checked
from hw_model.mapping.graph import MAX_STEPS, Phase, largest, winning
from hw_model.program.chip_program import ChipProgram
from hw_model.values import AnyArray, ByteArray, FloatArray, IntArray, Shown, joined

Engine = Literal["fast", "reference"]
ENGINES: tuple[Engine, ...] = get_args(Engine)

_log = logging.getLogger("locsnn")
_EVENTS = slice(TOTALS.index(EVENTS[0]), TOTALS.index(EVENTS[-1]) + 1)
"""Columns of an engine's totals that count wraps and clips."""
MAX_TOGETHER = 1 << 26
"""Bytes of a phase's spikes, one per compartment and step, that are held at a time: 64 MiB, chosen by hand. A larger
batch is played in parts."""
MAX_REMEMBERED = 1 << 18
"""Bytes of spikes up to which the result of an empty recording is kept for later ones; chosen by hand."""


class SimulationResult(Shown):
    """What a simulation returns; arrays are (batch, steps, n), or (steps, n) for a recording without a batch axis.

    ``spikes[name]`` for every population that can spike, ``u[name]``, ``v[name]`` and ``potential[name]`` (v as the
    threshold saw it) for every group of compartments, each only if it was asked for. The ``repr`` is short, as of every
    :class:`hw_model.values.Shown`: arrays are shown by type and shape.
    """

    spikes: Mapping[str, ByteArray]
    u: Mapping[str, IntArray]
    v: Mapping[str, IntArray]
    potential: Mapping[str, IntArray]
    activity: Mapping[str, tuple[StepActivity, ...]]
    """By phase, one entry per recording; empty without the probe ``"activity"``."""
    count_tables: Mapping[str, IntArray]
    """By phase, (batch, counts): a column for each of :data:`hw_model.description.counts.COUNTED`."""
    events: Mapping[str, Mapping[str, int]]
    """``events[population]``: its wraps and clips by kind, over all recordings; only populations that have any."""
    scores: FloatArray | None
    """Class scores of the readout, (batch, classes) or (classes,); None without a readout."""
    tie_class: int | None = None
    """The class that is predicted where all scores tie; None if the program names none."""

    @cached_property
    def per_recording(self) -> tuple[Counts, ...]:
        """Counts of every recording."""
        sums_over_phases = np.sum(list(self.count_tables.values()), axis=0)
        return tuple(Counts(*row) for row in sums_over_phases.tolist())

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

        Where all scores tie, it is the readout's class for ties or, without one, class 0.
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
    - ``steps``: of phases whose length the program does not fix. By default, such a phase has as many steps as the
      recording has rows or, if its input goes through the transpose buffer, runs until the last *visit*: a visit reads
      one channel from the buffer
    - ``engine``: ``"fast"`` or ``"reference"``; both give the same integers
    - ``probe``: what to keep. Each is a kind (``"spikes"``, ``"u"``, ``"v"``, ``"potential"``) for all populations and
      steps, or a :class:`hw_model.Probe` for some. ``"activity"`` keeps the counts of every step and core, which
      latency needs. Nothing else is kept
    - ``skip``: the fast engine leaves out what cannot change anything. Without it, every compartment is updated in
      every step, and only ``skipped_steps`` differs

    Raises ``InputError`` for bad arguments.
    """
    check_known(f"engine {engine!r}", "does not exist", engine, ENGINES)
    run_phase, player = _engine(engine, skip)
    # The reference engine is what the fast one is tested against, so it plays every recording anew.
    remember = engine == "fast"
    return play_recordings(program, spikes, steps, probe, run_phase, player, remember=remember)


Run = Callable[[ChipProgram, str, PhaseInput, dict[Register, Window]], PhaseTrace]
"""Plays some recordings to a phase of a program, and keeps of registers what the windows ask for."""


class _Playback(NamedTuple):
    """What all recordings of one call of :func:`simulate` have in common; hashable, as caches are keyed by it.

    - ``rows``: rows of every recording
    - ``steps``: steps of the phases whose length the program does not fix
    - ``is_batch``: whether the recordings were passed with a batch axis, which the results then have too
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
        """Bytes that the spikes of a recording take in the longest phase, at most."""
        compartments = sum(self.program.populations.values())
        return max(1, compartments * self.longest_phase)

    @property
    def longest_phase(self) -> int:
        """The most steps that the arrays of a phase have."""
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

    ``remember``: an empty recording is simulated once per program, and later ones get copies of its result. That takes
    a tenth to a fifth of the time (docs/research/benchmarks.md), and a sensor that nothing touches records silence.
    """
    _check_steps(steps)
    probes = read_probes(program, probe)
    # Listing the events looks at every byte anyway, and raises for bytes other than 0 and 1.
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
        return _copied_result(_result_of_silence(playback))
    return _play_in_parts(streams, playback)


def _check_steps(steps: int | None) -> None:
    """Raise ``InputError`` for a number of steps that cannot be simulated."""
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
def _result_of_silence(playback: _Playback) -> SimulationResult:
    """Return the result of an empty recording. It is shared between calls: copy it before handing it out."""
    streams = {}
    for name, channels in playback.program.streams.items():
        streams[name] = np.zeros((1, playback.rows, channels), dtype=np.uint8)
    return _play_in_parts(streams, playback)


def _copied_result(result: SimulationResult) -> SimulationResult:
    return SimulationResult(**_copied(vars(result)))


def _copied(value: Any) -> Any:
    """Return a deep copy of a field of a result; programs and routes that it refers to are not copied."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(map(_copied, value))
    if isinstance(value, StepActivity):
        return StepActivity(**_copied(vars(value)))
    return value


def _play_in_parts(streams: Mapping[str, ByteArray], playback: _Playback) -> SimulationResult:
    """Play recordings, as many at a time as :data:`MAX_TOGETHER` allows, and keep what the probes ask for."""
    program = playback.program
    player = playback.player
    plans = _plans(program, playback.probes, playback.rows, playback.steps)
    collector = _Collector(playback)
    batch = len(next(iter(streams.values())))
    together = max(1, MAX_TOGETHER // playback.spikes_of_recording)
    for start in range(0, batch, together):
        stop = min(start + together, batch)
        events = {}
        for name, array in streams.items():
            events[name] = player.list_events(name, array[start:stop])
        votes: dict[str, AnyArray] = {}
        for plan in plans:
            played = play(program, plan.phase, events, playback.steps, player)
            trace = playback.run_phase(program, plan.phase.name, played, plan.windows)
            collector.add(plan, played, trace)
            votes |= plan.votes(trace)
        if program.readout is not None:
            collector.scores.append(program.readout.weighed(votes))
    return collector.result()


class _Plan(NamedTuple):
    """A phase, and what to keep of its run: for the probes, and for the readout, which scores the classes.

    - ``windows``: the columns and steps of each register that the engine records
    - ``probed``: the populations that probes ask for, and where they lie in the engine's arrays
    - ``deciding``: the populations whose largest potential the readout weighs
    - ``counted``: the columns of the populations whose spikes the readout counts
    """

    phase: Phase
    windows: dict[Register, Window]
    probed: list[ProbedPopulation]
    deciding: list[ProbedPopulation]
    counted: dict[str, slice]

    def votes(self, trace: PhaseTrace) -> dict[str, AnyArray]:
        """Return what the readout weighs, by population, (batch, n): largest potentials, or numbers of spikes."""
        votes: dict[str, AnyArray] = {}
        arrays = _arrays_of(trace)
        for population in self.deciding:
            # From row 0 on: the recorded window begins at the first step that counts.
            votes[population.name] = largest(population.taken_from(arrays), first=0)
        for name, columns in self.counted.items():
            votes[name] = trace.fired[:, columns]
        return votes


def _arrays_of(trace: PhaseTrace) -> dict[Kind, AnyArray]:
    """Return the arrays of an engine by the kinds of probes that they answer."""
    arrays: dict[Kind, AnyArray] = {"spikes": trace.spikes}
    for register, rows in trace.registers.items():
        arrays[register] = rows
    return arrays


@lru_cache(maxsize=16)
def _plans(
    program: ChipProgram, probes: tuple[Probe, ...], rows: int, steps: int | None
) -> list[_Plan]:
    """Return what to keep of each phase, for recordings of ``rows`` rows."""
    readout = program.readout
    first_step_of = {} if readout is None else readout.from_step
    read_populations = () if readout is None else readout.populations
    # What the readout weighs is recorded by the engine like a probe of the user.
    deciding_probes = []
    for name, first_step in first_step_of.items():
        to_the_end = range(first_step, sys.maxsize)
        deciding_probes.append(Probe("potential", (name,), to_the_end))
    plans = []
    for phase in program.phases:
        # steps_of is the length of the engine's arrays. It is more than the steps for which a recording is played if
        # the phase begins at the first touch, which may be in any row.
        phase_steps = steps_of(program, phase, rows, steps)
        columns = program.columns_of(phase.name)
        all_probes = (*probes, *deciding_probes)
        probes_of_phase = phase_probes(program, phase.name, all_probes, phase_steps)
        probed: list[ProbedPopulation] = []
        for probe in probes:
            probed += probes_of_phase.populations[probe]
        deciding: list[ProbedPopulation] = []
        for probe in deciding_probes:
            deciding += probes_of_phase.populations[probe]
        counted: dict[str, slice] = {}
        for name in read_populations:
            if name in columns and name not in first_step_of:
                counted[name] = columns[name]
        plans.append(_Plan(phase, probes_of_phase.windows, probed, deciding, counted))
    return plans


@lru_cache(maxsize=16)
def _longest_phase(program: ChipProgram, rows: int, steps: int | None) -> int:
    """Return the most steps that the arrays of a phase have; cached, as every call of a simulation asks for it."""
    return max(steps_of(program, phase, rows, steps) for phase in program.phases)


class _Collector:
    """Collects what is kept of a batch, part by part and phase by phase, and makes a result of it."""

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
        """Add a phase of some recordings."""
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
        """Add wraps and clips to the sums of a phase, (populations, kinds)."""
        columns = self._playback.program.columns_of(phase).values()
        # trace.events is (recordings, kinds, columns). A sum over one recording would only copy it.
        of_columns = trace.events[0] if len(trace.events) == 1 else trace.events.sum(axis=0)
        # Populations lie side by side, so each sum ends where the next population begins.
        first_columns = [columns_of_group.start for columns_of_group in columns]
        of_populations = np.add.reduceat(of_columns, first_columns, axis=1)
        self._events[phase] = self._events.get(phase, 0) + of_populations.T

    def result(self) -> SimulationResult:
        """Return the result over all recordings that were added."""
        readout = self._playback.program.readout
        return SimulationResult(
            spikes=self._of_kind("spikes"),
            u=self._of_kind("u"),
            v=self._of_kind("v"),
            potential=self._of_kind("potential"),
            activity={phase: tuple(items) for phase, items in self._activity.items()},
            count_tables={phase: joined(tables) for phase, tables in self._counts.items()},
            events=self._events_by_population(),
            scores=None if readout is None else self._batch_of(self.scores),
            tie_class=None if readout is None else readout.tie_class,
        )

    def _of_kind(self, kind: Kind) -> dict[str, AnyArray]:
        return {name: self._batch_of(parts) for name, parts in self._arrays[kind].items()}

    def _batch_of(self, parts: list[AnyArray]) -> AnyArray:
        """Return the arrays of all parts as one; without the batch axis if the caller passed none."""
        if self._playback.is_batch:
            return joined(parts)
        only_recording: AnyArray = parts[0][0]
        return only_recording

    def _events_by_population(self) -> dict[str, dict[str, int]]:
        """Return wraps and clips by kind, for the populations that have any."""
        by_population = {}
        for phase, table in self._events.items():
            names = self._playback.program.columns_of(phase)
            for name, numbers in zip(names, table.tolist(), strict=True):
                if any(numbers):
                    by_population[name] = dict(zip(EVENTS, numbers, strict=True))
        return by_population


def _engine(engine: Engine, skip: bool) -> tuple[Run, Player]:
    """Return how an engine runs a phase and lists events; without compiled loops, "fast" is the plain engine too."""
    if engine == "fast" and _compiles():
        return _compiled_engine(skip)
    # Only "fast" counts skipped steps, so that its counts are the same with and without compiled loops.
    return _plain_engine(skip and engine == "fast")


@lru_cache(maxsize=2)
def _plain_engine(skip: bool) -> tuple[Run, Player]:
    """Return the reference engine, and the plain functions on events."""
    from hw_model.engine.reference import run_phase

    return partial(run_phase, skip=skip), Player()


@lru_cache(maxsize=2)
def _compiled_engine(skip: bool) -> tuple[Run, Player]:
    """Return the fast engine, and the compiled functions on events."""
    from hw_model.engine import fast as engine_fast  # numba: imported only when it is used
    from hw_model.engine.events import list_events, transpose

    return partial(engine_fast.run_phase, skip=skip), Player(list_events, transpose)


def start_compiling() -> None:
    """Start the helper processes that compile loops, if the fast engine is usable but not compiled yet."""
    if _compiles():
        from hw_model.engine.fast import start_ahead_if_missing

        start_ahead_if_missing()


@cache
def _compiles() -> bool:
    """Return whether loops can be compiled here; if not, log a warning, once per process."""
    reason = why_not_compiled()
    if reason is not None:
        _log.warning(
            "engine 'fast': the plain one plays instead, about a hundred times slower (%s). %s",
            reason,
            fix_of(reason),
        )
    return reason is None
