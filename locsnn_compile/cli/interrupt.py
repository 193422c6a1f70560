"""Ctrl-C at once: also while compiled code runs, whose end Python itself would wait for."""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

EXIT_INTERRUPTED = 130
GRACE_SECONDS = 1.0
"""How long a command may take to leave by itself and tidy up."""
_SHOW_CURSOR = "\r\x1b[K\x1b[?25h"
"""What a progress bar has to be followed by where it is cut off."""


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """See to it that after a Ctrl-C in this context the process ends within :data:`GRACE_SECONDS`.

    Python raises KeyboardInterrupt in the main thread and between its own instructions only, and joins all threads
    before it exits: a loop of compiled code, here or in a thread, would be waited for. So a thread of its own reads of
    the signal, and ends the process if it is still there after that time. Files are not written by such loops, and
    under another name until they are whole.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours, pythons = socket.socketpair()
    pythons.setblocking(False)
    before = signal.set_wakeup_fd(pythons.fileno(), warn_on_full_buffer=False)
    left = threading.Event()
    threading.Thread(target=_watch, args=(ours, left), daemon=True).start()
    try:
        yield
    finally:
        left.set()
        signal.set_wakeup_fd(before)
        pythons.close()  # which ends the watch, unless a signal came before


def _watch(ours: socket.socket, left: threading.Event) -> None:
    with ours:
        while received := ours.recv(64):
            if signal.SIGINT in received:
                time.sleep(GRACE_SECONDS)
                if not left.is_set():
                    print(f"{_SHOW_CURSOR if sys.stderr.isatty() else ''}Interrupted.", file=sys.stderr, flush=True)
                os._exit(EXIT_INTERRUPTED)
