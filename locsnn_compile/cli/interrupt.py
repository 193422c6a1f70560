"""Ctrl-C ends a command at once, even in a loop of compiled code; so does the end of its processor time."""

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

EXIT_INTERRUPTED, EXIT_LIMIT = 130, 2
GRACE_SECONDS = 1.0
"""How long a command may take to tidy up and exit by itself."""
LAST_GRACE_SECONDS = 0.1
"""The same in its last second of processor time, which ten threads use up within this."""
_SHOW_CURSOR = "\r\x1b[K\x1b[?25h"
"""What to print after a progress bar that was interrupted."""


class Ending(NamedTuple):
    """What a signal that ends a command means: the line, the exit code, and the time to tidy up."""

    line: str
    code: int
    grace_seconds: float


INTERRUPTED = Ending("Interrupted.", EXIT_INTERRUPTED, GRACE_SECONDS)

_USUAL_HANDLERS = (signal.default_int_handler, signal.SIG_DFL)

_endings: dict[int, Ending] = {}
"""By the number of a signal, those that may end the command that runs."""
_received: list[int] = []
"""The signals that came since it began."""


def ending() -> Ending | None:
    """Return what has ended a command since it began; None without."""
    return _endings[_received[0]] if _received else None


def _end(number: int, *told: Any) -> None:
    """Do what Python does on Ctrl-C, and remember why: a library that is being imported may raise an error instead."""
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
    """Let the signals of :data:`_endings` raise KeyboardInterrupt, except where somebody has set another handler."""
    usual = {number: signal.getsignal(number) for number in _endings}
    usual = {number: handler for number, handler in usual.items() if handler in _USUAL_HANDLERS}
    for number in usual:
        signal.signal(number, _end)
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


@contextmanager
def _watched() -> Iterator[None]:
    """Let a thread wait for the signals, which ends the process where the main thread does not."""
    ours, pythons = socket.socketpair()
    pythons.setblocking(False)
    before = signal.set_wakeup_fd(pythons.fileno(), warn_on_full_buffer=False)
    left = threading.Event()
    threading.Thread(target=watch, args=(ours, left), daemon=True).start()
    try:
        yield
    finally:
        left.set()
        signal.set_wakeup_fd(before)
        pythons.close()  # ends the watch, unless a signal came first


def watch(ours: socket.socket, left: threading.Event) -> None:
    """Read the numbers of signals as they come, until Python's end of the pair of sockets is closed."""
    with ours:
        while received := ours.recv(64):
            for number in set(received) & set(_endings):
                _leave(_endings[number], left)


def _leave(ended: Ending, left: threading.Event) -> NoReturn:
    """End the process; the main thread says why where it still can, which ``left`` tells."""
    time.sleep(ended.grace_seconds)
    if left.is_set():
        time.sleep(ended.grace_seconds)  # other threads may still hold the process
    else:
        cleared = _SHOW_CURSOR if sys.stderr.isatty() else ""
        print(f"{cleared}{ended.line}", file=sys.stderr, flush=True)
    os._exit(ended.code)
