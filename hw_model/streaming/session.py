"""Play a recording while it arrives: push its rows, and get the prediction after every row, in bounded memory.

This is the timestep-wise inference of hybrid networks (Kang et al. 2022). After row t, the time phases have run up to
step t, and the location phases are in the state that they would have if no event followed. Time phases simply go on
(:mod:`hw_model.streaming.time_phase`). Location phases play a recording channel by channel, so each row changes steps
that were run already; only what changes is run again (:mod:`hw_model.streaming.location_phase`).

The *reading* of a compartment is what the readout takes from it: its count of spikes so far, or its largest potential.
Class scores are weighted sums of readings. A *column* is a compartment's place in arrays of readings.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from hw_model.engine.compiled import called
from hw_model.engine.lay_out import fast_layout
from hw_model.engine.playing import Spikes, first_touch, length_of, list_events, read_streams
from hw_model.errors import InputError
from hw_model.io.arguments import as_array, checked
from hw_model.mapping.graph import Phase, Readout
from hw_model.program.chip_program import ChipProgram
from hw_model.streaming.location_phase import Replay
from hw_model.streaming.outcomes import StepScores
from hw_model.streaming.psi import check_psi, location_share
from hw_model.streaming.time_phase import Live, PotentialColumns, weigh
from hw_model.values import AnyArray, ArrayLike, ByteArray, FloatArray, IntArray


class Session:
    """One recording, played to a program while it arrives. The integers are those of :func:`hw_model.simulate`.

    With ``psi``, the readout's weights of populations in time phases are multiplied by 1 - w, and those in location
    phases by w, see :func:`hw_model.streaming.psi.location_share`; with None the weights stay. Raises ``InputError``
    for a program without a readout, and for a phase in which only some inputs go through the transpose buffer.
    """

    @checked
    def __init__(self, program: ChipProgram, psi: float | None = None) -> None:
        if program.readout is None:
            what = "has no readout, so it predicts nothing"
            raise InputError(f"program {program.name!r}", what, fix="Add a readout.")
        self.program = program
        self.psi = psi
        self.steps = 0
        self._by_potential = program.readout.from_step
        self._length = _recording_length(program, psi)
        self._phases: list[_SessionPhase] = []
        self._columns = 0
        for phase in program.phases:
            session_phase = _SessionPhase(program, phase, self._columns)
            self._phases.append(session_phase)
            self._columns += session_phase.width
        phase_of = {
            name: session_phase for session_phase in self._phases for name in session_phase.columns
        }
        terms = program.readout.terms
        self._columns_of = {name: phase_of[name].columns[name] for name, _ in terms}
        # A term of the readout is a population with its weight. Per term: the first of its columns (terms,), its
        # weight, and whether it is in a location phase (terms, 1).
        self._first_column = np.array([self._columns_of[name].start for name, _ in terms])
        self._weight = np.array([[float(weight)] for _, weight in terms])
        self._is_location = np.array(
            [[phase_of[name].phase.axis == "location"] for name, _ in terms]
        )
        self._classes = program.populations[program.readout.populations[0]]

    def reset(self) -> None:
        """Forget the recording, to play another one."""
        self.steps = 0
        for session_phase in self._phases:
            session_phase.reset()

    def push(self, spikes: Spikes) -> StepScores:
        """Play further rows, (rows, channels) or (channels,) of 0 and 1, or a mapping from streams to such rows.

        Returns the scores after each of these rows. A phase ignores rows after its last step.
        """
        # __init__ refuses programs without a readout.
        assert self.program.readout is not None
        streams = self._read(spikes)
        rows = len(next(iter(streams.values())))
        # The readings of all columns of all phases after each row; every phase fills its own columns.
        readings = np.empty((rows, self._columns), dtype=np.int64)
        for session_phase in self._phases:
            session_phase.push(self.steps, streams, readings)
        self.steps += rows
        scores = np.zeros((rows, self._classes))
        called(weigh, readings, self._first_column, self._weights(rows), scores)
        spike_counts: dict[str, IntArray] = {}
        potentials: dict[str, IntArray] = {}
        for name, columns in self._columns_of.items():
            if name in self._by_potential:
                potentials[name] = readings[:, columns]
            else:
                spike_counts[name] = readings[:, columns]
        return StepScores(spike_counts, potentials, scores, self.program.readout.tie_class)

    def _read(self, spikes: Spikes) -> dict[str, ByteArray]:
        """Return the rows of every stream, (rows, channels), as contiguous, writeable arrays for the compiled loops."""
        streams = self.program.streams
        first_stream = next(iter(streams), None)
        # The usual case first, since the full check takes longer than a step: one stream, rows of bytes.
        if len(streams) == 1 and first_stream is not None and isinstance(spikes, np.ndarray):
            rows = _plain_rows(spikes, streams[first_stream])
            if rows is not None:
                return {first_stream: rows}
        if isinstance(spikes, Mapping):
            by_stream = {name: _rows(array) for name, array in spikes.items()}
        elif first_stream is not None:
            by_stream = {first_stream: _rows(spikes)}
        else:
            by_stream = {}
        recordings, is_batch = read_streams(self.program, by_stream)
        if is_batch:
            raise InputError(
                "spikes", "a session plays one recording", fix="Give rows, (rows, channels)."
            )
        return {name: _plain(recording[0]) for name, recording in recordings.items()}

    @property
    def replayed(self) -> tuple[int, int]:
        """How much work replaying saves: the steps of location phases that were run so far, and the steps that it would
        have taken to run these phases in full after every row."""
        steps_run = 0
        steps_of_full_run = 0
        for session_phase in self._phases:
            if isinstance(session_phase.engine, Replay):
                run_in_phase, full_run_of_phase = session_phase.engine.replayed
                steps_run += run_in_phase
                steps_of_full_run += full_run_of_phase
        return steps_run, self.steps * steps_of_full_run

    def spikes(self, population: str) -> ByteArray:
        """Return the spikes (steps, n) of a population in a location phase, if no event followed those so far."""
        for session_phase in self._phases:
            if isinstance(session_phase.engine, Replay) and population in session_phase.columns:
                return session_phase.engine.spikes()[:, session_phase.columns_in_phase[population]]
        raise InputError(
            f"population {population!r}",
            "is in no transposed phase",
            fix="Read its counts from push.",
        )

    def _weights(self, rows: int) -> FloatArray:
        """Return the weight of each term after each of the last ``rows`` rows, (terms, rows), or (terms, 1) for all."""
        if self.psi is None:
            return self._weight
        # The numbers of the rows, counted from 1.
        step = np.arange(self.steps - rows + 1, self.steps + 1)
        share_of_location = location_share(self.psi, step, self._length)
        share = np.where(self._is_location, share_of_location, 1.0 - share_of_location)
        return self._weight * share


class _SessionPhase:
    """A phase of a session, with the engine that plays it: ``Live`` for a time phase, ``Replay`` for a location phase.

    All phases write into one table with a column per compartment. This phase has ``width`` columns, from
    ``first_column`` on. ``columns`` has the columns of each population in the table; ``columns_in_phase`` counts them
    from the first column of the phase.
    """

    def __init__(self, program: ChipProgram, phase: Phase, first_column: int) -> None:
        self.phase = phase
        self.first_column = first_column
        self.columns_in_phase = program.columns_of(phase.name)
        self.columns = {
            name: slice(columns.start + first_column, columns.stop + first_column)
            for name, columns in self.columns_in_phase.items()
        }
        inputs = program.inputs_of(phase.name)
        self._streams = [item.stream for item in inputs]
        transposed = [item for item in inputs if item.positions is not None]
        if 0 < len(transposed) < len(inputs):
            what = "mixes transposed inputs with inputs that are played as they come, so it cannot run as they arrive"
            raise InputError(f"phase {phase.name!r}", what, fix="Use simulate.")
        layout = fast_layout(program, phase.name)
        self.width = layout.columns
        potentials = _columns_of_potentials(program.readout, self.columns_in_phase)
        self.engine: Replay | Live
        if transposed:
            steps = length_of(program, phase, 1)
            self.engine = Replay(layout, steps, inputs, potentials)
        else:
            starts_late = phase.align_events is not None
            self.engine = Live(layout, phase.steps, potentials, starts_late)
        self._has_started = phase.align_events is None

    def reset(self) -> None:
        """Forget the recording, to play another one."""
        self.engine.reset()
        self._has_started = self.phase.align_events is None

    def push(self, before: int, streams: dict[str, ByteArray], readings: IntArray) -> None:
        """Play rows (rows, channels) of each stream, and write the phase's columns of ``readings`` (rows, all columns).

        ``before`` is the number of rows of the recording that came before them.
        """
        rows = _side_by_side([streams[name] for name in self._streams])
        waiting = 0
        if not self._has_started:
            waiting = self._rows_before_start(streams)
            self.engine.wait(rows[:waiting], readings[:waiting], self.first_column)
            self._has_started = waiting < len(rows)
        if self._has_started:
            self.engine.push(
                before + waiting, rows[waiting:], readings[waiting:], self.first_column
            )

    def _rows_before_start(self, streams: dict[str, ByteArray]) -> int:
        """Return how many of the rows come before the first one with enough events for an aligned phase to start."""
        # Phases that are not aligned have started from the beginning.
        assert self.phase.align_events is not None
        events = [list_events(name, streams[name][None]) for name in set(self._streams)]
        return int(first_touch(events, self.phase.align_events)[0])


def _plain_rows(spikes: AnyArray, channels: int) -> ByteArray | None:
    """Return bytes of 0 and 1 as rows (rows, channels), or None for anything else, which needs a full check."""
    if spikes.dtype != np.uint8 or spikes.ndim not in (1, 2) or not spikes.size:
        return None
    if spikes.shape[-1] != channels:
        return None
    # Delete all bytes 0 and 1, and see whether any is left. For a single row, numpy's maximum takes ten times as long.
    if spikes.tobytes().translate(None, b"\0\1"):
        return None
    return _plain(spikes.reshape(-1, channels))


def _plain(rows: ByteArray) -> ByteArray:
    """Return rows as a contiguous, writeable array; the loops would be compiled anew for any other kind of array."""
    if type(rows) is np.ndarray and rows.flags.carray:
        return rows
    return np.array(rows, order="C")


def _side_by_side(streams: list[ByteArray]) -> ByteArray:
    """Return the channels of several streams next to each other, (rows, channels of all)."""
    if len(streams) == 1:
        return streams[0]
    return np.concatenate(streams, axis=1)


def _rows(spikes: ArrayLike) -> AnyArray:
    """Return spikes as rows (rows, channels), given rows or a single row (channels,)."""
    array = as_array("spikes", spikes)
    return array[None] if array.ndim == 1 else np.atleast_2d(array)


def _columns_of_potentials(
    readout: Readout | None, columns: Mapping[str, slice]
) -> PotentialColumns:
    """Return the columns of a phase that the readout reads by their potentials, each with its first step."""
    first_step_of: dict[int, int] = {}
    if readout is not None:
        for name, first_step in readout.from_step.items():
            if name in columns:
                population = range(columns[name].start, columns[name].stop)
                first_step_of.update(dict.fromkeys(population, first_step))
    return PotentialColumns(
        columns=np.array(list(first_step_of), dtype=np.int64),
        first_step=np.array(list(first_step_of.values()), dtype=np.int64),
    )


def _recording_length(program: ChipProgram, psi: float | None) -> int:
    """Return T of the time-weighted prediction, the steps of a whole recording.

    Without psi, T is not used: then it is 1 if the program does not fix the steps of a recording.
    """
    time_phases = [phase for phase in program.phases if phase.axis == "time"]
    lengths = [phase.steps for phase in time_phases if phase.steps]
    if psi is not None:
        check_psi(psi)
        _check_phases_for_psi(program, time_phases, lengths)
    return max(lengths, default=1)


def _check_phases_for_psi(
    program: ChipProgram, time_phases: Sequence[Phase], lengths: Sequence[int]
) -> None:
    """Raise InputError if psi cannot be used: the program fixes no steps, or lacks time phases or location phases."""
    if time_phases and not lengths:
        fix = "Fix the steps of its phase."
        raise InputError("psi", "the program does not say how long a recording is", fix=fix)
    # No time phases, or nothing but time phases.
    if len(time_phases) in (0, len(program.phases)):
        missing_axis = "location" if time_phases else "time"
        what = f"the program has no {missing_axis} phase to weigh against another"
        raise InputError("psi", what, fix="Leave it out.")
