"""Recordings played to the core's SystemVerilog, and what it did as a simulation's result."""

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
from hw_model.io.given import checked
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
"""What stands for a value that the logic leaves undefined: nothing that a simulation gives."""
MISSING = -1
"""What stands for a number that a core that fails did not write."""
_UNDEFINED = dict.fromkeys(map(ord, "xXzZ"), str(UNKNOWN))
UPDATE = ("compartment", "u", "v", "potential", "fired", "active", *EVENTS)
"""What the bench writes of an update."""
ANSWER_COUNTS = (
    "synaptic_ops",
    "neuron_updates",
    "neuron_updates_active",
    "spikes",
    *EVENTS,
)
"""Counts of a recording that the core sends with its answer."""
ANSWER = ("error", "class", "cycles", *ANSWER_COUNTS)
"""What the bench writes of a recording."""


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
    """Return the result, and the core's own figures (batch, :data:`ANSWER`).

    ``texts``: SystemVerilog files by name. ``sizes``: the least sizes of the simulated core.
    ``patience``: cycles until a silent core is given up.
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
    """Return the words of a recording (rows, channels): events of a row, a tick after each, and the end."""
    rows_taken = recording[: core.heard]
    row, channel = np.nonzero(rows_taken)
    row_ends = np.searchsorted(row, np.arange(1, len(rows_taken) + 1))
    ticked = np.insert(channel, row_ends, TICK)
    return [*ticked.tolist(), END]


def bench_numbers(path: Path, shape: tuple[int, ...]) -> IntArray:
    """Return the numbers of a file in a shape.

    ``UNKNOWN`` stands for undefined ones, and ``MISSING`` for those that lack. A core that fails
    may give fewer, or more, which are left out.
    """
    written = np.array(path.read_text().translate(_UNDEFINED).split(), dtype=np.int64)
    numbers = np.full(shape, MISSING, dtype=np.int64)
    count = min(numbers.size, written.size)
    numbers.ravel()[:count] = written[:count]
    return numbers


class _Updates:
    """The updates that the bench wrote, handed out phase by phase as recordings are played.

    The bench writes them recording by recording, and phase by phase in each.
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
        """Return the updates (updates, :data:`UPDATE`) of each of the next recordings of a phase."""
        first = self._recordings_played[phase]
        stop = first + len(played.start)
        self._recordings_played[phase] = stop
        place = self._phases.index(phase)
        return [
            self._runs[recording * len(self._phases) + place] for recording in range(first, stop)
        ]


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
    """Write what the bench reads: the words of all memories, and those of all recordings."""
    (folder / "load").write_bytes(hex_words(core.load_words(sizes)))
    lines = [f"{word:x}\n" for recording in recordings for word in words_of(core, recording)]
    (folder / "words").write_text("".join(lines))


def _read_outputs(folder: Path, core: CoreProgram, recordings: ByteArray) -> _Outputs:
    """Return what the bench wrote of some recordings (batch, rows, channels)."""
    batch = len(recordings)
    readout = core.program.readout
    classes = core.program.populations[readout.populations[0]] if readout else 0
    return _Outputs(
        answers=bench_numbers(folder / "answers", (batch, len(ANSWER))),
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
    """Return what an engine does, of the updates (updates, fields) of each of the recordings that are played."""
    numbers = core.numbers[phase]
    shape = (len(updates), played.steps, len(numbers), len(UPDATE))
    by_column = np.zeros(shape, dtype=np.int64)
    # The core updates compartments in the order of their numbers, in every step.
    rank_of_column = np.argsort(np.argsort(numbers))
    for rows, start, run_updates in zip(by_column, played.start.tolist(), updates, strict=True):
        by_rank = run_updates.reshape(-1, len(numbers), len(UPDATE))
        run_rows = by_rank[:, rank_of_column]
        is_misplaced = run_rows[..., UPDATE.index("compartment")] != numbers
        run_rows[is_misplaced] = MISSING
        rows[start : start + len(run_rows)] = run_rows
    fields = dict(zip(UPDATE, np.moveaxis(by_column, -1, 0), strict=True))
    pieces = pieces_of(core.program, phase)
    trace = PhaseTrace.empty(played, len(numbers), len(pieces.group), windows)
    trace.spikes[:] = fields["fired"]
    for piece, (first, stop) in enumerate(zip(pieces.first, pieces.stop, strict=True)):
        is_active = fields["active"][..., first:stop] > 0
        trace.active[..., piece] = np.count_nonzero(is_active, axis=2)
    trace.events[:] = np.stack([fields[name].sum(axis=1) for name in EVENTS], axis=1)
    for register, window in windows.items():
        values = fields[register][:, window.start : window.stop, window.columns]
        trace.registers[register][:] = values
    return added_up(core.program, phase, played, trace)
