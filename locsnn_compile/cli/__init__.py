"""The command lines: the only package of this project that prints or exits.

Importing it installs a hook for uncaught exceptions. The commands themselves handle Ctrl-C in
``interrupt.py``, but they import numpy and numba first, and Python would answer a Ctrl-C during
these imports with a traceback.
"""

import sys
from typing import Any

_previous_hook = sys.excepthook


def _print_interrupt(kind: type[BaseException], *error_and_traceback: Any) -> None:
    """Print one line for a Ctrl-C; leave any other exception to the previous hook."""
    if kind is KeyboardInterrupt:
        print("Interrupted; nothing was written.", file=sys.stderr)
    else:
        _previous_hook(kind, *error_and_traceback)


sys.excepthook = _print_interrupt
