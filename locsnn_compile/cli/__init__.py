"""The commands."""

import sys
from typing import Any

_usual_hook = sys.excepthook


def _interrupted(kind: type[BaseException], *told: Any) -> None:
    """Say in one line that Ctrl-C came before a command began: while its modules are imported."""
    if kind is KeyboardInterrupt:
        print("Interrupted; nothing was written.", file=sys.stderr)
    else:
        _usual_hook(kind, *told)


sys.excepthook = _interrupted
