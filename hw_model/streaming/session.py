"""A recording as it arrives: push events step by step, and know the prediction after every one, in bounded memory.

This is the timestep-wise inference of hybrid networks (Kang et al. 2022): after step t the time phases have run up to
t, and the location phases are what they would be if nothing followed. A location phase is not run again for every
step: see :mod:`hw_model.streaming.location_phase`.
"""

from collections.abc import Mapping

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
        self.program, self.psi = program, psi
        self._by_potential = program.readout.from_step
        self.steps = 0
        self._length = _length(program, psi)
        self._branches: list[_Branch] = []
        self._columns = 0
        for phase in program.phases:
            self._branches.append(_Branch(program, phase, self._columns))
            self._columns += self._branches[-1].many
        of = {name: branch for branch in self._branches for name in branch.columns}
        self._output = {name: of[name].columns[name] for name, _ in program.readout.terms}
        self._weight = np.array([[float(weight)] for _, weight in program.readout.terms])
        self._is_location = np.array(
            [[of[name].phase.axis == "location"] for name, _ in program.readout.terms]
        )
        self._scored = np.array([self._output[name].start for name, _ in program.readout.terms])
        self._classes = program.populations[program.readout.populations[0]]
        streams = list(program.streams.items())
        self._only = streams[0] if len(streams) == 1 else None

    def reset(self) -> None:
        """Forget the recording, and be ready for another."""
        self.steps = 0
        for branch in self._branches:
            branch.reset()

    def push(self, spikes: Spikes) -> StepScores:
        """Play further rows, (rows, channels) or (channels,) of 0 and 1, or a mapping of streams to them.

        Rows after the last step that a phase is for change nothing in it.
        """
        streams = self._read(spikes)
        rows = len(next(iter(streams.values())))
        counts, scores = (
            np.empty((rows, self._columns), dtype=np.int64),
            np.zeros((rows, self._classes)),
        )
        for branch in self._branches:
            branch.push(self.steps, streams, counts)
        self.steps += rows
        called(weigh, counts, self._scored, self._weights(rows), scores)
        spikes_of: dict[str, IntArray] = {}
        potential: dict[str, IntArray] = {}
        for name, columns in self._output.items():
            (potential if name in self._by_potential else spikes_of)[name] = counts[:, columns]
        assert self.program.readout is not None  # sessions without one are refused
        return StepScores(spikes_of, potential, scores, self.program.readout.tie_class)

    def _read(self, spikes: Spikes) -> dict[str, ByteArray]:
        """Return the rows of every stream, (rows, channels), as loops can be given them: whole, and writeable."""
        if (
            self._only
            and isinstance(spikes, np.ndarray)
            and (rows := _plain_rows(spikes, self._only[1])) is not None
        ):
            return {self._only[0]: rows}
        given = (
            spikes
            if isinstance(spikes, Mapping)
            else {name: spikes for name in list(self.program.streams)[:1]}
        )
        streams, batched = read_streams(
            self.program, {name: _rows(array) for name, array in given.items()}
        )
        if batched:
            raise InputError(
                "spikes", "a session plays one recording", fix="Give rows, (rows, channels)."
            )
        return {name: _plain(array[0]) for name, array in streams.items()}

    @property
    def replayed(self) -> tuple[int, int]:
        """Steps of transposed phases run so far, and how many would run if all ran again after every step."""
        replayed = [
            branch.run.replayed for branch in self._branches if isinstance(branch.run, Replay)
        ]
        return sum(run for run, _ in replayed), self.steps * sum(every for _, every in replayed)

    def spikes(self, population: str) -> ByteArray:
        """Return the spikes of a population of a transposed phase as things stand, (steps, n)."""
        for branch in self._branches:
            if isinstance(branch.run, Replay) and population in branch.columns:
                its = branch.columns[population]
                return branch.run.spikes()[:, its.start - branch.low : its.stop - branch.low]
        raise InputError(
            f"population {population!r}",
            "is in no transposed phase",
            fix="Read its counts from push.",
        )

    def _weights(self, rows: int) -> FloatArray:
        """Return what each term's spikes or potentials count for after the last rows, (terms, rows), or (terms, 1)."""
        if self.psi is None:
            return self._weight
        location = location_share(
            self.psi, np.arange(self.steps - rows + 1, self.steps + 1), self._length
        )
        return self._weight * np.where(self._is_location, location, 1.0 - location)


class _Branch:
    """A phase of a session: played as it comes, or replayed from the first change on.

    What it gives is ``many`` columns of those of all phases, ``low`` on; ``columns`` are those of its populations.
    """

    def __init__(self, program: ChipProgram, phase: Phase, low: int) -> None:
        self.phase, self.low, own = phase, low, program.columns_of(phase.name)
        self.columns = {name: slice(its.start + low, its.stop + low) for name, its in own.items()}
        inputs = program.inputs_of(phase.name)
        self._streams = [item.stream for item in inputs]
        positions = [item.positions for item in inputs if item.positions is not None]
        if 0 < len(positions) < len(inputs):
            what = "mixes transposed inputs with inputs that are played as they come, so it cannot run as they arrive"
            raise InputError(f"phase {phase.name!r}", what, fix="Use simulate.")
        layout = fast_layout(program, phase.name)
        self.many, read = layout.columns, _read(program.readout, own)
        if positions:
            self.run: Replay | Live = Replay(layout, length_of(program, phase, 1), inputs, read)
        else:
            self.run = Live(layout, phase.steps, read, phase.align_events is not None)
        self._align = phase.align_events
        self._started = self._align is None

    def reset(self) -> None:
        """Forget the recording."""
        self.run.reset()
        self._started = self._align is None

    def push(self, before: int, streams: dict[str, ByteArray], counts: IntArray) -> None:
        """Push rows (rows, channels), and note what every column gives so far in ``counts`` (rows, all columns)."""
        parts = [streams[name] for name in self._streams]
        rows = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        if not self._started and self._align is not None:
            events = [list_events(name, streams[name][None]) for name in set(self._streams)]
            first = int(first_touch(events, self._align)[0])
            self._started = first < len(rows)
            self.run.wait(rows[:first], counts[:first], self.low)
            before, rows, counts = before + first, rows[first:], counts[first:]
        if self._started:
            self.run.push(before, rows, counts, self.low)


def _plain_rows(given: AnyArray, channels: int) -> ByteArray | None:
    """Return what are bytes of 0 and 1 as rows (rows, channels); None for all else, which is looked into."""
    if (
        given.dtype != np.uint8
        or not 0 < given.ndim <= 2
        or not given.size
        or given.shape[-1] != channels
    ):
        return None
    # What is left without 0 and 1: for a row, numpy's maximum takes ten times as long.
    if given.tobytes().translate(None, b"\0\1"):
        return None
    return _plain(given.reshape(-1, channels))


def _plain(rows: ByteArray) -> ByteArray:
    """Return rows as loops can be given them: they are compiled anew for what is read-only, or not side by side."""
    return rows if type(rows) is np.ndarray and rows.flags.carray else np.array(rows, order="C")


def _rows(given: ArrayLike) -> AnyArray:
    """Return rows, of which one may be given by itself."""
    array = as_array("spikes", given)
    return array[None] if array.ndim == 1 else np.atleast_2d(array)


def _read(readout: Readout | None, columns: Mapping[str, slice]) -> Read:
    """Return the columns of a phase whose potentials predict."""
    given = {} if readout is None else readout.from_step
    read = [(columns[name], step) for name, step in given.items() if name in columns]
    first = {column: step for its, step in read for column in range(its.start, its.stop)}
    return Read(
        np.array(list(first), dtype=np.int64), np.array(list(first.values()), dtype=np.int64)
    )


def _length(program: ChipProgram, psi: float | None) -> int:
    """Return T, the steps of a whole recording, where it is needed."""
    in_time = [phase for phase in program.phases if phase.axis == "time"]
    lengths = [phase.steps for phase in in_time if phase.steps]
    if psi is not None:
        check_psi(psi)
        if in_time and not lengths:
            fix = "Fix the steps of its phase."
            raise InputError("psi", "the program does not say how long a recording is", fix=fix)
        if len(in_time) in (0, len(program.phases)):
            axis = "location" if in_time else "time"
            raise InputError(
                "psi",
                f"the program has no {axis} phase to weigh against another",
                fix="Leave it out.",
            )
    return max(lengths, default=1)
