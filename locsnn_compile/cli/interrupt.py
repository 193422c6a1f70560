"""Ctrl-C ends a command at once, even in a loop of compiled code."""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

EXIT_INTERRUPTED = 130
GRACE_SECONDS = 1.0
"""How long a command may take to tidy up and exit by itself."""
_SHOW_CURSOR = "\r\x1b[K\x1b[?25h"
"""What to print after a progress bar that was interrupted."""


_interrupted = threading.Event()


def was_interrupted() -> bool:
    """Tell whether Ctrl-C came since a command began."""
    return _interrupted.is_set()


def _interrupt(*told: Any) -> None:
    """Do what Python does on Ctrl-C, and remember it: a library that is being imported may raise an error instead."""
    _interrupted.set()
    raise KeyboardInterrupt


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """End the process within :data:`GRACE_SECONDS` of a Ctrl-C in this context.

    Python raises KeyboardInterrupt only in the main thread and between its own instructions, and joins all threads
    before it exits, so it would wait for a loop of compiled code in any thread. Here a separate thread waits for the
    signal, and ends the process if it is still running after that time. That leaves no partial file: such loops write
    none, and files have another name until they are complete.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _interrupted.clear()
    usual = signal.getsignal(signal.SIGINT)
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    ours, pythons = socket.socketpair()
    pythons.setblocking(False)
    before = signal.set_wakeup_fd(pythons.fileno(), warn_on_full_buffer=False)
    left = threading.Event()
    threading.Thread(target=_watch, args=(ours, left), daemon=True).start()
    try:
        yield
    finally:
        left.set()
        # A handler that is not Python's own was left alone.
        if usual is signal.default_int_handler:
            signal.signal(signal.SIGINT, usual)
        signal.set_wakeup_fd(before)
        pythons.close()  # ends the watch, unless a signal came first


def _watch(ours: socket.socket, left: threading.Event) -> None:
    with ours:
        while received := ours.recv(64):
            if signal.SIGINT in received:
                time.sleep(GRACE_SECONDS)
                if not left.is_set():
                    print(
                        f"{_SHOW_CURSOR if sys.stderr.isatty() else ''}Interrupted.",
                        file=sys.stderr,
                        flush=True,
                    )
                os._exit(EXIT_INTERRUPTED)
