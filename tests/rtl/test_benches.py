"""Faults planted in the SystemVerilog of the core and of what surrounds it: the benches must find each."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from functools import cache
from itertools import zip_longest
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
from tests.support.desk import LAST, PRESS, STOP, Desk, over_a_line, rates, said, transcript
from tests.support.hybrids import graph_in_phase, program_of_graphs
from tests.support.marks import first_quick, sampled

pytestmark = [
    pytest.mark.usefixtures("cores_of_this_run"),
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]
MUTANTS = yaml.safe_load((Path(__file__).parent / "mutants.yaml").read_text())


def one_compartment(axis):
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input(f"{axis}/x", 2 if axis == "time" else 8)
    y = builder.add_compartments(f"{axis}/y", 1, decay_u=1024, decay_v=128, threshold=300)
    builder.connect(x, y, np.full((1, x.size), 100))
    return builder.graph()


def test_the_benches_wrap_and_clip():
    met = sum(
        (hw.simulate(program, spikes, probe=()).counts for program, spikes in benches()),
        hw.Counts(),
    )
    assert min(met.charge_wraps, met.current_wraps, met.voltage_clips) > 10


@pytest.mark.slow
@pytest.mark.parametrize("sizes", first_quick([LATER, SIZES]), ids=["later", "plain"])
def test_the_core_passes_every_bench(sizes):
    assert not differ(sources(), sizes)


def test_hybrids_hear_events_when_they_arrive():
    later = [
        CoreProgram(program, spikes.shape[1], None, LATER).later for program, spikes in benches()
    ]
    assert later.count(True) == 4


@pytest.mark.parametrize(
    ("changed", "shared"),
    [
        (slice(0), [0, 2, 3]),
        (slice(22 + 4, 22 + 8), [0, 2, 2]),
        (slice(22 + 6, 22 + 8), [0, 1, 1]),
        (slice(5, 6), [0, 0, 0]),
    ],
    ids=["none", "half a window", "two rows", "one row"],
)
def test_rows_of_a_window_share_a_source_where_all_weights_are_equal(changed, shared):
    program, spikes = windows(changed)
    core, apart = (CoreProgram(program, spikes.shape[1], None, sizes) for sizes in (LATER, SIZES))
    assert [phase.shared for phase in core.phases] == shared
    assert [phase.shared for phase in apart.phases] == [0, 0, 0]
    lines = sum(3 * (22 - -(-22 >> k)) for k in shared[1:])
    assert apart.needs.axons - core.needs.axons == lines
    assert core.needs.groups == any(shared)


SLICES = (
    ("slices take the lowest bits", "write_data[low+:BITS]", "write_data[0+:BITS]"),
    ("slices show the lowest bits", "read_data[low+:BITS]", "read_data[0+:BITS]"),
    ("the last slice is missing", "low < WIDTH; low", "low + SLICE < WIDTH; low"),
)


def in_slices(old: str = "", new: str = "") -> dict[str, str]:
    """Return the SystemVerilog by file, with memories in slices of a few bits, as large devices have them."""
    return {
        **sources(),
        "memory.sv": "`define MEMORY_BLOCK 256\n" + sources()["memory.sv"].replace(old, new),
    }


@pytest.mark.minutes
@pytest.mark.parametrize("sizes", [SIZES, LATER], ids=["plain", "later"])
def test_slices_of_memories_change_nothing(sizes):
    assert not differ(in_slices(), sizes)


@pytest.mark.parametrize(
    ("old", "new"), first_quick(row[1:] for row in SLICES), ids=[row[0] for row in SLICES]
)
def test_faults_of_slices_are_found(old, new):
    assert sources()["memory.sv"].count(old) == 1
    assert differ(in_slices(old, new))


@pytest.mark.parametrize(("places", "later"), [(1, False), (2, True)])
def test_events_wait_where_a_phase_has_one_place(places, later):
    """The lowest bit of a place chooses a bank, so slots cannot take it."""
    single = [
        graph_in_phase(one_compartment(axis), axis, 8, at)
        for axis, at in (("time", None), ("location", np.arange(2)))
    ]
    program = program_of_graphs(CHIP, Readout(("time/y", "location/y"), (1.0, 1.0)), *single)
    spikes = np.ones((1, 8, 2), dtype=np.uint8)
    sizes = replace(SIZES, compartments=4 * places, slots=8, later=2)
    comparison = compare(program, spikes, sources(), "icarus", sizes=sizes, patience=20000)
    assert CoreProgram(program, 8, None, sizes).later is later
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0)


@pytest.mark.minutes
def test_clocks_that_stop_change_nothing():
    assert not differ({**sources(), "clock_gate.sv": STOPPING_CLOCK_GATE})


desk = cache(Desk)


def axis_streams(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield answers and spikes of recordings with and without faults, however the neighbours wait."""
    beats = desk().beats()
    core = desk().core
    faults = [
        *beats[:9],
        LAST | STOP,
        *beats[:5],
        LAST,
        *beats[:5],
        END,
        LAST | TICK,
        STOP,
        LAST | TICK,
        1 << 20,
        LAST | STOP,
    ]
    last = [
        1 << 18,
        LAST | TICK,
        LAST | 1 << 18 | TICK,
        core.channels,
        LAST | TICK,
        TICK,
        LAST | END,
    ]
    played = [*beats, *faults, *beats, *last, *beats]
    for waits in (0, 2):
        yield desk().play_axis(folder, played, texts, waits)
    yield desk().play_axis(folder, beats, texts, 3, spikes=2)


def line_of_a_board(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield what a board on a line says to a greeting, a broken byte and a reset."""
    with closing(desk().port(texts, bit=8, patience=400)) as port:
        port.write([256 + 97])
        yield said(port)
        port.write([PRESS, 256 + 97])
        yield said(port)


def serial_bytes(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield what a receiver hears at several rates."""
    for bits in ((100, 100), (100, 104), (100, 96), (8, 8), (100, 130)):
        yield rates(folder, texts, *bits)


def session_of_a_board(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield what a board without a line says in a session with every fault."""
    yield from transcript(desk(), texts)


def session_with_spikes(folder: Path, texts: Mapping[str, str]) -> Iterator[object]:
    """Yield that session, and an answer over a line on which its spikes still wait."""
    yield from session_of_a_board(folder, texts)
    yield over_a_line(desk(), texts)


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
"""What tells a fault of the files around the core: something that is heard, and differs."""


_NOTHING = object()


@cache
def heard_without_fault(
    session: Callable[[Path, Mapping[str, str]], Iterator[object]],
) -> list[object]:
    with tempfile.TemporaryDirectory() as folder:
        return list(session(Path(folder), sources()))


def sounds_different(name: str, folder: Path, texts: Mapping[str, str]) -> bool:
    """Whether the session of a file hears a difference, up to the first; nothing to hear is one as well."""
    expected = heard_without_fault(SESSIONS[name])
    try:
        heard = SESSIONS[name](folder, texts)
        return any(one != other for one, other in zip_longest(heard, expected, fillvalue=_NOTHING))
    except (hw.InputError, ValueError, OSError, subprocess.SubprocessError):
        return True


@pytest.mark.parametrize(
    "name", first_quick(["top_uart.sv", "locsnn_axis.sv", "uart_rx.sv", "commands.sv"])
)
def test_a_session_hears_the_same_twice(name, tmp_path):
    assert not sounds_different(
        name, tmp_path, {**sources(), "crc16.sv": sources()["crc16.sv"] + "\n"}
    )


def test_there_are_enough_mutants():
    assert len(MUTANTS) >= 20
    for mutant in MUTANTS:
        assert sources()[mutant["file"]].count(mutant["old"]) == 1, mutant["id"]


@pytest.mark.parametrize("mutant", sampled({mutant["id"]: (mutant,) for mutant in MUTANTS}))
def test_every_mutant_is_found(mutant, tmp_path):
    name = mutant["file"]
    texts = {**sources(), name: sources()[name].replace(mutant["old"], mutant["new"])}
    if name in SESSIONS:
        assert sounds_different(name, tmp_path, texts)
    else:
        assert differ(
            {**texts, "clock_gate.sv": STOPPING_CLOCK_GATE}, LATER if mutant.get("later") else SIZES
        )
