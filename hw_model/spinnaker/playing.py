"""Play recordings to a program for a SpiNNaker, phase by phase, and count operations for the report.

An event of row t is a spike of an input line in step t. With the shortest delay it acts in step t + 1, as for all chips
of this project.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from hw_model.arithmetic import spinnaker
from hw_model.engine.playing import Player, list_events, play, read_streams
from hw_model.engine.trace import EventLists, PhaseInput
from hw_model.engine.usable import why_not_compiled
from hw_model.mapping.graph import Phase
from hw_model.spinnaker.network import SpinnakerNetwork
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.spinnaker.reference import SpinnakerResult, play_reference
from hw_model.values import AnyArray, ByteArray, FloatArray, Frozen, IntArray, Sums

Engine = Literal["fast", "reference"]
PlayRows = Callable[[AnyArray], SpinnakerResult]
"""A function that plays rows (rows, lines) of 0 and 1 to a phase, from rest."""


class SpinnakerCounts(Sums):
    """How often everything happened in a recording, or in several.

    ``synaptic_ops`` is additions to ring buffers. ``input_events`` reach an input line, ``transpose_events`` reach one
    through the transpose buffer, and ``events_dropped`` reach none. The last five are the arithmetic's
    :data:`hw_model.arithmetic.spinnaker.EVENTS`.
    """

    synaptic_ops: int = 0
    neuron_updates: int = 0
    spikes: int = 0
    input_events: int = 0
    transpose_events: int = 0
    events_dropped: int = 0
    ring_wraps: int = 0
    current_wraps: int = 0
    potential_wraps: int = 0
    saturated_weights: int = 0
    late_synapses: int = 0

    @property
    def wraps(self) -> int:
        """How often a sum did not fit 32 bits."""
        return self.ring_wraps + self.current_wraps + self.potential_wraps


class PlayedSpinnaker(Frozen, eq=False):
    """What a program did on a batch of recordings.

    - ``spikes``, ``potential``: (batch, steps, n) by population; potentials as they are compared with the threshold,
      s16.15
    - ``counts``: the counts of each recording, by phase
    - ``scores``: the class scores (batch, classes), or None if the program has no readout
    """

    spikes: Mapping[str, ByteArray]
    potential: Mapping[str, IntArray]
    counts: tuple[Mapping[str, SpinnakerCounts], ...]
    scores: FloatArray | None

    @property
    def total_counts(self) -> SpinnakerCounts:
        """The sum of the counts over all recordings and phases."""
        total = SpinnakerCounts()
        for counts_by_phase in self.counts:
            total = sum(counts_by_phase.values(), start=total)
        return total


class PhaseRun(NamedTuple):
    """A recording in a phase: the ``rows`` (steps, lines) that are run from step ``start`` on."""

    rows: ByteArray
    start: int
    result: SpinnakerResult

    @property
    def steps(self) -> slice:
        """The steps of the recording that are run."""
        return slice(self.start, self.start + len(self.rows))


def play_program(
    program: SpinnakerProgram, recordings: AnyArray, engine: Engine = "fast"
) -> PlayedSpinnaker:
    """Play recordings (batch, steps, channels) of 0 and 1, each from rest; engines give the same.

    Raises ``InputError`` for recordings that do not fit the program.
    """
    events = _events(program, recordings)
    batch = len(next(iter(events.values())).first)
    spikes: dict[str, ByteArray] = {}
    potential: dict[str, IntArray] = {}
    counts: list[dict[str, SpinnakerCounts]] = [{} for _ in range(batch)]
    for phase in program.network.phases:
        played = play(program, phase, events, steps=None, player=Player())
        play_rows = player_of(program.network, phase, engine)
        runs = [_run(play_rows, played, recording) for recording in range(batch)]
        for name, columns in program.network.columns_of(phase.name).items():
            spikes[name] = _spikes_of(runs, columns, played.steps)
            potential[name] = _potential_of(runs, columns, played.steps)
        fan_out = _fan_out(program.network, phase.name)
        for recording, run in enumerate(runs):
            counts[recording][phase.name] = _counts(run, played.counts[:, recording], fan_out)
    return PlayedSpinnaker(spikes, potential, tuple(counts), _scores(program, spikes, potential))


def play_recording(program: SpinnakerProgram, recording: AnyArray) -> dict[str, PhaseRun]:
    """Play one recording (steps, channels) and return its run in each phase, with all registers."""
    events = _events(program, np.asarray(recording)[None])
    runs = {}
    for phase in program.network.phases:
        played = play(program, phase, events, steps=None, player=Player())
        runs[phase.name] = _run(player_of(program.network, phase, "fast"), played, recording=0)
    return runs


def _events(program: SpinnakerProgram, recordings: AnyArray) -> dict[str, EventLists]:
    """Return the events of recordings (batch, steps, channels) as lists, by stream."""
    streams, _ = read_streams(program, np.asarray(recordings))
    return {name: list_events(name, array) for name, array in streams.items()}


def player_of(network: SpinnakerNetwork, phase: Phase, engine: Engine) -> PlayRows:
    """Return the function that plays rows to a phase. Without numba, it is the plain engine's."""
    if engine == "reference" or why_not_compiled() is not None:
        return lambda rows: play_reference(network, phase.name, rows)
    # Imported here, because it imports numba, which takes long and may be missing.
    from hw_model.spinnaker.fast import FastPhase

    return FastPhase(network, phase.name).play


def _run(play_rows: PlayRows, played: PhaseInput, recording: int) -> PhaseRun:
    """Play the steps of a recording in which the phase runs, from its start to its stop."""
    start = int(played.start[recording])
    stop = int(played.stop[recording])
    rows = played.lines(recording)[start:stop]
    return PhaseRun(rows, start, play_rows(rows))


def _spikes_of(runs: Sequence[PhaseRun], columns: slice, steps: int) -> ByteArray:
    """Return the spikes of a population, (batch, steps, n); they are 0 in steps in which the phase does not run."""
    spikes = np.zeros((len(runs), steps, columns.stop - columns.start), dtype=np.uint8)
    for recording, run in enumerate(runs):
        spikes[recording, run.steps] = run.result.spikes[:, columns]
    return spikes


def _potential_of(runs: Sequence[PhaseRun], columns: slice, steps: int) -> IntArray:
    """Return the potentials of a population, (batch, steps, n), s16.15; 0 in steps in which the phase does not run."""
    potential = np.zeros((len(runs), steps, columns.stop - columns.start), dtype=np.int64)
    for recording, run in enumerate(runs):
        potential[recording, run.steps] = run.result.potential[:, columns]
    return potential


def _counts(run: PhaseRun, input_counts: IntArray, fan_out: IntArray) -> SpinnakerCounts:
    """Return the counts of a run.

    ``input_counts`` is in the order of :data:`hw_model.engine.trace.PLAYED`; ``fan_out`` (sources,) is the number of
    synapses of each source.
    """
    spikes_by_source = np.concatenate([run.rows.sum(axis=0), run.result.spikes.sum(axis=0)])
    input_events, transpose_events, events_dropped, _ = input_counts.tolist()
    return SpinnakerCounts(
        synaptic_ops=int(spikes_by_source @ fan_out),
        neuron_updates=run.result.spikes.size,
        spikes=int(run.result.spikes.sum()),
        input_events=input_events,
        transpose_events=transpose_events,
        events_dropped=events_dropped,
        **run.result.events,
    )


def _fan_out(network: SpinnakerNetwork, phase: str) -> IntArray:
    """Return how many synapses each source of a phase has, (sources,)."""
    first_source = network.sources_of(phase)
    fan_out = np.zeros(network.lines_of(phase) + network.neurons_of(phase), dtype=np.int64)
    for projection in network.projections_of(phase):
        np.add.at(fan_out, first_source[projection.source] + projection.source_index, 1)
    return fan_out


def _scores(
    program: SpinnakerProgram,
    spikes: Mapping[str, ByteArray],
    potential: Mapping[str, IntArray],
) -> FloatArray | None:
    """Return the class scores (batch, classes), or None if the program has no readout."""
    if program.readout is None:
        return None
    return program.readout.scores(spikes, potentials_in_units(program, potential))


def potentials_in_units(
    program: SpinnakerProgram, potential: Mapping[str, IntArray]
) -> dict[str, FloatArray]:
    """Return potentials in units of the trained network, given s16.15 integers."""
    in_units = {}
    for name, values in potential.items():
        unit = program.network.population(name).potential_unit * spinnaker.ONE
        in_units[name] = values / unit
    return in_units
