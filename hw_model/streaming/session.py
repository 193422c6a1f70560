"""A recording as it arrives: push events step by step, and know the prediction after every one, in bounded memory.

This is the timestep-wise inference of hybrid networks (Kang et al. 2022): after step t the time phases have run up to
t, and the location phases are what they would be if nothing followed. A location phase is not run again for every
step: see :mod:`hw_model.streaming.location_phase`.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from hw_model.engine.compiled import called
from hw_model.engine.lay_out import fast_layout
from hw_model.engine.playing import Spikes, first_touch, length_of, list_events, read_streams
from hw_model.errors import InputError
from hw_model.io.given import as_array, checked
from hw_model.mapping.graph import Phase, Readout
from hw_model.program.chip_program import ChipProgram
from hw_model.streaming.location_phase import Replay
from hw_model.streaming.outcomes import StepScores
from hw_model.streaming.psi import check_psi, location_share
from hw_model.streaming.time_phase import Live, Read, weigh
from hw_model.values import AnyArray, ArrayLike, ByteArray, FloatArray, IntArray


class Session:
    """One recording, played to a program as it arrives. The integers are those of :func:`hw_model.simulate`.

    ``psi``: weigh the time populations by 1 - w and the location populations by w of :func:`location_share`; None
    leaves the readout's own weights. Phases that mix inputs as they come with transposed ones, and programs without a
    readout, are an ``InputError``.
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
        self._branches: list[_Branch] = []
        self._columns = 0
        for phase in program.phases:
            branch = _Branch(program, phase, self._columns)
            self._branches.append(branch)
            self._columns += branch.width
        branch_of = {name: branch for branch in self._branches for name in branch.columns}
        terms = program.readout.terms
        self._columns_of = {name: branch_of[name].columns[name] for name, _ in terms}
        # By term of the readout: its first column, (terms,); its weight and branch, (terms, 1).
        self._first_column = np.array([self._columns_of[name].start for name, _ in terms])
        self._weight = np.array([[float(weight)] for _, weight in terms])
        self._is_location = np.array(
            [[branch_of[name].phase.axis == "location"] for name, _ in terms]
        )
        self._classes = program.populations[program.readout.populations[0]]

    def reset(self) -> None:
        """Forget the recording, and be ready for another."""
        self.steps = 0
        for branch in self._branches:
            branch.reset()

    def push(self, spikes: Spikes) -> StepScores:
        """Play further rows, (rows, channels) or (channels,) of 0 and 1, or a mapping of streams to them.

        Rows after the last step that a phase is for change nothing in it.
        """
        assert self.program.readout is not None  # sessions without one are refused
        streams = self._read(spikes)
        rows = len(next(iter(streams.values())))
        counts = np.empty((rows, self._columns), dtype=np.int64)
        for branch in self._branches:
            branch.push(self.steps, streams, counts)
        self.steps += rows
        scores = np.zeros((rows, self._classes))
        called(weigh, counts, self._first_column, self._weights(rows), scores)
        spike_counts: dict[str, IntArray] = {}
        potentials: dict[str, IntArray] = {}
        for name, columns in self._columns_of.items():
            if name in self._by_potential:
                potentials[name] = counts[:, columns]
            else:
                spike_counts[name] = counts[:, columns]
        return StepScores(spike_counts, potentials, scores, self.program.readout.tie_class)

    def _read(self, spikes: Spikes) -> dict[str, ByteArray]:
        """Return the rows of every stream, (rows, channels), as loops can be given them: whole, and writeable."""
        streams = self.program.streams
        first_stream = next(iter(streams), None)
        # A short cut for rows that can be played as they are.
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
        """Steps of transposed phases run so far, and how many would run if all ran again after every step."""
        run_so_far = 0
        run_again_for_a_row = 0
        for branch in self._branches:
            if isinstance(branch.run, Replay):
                steps_run, steps_of_all = branch.run.replayed
                run_so_far += steps_run
                run_again_for_a_row += steps_of_all
        return run_so_far, self.steps * run_again_for_a_row

    def spikes(self, population: str) -> ByteArray:
        """Return the spikes of a population of a transposed phase as things stand, (steps, n)."""
        for branch in self._branches:
            if isinstance(branch.run, Replay) and population in branch.columns:
                return branch.run.spikes()[:, branch.own_columns[population]]
        raise InputError(
            f"population {population!r}",
            "is in no transposed phase",
            fix="Read its counts from push.",
        )

    def _weights(self, rows: int) -> FloatArray:
        """Return what each term's spikes or potentials count for after the last rows, (terms, rows), or (terms, 1)."""
        if self.psi is None:
            return self._weight
        step = np.arange(self.steps - rows + 1, self.steps + 1)
        of_location = location_share(self.psi, step, self._length)
        return self._weight * np.where(self._is_location, of_location, 1.0 - of_location)


class _Branch:
    """A phase of a session: played as it comes, or replayed from the first change on.

    All phases share a table of columns, one a compartment: this one has ``width`` of them, from
    ``first_column`` on. ``columns`` of each population count from the table's first, and
    ``own_columns`` from the phase's.
    """

    def __init__(self, program: ChipProgram, phase: Phase, first_column: int) -> None:
        self.phase = phase
        self.first_column = first_column
        self.own_columns = program.columns_of(phase.name)
        self.columns = {
            name: slice(own.start + first_column, own.stop + first_column)
            for name, own in self.own_columns.items()
        }
        inputs = program.inputs_of(phase.name)
        self._streams = [item.stream for item in inputs]
        transposed = [item for item in inputs if item.positions is not None]
        if 0 < len(transposed) < len(inputs):
            what = "mixes transposed inputs with inputs that are played as they come, so it cannot run as they arrive"
            raise InputError(f"phase {phase.name!r}", what, fix="Use simulate.")
        layout = fast_layout(program, phase.name)
        self.width = layout.columns
        potentials = _columns_of_potentials(program.readout, self.own_columns)
        self.run: Replay | Live
        if transposed:
            steps = length_of(program, phase, 1)
            self.run = Replay(layout, steps, inputs, potentials)
        else:
            starts_late = phase.align_events is not None
            self.run = Live(layout, phase.steps, potentials, starts_late)
        self._has_started = phase.align_events is None

    def reset(self) -> None:
        """Forget the recording."""
        self.run.reset()
        self._has_started = self.phase.align_events is None

    def push(self, before: int, streams: dict[str, ByteArray], counts: IntArray) -> None:
        """Push rows (rows, channels), and note what every column gives so far in ``counts`` (rows, all columns).

        ``before``: rows of the recording that were pushed already.
        """
        rows = _side_by_side([streams[name] for name in self._streams])
        waiting = 0
        if not self._has_started:
            waiting = self._rows_before_start(streams)
            self.run.wait(rows[:waiting], counts[:waiting], self.first_column)
            self._has_started = waiting < len(rows)
        if self._has_started:
            self.run.push(before + waiting, rows[waiting:], counts[waiting:], self.first_column)

    def _rows_before_start(self, streams: dict[str, ByteArray]) -> int:
        """Return how many rows come before the one that has enough events for the phase to start."""
        assert self.phase.align_events is not None  # others have started
        events = [list_events(name, streams[name][None]) for name in set(self._streams)]
        return int(first_touch(events, self.phase.align_events)[0])


def _plain_rows(spikes: AnyArray, channels: int) -> ByteArray | None:
    """Return what are bytes of 0 and 1 as rows (rows, channels); None for all else, which is looked into."""
    if spikes.dtype != np.uint8 or spikes.ndim not in (1, 2) or not spikes.size:
        return None
    if spikes.shape[-1] != channels:
        return None
    # What is left without 0 and 1: for a row, numpy's maximum takes ten times as long.
    if spikes.tobytes().translate(None, b"\0\1"):
        return None
    return _plain(spikes.reshape(-1, channels))


def _plain(rows: ByteArray) -> ByteArray:
    """Return rows as loops can be given them: they are compiled anew for what is read-only, or not side by side."""
    if type(rows) is np.ndarray and rows.flags.carray:
        return rows
    return np.array(rows, order="C")


def _side_by_side(streams: list[ByteArray]) -> ByteArray:
    """Return the channels of several streams next to each other, (rows, channels of all)."""
    if len(streams) == 1:
        return streams[0]
    return np.concatenate(streams, axis=1)


def _rows(given: ArrayLike) -> AnyArray:
    """Return rows, of which one may be given by itself."""
    array = as_array("spikes", given)
    return array[None] if array.ndim == 1 else np.atleast_2d(array)


def _columns_of_potentials(readout: Readout | None, columns: Mapping[str, slice]) -> Read:
    """Return the columns of a phase whose potentials predict, each with its first step."""
    first_step_of: dict[int, int] = {}
    if readout is not None:
        for name, first_step in readout.from_step.items():
            if name in columns:
                population = range(columns[name].start, columns[name].stop)
                first_step_of.update(dict.fromkeys(population, first_step))
    return Read(
        columns=np.array(list(first_step_of), dtype=np.int64),
        first=np.array(list(first_step_of.values()), dtype=np.int64),
    )


def _recording_length(program: ChipProgram, psi: float | None) -> int:
    """Return T, the steps of a whole recording; 1 where the program does not say it and psi does not need it."""
    time_phases = [phase for phase in program.phases if phase.axis == "time"]
    lengths = [phase.steps for phase in time_phases if phase.steps]
    if psi is not None:
        check_psi(psi)
        _check_branches(program, time_phases, lengths)
    return max(lengths, default=1)


def _check_branches(
    program: ChipProgram, time_phases: Sequence[Phase], lengths: Sequence[int]
) -> None:
    """Refuse psi where a program does not say its length, or lacks time or location phases."""
    if time_phases and not lengths:
        fix = "Fix the steps of its phase."
        raise InputError("psi", "the program does not say how long a recording is", fix=fix)
    if len(time_phases) in (0, len(program.phases)):
        missing_axis = "location" if time_phases else "time"
        what = f"the program has no {missing_axis} phase to weigh against another"
        raise InputError("psi", what, fix="Leave it out.")
