"""Compile the loops of the fast engine in other processes, before they are needed.

Numba compiles one function at a time, in seconds each, and keeps the machine code in files. If the code
is not there yet, helper processes compile some loops while this process compiles others or imports its
modules. This module itself imports nothing that takes long.
"""

from hw_model.engine.ahead import compile_ahead, start_ahead_where_nothing_is_compiled

# Each is the name of a module that compiles loops when it runs as a process, and the modules of these
# loops. They are names, so that nothing is imported here.
AHEAD_OF_TILES = (
    "hw_model.engine.ahead_of_tiles",
    ("hw_model.engine.tiles", "hw_model.engine.fast"),
)
"""The loops that play whole recordings."""
AHEAD_OF_SESSIONS = (
    "hw_model.streaming.ahead",
    ("hw_model.streaming.time_phase", "hw_model.streaming.location_phase"),
)
"""The loops that play recordings step by step, for predictions after each step."""


def compile_loops_ahead(*, sessions: bool) -> None:
    """Let other processes compile the loops of a check, as soon as a loop turns out not to be compiled.

    With ``sessions``, also the loops for predictions after each step.
    """
    compile_ahead(*AHEAD_OF_TILES)
    if sessions:
        compile_ahead(*AHEAD_OF_SESSIONS)


def compile_loops_at_once() -> None:
    """Start these processes at once if nothing was ever compiled: they work while this one imports its modules."""
    compile_loops_ahead(sessions=True)
    start_ahead_where_nothing_is_compiled()
