"""Play recordings to the core's SystemVerilog; the result is like that of a simulation.

A bench (``bench.sv``), built with Verilator or Icarus Verilog, reads the program and the recordings
from files and writes every update and answer of the core to files. The updates are sorted back into
the arrays that the simulator's engines give for a phase, so both results have the same type and can
be compared value by value.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hw_model.description.counts import COUNTED
from hw_model.engine.playing import Player, Spikes, read_streams
from hw_model.engine.probes import Kind, Probe
from hw_model.engine.trace import EVENTS, PhaseInput, PhaseTrace, Register, Window, added_up
from hw_model.io.arguments import checked
from hw_model.program.chip_program import ChipProgram
from hw_model.program.pieces import pieces_of
from hw_model.rtl.device import check_room
from hw_model.rtl.images import SIMULATED, CoreProgram, Sizes
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.simulators import Simulator, built, run, sources
from hw_model.simulation import SimulationResult, play_recordings
from hw_model.values import ByteArray, FloatArray, IntArray

TICK = 1 << 16
"""Word of the stream that ends a row; smaller words are channels."""
END = 2 << 16
"""Word of the stream that ends a recording."""
PATIENCE = 1 << 20
"""Cycles without a sign of life after which a core is given up."""
UNKNOWN = -(1 << 62)
"""Stands for a value with undefined bits (x, z). No simulation gives this number, so it always
differs."""
MISSING = -1
"""Stands for a number that the bench did not write, as of a core that fails."""
_UNDEFINED = dict.fromkeys(map(ord, "xXzZ"), str(UNKNOWN))
UPDATE = ("compartment", "u", "v", "potential", "fired", "active", *EVENTS)
"""The numbers that the bench writes of an update, in order."""
ANSWER_COUNTS = (
    "synaptic_ops",
    "neuron_updates",
    "neuron_updates_active",
    "spikes",
    *EVENTS,
)
"""Counts of a recording that the core sends with its answer."""
ANSWER = ("error", "class", "cycles", *ANSWER_COUNTS)
"""The numbers that the bench writes of a recording, in order."""


@checked
def cosimulate(
    program: ChipProgram,
    spikes: Spikes,
    steps: int | None = None,
    simulator: Simulator = "verilator",
    probe: Sequence[Kind | Probe] = ("spikes",),
) -> SimulationResult:
    """Do what :func:`hw_model.simulate` does, on the open core's SystemVerilog.

    ``counts["cycles"]`` are the core's cycles, and scores are those by which it decides. A program that the core cannot
    run is a ``TargetError``; a simulator that is not installed is an ``InputError``.
    """
    return play_on_core(program, spikes, steps, probe, simulator, sources())[0]


def play_on_core(  # noqa: PLR0913 - public: each is an option of its own
    program: ChipProgram,
    spikes: Spikes,
    steps: int | None,
    probe: Sequence[Kind | Probe],
    simulator: Simulator,
    texts: Mapping[str, str],
    sizes: Sizes = SIMULATED,
    patience: int = PATIENCE,
) -> tuple[SimulationResult, IntArray]:
    """Return the result, and the numbers of the core's answers (batch, :data:`ANSWER`).

    ``texts``: SystemVerilog files by name. ``sizes``: the least sizes of the simulated core.
    ``patience``: cycles without a sign of life after which the run ends.
    """
    streams, batched = read_streams(program, spikes)
    recordings = np.concatenate([streams[name] for name in program.streams], axis=2)
    core = CoreProgram(program, recordings.shape[1], steps, program.chip.open_core or sizes)
    if program.chip.open_core:
        check_room(core, program.chip)
    simulated_sizes = core.simulated(sizes)
    binary = built(simulator, simulated_sizes, texts)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_inputs(folder, core, simulated_sizes, recordings)
        run(binary, folder, patience)
        outputs = _read_outputs(folder, core, recordings)

    # The engine that plays a phase for play_recordings: it only looks up what the core did.
    def run_phase(
        program: ChipProgram, phase: str, played: PhaseInput, windows: dict[Register, Window]
    ) -> PhaseTrace:
        return _trace(core, phase, played, windows, outputs.updates.next_of(phase, played))

    result = play_recordings(program, spikes, steps, probe, run_phase, Player())
    last_phase = core.phases[-1].name
    result.count_tables[last_phase][:, COUNTED.index("cycles")] = outputs.cycles
    scores: FloatArray | None = None
    if program.readout is not None:
        scores = outputs.scores if batched else outputs.scores[0]
    return replace(result, scores=scores), outputs.answers


def words_of(core: CoreProgram, recording: ByteArray) -> list[int]:
    """Return the words of a recording (rows, channels) on the stream.

    They are the channels of the events of each row, a tick after each row, and an end.
    """
    rows_taken = recording[: core.heard]
    row, channel = np.nonzero(rows_taken)
    # np.nonzero sorts events by row: a tick goes in front of the first event of the next row.
    row_ends = np.searchsorted(row, np.arange(1, len(rows_taken) + 1))
    events_and_ticks = np.insert(channel, row_ends, TICK)
    return [*events_and_ticks.tolist(), END]


def bench_numbers(path: Path, shape: tuple[int, ...]) -> IntArray:
    """Return the numbers in a file of the bench, in a given shape.

    Undefined numbers become ``UNKNOWN``. A core that fails may write fewer numbers, which are
    filled up with ``MISSING``, or more, which are left out.
    """
    written = np.array(path.read_text().translate(_UNDEFINED).split(), dtype=np.int64)
    numbers = np.full(shape, MISSING, dtype=np.int64)
    count = min(numbers.size, written.size)
    numbers.ravel()[:count] = written[:count]
    return numbers


class _Updates:
    """The updates that the bench wrote, handed out in the order in which phases are played.

    The bench writes all phases of a recording, then the next recording. ``play_recordings`` plays a
    phase of a batch of recordings, then the next phase. So the updates are split into runs, one for
    each recording and phase.
    """

    def __init__(self, path: Path, core: CoreProgram, recordings: ByteArray) -> None:
        counts = [
            len(phase.span(recording)) * len(core.numbers[phase.name])
            for recording in recordings
            for phase in core.phases
        ]
        ends = np.cumsum(counts)
        updates = bench_numbers(path, (sum(counts), len(UPDATE)))
        self._runs = np.split(updates, ends[:-1])
        self._phases = [phase.name for phase in core.phases]
        self._recordings_played = dict.fromkeys(core.numbers, 0)

    def next_of(self, phase: str, played: PhaseInput) -> list[IntArray]:
        """Return the updates of a phase in the recordings that are played next.

        An array (updates, :data:`UPDATE`) for each of them; ``played`` says how many these are.
        """
        first = self._recordings_played[phase]
        stop = first + len(played.start)
        self._recordings_played[phase] = stop
        phase_index = self._phases.index(phase)
        phases = len(self._phases)
        return [self._runs[recording * phases + phase_index] for recording in range(first, stop)]


class _Outputs(NamedTuple):
    """What the bench wrote: answers (batch, :data:`ANSWER`), scores (batch, classes), and updates."""

    answers: IntArray
    scores: FloatArray
    updates: _Updates

    @property
    def cycles(self) -> IntArray:
        """The core's cycles for each recording, (batch,)."""
        return self.answers[:, ANSWER.index("cycles")]


def _write_inputs(folder: Path, core: CoreProgram, sizes: Sizes, recordings: ByteArray) -> None:
    """Write the files that the bench reads: the words of all memories, and of all recordings."""
    (folder / "load").write_bytes(hex_words(core.load_words(sizes)))
    lines = [f"{word:x}\n" for recording in recordings for word in words_of(core, recording)]
    (folder / "words").write_text("".join(lines))


def _read_outputs(folder: Path, core: CoreProgram, recordings: ByteArray) -> _Outputs:
    """Return the numbers that the bench wrote for recordings (batch, rows, channels)."""
    batch = len(recordings)
    readout = core.program.readout
    classes = core.program.populations[readout.populations[0]] if readout else 0
    return _Outputs(
        answers=bench_numbers(folder / "answers", (batch, len(ANSWER))),
        # The core's weights are whole numbers, `scale` times those of the program.
        scores=bench_numbers(folder / "scores", (batch, classes)) / core.scale,
        updates=_Updates(folder / "updates", core, recordings),
    )


def _trace(
    core: CoreProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    updates: list[IntArray],
) -> PhaseTrace:
    """Return the trace of a phase that an engine would return, made from the core's updates.

    ``updates`` holds an array (updates, :data:`UPDATE`) for each recording that is played.
    """
    by_column = _updates_by_column(core.numbers[phase], played, updates)
    fields = dict(zip(UPDATE, np.moveaxis(by_column, -1, 0), strict=True))
    # A piece is the part of a population that is on one core.
    pieces = pieces_of(core.program, phase)
    columns = by_column.shape[2]
    trace = PhaseTrace.empty(played, columns, len(pieces.group), windows)
    trace.spikes[:] = fields["fired"]
    for piece, (first, stop) in enumerate(zip(pieces.first, pieces.stop, strict=True)):
        is_active = fields["active"][..., first:stop] > 0
        trace.active[..., piece] = np.count_nonzero(is_active, axis=2)
    trace.events[:] = np.stack([fields[name].sum(axis=1) for name in EVENTS], axis=1)
    for register, window in windows.items():
        values = fields[register][:, window.start : window.stop, window.columns]
        trace.registers[register][:] = values
    return added_up(core.program, phase, played, trace)


def _updates_by_column(numbers: IntArray, played: PhaseInput, updates: list[IntArray]) -> IntArray:
    """Return updates in the order of an engine, (recording, step, column, :data:`UPDATE`).

    ``numbers`` (columns,) are the numbers of the phase's compartments. Steps in which the core does
    not run the phase have zeros, and updates that the core did not make, or of another compartment
    than expected, ``MISSING``.
    """
    by_column = np.zeros((len(updates), played.steps, len(numbers), len(UPDATE)), dtype=np.int64)
    # The core updates compartments in the order of their numbers, in every step. The rank of a
    # compartment is its place in this order; an argsort of an argsort gives ranks.
    rank_of_column = np.argsort(np.argsort(numbers))
    for rows, start, run_updates in zip(by_column, played.start.tolist(), updates, strict=True):
        by_rank = run_updates.reshape(-1, len(numbers), len(UPDATE))
        run_rows = by_rank[:, rank_of_column]
        is_misplaced = run_rows[..., UPDATE.index("compartment")] != numbers
        run_rows[is_misplaced] = MISSING
        rows[start : start + len(run_rows)] = run_rows
    return by_column
