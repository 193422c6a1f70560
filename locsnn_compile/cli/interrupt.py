"""Ctrl-C ends a command at once, even in a loop of compiled code; so does the end of its processor time.

Python runs signal handlers only in the main thread, between two of its own instructions. A loop that
numba compiled may run for minutes without one. So Python also writes the number of each signal to a
socket (``signal.set_wakeup_fd``), and a thread that waits there ends the process if the main thread
has not done so within a second.

The end of processor time is SIGXCPU, which the system sends to a process at its ``ulimit -t``.
"""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, NoReturn

from hw_model.io.processor_time import last_second_kept, too_little_time

EXIT_INTERRUPTED = 130
"""The usual exit code of a command that SIGINT, signal 2, ended: 128 + 2."""
EXIT_LIMIT = 2
"""The exit code for wrong usage (``EXIT_INPUT`` in ``shell.py``): the limit is too low."""
GRACE_SECONDS = 1.0
"""How long a command may take to tidy up and exit by itself: chosen by hand."""
LAST_GRACE_SECONDS = 0.1
"""The same in the last second of processor time, which ten busy threads use up in 0.1 s."""
_SHOW_CURSOR = "\r\x1b[K\x1b[?25h"
"""Clears the line of a progress bar that was interrupted, and shows the cursor, which the bar hides."""


class Ending(NamedTuple):
    """How a signal ends a command: the line to print, the exit code, and the time to tidy up."""

    line: str
    code: int
    grace_seconds: float


INTERRUPTED = Ending("Interrupted.", EXIT_INTERRUPTED, GRACE_SECONDS)

_DEFAULT_HANDLERS = (signal.default_int_handler, signal.SIG_DFL)
"""What Python installs for SIGINT and for SIGXCPU."""

# Module state, because a signal handler takes no arguments of ours; one command runs at a time.
_endings: dict[int, Ending] = {}
"""The signals that end the running command, by their numbers."""
_received: list[int] = []
"""The numbers of these signals that have come since the command began."""


def ending() -> Ending | None:
    """Return how a signal has ended the running command; None if none has come."""
    return _endings[_received[0]] if _received else None


def _handle_signal(number: int, *frame: Any) -> None:
    """Raise KeyboardInterrupt as Python does on Ctrl-C, and remember the signal.

    It is remembered because a library that is being imported may catch the KeyboardInterrupt and
    raise an error of its own.
    """
    _received.append(number)
    raise KeyboardInterrupt


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """End the process within :data:`GRACE_SECONDS` of a Ctrl-C in this context, or of its last second of time.

    Python raises KeyboardInterrupt only in the main thread and between its own instructions, and joins all threads
    before it exits, so it would wait for a loop of compiled code in any thread. Here a separate thread waits for the
    signal, and ends the process if it is still running after that time. That leaves no partial file: such loops write
    none, and files have another name until they are complete.
    """
    if threading.current_thread() is not threading.main_thread():
        # Only the main thread may set signal handlers; a program that calls a command elsewhere
        # handles Ctrl-C itself.
        yield
        return
    _received.clear()
    _endings.clear()
    with last_second_kept() as seconds:
        _endings[signal.SIGINT] = INTERRUPTED
        if seconds is not None:
            line = str(too_little_time(seconds))
            _endings[signal.SIGXCPU] = Ending(line, EXIT_LIMIT, LAST_GRACE_SECONDS)
        with _handled(), _watched():
            yield


@contextmanager
def _handled() -> Iterator[None]:
    """Let the signals of :data:`_endings` raise KeyboardInterrupt.

    A signal for which the calling program has set a handler of its own keeps that handler.
    """
    replaced_handlers: dict[int, Any] = {}
    for number in _endings:
        handler = signal.getsignal(number)
        if handler in _DEFAULT_HANDLERS:
            replaced_handlers[number] = handler
    for number in replaced_handlers:
        signal.signal(number, _handle_signal)
    try:
        yield
    finally:
        for number, handler in replaced_handlers.items():
            signal.signal(number, handler)


@contextmanager
def _watched() -> Iterator[None]:
    """Run a thread that waits for the signals and ends the process if the main thread does not."""
    reading_end, signal_end = socket.socketpair()
    signal_end.setblocking(False)  # set_wakeup_fd requires it
    previous_fd = signal.set_wakeup_fd(signal_end.fileno(), warn_on_full_buffer=False)
    command_ended = threading.Event()
    # A daemon, so that Python does not wait for it at the end.
    threading.Thread(target=watch, args=(reading_end, command_ended), daemon=True).start()
    try:
        yield
    finally:
        command_ended.set()
        signal.set_wakeup_fd(previous_fd)
        signal_end.close()  # ends the thread, unless a signal came first


def watch(reading_end: socket.socket, command_ended: threading.Event) -> None:
    """Read the numbers of signals as they come, until the other end of the pair of sockets is closed.

    The first signal that ends commands ends the process; ``command_ended`` is set once the main
    thread has left the command.
    """
    with reading_end:
        while received := reading_end.recv(64):  # Python writes one byte per signal, its number
            for number in set(received) & set(_endings):
                _end_process(_endings[number], command_ended)


def _end_process(ending_of_signal: Ending, command_ended: threading.Event) -> NoReturn:
    """Give the main thread time to end the process; then end it, whatever still runs.

    The main thread prints the line if it leaves the command in time; otherwise it is printed here.
    """
    time.sleep(ending_of_signal.grace_seconds)
    if command_ended.is_set():
        # The main thread is on its way out, but Python joins all other threads before it exits.
        time.sleep(ending_of_signal.grace_seconds)
    else:
        cleared = _SHOW_CURSOR if sys.stderr.isatty() else ""
        print(f"{cleared}{ending_of_signal.line}", file=sys.stderr, flush=True)
    os._exit(ending_of_signal.code)  # without joining threads or flushing
