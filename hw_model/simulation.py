"""Play recordings to a program, phase by phase, and collect spikes, registers and counts under population names."""

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, lru_cache, partial
from itertools import chain
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


def play_recordings(
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
    if steps is not None and steps < 1:
        raise InputError(
            "steps",
            "nothing to simulate",
            measured=f"{steps} against at least 1",
            fix="Raise steps.",
        )
    check_most(
        steps or 1, MAX_STEPS, "steps", "a simulation does not hold so many", fix="Lower steps."
    )
    probes = read_probes(program, probe)
    streams, batched = read_streams(program, spikes, listed=True)
    batch, rows = next(iter(streams.values())).shape[:2]
    if batch == 0 or (rows == 0 and steps is None):
        measured = f"recordings: {batch}, steps: {rows}"
        raise InputError(
            "spikes",
            "nothing to simulate",
            measured=measured,
            fix="Give some recordings and steps.",
        )
    longest = _plans(program, tuple(probes.values()), rows, steps)[1]
    size = max(1, sum(program.populations.values()) * longest)
    arguments = program, tuple(probes.values()), rows, steps, batched, run_phase, player
    remember = remember and batch == 1 and size <= MAX_REMEMBERED
    if remember and not any(array.max(initial=0) for array in streams.values()):
        return SimulationResult(**_copied(vars(_of_nothing(*arguments))))
    return _played(streams, *arguments)


@lru_cache(maxsize=8)
def _of_nothing(
    program: ChipProgram, probes: tuple[Probe, ...], rows: int, *rest: Any
) -> SimulationResult:
    """Return the result of an empty recording of ``rows`` rows, which nobody changes; others as for :func:`_played`."""
    streams = {
        name: np.zeros((1, rows, channels), dtype=np.uint8)
        for name, channels in program.streams.items()
    }
    return _played(streams, program, probes, rows, *rest)


def _copied(value: Any) -> Any:
    """Return a value with arrays, and what holds them, of its own."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(map(_copied, value))
    return StepActivity(**_copied(vars(value))) if isinstance(value, StepActivity) else value


def _played(
    streams: Mapping[str, ByteArray],
    program: ChipProgram,
    probes: tuple[Probe, ...],
    rows: int,
    steps: int | None,
    batched: bool,
    run_phase: Run,
    player: Player,
) -> SimulationResult:
    """Play recordings, all of ``rows`` rows, as many at a time as can be held, and keep what the probes ask for."""
    plans, longest = _plans(program, probes, rows, steps)
    keeps_activity = any(probe.kind == "activity" for probe in probes)
    batch = len(next(iter(streams.values())))
    together = max(1, MAX_TOGETHER // max(1, sum(program.populations.values()) * longest))

    probed: dict[Kind, dict[str, list[AnyArray]]] = {kind: {} for kind in KINDS}
    counts: dict[str, list[IntArray]] = {phase.name: [] for phase in program.phases}
    activity: dict[str, list[StepActivity]] = {}
    if keeps_activity:
        activity = {phase.name: [] for phase in program.phases}
    events: dict[str, IntArray] = {}
    scores: list[FloatArray] = []
    for start in range(0, batch, together):
        stop = min(start + together, batch)
        lists_by_stream = {
            name: player.list_events(name, array[start:stop]) for name, array in streams.items()
        }
        readings: dict[str, AnyArray] = {}
        for phase, windows, wanted, deciding, counting in plans:
            played = play(program, phase, lists_by_stream, steps, player)
            trace = run_phase(program, phase.name, played, windows)
            arrays: dict[Any, AnyArray] = {"spikes": trace.spikes, **trace.registers}
            counts[phase.name].append(count_totals(program, phase.name, played, trace))
            if keeps_activity:
                activity[phase.name] += count_steps(program, phase.name, played, trace)
            for population in wanted:
                values = population.taken_from(arrays)
                probed[population.kind].setdefault(population.name, []).append(values)
            _add_events(program, phase.name, trace, events)
            for population in deciding:
                readings[population.name] = largest(population.taken_from(arrays), 0)
            for name, columns in counting.items():
                readings[name] = trace.fired[:, columns]
        if program.readout is not None:
            scores.append(program.readout.weighed(readings))

    def result(kind: Kind) -> dict[str, AnyArray]:
        return {
            name: joined(arrays) if batched else arrays[0][0]
            for name, arrays in probed[kind].items()
        }

    return SimulationResult(
        spikes=result("spikes"),
        u=result("u"),
        v=result("v"),
        potential=result("potential"),
        activity={phase: tuple(items) for phase, items in activity.items()},
        count_tables={phase: joined(tables) for phase, tables in counts.items()},
        events=_events_by_population(program, events),
        scores=_scores(scores, batched=batched),
        tie_class=None if program.readout is None else program.readout.tie_class,
    )


def _events_by_population(
    program: ChipProgram, events: Mapping[str, IntArray]
) -> dict[str, dict[str, int]]:
    """Return wraps and clips by population and kind, without populations that have none."""
    by_population: dict[str, dict[str, int]] = {}
    for phase, table in events.items():
        for name, counts in zip(program.columns_of(phase), table.tolist(), strict=True):
            if any(counts):
                by_population[name] = dict(zip(EVENTS, counts, strict=True))
    return by_population


def _scores(parts: Sequence[FloatArray], *, batched: bool) -> FloatArray | None:
    """Return the scores of all recordings, or of the only one; None without a readout."""
    if not parts:
        return None
    return joined(parts) if batched else parts[0][0]


class _Plan(NamedTuple):
    """A phase, and what to keep of it: for the probes, and, for the readout, potentials and counts of columns."""

    phase: Phase
    windows: dict[Register, Window]
    wanted: list[ProbedPopulation]
    deciding: list[ProbedPopulation]
    counting: dict[str, slice]


@lru_cache(maxsize=16)
def _plans(
    program: ChipProgram, probes: tuple[Probe, ...], rows: int, steps: int | None
) -> tuple[list[_Plan], int]:
    """Return all that recordings of ``rows`` rows have in common, phase by phase, and the most steps of one."""
    first_step_of_potentials: Mapping[str, int] = {}
    read_out: Sequence[str] = ()
    if program.readout is not None:
        first_step_of_potentials = program.readout.from_step
        read_out = program.readout.populations
    deciding_probes = [
        Probe("potential", (name,), range(step, sys.maxsize))
        for name, step in first_step_of_potentials.items()
    ]
    plans = []
    for phase in program.phases:
        phase_steps = steps_of(program, phase, rows, steps)
        columns = program.columns_of(phase.name)
        windows, populations = phase_probes(
            program, phase.name, (*probes, *deciding_probes), phase_steps
        )
        wanted = list(chain.from_iterable(populations[probe] for probe in probes))
        deciding = list(chain.from_iterable(populations[probe] for probe in deciding_probes))
        counting = {}
        for name in read_out:
            if name in columns and name not in first_step_of_potentials:
                counting[name] = columns[name]
        plans.append(_Plan(phase, windows, wanted, deciding, counting))
    return plans, max(length_of(program, phase, rows, steps) for phase in program.phases)


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


def _add_events(
    program: ChipProgram, phase: str, trace: PhaseTrace, events: dict[str, IntArray]
) -> None:
    """Add up wraps and clips by phase, (populations, kinds)."""
    if not np.count_nonzero(trace.totals[:, _EVENTS]):
        return
    starts = [columns.start for columns in program.columns_of(phase).values()]
    # A batch of one, as most calls are, needs no sum.
    by_column = trace.events[0] if len(trace.events) == 1 else trace.events.sum(axis=0)
    by_population = np.add.reduceat(by_column, starts, axis=1)
    events[phase] = events.get(phase, 0) + by_population.T
