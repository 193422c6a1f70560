"""Ports through which a host talks to a board: a serial device, or a simulated board."""

import subprocess
from collections.abc import Iterable

from hw_model.errors import InputError
from hw_model.io.extras import install_hint
from hw_model.rtl.images import Sizes
from hw_model.rtl.simulators import built, command_of, sources

WAIT = 512
"""Number that makes the simulated line wait for a byte from the board; board_bench.sv lists all
numbers that it takes."""
SECONDS = 2.0
"""How long a board may be silent before it is asked again, on top of the time that its bytes take.
Chosen by hand."""
LONGEST_BITS = 40_000
"""The most bits on the line before an answer: 4,000 bytes, of ten bits with start and stop bit.
Chosen by hand."""


class SimulatedBoard:
    """A simulated board as a port, by ``board_bench.sv``. Its time stands still between calls.

    ``more`` are parameters of the bench, by name.
    """

    def __init__(self, simulator: str, sizes: Sizes, **more: int) -> None:
        binary = built(simulator, sizes, sources(), "board_bench", **more)
        self._process = subprocess.Popen(
            command_of(binary), stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def write(self, data: Iterable[int]) -> None:
        """Send bytes; numbers beyond those of a byte are for the bench."""
        assert self._process.stdin is not None
        self._process.stdin.write("".join(f"{token}\n" for token in data).encode())
        self._process.stdin.flush()

    def read(self) -> bytes:
        """Let simulated time pass until a byte comes, and return the bytes that came."""
        assert self._process.stdout is not None
        self.write([WAIT])
        received = bytearray()
        for line in self._process.stdout:
            if line == b".\n":  # the end of the bytes that came
                break
            received.append(int(line))
        return bytes(received)

    def close(self) -> None:
        """End the simulation."""
        self._process.communicate()


class SerialPort:
    """A serial device as a port, by pyserial."""

    def __init__(self, name: str, baud: int) -> None:
        where = f"port {name!r}"
        try:
            import serial
        except ImportError:
            fix = install_hint("rtl")
            raise InputError(where, "pyserial is not installed", fix=fix) from None
        try:
            self._device = serial.Serial(name, baud, timeout=SECONDS + LONGEST_BITS / baud)
        except (OSError, ValueError) as error:
            fix = "Name a serial device, or sim:verilator."
            raise InputError(where, "cannot be opened", measured=str(error), fix=fix) from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._device.write(data)

    def read(self) -> bytes:
        """Return the bytes that came: all that wait or, if there are none, the next one."""
        return bytes(self._device.read(max(1, self._device.in_waiting)))

    def close(self) -> None:
        """Close the device."""
        self._device.close()


Port = SimulatedBoard | SerialPort
"""A line to a board. ``read`` returns the bytes that came, none after some time without any."""


def open_port(name: str, baud: int, sizes: Sizes) -> Port:
    """Open a serial device, or with the name ``sim:SIMULATOR`` a simulated board of these sizes."""
    kind, _, simulator = name.partition(":")
    return SimulatedBoard(simulator, sizes) if kind == "sim" else SerialPort(name, baud)
