"""Recordings played to the core's SystemVerilog, and what it did as a simulation's result."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

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
from hw_model.values import ByteArray, IntArray

TICK, END = 1 << 16, 2 << 16
"""Words of the stream that are not channels."""
PATIENCE = 1 << 20
"""Cycles without a sign of life after which a core is given up."""
UNKNOWN = -(1 << 62)
"""What stands for a value that the logic leaves undefined: nothing that a simulation gives."""
_UNDEFINED = dict.fromkeys(map(ord, "xXzZ"), str(UNKNOWN))
UPDATE = ("compartment", "u", "v", "potential", "fired", "active", *EVENTS)
ANSWER = (
    "error",
    "class",
    "cycles",
    "synaptic_ops",
    "neuron_updates",
    "neuron_updates_active",
    "spikes",
    *EVENTS,
)
"""What the bench writes of an update, and of a recording."""


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


def play_on_core(
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

    ``texts``: SystemVerilog files by name; ``sizes``: the least; ``patience``: cycles until a silent core is given up.
    """
    streams, batched = read_streams(program, spikes)
    recordings = np.concatenate([streams[name] for name in program.streams], axis=2)
    core = CoreProgram(program, recordings.shape[1], steps, program.chip.open_core or sizes)
    if program.chip.open_core:
        check_room(core, program.chip)
    sizes = core.simulated(sizes)
    binary = built(simulator, sizes, texts)
    readout, batch = program.readout, len(recordings)
    classes = program.populations[readout.populations[0]] if readout else 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "load").write_bytes(hex_words(core.load_words(sizes)))
        (folder / "words").write_text(
            "".join(f"{word:x}\n" for one in recordings for word in words_of(core, one))
        )
        run(binary, folder, patience)
        answers = bench_numbers(folder / "answers", (batch, len(ANSWER)))
        scores = bench_numbers(folder / "scores", (batch, classes)) / core.scale
        runs = [
            len(p.span(one)) * len(core.numbers[p.name]) for one in recordings for p in core.phases
        ]
        ends = np.cumsum([0, *runs])
        updates = bench_numbers(folder / "updates", (int(ends[-1]), len(UPDATE)))

    names, played_so_far = [phase.name for phase in core.phases], dict.fromkeys(core.numbers, 0)

    def run_phase(
        program: ChipProgram, phase: str, played: PhaseInput, windows: dict[Register, Window]
    ) -> PhaseTrace:
        begin = played_so_far[phase]
        played_so_far[phase] += len(played.start)
        places = len(names) * np.arange(begin, played_so_far[phase]) + names.index(phase)
        return _trace(
            core, phase, played, windows, [updates[ends[at] : ends[at + 1]] for at in places]
        )

    found = play_recordings(program, spikes, steps, probe, run_phase, Player())
    found.count_tables[names[-1]][:, COUNTED.index("cycles")] = answers[:, 2]
    return replace(found, scores=(scores if batched else scores[0]) if readout else None), answers


def words_of(core: CoreProgram, recording: ByteArray) -> list[int]:
    """Return the words of a recording (rows, channels): events of a row, a tick after each, and the end."""
    heard = recording[: core.heard]
    row, channel = np.nonzero(heard)
    ticked = np.insert(channel, np.searchsorted(row, np.arange(1, len(heard) + 1)), TICK)
    return [*ticked.tolist(), END]


def bench_numbers(path: Path, shape: tuple[int, ...]) -> IntArray:
    """Return the numbers of a file in a shape; ``UNKNOWN`` stands for undefined ones, and -1 for those that lack.

    A core that fails may give more, or fewer.
    """
    found = np.array(path.read_text().translate(_UNDEFINED).split(), dtype=np.int64)
    full = np.full(shape, -1, dtype=np.int64)
    count = min(full.size, found.size)
    full.ravel()[:count] = found[:count]
    return full


def _trace(
    core: CoreProgram,
    phase: str,
    played: PhaseInput,
    windows: dict[Register, Window],
    updates: list[IntArray],
) -> PhaseTrace:
    """Return what an engine does, of the updates (updates, fields) of each of the recordings that are played."""
    numbers = core.numbers[phase]
    by_column = np.zeros((len(updates), played.steps, len(numbers), len(UPDATE)), dtype=np.int64)
    for rows, start, mine in zip(by_column, played.start.tolist(), updates, strict=True):
        here = mine.reshape(-1, len(numbers), len(UPDATE))[:, np.argsort(np.argsort(numbers))]
        here[here[..., 0] != numbers] = -1
        rows[start : start + len(here)] = here
    fields, pieces = (
        dict(zip(UPDATE, np.moveaxis(by_column, -1, 0), strict=True)),
        pieces_of(core.program, phase),
    )
    trace = PhaseTrace.empty(played, len(numbers), len(pieces.group), windows)
    trace.spikes[:] = fields["fired"]
    for piece, (low, high) in enumerate(zip(pieces.first, pieces.stop, strict=True)):
        trace.active[..., piece] = np.count_nonzero(fields["active"][..., low:high] > 0, axis=2)
    trace.events[:] = np.stack([fields[name].sum(axis=1) for name in EVENTS], axis=1)
    for kind, window in windows.items():
        trace.registers[kind][:] = fields[kind][:, window.start : window.stop, window.columns]
    return added_up(core.program, phase, played, trace)
