"""The benches play the core as the simulator does, and they find faults that are planted in the SystemVerilog.

A mutant is a source file with one planted fault (`mutants.yaml`). A fault of the core must give another result than the
simulator's on one of the benches (`tests/support/benches.py`). A fault of the files around the core must change something
that a host receives in a session with it. The sessions use a `Desk` (`tests/support/desk.py`): a program with a
recording, and simulated boards that run it. A beat is one word of an AXI-Stream.

Most tests run with two sizes of the core. `SIZES` are plain. With `LATER`, a second phase hears its events when they
arrive, where the program allows it, and rows of a recording may share a source of spikes.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from functools import cache
from itertools import zip_longest
from math import ceil
from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
from hw_model.mapping.graph import Readout
from hw_model.rtl.comparison import compare
from hw_model.rtl.cosimulation import END, TICK
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.simulators import sources
from tests.support.benches import (
    CHIP,
    LATER,
    SIZES,
    STOPPING_CLOCK_GATE,
    benches,
    differ,
    windows,
)
from tests.support.desk import (
    LAST,
    LINE_BROKEN,
    PRESS,
    STOP,
    Desk,
    over_a_line,
    received_bytes,
    received_frames,
    transcript,
)
from tests.support.hybrids import graph_in_phase, program_of_graphs
from tests.support.marks import first_quick, sampled
from tests.support.planted_faults import Fault

pytestmark = [
    pytest.mark.usefixtures("cores_of_this_run"),
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]
MUTANTS = yaml.safe_load((Path(__file__).parent / "mutants.yaml").read_text())
PATIENCE = 20_000
"""Cycles of silence after which a faulty core is given up; a recording of a bench takes fewer."""


def one_compartment(axis):
    """Return the graph of one compartment that hears two channels or, over channels, eight rows."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input(f"{axis}/x", 2 if axis == "time" else 8)
    # Chosen by hand: a few spikes of these weights reach the threshold.
    y = builder.add_compartments(f"{axis}/y", 1, decay_u=1024, decay_v=128, threshold=300)
    builder.connect(x, y, np.full((1, x.size), 100))
    return builder.graph()


def test_the_benches_wrap_and_clip():
    counts = hw.Counts()
    for program, spikes in benches():
        counts += hw.simulate(program, spikes, probe=()).counts
    assert min(counts.charge_wraps, counts.current_wraps, counts.voltage_clips) > 10


@pytest.mark.slow
@pytest.mark.parametrize("sizes", first_quick([LATER, SIZES]), ids=["later", "plain"])
def test_the_core_passes_every_bench(sizes):
    assert not differ(sources(), sizes)


BENCHES_THAT_HEAR_ON_ARRIVAL = 4
"""`hybrid(22)`, twice (whole and cut short), `long` and `early_rows`: a time phase, then one location phase."""


def test_hybrids_hear_events_when_they_arrive():
    hears_on_arrival = [
        CoreProgram(program, rows=spikes.shape[1], sizes=LATER).later
        for program, spikes in benches()
    ]
    assert hears_on_arrival.count(True) == BENCHES_THAT_HEAR_ON_ARRIVAL


ROWS = 22
"""Rows of the bench `windows`: each of its three channels has as many lines. Its two phases have equal weights within
windows of 4 and of 8 rows."""
CHANNELS = 3
"""Channels of the bench `windows`."""


@pytest.mark.parametrize(
    ("changed", "shared"),
    [
        (slice(0), [0, 2, 3]),
        (slice(ROWS + 4, ROWS + 8), [0, 2, 2]),
        (slice(ROWS + 6, ROWS + 8), [0, 1, 1]),
        (slice(5, 6), [0, 0, 0]),
    ],
    ids=["none", "half a window", "two rows", "one row"],
)
def test_rows_of_a_window_share_a_source_where_all_weights_are_equal(changed, shared):
    """If lines `changed` of the input have other weights, 2^shared[i] rows have one source in phase i of the core.

    Phase 0 only takes the arriving recording, and has no sources of its own.
    """
    program, spikes = windows(changed)
    core = CoreProgram(program, rows=spikes.shape[1], sizes=LATER)
    core_without_sharing = CoreProgram(program, rows=spikes.shape[1], sizes=SIZES)
    assert [phase.shared for phase in core.phases] == shared
    assert [phase.shared for phase in core_without_sharing.phases] == [0, 0, 0]
    # The last group of rows may be cut short, so divisions are rounded up. `axons` is the number of sources.
    sources_per_channel = [ceil(ROWS / 2**k) for k in shared[1:]]
    sources_saved = sum(CHANNELS * (ROWS - sources) for sources in sources_per_channel)
    assert core_without_sharing.needs.axons - core.needs.axons == sources_saved
    # 1 if the program needs a core in which rows can share a source.
    assert core.needs.groups == any(shared)


FAULTS_OF_SLICES = (
    Fault("slices take the lowest bits", "memory.sv", "write_data[low+:BITS]", "write_data[0+:BITS]"),
    Fault("slices show the lowest bits", "memory.sv", "read_data[low+:BITS]", "read_data[0+:BITS]"),
    Fault("the last slice is missing", "memory.sv", "low < WIDTH; low", "low + SLICE < WIDTH; low"),
)  # fmt: skip


def in_slices(texts: Mapping[str, str]) -> dict[str, str]:
    """Return the SystemVerilog by file, with memories in slices of a few bits, as large devices have them.

    Blocks of 256 bits are so small that the memories of these cores are cut.
    """
    return {**texts, "memory.sv": "`define MEMORY_BLOCK 256\n" + texts["memory.sv"]}


@pytest.mark.minutes
@pytest.mark.parametrize("sizes", [SIZES, LATER], ids=["plain", "later"])
def test_slices_of_memories_change_nothing(sizes):
    assert not differ(in_slices(sources()), sizes)


@pytest.mark.parametrize(
    "fault",
    first_quick(FAULTS_OF_SLICES),
    ids=[fault.name for fault in FAULTS_OF_SLICES],
)
def test_faults_of_slices_are_found(fault):
    assert differ(in_slices(fault.planted_in(sources())))


@pytest.mark.parametrize(("places", "later"), [(1, False), (2, True)])
def test_events_wait_where_a_phase_has_one_place(places, later):
    """A second phase hears events when they arrive only if the memory of charges has two places per slot or more.

    With `later=2`, two bits that number compartments number slots instead: there are four times the slots, each with a
    place for a quarter of the compartments. The last bit of a place cannot be taken, as it chooses the bank.
    """
    rows = 8
    channels = 2
    time = graph_in_phase(one_compartment("time"), "time", rows, positions=None)
    location = graph_in_phase(one_compartment("location"), "location", rows, np.arange(channels))
    readout = Readout(("time/y", "location/y"), (1.0, 1.0))
    program = program_of_graphs(CHIP, readout, time, location)
    spikes = np.ones((1, rows, channels), dtype=np.uint8)
    # 32 slots of `places` charges.
    sizes = replace(SIZES, compartments=4 * places, slots=8, later=2)
    comparison = compare(program, spikes, sources(), "icarus", sizes=sizes, patience=PATIENCE)
    assert CoreProgram(program, rows=rows, sizes=sizes).later is later
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0)


@pytest.mark.minutes
def test_clocks_that_stop_change_nothing():
    assert not differ({**sources(), "clock_gate.sv": STOPPING_CLOCK_GATE})


shared_desk = cache(Desk)


def axis_streams(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield answers and spikes of recordings with and without faults, with neighbours that stall seldom and often."""
    desk = shared_desk()
    beats = desk.beats()
    # How many beats come before a fault is arbitrary.
    # A recording that a stop ends, and one whose last beat is an event of channel 0, so its step has no tick.
    cut_off = [*beats[:9], LAST | STOP, *beats[:5], LAST]
    # An end and a stop are valid only as the last beat of a recording.
    wrong_kinds = [*beats[:5], END, LAST | TICK, STOP, LAST | TICK]
    # The kind of a word is in bits 16 and 17; all bits above must be 0.
    bit_above_kind = 1 << 18
    higher_bit = 1 << 20
    # A stop drops a recording without an answer, also one with a fault.
    dropped_with_fault = [higher_bit, LAST | STOP]
    wrong_bits = [bit_above_kind, LAST | TICK, LAST | bit_above_kind | TICK]
    wrong_channel = [desk.core.channels, LAST | TICK]
    end_of_its_own = [TICK, LAST | END]
    # Recordings without faults in between, which must not be disturbed.
    played = [
        *beats,
        *cut_off,
        *wrong_kinds,
        *dropped_with_fault,
        *beats,
        *wrong_bits,
        *wrong_channel,
        *end_of_its_own,
        *beats,
    ]
    # In `waits` of four cycles each neighbour stalls, on average.
    for waits in (0, 2):
        yield desk.play_axis(folder, played, texts, waits=waits)
    # Room for two spikes only, and a neighbour that takes them slowly: one is lost.
    yield desk.play_axis(folder, beats, texts, waits=3, spikes=2)


def line_of_a_board(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield the frames that a board on a line sends after a broken byte, before and after a reset."""
    broken_byte = LINE_BROKEN + ord("a")  # sent without its stop bit
    # 8 clock cycles per bit, the fewest that the receiver allows; 400 cycles of silence are five bytes of ten bits.
    with closing(shared_desk().port(texts, bit=8, patience=400)) as port:
        port.write([broken_byte])
        yield received_frames(port)
        port.write([PRESS, broken_byte])
        yield received_frames(port)


def serial_bytes(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield the bytes that a receiver hears at several rates: equal, 4 % apart, as fast as can be, and much too slow.

    The rates are clock cycles per bit, of the receiver and of the sender.
    """
    for bit, host_bit in ((100, 100), (100, 104), (100, 96), (8, 8), (100, 130)):
        yield received_bytes(folder, texts, bit, host_bit)


def session_of_a_board(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield the bytes that a board without a line sends in a session with every fault."""
    yield from transcript(shared_desk(), texts)


def session_with_spikes(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield the bytes of `session_of_a_board`, and an answer over a line so slow that spikes still wait for it."""
    yield from session_of_a_board(folder, texts)
    yield over_a_line(shared_desk(), texts)


SESSIONS = {
    "locsnn_axis.sv": axis_streams,
    "uart_rx.sv": serial_bytes,
    "uart_tx.sv": serial_bytes,
    "reset_sync.sv": line_of_a_board,
    "top_uart.sv": line_of_a_board,
    "locsnn_bytes.sv": session_of_a_board,
    "frame_receiver.sv": session_of_a_board,
    "frame_sender.sv": session_of_a_board,
    "crc16.sv": session_of_a_board,
    "held_queue.sv": session_of_a_board,
    "commands.sv": session_of_a_board,
    "spike_report.sv": session_of_a_board,
    "replies.sv": session_with_spikes,
}
"""The session that reveals the faults of each file around the core; a session yields what a host receives."""


_NOTHING = object()


@cache
def received_without_fault(
    session: Callable[[Path, Mapping[str, str]], Iterator[object]],
) -> list[object]:
    with tempfile.TemporaryDirectory() as folder:
        return list(session(Path(folder), sources()))


def session_differs(name: str, folder: Path, texts: Mapping[str, str]) -> bool:
    """Return whether the session of a file receives anything else with these sources, up to the first difference.

    A session that breaks, or receives less or more, differs as well.
    """
    expected = received_without_fault(SESSIONS[name])
    try:
        received = SESSIONS[name](folder, texts)
        pairs = zip_longest(received, expected, fillvalue=_NOTHING)
        return any(item != expected_item for item, expected_item in pairs)
    except (hw.InputError, ValueError, OSError, subprocess.SubprocessError):
        return True


@pytest.mark.parametrize(
    "name", first_quick(["top_uart.sv", "locsnn_axis.sv", "uart_rx.sv", "commands.sv"])
)
def test_a_session_receives_the_same_twice(name, tmp_path):
    # Another text, which is built anew, of the same logic.
    texts = {**sources(), "crc16.sv": sources()["crc16.sv"] + "\n"}
    assert not session_differs(name, tmp_path, texts)


def test_every_mutant_fits_its_file():
    assert len(MUTANTS) >= 20
    for mutant in MUTANTS:
        assert Fault.of_row(mutant).fits(sources()), mutant["id"]


@pytest.mark.parametrize("mutant", sampled({mutant["id"]: (mutant,) for mutant in MUTANTS}))
def test_every_mutant_is_found(mutant, tmp_path):
    fault = Fault.of_row(mutant)
    texts = fault.planted_in(sources())
    if fault.file in SESSIONS:
        assert session_differs(fault.file, tmp_path, texts)
    else:
        # With clocks that stop, faults in when a clock runs are found as well.
        texts = {**texts, "clock_gate.sv": STOPPING_CLOCK_GATE}
        sizes = LATER if mutant.get("later") else SIZES
        assert differ(texts, sizes)
