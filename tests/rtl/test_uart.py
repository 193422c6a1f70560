"""The serial line of a board (uart_rx.sv, uart_tx.sv): bytes pass at rates that differ a little, and not at others.

A board on a line does what it does without one. The SystemVerilog has no warning of Verilator.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

import hw_model as hw
from hw_model.rtl.board import Board
from hw_model.rtl.frames import ERROR, HELLO, WELCOME
from hw_model.rtl.ports import SimulatedBoard
from hw_model.rtl.simulators import sources
from tests.support.desk import (
    LINE_BROKEN,
    PATIENCE,
    Desk,
    exchange,
    received_bytes,
    received_frames,
)
from tests.support.marks import first_quick

RTL = Path(hw.__file__).parent / "rtl"
icarus = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)
verilator = pytest.mark.skipif(
    shutil.which("verilator") is None, reason="Verilator is not installed"
)


@icarus
@pytest.mark.parametrize(
    ("bit", "host_bit"),
    # Clock cycles of a bit, for board and host: at most 4 % apart, and the fewest that a bit may have.
    first_quick([(100, 104), (8, 8), (100, 100), (100, 98), (100, 102), (100, 96), (217, 213)], 2),
)
def test_every_byte_passes_at_a_rate_within_the_tolerance(tmp_path, bit, host_bit):
    assert received_bytes(tmp_path, sources(), bit, host_bit) == [str(byte) for byte in range(256)]


@pytest.mark.slow
@icarus
@pytest.mark.parametrize("host_bit", [80, 125])  # 20 and 25 % off; 4 % are tolerated
def test_a_wrong_rate_breaks_bytes(tmp_path, host_bit):
    assert "broken" in received_bytes(tmp_path, sources(), 100, host_bit)


@pytest.fixture
def desk(cores_of_this_run):
    return Desk()


@pytest.mark.slow
@icarus
def test_a_greeting_over_the_line(desk):
    # 8 clock cycles per bit, the fewest that the receiver allows, so ten bits of a byte take 80 of the cycles of silence.
    port = desk.port(bit=8, patience=200)
    board = Board(port)
    # A missing stop bit is reported at once, and the next frame is understood.
    byte_without_stop_bit = LINE_BROKEN + ord("a")
    port.write([byte_without_stop_bit])
    replies = received_frames(port)
    welcome = exchange(port, HELLO, 3)
    port.close()
    assert board.sizes == desk.sizes
    assert replies == [(ERROR, 1, b"\1")]
    assert [frame[:2] for frame in welcome] == [(WELCOME, 3)]


@verilator
@pytest.mark.minutes
@pytest.mark.parametrize("host_bit", [98, 102])
def test_a_recording_at_a_rate_that_is_two_percent_off(desk, host_bit):
    port = SimulatedBoard("verilator", desk.sizes, bit=100, host_bit=host_bit, patience=PATIENCE)
    board = Board(port)
    board.load(desk.core)
    answer = board.play(desk.core, desk.spikes[0])
    port.close()
    assert (answer.error, answer.winner) == (
        0,
        hw.simulate(desk.program, desk.spikes).prediction[0],
    )


@verilator
@pytest.mark.parametrize("top", ["top_uart", "locsnn_axis"])
def test_the_tops_have_no_warning(top, tmp_path):
    names = [name for name in sources() if not name.endswith("bench.sv")]
    command = ["verilator", "--lint-only", "-Wall", "--top-module", top, *names]
    process = subprocess.run(
        command,
        cwd=RTL,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    assert (process.returncode, process.stderr) == (0, "")
